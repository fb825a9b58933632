#!/usr/bin/env bash
# h5py 3.16.0 (HDF5 2.0.0), Linux on x86_64 or aarch64.
# One would guess: locking="best-effort", h5py's default too, opens a file where the file system has no locks.
# Seen: it does where flock says ENOSYS (38), but not where it says ENOLCK (37), as network file systems without a lock
# service do. Reading then needs locking=False, or HDF5_USE_FILE_LOCKING=FALSE in the environment.
# The kernel is made to give either answer by a seccomp filter on flock. Exit code 1 if any of this changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet h5py==3.16.0
cat > "$folder/read.py" <<'PYTHON'
import ctypes, platform, struct, sys
import h5py

path, number = sys.argv[1], int(sys.argv[2])
locking = {"default": None, "best-effort": "best-effort", "off": False}[sys.argv[3]]
with h5py.File(path, "w") as file:
    file["x"] = 1.0
flock = {"x86_64": 73, "aarch64": 32}[platform.machine()]
code = [(0x20, 0, 0, 0), (0x15, 0, 1, flock), (6, 0, 0, 0x50000 | number), (6, 0, 0, 0x7FFF0000)]
lines = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *line) for line in code))
program = ctypes.create_string_buffer(struct.pack("HL", len(code), ctypes.addressof(lines)))
prctl = ctypes.CDLL(None).prctl
assert prctl(38, 1, 0, 0, 0) == 0 and prctl(22, 2, program, 0, 0) == 0
try:
    with h5py.File(path, "r", locking=locking) as file:
        print(number, sys.argv[3], "read", file["x"][()])
except OSError as error:
    print(number, sys.argv[3], "refused", error.errno)
PYTHON
seen=$(for number in 37 38; do for locking in default best-effort off; do
    env -u HDF5_USE_FILE_LOCKING "$folder/venv/bin/python" "$folder/read.py" "$folder/file.h5" $number $locking
done; done)
echo "$seen"
[ "$seen" = "37 default refused 37
37 best-effort refused 37
37 off read 1.0
38 default read 1.0
38 best-effort read 1.0
38 off read 1.0" ]
