# make demo   plays the thesis' cases, standard against corrected: a table and pictures in out/demo
# make test   runs every test
# make lint   ruff and mypy, as CI does
# make prove  shows in a few minutes that nothing committed is lost and nothing wrong let in: a line each, out/prove/proof.json
# make prove-full the same with the counts of a night
# make mutants changes journal, session and codec in small ways and shows that the tests notice (tests/mutation), ten minutes
# make peers  compares with OpenFOAM, Kratos and textbook RBF, as far as they are installed (benchmarks/README.md)
# make bench  measures growth to five million nodes, the correction and every system installed: one page, twenty minutes
# make bench-quick the most telling of it in three minutes
# make studies recomputes every table and figure of docs/thesis.md and docs/beyond.md (STUDY="name …" for some)
# make adapters builds and tests the clients whose tools are installed, and says which are not (adapters/README.md)
# make docker builds the images and runs server + mock fluid + mock solid (needs a Docker engine)
#
# Each makes the virtual environment by itself. PYTHON=python3.12 chooses another interpreter (3.11 or newer).

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

# The kernels' threads sleep while they wait, as the server's workers set it: on a busy machine spinning costs more.
export OMP_WAIT_POLICY ?= passive

.DEFAULT_GOAL := help
.PHONY: help demo test test-fast lint format prove prove-full mutants peers bench bench-quick studies adapters docker clean

help:
	@sed -n '1,14s/^# \{0,1\}//p' Makefile

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "Python 3.11 or newer is needed; $(PYTHON) is older. Try: make PYTHON=python3.12 …"; exit 1; }
	$(PYTHON) -m venv $(VENV)

# What runs the server and draws; the kernels are compiled once here, so that no session waits for them.
$(VENV)/.runtime: $(BIN)/python pyproject.toml
	$(BIN)/pip install --quiet --disable-pip-version-check -e '.[server,plot]'
	$(BIN)/mesh-motion version --warm
	@touch $@

$(VENV)/.development: $(VENV)/.runtime
	$(BIN)/pip install --quiet --disable-pip-version-check -e '.[dev]'
	@touch $@

demo: $(VENV)/.runtime
	$(BIN)/mesh-motion demo --out out/demo

test: $(VENV)/.development
	$(BIN)/pytest

test-fast: $(VENV)/.development
	$(BIN)/pytest -m "not slow"

lint: $(VENV)/.development
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(VENV)/.development
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

prove: $(VENV)/.runtime
	$(BIN)/mesh-motion prove --out out/prove

prove-full: $(VENV)/.runtime
	$(BIN)/mesh-motion prove --full --out out/prove-full

mutants: $(VENV)/.development
	$(BIN)/python tests/mutation

peers: $(VENV)/.development
	$(BIN)/python -m benchmarks.peers --out out/peers --threads 1

bench: $(VENV)/.development
	$(BIN)/python -m benchmarks --out out/bench --meshes out/meshes

bench-quick: $(VENV)/.development
	$(BIN)/python -m benchmarks --plan quick --minutes 2.5 --repeat 2 --out out/bench-quick --meshes out/meshes

studies: $(VENV)/.development
	$(BIN)/python -m docs.studies $(STUDY)

adapters: $(VENV)/.development
	$(BIN)/python adapters/check.py

docker:
	docker-compose up --build --abort-on-container-exit --exit-code-from fluid

clean:
	rm -rf $(VENV) out dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
