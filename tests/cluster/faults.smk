"""Small jobs that go wrong, asked for as the workflow's own are (`workflow.demands`). Each writes down that it ran."""

import sys

sys.path.insert(0, config["project"])
from workflow.demands import attach


wildcard_constraints:
    name="[a-z]+",


rule quick:
    output:
        "out/{name}.txt",
    resources:
        mem_mb=600,
        runtime=2,
    shell:
        "echo $$ >> runs_{wildcards.name}; sleep 8; echo done > {output}"


rule memory_taken:
    output:
        "out/memory_taken.txt",
    resources:
        mem_mb=600,
        runtime=2,
    shell:
        "echo $$ >> runs_memory_taken; {sys.executable} -c 'import time; a = bytearray(700_000_000); time.sleep(12)';"
        " echo done > {output}"


rule time_taken:
    output:
        "out/time_taken.txt",
    resources:
        mem_mb=600,
        runtime=1,
    shell:
        "echo $$ >> runs_time_taken; sleep 75; echo done > {output}"


attach(workflow.rules, [], {})
