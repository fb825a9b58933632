"""Beamrider: unit cell → pressure table → stability → flight → figures. `make results` runs all of it."""

from snakemake.utils import min_version

min_version("9.20")


report: "workflow/report/workflow.rst"


include: "workflow/rules/common.smk"
include: "workflow/rules/optics.smk"
include: "workflow/rules/stability.smk"
include: "workflow/rules/flight.smk"
include: "workflow/rules/figures.smk"


rule all:
    default_target: True
    input:
        [plan.table(design, "modal") for design in plan.cells],
        [plan.table(design, "fdtd") for design in plan.fdtd_designs],
        [f"results/scenes/{scene}/plan.json" for scene in plan.scenes],
        [f"results/scenes/{scene}/floquet.json" for scene in plan.config.floquet],
        [f"results/scenes/{scene}/floquet_fdtd.json" for scene in plan.fdtd_scenes],
        [f"results/scenes/{scene}/rigid.h5" for scene in plan.config.rigid],
        [f"results/scenes/{scene}/flight.vtkhdf" for scene in plan.config.flight],
        figures(),
        "results/summary.csv",
