# make demo and make test need Python 3.11 or newer with venv; everything else is set up in $(VENV).

PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
PIP    := $(BIN)/python -m pip --disable-pip-version-check
PYTEST := $(BIN)/python -m pytest

WHEELS       ?= wheels
IMAGE_PYTHON ?= 3.13
MACHINE      ?= $(shell uname -m)
WORKERS      ?= 3
MUTANTS      ?= 120
SEED         ?= 1
SEEDS        ?= 4
ONLY         ?=
COUNT        ?= 2000000
MINUTES      ?= 10

# Markers of the tests that `make test` leaves to other targets.
APART := long or hostile or compose or rust or ros

.PHONY: help demo test check lint format types rooms unit team system long compose-test rust-test mutants fuzz adversary nights soak bench figures docs bridges screenshots wheels venv clean
.NOTPARALLEL:

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-14s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

demo: $(VENV)/.run ## six robots in two sub-teams localise themselves and two objects: ends with PASS or FAIL
	@$(BIN)/blackboard demo

# Many tests wait for other processes, so three run side by side on two cores; the longest come first (tests/conftest.py), and mypy
# runs beside them. Python keeps what it compiles, also where the environment says otherwise: all test modules are compiled anew else.
test unit team system: export PYTHONDONTWRITEBYTECODE :=
test: $(VENV)/.dev lint format rooms ## checks, unit tests, whole teams, real processes: all but `make long`, `fuzz`, `rust-test`, `compose-test`
	@$(BIN)/mypy & types=$$!; trap 'kill $$types' INT TERM; \
	$(PYTEST) -m "not ($(APART))" -n $(WORKERS) --dist loadgroup --durations=5; tests=$$?; wait $$types && exit $$tests

check: lint format types rooms docs ## ruff, mypy --strict, who imports whom, the documentation without a warning

lint: $(VENV)/.dev ## ruff's rules
	$(BIN)/ruff check

format: $(VENV)/.dev ## whether ruff would format anything otherwise
	$(BIN)/ruff format --check

types: $(VENV)/.dev ## mypy --strict
	$(BIN)/mypy

rooms: $(VENV)/.dev ## who may import whom: a line for each import that breaks the list, and each circle
	@$(BIN)/python -m tests.rooms > /dev/null

unit: $(VENV)/.dev ## tests of the pure rooms, in seconds
	$(PYTEST) -m "not (system or team or $(APART))" -n $(WORKERS) --durations=5

team: $(VENV)/.dev ## whole teams in one process, links, the laboratory, tapes and views
	$(PYTEST) -m "team and not ($(APART))" -n $(WORKERS) --dist loadgroup --durations=5

system: $(VENV)/.dev ## real processes over real Zenoh on 127.0.0.1, those of `make long` that are of this kind included
	$(PYTEST) -m system -n $(WORKERS) --dist loadgroup --durations=5

long: $(VENV)/.dev ## what takes minutes: teams on fields, recordings, growth, deaths, the laboratory, the documentation to its last line
	$(PYTEST) -m long -n 2 --dist loadgroup --durations=5

compose-test: $(VENV)/.dev ## the containers; skipped with its reason where no Docker engine answers
	$(PYTEST) -m compose --durations=5

rust-test: $(VENV)/.dev ## programs in Rust beside ours, the robot of examples/robot_rust and a ROS 2 node; skipped where there is no cargo
	$(PYTEST) tests/other -m "rust or ros" --durations=5

mutants: $(VENV)/.mutants ## change the pure rooms at random places and see whether the tests notice: MUTANTS=120 SEED=1 ONLY=board
	$(BIN)/python -m tests.mutants --count $(MUTANTS) --seed $(SEED) --only '$(ONLY)'

fuzz: $(VENV)/.dev ## every attack, and changed messages of every type, on a team in one process, in an hour: COUNT=2000000 SEED=1
	$(PYTEST) tests/hostile -m hostile
	$(BIN)/python -m tests.hostile.fuzz --count $(COUNT) --seed $(SEED)

adversary: COUNT = 200
adversary: $(VENV)/.dev ## search for the worst lie that one member can tell, on short teams in one process: COUNT=200 SEED=1
	@$(BIN)/python -m tests.hostile.adversary --count $(COUNT) --seed $(SEED)

nights: COUNT = 1000
nights: FIRST = 0
nights: MINUTES = inf
nights: $(VENV)/.dev ## whole teams in virtual time under faults that a seed draws, judged by oracles: COUNT=1000 SEED=1 FIRST=50 MINUTES=5
	@$(BIN)/python -m tests.nights --count $(COUNT) --seed $(SEED) --first $(FIRST) --minutes $(MINUTES)

soak: $(VENV)/.run ## a team in real time that is killed, frozen, restarted and cut off, and must stay as it is: MINUTES=10 SEED=1
	@$(BIN)/python -m blackboard.chaos soak --minutes $(MINUTES) --seed $(SEED)

bench: export OPENBLAS_NUM_THREADS := 1
bench: $(VENV)/.dev ## one table of ratios, pools, wire, team and processes, in about two minutes; python benchmarks/bench.py --json
	@$(BIN)/python benchmarks/bench.py

figures: $(VENV)/.plot ## the paper's figures and a page of them, into figures/, in about five minutes: SEEDS=4
	$(BIN)/blackboard figures --out figures --seeds $(SEEDS)

docs: $(VENV)/.docs ## the documentation as a site, in build/docs; warnings are errors
	@$(BIN)/sphinx-build -q -E -W --keep-going -b html docs build/docs
	@echo "build/docs/index.html"

bridges: $(VENV)/.dev ## tests of Rerun and Parquet in an environment of their own, $(VENV)-bridges: 850 MB
	@test -x $(VENV)-bridges/bin/pip || $(PYTHON) -m venv $(VENV)-bridges
	@$(VENV)-bridges/bin/python -m pip --disable-pip-version-check install --quiet --editable '.[rerun,table,dev]'
	$(VENV)-bridges/bin/python -m pytest tests/bridges tests/tape/test_door.py tests/judge/test_files.py

screenshots: $(VENV)/.dev ## docs/view.png, the picture of the page in the README; needs a Chromium
	$(BIN)/python -m tests.view.screenshots docs/view.png

wheels: | $(VENV)/bin/pip ## wheels/, from which the image is built offline: IMAGE_PYTHON=3.13 as in the base image
	$(PIP) download --quiet --dest $(WHEELS) --only-binary :all: --python-version $(IMAGE_PYTHON) \
	  --platform manylinux_2_28_$(MACHINE) --platform manylinux2014_$(MACHINE) hatchling '.[web]'

venv: $(VENV)/.dev ## the virtual environment for developers

# Stamps: an environment is set up again only when pyproject.toml has changed.
$(VENV)/.run: pyproject.toml | $(VENV)/bin/pip
	@echo "setting up $(VENV) (once)"
	@$(PIP) install --quiet --editable .
	@touch $@

$(VENV)/.dev: pyproject.toml | $(VENV)/bin/pip
	@echo "setting up $(VENV) with the developer's tools (once)"
	@$(PIP) install --quiet --editable '.[dev]'
	@touch $@ $(VENV)/.run

$(VENV)/.mutants: $(VENV)/.dev
	@$(PIP) install --quiet --editable '.[mutants]'
	@touch $@

$(VENV)/.plot: $(VENV)/.run
	@$(PIP) install --quiet --editable '.[plot]'
	@touch $@

$(VENV)/.docs: $(VENV)/.dev
	@$(PIP) install --quiet --editable '.[docs]'
	@touch $@

$(VENV)/bin/pip:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "$(PYTHON) is missing or older than 3.11: install Python 3.11 or newer, or say make PYTHON=/path/to/python3.12" >&2; exit 2; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
	  { echo "$(PYTHON) has no venv module: install it (on Debian and Ubuntu the package python3-venv)" >&2; exit 2; }
	@$(PYTHON) -m venv $(VENV)

clean: ## remove what make has made
	rm -rf $(VENV) $(VENV)-bridges .cargo-target .mypy_cache .ruff_cache .hypothesis build dist docs/commands.md docs/tables.md figures wheels
