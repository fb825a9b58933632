#!/usr/bin/env bash
# Numba 0.68.1, llvmlite 0.50.0, NumPy 1.26.4 or 2.x.
# One would guess: what guvectorize(cache=True) keeps is whole in itself, as what njit(cache=True) keeps is, so that two
# processes may compile at once and whichever writes last wins.
# Seen: it keeps two pairs of files, NAME and guf-NAME. The wrapper in guf-NAME calls the kernel in NAME by a symbol that
# holds a number of the compiling process: how many functions that had compiled before. Two processes that have compiled
# different things before give the same file names and other symbols, and nothing in index or key tells them apart: a
# folder that both wrote into may hold the wrapper of one and the kernel of the other, and then processes that load them
# crash (seen in a test suite on two processes; not repeated here, where each has a folder of its own).
# njit alone, over arrays made flat, has no such pair. Exit code 1 if any of this changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numba==0.68.1 llvmlite==0.50.0
cat > "$folder/made.py" <<'PYTHON'
import sys
import numba

@numba.njit
def other(x):
    return x + 1

for value in (1, 2.0, 1j)[: int(sys.argv[1])]:
    other(value)

@numba.guvectorize(["void(f8[:], f8[:])"], "(n)->()", nopython=True, cache=True)
def total(x, out):
    out[0] = x.sum()

print(total([1.0, 2.0]))
PYTHON
for before in 0 3; do
    NUMBA_CACHE_DIR="$folder/$before" "$folder/venv/bin/python" "$folder/made.py" $before > /dev/null
done
cat > "$folder/look.py" <<'PYTHON'
import re, sys
from pathlib import Path

def symbols(folder, start):
    (path,) = (p for p in Path(folder).rglob("*.nbc") if p.name.startswith(start))
    return path.name, set(re.findall(rb"_ZN8__main__5totalB\d?v(\d+)B", path.read_bytes()))

found = {before: (symbols(f"{sys.argv[1]}/{before}", "guf-"), symbols(f"{sys.argv[1]}/{before}", "made.total"))
         for before in ("0", "3")}
(guf_a, kernel_a), (guf_b, kernel_b) = found["0"], found["3"]
print("wrapper names its own kernel:", bool(guf_a[1] & kernel_a[1]) and bool(guf_b[1] & kernel_b[1]))
print("names of files are the same:", (guf_a[0], kernel_a[0]) == (guf_b[0], kernel_b[0]))
print("wrapper of one names a symbol of the other's kernel:", bool(guf_a[1] & kernel_b[1]))
PYTHON
seen=$("$folder/venv/bin/python" "$folder/look.py" "$folder")
echo "$seen"
[ "$seen" = "wrapper names its own kernel: True
names of files are the same: True
wrapper of one names a symbol of the other's kernel: False" ]
