#!/usr/bin/env bash
# Snakemake's executor plugin for Slurm 2.6.1 (read alike: 2.7.1, 2.8.0); seen with Slurm 22.05.8 and slurmdbd.
# One would guess: a job that scancel ends is noticed, and tried again or reported.
# Seen: where the plugin asks sacct, it waits for ever. sacct says by whom, "CANCELLED by 0"; the plugin looks that whole
# text up among its states of failure, where "CANCELLED" stands, and takes the job for one that runs. squeue says
# "CANCELLED". Hence workflow/profiles/slurm asks squeue, if ended jobs are remembered for long enough (MinJobAge).
# Exit code 1 if any of this changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet snakemake==9.27.1 snakemake-executor-plugin-slurm==2.6.1
seen=$("$folder/venv/bin/python" - <<'END'
import asyncio
import inspect
import logging

import snakemake_executor_plugin_slurm as plugin
from snakemake_executor_plugin_slurm.job_status_query import query_job_status

answer, _ = asyncio.run(query_job_status("printf '6|CANCELLED by 0\n'", logging.getLogger()))
lines = [line.strip() for line in inspect.getsource(plugin.Executor.check_active_jobs).splitlines()]
print("seen", answer, *(line for line in lines if '"CANCELLED' in line or "in fail_stati" in line))
END
)
echo "$seen"
[ "$seen" = "seen {'6': 'CANCELLED by 0'} \"CANCELLED\", elif status in fail_stati:" ]
