#!/usr/bin/env bash
# h5py 3.16.0 (HDF5 2.0.0), h5netcdf 1.8.1, pyarrow 21.0.0.
# One would guess: bytes that follow the end of a data file (a signature, a checksum) are either refused or left alone.
# Seen: HDF5 reads over them, as do readers of netCDF-4 on top of it; but opening such a file for writing and closing it
# again cuts them off, though nothing was written. Parquet, which is found from its end, refuses them: what is to be added
# goes between the data and the footer, and reads as before.
# Exit code 1 if any of this changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet h5py==3.16.0 h5netcdf==1.8.1 pyarrow==21.0.0
cat > "$folder/try.py" <<'PYTHON'
import os
import struct
import h5netcdf
import h5py
import pyarrow as pa
import pyarrow.parquet as pq

MORE = b"#" * 80


def add(path):
    with open(path, "ab") as stream:
        stream.write(MORE)
    return os.path.getsize(path)


with h5netcdf.File("a.h5", "w") as file:
    file.dimensions = {"x": 2}
    file.create_variable("x", ("x",), float)[:] = [1.0, 2.0]
bare = os.path.getsize("a.h5")
print("bytes more:", add("a.h5") - bare)
with h5py.File("a.h5", "r") as file:
    print("h5py reads", file["x"][:].tolist())
with h5netcdf.File("a.h5", "r") as file:
    print("h5netcdf reads", file["x"][:].tolist())
with h5py.File("a.h5", "r+"):
    pass
print("bytes more after r+ without a change:", os.path.getsize("a.h5") - bare)
pq.write_table(pa.table({"x": [1.0]}), "b.parquet")
with open("b.parquet", "rb") as stream:
    whole = stream.read()
footer = struct.unpack("<I", whole[-8:-4])[0] + 8
with open("c.parquet", "wb") as stream:
    stream.write(whole[:-footer] + MORE + whole[-footer:])
print("before the footer:", pq.read_table("c.parquet")["x"].to_pylist())
add("b.parquet")
try:
    pq.read_table("b.parquet")
except pa.ArrowInvalid:
    print("after the footer: refused")
PYTHON
seen=$(cd "$folder" && venv/bin/python try.py)
echo "$seen"
[ "$seen" = "bytes more: 80
h5py reads [1.0, 2.0]
h5netcdf reads [1.0, 2.0]
bytes more after r+ without a change: 0
before the footer: [1.0]
after the footer: refused" ]
