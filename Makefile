# make results: everything, from a bare Debian 12 to figures and report in results/.   make test: the tests.
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := results
.PHONY: results test test-slow setup

CORES ?= $(shell env -u OMP_NUM_THREADS nproc)
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/ready
SNAKEMAKE := $(BIN)/snakemake --workflow-profile workflow/profiles/default --cores $(CORES)
REPORT := results/report.html
# Small matrices are slower on several threads, and far slower where these have to wait for a core.
ONE_THREAD := env OPENBLAS_NUM_THREADS=1

# Debian's own Python: its Meep is built for no other. Settings meant for other Pythons must not leak into the venv.
PYTHON := /usr/bin/python3
unexport PYTHONPATH PYTHONHOME PIP_USER PIP_TARGET PIP_PREFIX PIP_ROOT PIP_REQUIREMENT PIP_CONSTRAINT PIP_NO_DEPS
unexport PIP_DRY_RUN PIP_IGNORE_INSTALLED PIP_NO_BINARY PIP_ONLY_BINARY PIP_PYTHON PIP_PRE

SUDO := $(shell [ "$$(id -u)" = 0 ] || command -v sudo)
APT := $(SUDO) env DEBIAN_FRONTEND=noninteractive apt-get -y -q -o Acquire::Retries=3 -o DPkg::Lock::Timeout=120

results: setup
	$(SNAKEMAKE)
	@if [ ! -e $(REPORT) ] || [ -n "$$(find results workflow/report -type f -newer $(REPORT) -print -quit)" ]; then \
		$(SNAKEMAKE) --quiet --report results/.new.html && mv results/.new.html $(REPORT); fi
	@echo "Figures and numbers: results/   Report: $(REPORT)"

test: setup
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/mypy workflow/*.py workflow/figures/*.py
	$(BIN)/lint-imports
	$(ONE_THREAD) $(BIN)/python -m pytest -m "not slow"

# Checks of minutes each: whole flights against the published ones, FDTD at full resolution.
test-slow: setup
	$(ONE_THREAD) $(BIN)/python -m pytest -m slow

setup: $(READY)

# The environment is made again when the files that define it change.
$(READY): pyproject.toml constraints.txt
	@if ! $(PYTHON) -c 'import ensurepip; from meep import Simulation' 2>/dev/null; then \
		echo "Installing python3-venv and python3-meep from Debian (Meep solves Maxwell's equations for the FDTD stage)"; \
		{ $(APT) update || true; for package in python3-venv python3-meep; do \
			$(APT) install --no-install-recommends $$package || $(APT) install --no-install-recommends $$package || true; \
		done; } >&2; fi
	@$(PYTHON) -c 'import ensurepip' || { echo "Python with venv is needed: apt-get install python3-venv" >&2; exit 1; }
	@$(PYTHON) -c 'from meep import Simulation' 2>/dev/null >&2 || \
		echo "Meep could not be installed (apt-get install python3-meep): all but the FDTD stage works." >&2
	@[ "$$(readlink -f $(BIN)/python)" = "$$(readlink -f $(PYTHON))" ] || rm -rf $(VENV)
	$(PYTHON) -m venv --system-site-packages $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --retries 5 -e '.[dev]' -c constraints.txt
	@touch $@
