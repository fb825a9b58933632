"""Beamrider: unit cell → pressure table → stability → flight → figures. `make results` runs all of it."""

from snakemake.utils import min_version

min_version("9.20")


report: "workflow/report/workflow.rst"


include: "workflow/rules/common.smk"
include: "workflow/rules/optics.smk"
include: "workflow/rules/stability.smk"
include: "workflow/rules/flight.smk"
include: "workflow/rules/figures.smk"
include: "workflow/rules/accuracy.smk"
include: "workflow/rules/basins.smk"
include: "workflow/rules/way.smk"
include: "workflow/rules/screening.smk"
include: "workflow/rules/polarisation.smk"
include: "workflow/rules/rounded.smk"
include: "workflow/rules/accuracy_rigid.smk"
include: "workflow/rules/accuracy_flight.smk"
include: "workflow/rules/published.smk"


rule all:
    default_target: True
    input:
        plan.all_tables,
        [f"results/scenes/{scene}/plan.json" for scene in plan.scenes],
        plan.all_floquet,
        plan.all_flights,
        plan.checks,
        plan.all_families,
        [f"results/figures/{name}.{kind}" for name in plan.figures for kind in ("png", "svg")],
        "results/summary.csv",
        "results/contents.sha256",


attach(workflow.rules, ancient(MACHINE_CODE) if os.environ.get("BEAMRIDER_COMPILE_FIRST") else None, plan.files)
keys.attach()  # to all rules above, with the inputs that they have by now


onsuccess:
    keys.learn()


onerror:
    keys.learn()
    keys.examine()
