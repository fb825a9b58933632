#!/usr/bin/env bash
# Numba 0.68.1, llvmlite 0.50.0, NumPy 1.26.4 or 2.x.
# One would guess: a function decorated with plain njit has Numba's default options, error_model="python" among them, so
# that 1/0 raises ZeroDivisionError whoever calls it; options of a caller are the caller's.
# Seen: options that a function doesn't give itself (error_model, fastmath, _nrt, debug, …) are those of the function for
# which it is compiled, the first that calls it, as one is compiled while the other is (`inherit_if_not_set` in
# numba.core.options and cpu). It is compiled once for its types: a later call from Python, or from another function,
# gets that code, and cache=True keeps it for all later processes. Which function is called first then decides whether
# the same two functions raise or return infinity, in this process and, by the cache, in the next.
# To be safe: each function gives all options that matter. Exit code 1 if any of this changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numba==0.68.1 llvmlite==0.50.0
cat > "$folder/made.py" <<'PYTHON'
import sys
import numba

@numba.njit(cache=True)
def share(a, b):
    return a / b

@numba.njit(cache=True, error_model="numpy")
def caller(a, b):
    return share(a, b)

def tried(function):
    try:
        return function(1.0, 0.0)
    except ZeroDivisionError:
        return "ZeroDivisionError"

print(*[f"{name} {tried(globals()[name])}" for name in sys.argv[1:]], sep=", ")
PYTHON
run() {
    NUMBA_CACHE_DIR="$folder/$1" "$folder/venv/bin/python" "$folder/made.py" "${@:2}"
}
seen=$(run one share caller; run two caller share; echo "next process:"; run one share caller; run two share caller)
"$folder/venv/bin/python" -c 'import numba; print("Numba", numba.__version__)'
echo "$seen"
[ "$seen" = "share ZeroDivisionError, caller ZeroDivisionError
caller inf, share inf
next process:
share ZeroDivisionError, caller ZeroDivisionError
share inf, caller inf" ]
