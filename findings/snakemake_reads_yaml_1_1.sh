#!/usr/bin/env bash
# Snakemake 9.27.1 (PyYAML 6.0.3).
# One would guess: numbers in a `configfile:` are those of YAML 1.2, as in JSON, and those of --config are typed alike.
# Seen: 1e-3 is text, 0600 is 384, 1:30 is 90 and `no` is False; of --config, a plain 1e-3 is a number, but one within a
# mapping is text, as are true and 5 there. Exit code 1 if any of this changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet snakemake==9.27.1 pyyaml==6.0.3
printf 'a: [1e-3, 0600, 1:30, no]\n' > "$folder/config.yaml"
cat > "$folder/Snakefile" <<'SNAKEFILE'
configfile: "config.yaml"
print("seen", config["a"], repr(config["bb"]), config["cc"])
rule all:
SNAKEFILE
seen=$(cd "$folder" && venv/bin/snakemake --quiet --cores 1 --config bb=1e-3 'cc={x: 1e-3, y: true, z: 5}' 2>/dev/null | grep '^seen' | head -n 1)
echo "$seen"
[ "$seen" = "seen ['1e-3', 384, 90, False] 0.001 {'x': '1e-3', 'y': 'true', 'z': '5'}" ]
