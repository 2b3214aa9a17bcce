# strandcast: `make demo` and `make test` do all their own set-up; `make help` lists the rest.
SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DRIVERS := .venv-drivers
FRANKA_SIM := .venv-franka-sim
CORES ?= 2
JOBS ?= $(CORES)
SEEDS ?= 3

.PHONY: help
help:  ## what can be made
	@echo "strandcast: make <target>"
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 18 | sed 's/^/  /'

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

# The vendors' packages stay out of the demo's environment: an environment that sees ours, and has them besides.
$(DRIVERS)/drivers.stamp: requirements/drivers.lock $(VENV)/dev.stamp
	@echo "set-up: installing the robot vendors' packages in $(DRIVERS)"
	@rm -rf $(DRIVERS) && $(BIN)/python -m venv $(DRIVERS)
	@$(BIN)/python -c 'import sysconfig; print("import site; site.addsitedir(%r)" % sysconfig.get_path("purelib"))' > \
	  "$$($(DRIVERS)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/strandcast.pth"
	@$(DRIVERS)/bin/pip install --quiet --disable-pip-version-check --require-hashes --no-build-isolation -r $<
	@touch $@

# The Franka controller to test against pins an older numpy and MuJoCo.
$(FRANKA_SIM)/franka-sim.stamp: requirements/franka-sim.lock | $(BIN)/python
	@echo "set-up: installing franka-sim in $(FRANKA_SIM)"
	@rm -rf $(FRANKA_SIM) && $(BIN)/python -m venv $(FRANKA_SIM)
	@$(FRANKA_SIM)/bin/pip install --quiet --disable-pip-version-check --require-hashes --only-binary :all: -r $<
	@touch $@

.PHONY: install
install: $(VENV)/runtime.stamp  ## the virtual environment with all that strandcast needs

.PHONY: demo
demo: $(VENV)/runtime.stamp  ## a virtual arm throws an unknown string until it hits; ends with the report
	@$(BIN)/strandcast run demo --cores $(CORES)

.PHONY: paper
paper: $(VENV)/runtime.stamp  ## the paper's seven strings through video, its method and ours: results/paper/report.html; JOBS=2 SEEDS=3; hours
	@$(BIN)/strandcast paper --cores $(JOBS) --seeds $(SEEDS)

.PHONY: paper-quick
paper-quick: $(VENV)/runtime.stamp  ## the same with three strings, one seed, little effort: results/paper-quick/report.html
	@$(BIN)/strandcast paper --quick --cores $(JOBS)

.PHONY: test
test: $(VENV)/dev.stamp  ## all tests, a file at a time on each of CORES=2
	@$(BIN)/pytest --numprocesses $(CORES) --dist loadfile

.PHONY: test-drivers
test-drivers: $(DRIVERS)/drivers.stamp $(FRANKA_SIM)/franka-sim.stamp  ## the drivers' tests, against a Franka controller and a UR stand-in
	@STRANDCAST_FRANKA_SIM="$(CURDIR)/$(FRANKA_SIM)/bin/python" $(DRIVERS)/bin/python -m pytest tests/drivers

.PHONY: bench
bench: $(VENV)/bench.stamp  ## the string's speed and error beside MuJoCo, PyElastica and numpy: results/bench.json
	@$(BIN)/python -m strandcast.bench.run --threads $(CORES)

.PHONY: bench-video
bench-video: $(VENV)/runtime.stamp  ## the tracker's errors and speed on filmed throws, beside peers: results/bench-video.md; some 40 minutes
	@$(BIN)/python -m strandcast.bench.video $(if $(WORK),--work $(WORK))

.PHONY: bench-streaming
bench-streaming: $(VENV)/runtime.stamp  ## how late the streaming loop wakes, with and without real-time scheduling: results/bench-streaming.json
	@$(BIN)/python -m strandcast.bench.streaming

.PHONY: bench-loop
bench-loop: $(VENV)/runtime.stamp  ## seven strings, 15 seeds, three throws each with supplied tracks: results/bench-loop.json; an hour of one core
	@$(BIN)/python -m strandcast.bench.loop --jobs $(JOBS) --work results/bench-loop

.PHONY: bench-drawn
bench-drawn: $(VENV)/runtime.stamp  ## sixty strings, targets and servos drawn by chance, three throws each: results/bench-drawn.json; three quarters of an hour of one core
	@$(BIN)/python -m strandcast.bench.loop_drawn --jobs $(JOBS)

.PHONY: error-budget
error-budget: $(VENV)/runtime.stamp  ## what throws miss by, cause by cause (after bench-loop), for the paper's page: results/error-budget.json
	@$(BIN)/python -m strandcast.bench.loop_budget results/bench-loop/default/usual --jobs $(JOBS)

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
	@for name in build runtime franka-sim; do \
	  uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --annotation-style line \
	    requirements/$$name.in -o requirements/$$name.lock; done
	@for name in dev bench drivers; do \
	  uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --annotation-style line \
	    -c requirements/runtime.lock requirements/$$name.in -o requirements/$$name.lock; done

.PHONY: clean
clean:  ## remove the environment and caches; data and results stay
	@rm -rf $(VENV) $(DRIVERS) $(FRANKA_SIM) .snakemake .pytest_cache .mypy_cache .ruff_cache .hypothesis src/*.egg-info
	@find src tests -name __pycache__ -type d -prune -exec rm -rf {} +
