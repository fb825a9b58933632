# make results: everything, from a bare Debian 12 or 13 to figures and report in results/.   make test: the tests.
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := results
.PHONY: results test test-slow test-slurm coverage setup

CORES ?= $(shell env -u OMP_NUM_THREADS nproc)
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/ready
SNAKEMAKE := $(BIN)/snakemake --cores $(CORES)
REPORT := results/report.html
# Small matrices are slower on several threads, and far slower where these have to wait for a core.
ONE_THREAD := env OPENBLAS_NUM_THREADS=1

# Debian's own Python: its Meep is built for no other, and is all that the environment sees of Debian's packages. Settings meant for other Pythons must not leak into the venv.
PYTHON := /usr/bin/python3
MEEP := /usr/lib/python3/dist-packages/meep
unexport PYTHONPATH PYTHONHOME PIP_USER PIP_TARGET PIP_PREFIX PIP_ROOT PIP_REQUIREMENT PIP_CONSTRAINT PIP_NO_DEPS
unexport PIP_DRY_RUN PIP_IGNORE_INSTALLED PIP_NO_BINARY PIP_ONLY_BINARY PIP_PYTHON PIP_PRE

AS_ROOT := $(shell [ "$$(id -u)" = 0 ] && echo env || command -v sudo)
APT := $(AS_ROOT) env DEBIAN_FRONTEND=noninteractive apt-get -y -q -o Acquire::Retries=3 -o DPkg::Lock::Timeout=120

# An environment of another folder, or for another Python, is not ready.
PLACE := echo "$(CURDIR) $$(basename "$$(readlink -f $(PYTHON))")"
$(shell [ "$$(cat $(READY) 2>/dev/null)" = "$$($(PLACE))" ] || rm -f $(READY))

# Snakemake keeps a cache below the home folder: without one that can be written, here.
ifndef XDG_CACHE_HOME
ifneq ($(shell [ -w ~ ] && echo yes),yes)
export XDG_CACHE_HOME := $(CURDIR)/.cache
endif
endif

# A Snakemake that was killed leaves its locks, which are taken off where none lives that could hold them.
results: setup
	@$(BIN)/python -m workflow.unlock $(SNAKEMAKE) --unlock
	$(SNAKEMAKE)
	@if [ ! -e $(REPORT) ] || [ -n "$$(find results workflow/report -type f -newer $(REPORT) -print -quit)" ]; then \
		$(SNAKEMAKE) --quiet --report results/.new.html && mv results/.new.html $(REPORT); fi
	@echo "Figures and numbers: results/   Report: $(REPORT)"

test: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check --quiet .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/snakefmt --check --compact-diff Snakefile workflow/rules
	$(BIN)/codespell $$(git ls-files)
	$(ONE_THREAD) $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder -m "not slow"

# Which lines of Python the tests run. Kernels that Numba compiles are not seen by it, and don't count.
coverage: setup
	$(ONE_THREAD) $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder -m "not slow" --cov --cov-report=term

# Checks of minutes each: whole flights against the published ones, FDTD at full resolution.
test-slow: setup
	$(ONE_THREAD) $(BIN)/python -m pytest -m "slow and not slurm"

# The workflow on a Slurm cluster of this one machine, with accounting and without. As root: it installs Slurm from Debian.
test-slurm: setup
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev,slurm]' -c constraints.txt
	$(ONE_THREAD) $(BIN)/python -m pytest -m slurm

setup: $(READY)

# The environment is made again when the files that define it change.
$(READY): pyproject.toml constraints.txt
	@if $(PYTHON) -c 'import ensurepip' 2>/dev/null && [ -e $(MEEP) ]; then :; elif [ -z "$(AS_ROOT)" ]; then \
		echo "Neither root nor sudo: Debian's packages python3-venv and python3-meep are not installed." >&2; \
	else \
		echo "Installing python3-venv and python3-meep from Debian (Meep solves Maxwell's equations for the FDTD stage)"; \
		{ $(APT) update || true; for package in python3-venv python3-meep; do \
			$(APT) install --no-install-recommends $$package || $(APT) install --no-install-recommends $$package || true; \
		done; } >&2; fi
	@$(PYTHON) -c 'import ensurepip, sys; sys.version_info >= (3, 11) or exit(1)' 2>/dev/null || { \
		echo "error: $(PYTHON): must be Python 3.11 or later with venv; on Debian 12 or 13, as root:" \
			"apt-get install python3-venv" >&2; exit 1; }
	@[ -e $@ ] || rm -rf $(VENV)
	$(PYTHON) -m venv $(VENV)
	@ln -sfn $(MEEP) $$($(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/meep
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --retries 5 --use-pep517 \
		-e '.[dev]' -c constraints.txt || { \
		echo "error: pip could not install the packages, see above; it needs PyPI, or a mirror named in its own" \
			"settings. Then: make setup" >&2; exit 1; }
# Tried in the environment, as its import needs packages from there.
	@if [ ! -e $(MEEP) ]; then echo "Meep is not installed: FDTD is left out, all the rest works." \
			"To add it, now or later, as root: apt-get install python3-meep" >&2; \
	elif said=$$($(BIN)/python -c 'from meep import Simulation, __version__' 2>&1 >/dev/null); then \
		echo "Meep works: FDTD is run too."; \
	else echo "Meep is installed but cannot be imported ($${said##*$$'\n'}):" \
		"set fdtd: false in workflow/config.yaml, and all the rest works." >&2; fi
	@$(PLACE) > $@
