# Everything runs inside .venv; nothing but Python >= 3.11 with its venv module is needed first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
UV := UV_PYTHON_DOWNLOADS=never $(BIN)/uv
INSTALLED := $(VENV)/.installed
# Matrices are small: threads of linear algebra would only wait for one another.
export OPENBLAS_NUM_THREADS := 1
# A process is started in half the time where modules were compiled before.
export PYTHONDONTWRITEBYTECODE :=
# One process a core; one that is done takes tests from the others. Tests that wait for processes of
# a bench leave a quarter of the cores idle, which one process more uses.
SIDE_BY_SIDE := --numprocesses auto --dist worksteal
ONE_MORE := --numprocesses $(shell expr $$(nproc) + 1) --dist worksteal

# What the core does, without the host, the page, the studies, Monte Carlo and what takes long to
# compile: the filters of the turntable, the positions by hand and the norms of a centrifuge.
QUICK := tests/benches tests/calibration tests/design tests/estimate tests/io tests/methods \
  tests/observe tests/recipes tests/runfile tests/segments tests/sensors tests/uncertainty \
  $(wildcard tests/test_*.py)
NOT_QUICK := tests/benches/test_e*.py tests/benches/test_turntable*.py \
  $(foreach name,turntable multi_position dual_orthogonal ship tumble_uncertainty sequential every \
  centrifuge bench_sensitivities rates poses,tests/methods/test_$(name)*.py) \
  tests/runfile/test_every_key_counts.py tests/segments/test_turntable*.py \
  tests/observe/test_norm*.py tests/design/test_path*.py tests/test_kernel_cache.py

.PHONY: help demo quick test slow check style types bench evidence numbers architecture glossary verbs interface dependencies pictures notebooks docs \
  lock format clean
help:
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 10

$(INSTALLED): requirements.lock pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "inercal needs Python 3.11 or newer")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check uv==0.13.8
	$(UV) pip install --quiet --compile-bytecode --python $(BIN)/python --require-hashes \
	  --requirement requirements.lock
	$(UV) pip install --quiet --python $(BIN)/python --no-deps --no-build-isolation --editable .
	touch $@

demo: $(INSTALLED)  ## install, then calibrate an IMU in five simulated minutes, write the report
	$(BIN)/inercal demo --quick --out demo-output

quick: $(INSTALLED)  ## the core's tests, in a minute
	$(BIN)/python -m pytest $(ONE_MORE) $(QUICK) \
	  $(foreach path,$(NOT_QUICK),--ignore-glob=$(path))

# Several processes run the tests; those that measure how soon something answers run last, alone.
# A test that fails is run once more, alone: that tells a fault from a machine that stood still.
# Draws are seeded, so no number passes the second time.
define run_tests
	$(BIN)/python -m pytest -m "$(1) and not wall_time" $(ONE_MORE) $(2) || { [ $$? = 1 ] && \
	  $(BIN)/python -m pytest -m "$(1)" --last-failed --last-failed-no-failures none; }
	$(BIN)/python -m pytest -m "$(1) and wall_time" tests/host
endef

test: $(INSTALLED)  ## all tests but the slow ones
	$(call run_tests,not slow and not evidence,tests src)

# All of them take longer than a change should wait for: each commit draws its half.
slow: $(INSTALLED)  ## half of the slow tests and Monte Carlo runs, drawn by the commit
	$(call run_tests,slow and not evidence,tests --one-in 2)

# Types take minutes of one core: with two, `make --jobs 2 check` runs the tests beside them.
check: style types test  ## format, lint, types, layers, tests, doctests, examples

style: $(INSTALLED)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports

types: $(INSTALLED)
	$(BIN)/pyright

bench: $(INSTALLED)  ## speed against a peer, measured in one run, and its page: on a machine that does nothing else
	$(BIN)/python -m benchmarks --page

evidence: $(INSTALLED)  ## what verdicts say of violations of known visibility, in full, and all slow tests: hours
	$(BIN)/python -m tests.evidence
	$(BIN)/python -m tests.evidence.turntable_errors
	$(BIN)/python -m tests.evidence.turntable_base
	$(BIN)/python -m tests.evidence.noise_coverage
	$(BIN)/python -m tests.evidence.repeatability
	$(BIN)/python -m tests.evidence.sensor_noise
	$(BIN)/python -m tests.evidence.filtered_noise
	$(BIN)/python -m tests.evidence.temperature_table
	$(BIN)/python -m tests.evidence.control
	$(BIN)/python -m tests.evidence.characteristics
	$(BIN)/python -m tests.evidence.warm_up
	$(BIN)/python -m tests.evidence.systematic
	$(BIN)/python -m tests.evidence.systematic_violations
	$(BIN)/python -m tests.evidence.auto
	$(BIN)/python -m tests.evidence.prediction
	$(BIN)/python -m tests.evidence.axes
	$(BIN)/python -m tests.evidence.magnetometer
	$(BIN)/python -m tests.evidence.prior
	$(BIN)/python -m tests.evidence.peers
	$(BIN)/python -m pytest -m "slow or evidence" $(SIDE_BY_SIDE) tests

numbers: $(INSTALLED)  ## renew the record of all numbers of examples and studies, and print what changed most
	$(BIN)/python -m tools.numbers --write

architecture: $(INSTALLED)  ## draw the picture of the rooms from their imports, and list them in CONTRIBUTING
	$(BIN)/python -m tools.architecture

glossary: $(INSTALLED)  ## write the page of the terms
	$(BIN)/python -m inercal.physics.glossary > docs/reference/glossary.md

verbs: $(INSTALLED)  ## write the page of the verbs
	$(BIN)/python -m tools.verbs_page

interface: $(INSTALLED)  ## write the page and the OpenAPI description of the live page's HTTP interface
	$(BIN)/python -m tools.interface_page

dependencies: $(INSTALLED)  ## write the page of the dependencies, with sizes and licences, and their bill of materials: after make lock
	$(BIN)/python -m tools.dependencies_page
	$(BIN)/python -m tools.bill_of_materials

notebooks: $(INSTALLED)  ## run the notebooks, and write their pages
	$(BIN)/python -m tools.notebook_pages

pictures: $(INSTALLED)  ## take the pictures of README and site, by the system's chromium
	$(BIN)/python -m tools.pictures

docs: $(INSTALLED) glossary verbs interface architecture  ## build the documentation site in site/, which needs no network
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going --builder html docs site
	@echo "open site/index.html"

format: $(INSTALLED)  ## mend format and lint
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

lock: $(INSTALLED)  ## resolve the dependencies anew: hashes, no addresses
	$(UV) pip compile --quiet --universal --generate-hashes --all-extras --group dev \
	  --python-version 3.11 --no-header --no-annotate --no-emit-index-url --upgrade \
	  pyproject.toml --output-file requirements.lock

clean:  ## remove the environment and what runs left
	rm -rf $(VENV) demo-output site .hypothesis .pytest_cache .ruff_cache .import_linter_cache
