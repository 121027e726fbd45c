# Every target builds .venv itself; only Python 3.11 or later and make are needed.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.ready
# A process takes one file after the other in their order, so that those of whole fleets, which take
# longest, begin first. Two share a core where many tests wait for others; unit tests wait for nothing,
# and each process loads all libraries and reads all tests.
CORES := $(shell $(PYTHON) -c 'import os; print(os.cpu_count())')
PYTEST := $(BIN)/python -m pytest --maxprocesses 8 --dist loadfile --no-loadscope-reorder

# What one of the hundreds of processes has compiled, the next one only reads.
unexport PYTHONDONTWRITEBYTECODE
# There are more processes than cores, and what a second thread waits in costs a seventh more time.
export OPENBLAS_NUM_THREADS := 1

BROWSER := chromium google-chrome chrome

.DEFAULT_GOAL := help
.PHONY: help demo test unit lint check browser goldens soak power-loss mutants bench bench-fleet bench-page bench-sim bench-analysis bench-closeloop bench-closeloop-unkind curves picture \
	measurement measurements-age clean

help:  ## Say what each target does
	@grep -hE '^[a-z-]+:.*## ' Makefile | awk -F ':.*## ' '{printf "  make %-17s %s\n", $$1, $$2}'

demo: $(READY)  ## Run the paper's two-phase study here, small; Ctrl-C and again resumes
	$(BIN)/rehyb campaign run --preset demo --local-workers 2 --directory demo

browser:  ## Install Chromium, in which tests look at the pages, where there is apt (once, as root)
	@for name in $(BROWSER); do command -v $$name && exit; done; \
	if command -v apt-get >/dev/null; then apt-get update && apt-get install --yes chromium; \
	else echo "install Chromium or Chrome: without one the tests of the pages are skipped"; fi

test: $(READY)  ## Run every test (unit, integration with real processes, acceptance)
	$(PYTEST) --numprocesses $$((2 * $(CORES)))

unit: $(READY)  ## Run the unit tests, which take seconds
	$(PYTEST) --numprocesses $(CORES) tests/unit

lint: $(READY)  ## Look at style, format, types and which room imports which
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

check: lint unit  ## What to run before each commit: lint and unit

goldens: $(READY)  ## Write what a user sees to DIR, to compare two trees by diff -r
	$(BIN)/python -m tests.testbed.goldens $(or $(DIR),$(error make goldens DIR=folder))

soak: $(READY)  ## Disturb studies in every way, twenty times over; an hour
	REHYB_SOAK_ROUNDS=20 REHYB_PROTOCOL_STORIES=200 REHYB_CONTRACT=100 REHYB_FUZZ=2000 $(BIN)/python -m pytest -s \
		tests/acceptance/test_chaos.py tests/acceptance/test_acknowledged.py \
		tests/integration/server/test_protocol.py tests/integration/server/routes/test_contract.py \
		tests/integration/server/routes/test_fuzz.py \
		tests/integration/analysis/closeloop/test_spoilt_files.py \
		tests/integration/models/test_spoilt_files.py

mutants: $(READY)  ## Break what decides in every small way, and list what no test notices (ROOM="server.logic.fleet*")
	$(BIN)/mutmut run $(if $(ROOM),"$(ROOM)")
	$(BIN)/mutmut results

power-loss: $(READY)  ## Cut the power at every commit of a study, each in a hundred ways
	REHYB_POWER_CUTS=100 $(BIN)/python -m pytest tests/integration/server/store/test_power_loss.py

bench: .venv/.rivals  ## Print the figures that README and docs quote, and rivals beside them
	$(BIN)/python -m benchmarks.simulation.table_1
	$(BIN)/python -m benchmarks.service.side_by_side
	$(BIN)/python -m benchmarks.service.on_postgresql
	$(BIN)/python -m benchmarks.service.cycle
	$(BIN)/python -m benchmarks.service.own_models
	$(MAKE) bench-analysis

bench-fleet: $(READY)  ## Print how many pilots of 32 cores a coordinator carries (8 minutes at most)
	$(BIN)/python -m benchmarks.service.fleet

bench-page: $(READY)  ## Print what 50 open pages cost the coordinator, and when a page first paints
	$(BIN)/python -m benchmarks.service.page

bench-sim: $(READY)  ## Print what an assessment costs and how the fidelities agree (8 minutes)
	$(BIN)/python -m benchmarks.simulation.fidelities

curves: $(READY)  ## Draw what each factor does alone (docs/measurements/one_at_a_time.png)
	$(BIN)/python -m benchmarks.simulation.one_at_a_time docs/measurements/one_at_a_time.png

bench-analysis: $(READY)  ## Errors, coverage and speed of the indices beside SALib, SciPy and OpenTURNS
	$(BIN)/python -m benchmarks.sensitivity.indices
	$(BIN)/python -m benchmarks.sensitivity.hard
	$(BIN)/python -m benchmarks.sensitivity.opponents
	$(BIN)/python -m benchmarks.sensitivity.curves
	$(BIN)/python -m benchmarks.sensitivity.rivals

bench-closeloop: $(READY)  ## Print how often closing the loop names the right effect
	$(BIN)/python -m benchmarks.closeloop.synthetic $(ARGS)

bench-closeloop-unkind: $(READY)  ## The same on robots under control with unkind sensors (ARGS="--jobs 2 --arms 20")
	$(BIN)/python -m benchmarks.closeloop.unkind $(ARGS)

picture: $(READY)  ## Draw the arm in the exoskeleton (docs/understand/system.png), and with passive joints
	$(BIN)/python -m sim.pictures.rendering docs/understand/system.png
	$(BIN)/python -m sim.pictures.rendering docs/pictures/passive.png nesm_passive

measurement: $(READY)  ## Run the command of docs/measurements/PAGE.md and write its figures (PAGE=cycle)
	$(BIN)/python -m benchmarks.measurement $(PAGE)

measurements-age: $(READY)  ## Say which of these pages are older than the code that they measure
	$(BIN)/python -m benchmarks.measurement

clean:  ## Remove .venv and what the targets wrote; a demo's results go too
	rm -rf .venv demo validation *.egg-info .mypy_cache .ruff_cache .pytest_cache

$(READY): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo "rehyb needs Python 3.11 or later: make PYTHON=python3.11 ..."; exit 2; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $(READY)

.venv/.rivals: $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[rivals]'
	@touch $@
