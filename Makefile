# strandcast: `make demo` and `make test` do all their own set-up; `make help` lists the rest.
SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
CORES ?= 2

.PHONY: help
help:  ## what can be made
	@echo "strandcast: make <target>"
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12 | sed 's/^/  /'

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(not ((3, 11) <= sys.version_info < (3, 14)))' || \
	  { echo "strandcast needs Python 3.11, 3.12 or 3.13; $(PYTHON) is $$($(PYTHON) --version). Try: make PYTHON=python3.12 ..."; exit 3; }
	@echo "set-up: virtual environment in $(VENV)"
	@$(PYTHON) -m venv $(VENV)

# Source packages are built with the pinned setuptools, never with one fetched on the side.
$(VENV)/build.stamp: requirements/build.lock | $(BIN)/python
	@$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes --only-binary :all: -r $<
	@touch $@

$(VENV)/runtime.stamp: requirements/runtime.lock pyproject.toml $(VENV)/build.stamp
	@echo "set-up: installing the pinned packages (about a minute, once)"
	@$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes --no-build-isolation -r $<
	@$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@

$(VENV)/dev.stamp: requirements/dev.lock $(VENV)/runtime.stamp
	@echo "set-up: installing the pinned test tools"
	@$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes --no-build-isolation -r $<
	@touch $@

$(VENV)/bench.stamp: requirements/bench.lock $(VENV)/runtime.stamp
	@echo "set-up: installing the pinned peers of the benchmark"
	@$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes --no-build-isolation -r $<
	@touch $@

.PHONY: install
install: $(VENV)/runtime.stamp  ## the virtual environment with all that strandcast needs

.PHONY: demo
demo: $(VENV)/runtime.stamp  ## a virtual arm throws an unknown string until it hits; ends with the report
	@$(BIN)/strandcast run demo --cores $(CORES)

.PHONY: test
test: $(VENV)/dev.stamp  ## all tests
	@$(BIN)/pytest

.PHONY: bench
bench: $(VENV)/bench.stamp  ## the string's speed and error beside MuJoCo, PyElastica and numpy: results/bench.json
	@$(BIN)/python -m strandcast.bench.run --threads $(CORES)

.PHONY: bench-video
bench-video: $(VENV)/runtime.stamp  ## the tracker's errors and speed on filmed throws, beside peers: results/bench-video.md; some 40 minutes
	@$(BIN)/python -m strandcast.bench.video $(if $(WORK),--work $(WORK))

.PHONY: real
real: $(VENV)/runtime.stamp  ## predictions of real, measured motion, as JSON; data: STRANDCAST_REAL_DATA=folder
	@$(BIN)/python -m strandcast.evidence.run

.PHONY: claims
claims: $(VENV)/runtime.stamp  ## the paper's claims on masses and motions, ablated in the lab, as JSON; some ten minutes
	@$(BIN)/python -m strandcast.evidence.claims --jobs $(CORES)

.PHONY: check
check: $(VENV)/dev.stamp  ## lint, formats, types, import rules, the workflow's lint
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/lint-imports --no-cache
	@PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/snakefmt --check Snakefile workflow
	@PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/snakemake --lint

.PHONY: format
format: $(VENV)/dev.stamp  ## bring code and workflow into their form
	@$(BIN)/ruff check --fix --quiet . || true
	@$(BIN)/ruff format --quiet .
	@PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/snakefmt Snakefile workflow

.PHONY: lock
lock:  ## pin requirements/*.in anew (needs uv)
	@for name in build runtime; do \
	  uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --annotation-style line \
	    requirements/$$name.in -o requirements/$$name.lock; done
	@for name in dev bench; do \
	  uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --annotation-style line \
	    -c requirements/runtime.lock requirements/$$name.in -o requirements/$$name.lock; done

.PHONY: clean
clean:  ## remove the environment and caches; data and results stay
	@rm -rf $(VENV) .snakemake .pytest_cache .mypy_cache .ruff_cache .hypothesis src/*.egg-info
	@find src tests -name __pycache__ -type d -prune -exec rm -rf {} +
