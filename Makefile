# strandcast: `make demo` and `make test` do all their own set-up; `make help` lists the rest.
SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
# A run starts many processes: each would compile every module again.
unexport PYTHONDONTWRITEBYTECODE

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DRIVERS := .venv-drivers
FRANKA_SIM := .venv-franka-sim
SLURM := .venv-slurm
STORAGE := .venv-storage
AUDIT := .venv-audit
DOCS := .venv-docs
CORES ?= 2
JOBS ?= $(CORES)
SEEDS ?= 3

.PHONY: help
help:  ## list the targets
	@echo "strandcast: make <target>"
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 18 | sed 's/^/  /'

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(not ((3, 11) <= sys.version_info < (3, 14)))' || \
	  { echo "strandcast needs Python 3.11, 3.12 or 3.13; $(PYTHON) is $$($(PYTHON) --version). Try: make PYTHON=python3.12 ..."; exit 3; }
	@echo "set-up: virtual environment in $(VENV)"
	@$(PYTHON) -m venv $(VENV)

# $(call install,ENVIRONMENT,ARGUMENTS) installs pinned packages. uv takes a tenth of pip's time; where it finds no
# package index, because it does not read pip's configuration, pip does the work, and says what is wrong.
install = $(BIN)/uv pip install --quiet --compile-bytecode --python $(1)/bin/python --require-hashes --no-build-isolation $(2) 2>/dev/null || \
  $(1)/bin/pip install --quiet --disable-pip-version-check --require-hashes --no-build-isolation $(2)

# Source packages are built with the pinned setuptools, never with one fetched on the side.
$(VENV)/build.stamp: requirements/build.lock | $(BIN)/python
	@$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes --only-binary :all: -r $<
	@touch $@

$(VENV)/runtime.stamp: requirements/runtime.lock pyproject.toml $(VENV)/build.stamp
	@echo "set-up: installing the pinned packages, once"
	@# All distributions of OpenCV share one folder: an older environment may hold another, or a half-removed one.
	@$(BIN)/uv pip uninstall --quiet --python $(BIN)/python opencv-python opencv-python-headless opencv-contrib-python \
	  opencv-contrib-python-headless 2>/dev/null
	@$(call install,$(VENV),-r $<)
	@$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@

# The plug-in that proves the seam of trackers, installed as a lab's own package is.
$(VENV)/pendulum.stamp: plugins/pendulum/pyproject.toml $(VENV)/runtime.stamp
	@$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable plugins/pendulum
	@touch $@

$(VENV)/dev.stamp: requirements/dev.lock $(VENV)/runtime.stamp $(VENV)/pendulum.stamp
	@echo "set-up: installing the pinned test tools"
	@$(call install,$(VENV),-r $<)
	@touch $@

$(VENV)/studies.stamp: requirements/studies.lock $(VENV)/runtime.stamp
	@echo "set-up: installing the pinned packages of the studies"
	@$(call install,$(VENV),-r $<)
	@touch $@

$(VENV)/fuzz.stamp: requirements/fuzz.lock $(VENV)/dev.stamp
	@echo "set-up: installing the pinned fuzzer"
	@$(call install,$(VENV),-r $<)
	@touch $@

# What examines the locks is not itself in the environment that they describe.
$(AUDIT)/audit.stamp: requirements/audit.lock | $(VENV)/build.stamp
	@echo "set-up: installing the tools of the audit in $(AUDIT)"
	@rm -rf $(AUDIT) && $(BIN)/python -m venv $(AUDIT)
	@$(call install,$(AUDIT),--only-binary :all: -r $<)
	@touch $@

$(DOCS)/docs.stamp: requirements/docs.lock | $(VENV)/build.stamp
	@echo "set-up: installing the pinned packages of the documentation in $(DOCS)"
	@rm -rf $(DOCS) && $(BIN)/python -m venv $(DOCS)
	@$(call install,$(DOCS),--only-binary :all: -r $<)
	@touch $@

# $(call extend,ENVIRONMENT) makes an environment that also has the packages of $(VENV).
extend = rm -rf $(1) && $(BIN)/python -m venv $(1) && \
  $(BIN)/python -c 'import sysconfig; print("import site; site.addsitedir(%r)" % sysconfig.get_path("purelib"))' > \
  "$$($(1)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/strandcast.pth"

# $(call programs,ENVIRONMENT) adds the commands `strandcast` and `snakemake` to it.
programs = for name in strandcast snakemake; do \
  printf '\#!/bin/sh\nexec "%s/python" -m %s "$$@"\n' "$(CURDIR)/$(1)/bin" $$name > $(1)/bin/$$name && chmod +x $(1)/bin/$$name; done

# Snakemake imports all its plugins at every start: they stay out of the usual environment.
$(SLURM)/slurm.stamp: requirements/slurm.lock $(VENV)/runtime.stamp
	@echo "set-up: installing Snakemake's plugin for Slurm in $(SLURM)"
	@$(call extend,$(SLURM))
	@$(SLURM)/bin/pip install --quiet --disable-pip-version-check --require-hashes --no-build-isolation -r $<
	@$(call programs,$(SLURM))
	@touch $@

$(STORAGE)/storage.stamp: requirements/storage.lock $(VENV)/runtime.stamp
	@echo "set-up: installing Snakemake's plugin for S3 and a local S3 server in $(STORAGE)"
	@$(call extend,$(STORAGE))
	@$(STORAGE)/bin/pip install --quiet --disable-pip-version-check --require-hashes --no-build-isolation -r $<
	@$(call programs,$(STORAGE))
	@touch $@

# The vendors' packages stay out of the demo's environment: this one extends it.
$(DRIVERS)/drivers.stamp: requirements/drivers.lock $(VENV)/dev.stamp
	@echo "set-up: installing the robot vendors' packages in $(DRIVERS)"
	@$(call extend,$(DRIVERS))
	@$(DRIVERS)/bin/pip install --quiet --disable-pip-version-check --require-hashes --no-build-isolation -r $<
	@touch $@

# The Franka controller to test against pins an older numpy and MuJoCo.
$(FRANKA_SIM)/franka-sim.stamp: requirements/franka-sim.lock | $(VENV)/build.stamp
	@echo "set-up: installing franka-sim in $(FRANKA_SIM)"
	@rm -rf $(FRANKA_SIM) && $(BIN)/python -m venv $(FRANKA_SIM)
	@$(call install,$(FRANKA_SIM),--only-binary :all: -r $<)
	@touch $@

.PHONY: install
install: $(VENV)/runtime.stamp  ## make the virtual environment

.PHONY: slurm
slurm: $(SLURM)/slurm.stamp  ## make .venv-slurm; its `strandcast run --profile slurm` submits to a Slurm cluster

.PHONY: storage
storage: $(STORAGE)/storage.stamp  ## make .venv-storage; its `snakemake` takes raw data from object storage and puts results there

.PHONY: demo
demo: $(VENV)/runtime.stamp  ## let a virtual arm throw an unknown string until it hits; write the report
	@$(BIN)/strandcast run demo --cores $(CORES)

.PHONY: paper
paper: $(VENV)/runtime.stamp  ## reproduce the paper: seven strings, its method and ours: results/paper/report.html; JOBS=2 SEEDS=3; hours
	@$(BIN)/python -m strandcast_studies.paper run --cores $(JOBS) --seeds $(SEEDS)

.PHONY: paper-quick
paper-quick: $(VENV)/runtime.stamp  ## the same with three strings, one seed, smaller searches: results/paper-quick/report.html
	@$(BIN)/python -m strandcast_studies.paper run --quick --cores $(JOBS)

# $(call pytest,TESTS) runs them on CORES processes; COVERAGE=1 prints their coverage.
pytest = $(BIN)/pytest --numprocesses $(CORES) --dist loadfile --no-loadscope-reorder $(if $(COVERAGE),--cov) $(1)

.PHONY: test
test: $(VENV)/dev.stamp  ## run the tests on CORES=2; COVERAGE=1 prints their coverage
	@$(call pytest,-m "not thorough")

.PHONY: test-rare
test-rare: $(VENV)/dev.stamp  ## run the tests of rare paths: commands of the documents, all proofs, kills, long searches; TESTS=tests/docs: only these
	@$(call pytest,-m thorough $(TESTS))

.PHONY: test-all
test-all: test test-rare  ## run all tests: half an hour

# The tests that reach every kernel.
KERNEL_TESTS := $(addprefix tests/arm/test_,dynamics.py limits.py link_masses.py load.py reach.py servo.py spatial.py) \
  tests/arm/test_yielding_joints.py::test_they_move_as_mujocos tests/camera/test_marker_sides.py \
  $(addprefix tests/dynamics/test_,simulate.py space.py) tests/estimation/test_descent.py \
  tests/lab/test_film.py::test_string_is_drawn_where_it_is \
  $(addprefix tests/planning/test_,assessment.py bezier.py draw.py motion_descent.py new_objective.py simulated_misses.py) \
  tests/planning/test_space.py::test_a_planar_throw_in_a_turned_plane_misses_by_the_same tests/stages/test_fitted_string.py \
  $(addprefix tests/tracking/test_,attachments.py background.py detection.py hand.py smoother.py tip.py) \
  tests/tracking/test_led.py::test_the_led_is_detected_in_the_pass_that_tracks_the_string

.PHONY: test-kernels
test-kernels: $(VENV)/dev.stamp  ## compile every kernel by a few tests; VENV=.venv-3.13 PYTHON=python3.13: with another Python
	@# A kernel counts as compiled in its own process: none is taken from the user's folder. Then one experiment from film to plan.
	@NUMBA_CACHE_DIR="$$(mktemp -d)"; export NUMBA_CACHE_DIR; trap 'rm -rf "$$NUMBA_CACHE_DIR"' EXIT; \
	  $(BIN)/python -m pytest -p tests.kernels -m "not thorough" $(KERNEL_TESTS) && \
	  $(BIN)/python -m pytest -m "not thorough" tests/workflow/test_loop.py::test_every_stage_writes_its_files tests/workflow/test_sitting_files.py

.PHONY: test-widths
test-widths: $(VENV)/dev.stamp  ## run the tests of numbers as on other processors; hours; WIDTHS="bits=0 blas=Haswell" TESTS=tests/estimation: only these
	@$(BIN)/python -m tests.widths $(if $(WIDTHS),--only "$(WIDTHS)") $(if $(TESTS),--tests "$(TESTS)") --numprocesses $(CORES) --dist loadfile

.PHONY: faults
faults: $(VENV)/dev.stamp  ## inject the 95 faults of tests/faults/table.toml and print what came of each; ROWS="1 2": only these
	@$(BIN)/python -m tests.faults.table --numprocesses $(CORES) --dist loadfile $(if $(ROWS),--rows $(ROWS))

.PHONY: faults-nightly
faults-nightly: $(VENV)/dev.stamp fuzz  ## `make fuzz`, kill runs and stages, and refuse every file call of every stage; many hours
	@$(BIN)/python -m tests.faults.kills --runs 100 --stages 20
	@$(BIN)/python -m tests.faults.refused_calls

.PHONY: test-drivers
test-drivers: $(DRIVERS)/drivers.stamp $(FRANKA_SIM)/franka-sim.stamp  ## run the drivers' tests, against a Franka controller and a simulated UR; ALL=1: whole sittings too
	@STRANDCAST_FRANKA_SIM="$(CURDIR)/$(FRANKA_SIM)/bin/python" $(DRIVERS)/bin/python -m pytest --numprocesses $(CORES) --dist loadfile \
	  $(if $(ALL),,-m "not thorough") \
	  tests/executor/drivers tests/exports/test_recordings.py

.PHONY: test-slurm
test-slurm: $(SLURM)/slurm.stamp $(VENV)/dev.stamp  ## run 20 experiments through a Slurm of two nodes on this machine, where it is installed
	@$(SLURM)/bin/python -m pytest -rs tests/slurm

.PHONY: test-storage
test-storage: $(STORAGE)/storage.stamp $(VENV)/dev.stamp  ## run an experiment from a local S3 server into it
	@$(STORAGE)/bin/python -m pytest -rs tests/storage

.PHONY: fuzz
fuzz: $(VENV)/fuzz.stamp  ## damage the files of every reader 10,000 times, with and without guidance by coverage; hours
	@$(BIN)/python -m tests.faults.nightly
	@$(BIN)/python -m tests.faults.nightly --guided

.PHONY: docs
docs: $(DOCS)/docs.stamp  ## build the documentation as a site, build/site/index.html; a broken link is an error
	@NO_MKDOCS_2_WARNING=1 $(DOCS)/bin/mkdocs build

.PHONY: audit
audit: $(AUDIT)/audit.stamp  ## compare the pinned packages with the known vulnerabilities (needs the network)
	@failed=; for name in build runtime player dev studies drivers slurm storage franka-sim fuzz audit docs; do \
	  echo "requirements/$$name.lock"; \
	  $(AUDIT)/bin/pip-audit --strict --require-hashes --disable-pip --progress-spinner off -r requirements/$$name.lock \
	    2>&1 | tail -n 20 || failed=1; done; \
	  [ -z "$$failed" ] || { echo "a known vulnerability, or no service that could be asked: see above"; exit 1; }

.PHONY: wheel
wheel: $(VENV)/runtime.stamp  ## build dist/strandcast-*.whl with compiled kernels, by running the demo; minutes
	@$(BIN)/python -m strandcast_studies.kernel_seeds build/kernels
	@$(BIN)/pip wheel --quiet --disable-pip-version-check --no-deps --no-build-isolation --wheel-dir dist .

.PHONY: sbom
sbom: $(AUDIT)/audit.stamp  ## list the packages of an installation as CycloneDX JSON: results/sbom.json
	@$(AUDIT)/bin/cyclonedx-py requirements --output-reproducible --of JSON -o results/sbom.json requirements/runtime.lock
	@diff <(grep -oE '^[a-z0-9._-]+==[^ ;]+' requirements/runtime.lock | sort -u) \
	  <(grep -oE '"pkg:pypi/[^?"]+' results/sbom.json | sed 's|.*pypi/||; s|@|==|' | sort -u) || \
	  { echo "results/sbom.json does not name every pinned package"; exit 1; }

.PHONY: bench
bench: $(VENV)/studies.stamp  ## compare the string's speed and error with MuJoCo, PyElastica and numpy: results/bench.json
	@$(BIN)/python -m strandcast_studies.benchmarks.simulation.run --threads $(CORES)

.PHONY: bench-video
bench-video: $(VENV)/studies.stamp  ## compare the tracker's errors and speed with peers: results/bench-video.md; about 40 minutes
	@$(BIN)/python -m strandcast_studies.benchmarks.video.run $(if $(WORK),--work $(WORK))

.PHONY: bench-streaming
bench-streaming: $(VENV)/runtime.stamp  ## measure the streaming loop's jitter: results/bench-streaming.json
	@$(BIN)/python -m strandcast_studies.benchmarks.streaming

.PHONY: bench-loop
bench-loop: $(VENV)/runtime.stamp  ## run the loop on seven strings, 15 seeds, three throws each: results/bench-loop.json; an hour of one core
	@$(BIN)/python -m strandcast_studies.benchmarks.loop.run --jobs $(JOBS) --work results/bench-loop

.PHONY: bench-drawn
bench-drawn: $(VENV)/runtime.stamp  ## run the loop on sixty random strings, targets and servos: results/bench-drawn.json; 45 minutes of one core
	@$(BIN)/python -m strandcast_studies.benchmarks.loop.drawn --jobs $(JOBS)

.PHONY: bench-space
bench-space: $(VENV)/runtime.stamp  ## run the loop in space on twenty random strings, arms of six and seven joints, with rehearsals: results/bench-space.json; 12 minutes of one core
	@$(BIN)/python -m strandcast_studies.benchmarks.space.run --rehearsed --jobs $(JOBS)

.PHONY: calibration
calibration: $(VENV)/runtime.stamp  ## count how far throws of drawn strings and rigs miss, for the stated probabilities; hours
	@$(BIN)/python -m strandcast_studies.benchmarks.loop.drawn --jobs $(JOBS) --unrehearsed --seeds 4001-4036 --out results/calibration-unrehearsed.json
	@$(BIN)/python -m strandcast_studies.benchmarks.loop.drawn --jobs $(JOBS) --unrehearsed --wide --seeds 5001-5024 --out results/calibration-unrehearsed-wide.json
	@$(BIN)/python -m strandcast_studies.benchmarks.loop.drawn --jobs $(JOBS) --seeds 41001-41024,42001-42030 --out results/calibration-usual.json
	@$(BIN)/python -m strandcast_studies.benchmarks.loop.drawn --jobs $(JOBS) --wide --seeds 43001-43030 --out results/calibration-wide.json
	@$(BIN)/python -m strandcast_studies.benchmarks.loop.calibration fit results/calibration-usual.json results/calibration-wide.json \
	  results/calibration-unrehearsed.json results/calibration-unrehearsed-wide.json
	@$(BIN)/python -m strandcast_studies.benchmarks.space.run --rehearsed --every --trials 2 --jobs $(JOBS) --seeds 8001-8027 --out results/calibration-space.json
	@$(BIN)/python -m strandcast_studies.benchmarks.loop.calibration fit --space results/calibration-space.json

.PHONY: bench-batch
bench-batch: $(VENV)/runtime.stamp  ## measure the overhead of a batch over its stages' own work: results/bench-batch.json; SIZE=2x3; ten minutes of CPU
	@$(BIN)/python -m strandcast_studies.benchmarks.batch.run $(if $(SIZE),--size $(SIZE))

.PHONY: bench-growth
bench-growth: $(VENV)/runtime.stamp  ## measure how tracking grows with frames and pixels, and the string's kernel with points and cores; ten minutes of CPU
	@$(BIN)/python -m strandcast_studies.benchmarks.batch.growth

.PHONY: bench-trial
bench-trial: $(VENV)/runtime.stamp  ## measure what users wait for: a recorded trial by stage, the demo, commands: results/bench-trial.json; ten minutes of CPU
	@$(BIN)/python -m strandcast_studies.benchmarks.batch.trial

.PHONY: bench-agents
bench-agents: $(VENV)/studies.stamp  ## compare planners, random search and CMA-ES by their misses per throw: results/bench-agents; hours
	@$(BIN)/python -m strandcast_studies.benchmarks.agents.run --jobs $(JOBS)

.PHONY: error-budget
error-budget: $(VENV)/runtime.stamp  ## split the misses of bench-loop by cause: results/error-budget.json
	@$(BIN)/python -m strandcast_studies.benchmarks.loop.error_budget results/bench-loop/default/usual --jobs $(JOBS)

.PHONY: bad-throws
bad-throws: $(VENV)/runtime.stamp  ## throw in the lab with a slipping clamp, a hidden tip, a wrong clock, arm or length: results/bad-throws; half an hour
	@$(BIN)/python -m strandcast_studies.bad_throws --cores $(CORES)

.PHONY: sure-misses
sure-misses: $(VENV)/runtime.stamp  ## film 42 throws by a second renderer and compare the stated error of each miss with the true one: results/second-renderer; an hour
	@$(BIN)/python -m strandcast_studies.second_renderer.run --jobs $(JOBS)

.PHONY: misstated-rigs
misstated-rigs: $(VENV)/runtime.stamp  ## throw in the lab with arms that their files describe wrongly by millimetres: results/misstated-rigs; half an hour
	@$(BIN)/python -m strandcast_studies.misstated_rigs --cores $(CORES)

.PHONY: real
real: $(VENV)/studies.stamp  ## predict real, measured motion, as JSON; data: STRANDCAST_REAL_DATA=folder; some of it: PARTS="pac_cable.tip"
	@$(BIN)/python -m strandcast_studies.evidence.run $(PARTS)

.PHONY: claims
claims: $(VENV)/runtime.stamp  ## test the paper's claims on masses and motions in the lab, as JSON; five minutes
	@$(BIN)/python -m strandcast_studies.evidence.claims --jobs $(CORES)

.PHONY: check
check: $(VENV)/dev.stamp  ## check lint, formats, types, import rules and the workflow
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/lint-imports --no-cache
	@PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/snakefmt --check Snakefile workflow src/strandcast_studies/paper/Snakefile src/strandcast/workflow/template/Snakefile
	@PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/snakemake --lint

.PHONY: format
format: $(VENV)/dev.stamp  ## format code and workflow
	@$(BIN)/ruff check --fix --quiet . || true
	@$(BIN)/ruff format --quiet .
	@PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/snakefmt Snakefile workflow src/strandcast_studies/paper/Snakefile src/strandcast/workflow/template/Snakefile

PIN = $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --annotation-style line
PIN_LIKE_RUNTIME = $(PIN) --constraint requirements/runtime.lock

.PHONY: lock
lock: $(VENV)/build.stamp  ## pin pyproject.toml and requirements/*.in again
	@for name in build franka-sim audit docs; do $(PIN) requirements/$$name.in -o requirements/$$name.lock; done
	@$(PIN) pyproject.toml -o requirements/runtime.lock
	@$(PIN_LIKE_RUNTIME) pyproject.toml --extra gym --extra studies -o requirements/studies.lock
	@$(PIN_LIKE_RUNTIME) pyproject.toml --extra c3d --extra crate --extra franka --extra mcap --extra rerun --extra ros --extra ur --extra xarm -o requirements/drivers.lock
	@$(PIN_LIKE_RUNTIME) pyproject.toml --extra slurm -o requirements/slurm.lock
	@# Amazon's botocore needs an older python-dateutil than the others have.
	@grep -E '^[a-z]' requirements/runtime.lock | grep -v '^python-dateutil=' | tr -d '\\' | \
	  $(PIN) --constraint - pyproject.toml --extra s3 requirements/storage.in -o requirements/storage.lock
	@for name in dev fuzz; do $(PIN_LIKE_RUNTIME) pyproject.toml requirements/$$name.in -o requirements/$$name.lock; done
	@$(BIN)/python -c 'import tomllib; \
	  print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["player"], sep="\n")' | \
	  $(PIN_LIKE_RUNTIME) - -o requirements/player.lock

.PHONY: clean
clean:  ## remove the environment and caches; data and results stay
	@rm -rf $(VENV) .venv-3.1[0-9] $(DRIVERS) $(FRANKA_SIM) $(SLURM) $(STORAGE) $(AUDIT) $(DOCS) .snakemake .pytest_cache .mypy_cache .ruff_cache .hypothesis src/*.egg-info
	@find src tests -name __pycache__ -type d -prune -exec rm -rf {} +
