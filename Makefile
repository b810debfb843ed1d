# make demo        plays the thesis' cases, standard against corrected: a table and pictures in out/demo
# make test        a core of every area's tests, three files at a time (JOBS=4 for more), in about six minutes
# make test-all    all tests, as in CI, in half an hour; a test that fails runs once more, alone, and is reported as flaky if it then passes
# make coverage    the tests of `make test`, and which lines they run in all processes: out/coverage
# make manual      writes docs/man after a change of a command
# make wheel       builds the distributions into dist, the wheel for every instruction set, and tries it in an empty environment
# make lock        writes the newest exact versions and hashes of all packages (requirements/)
# make release VERSION=x.y.z checks the requirements of a release, builds it twice, tries it, and prints the next steps
# make lint        ruff and mypy, as CI does
# make prove       shows in a few minutes that no committed step is lost and no wrong input accepted: out/prove/proof.json
#                  (PROVE="--only soak" for some)
# make prove-full  the same with many more repetitions, for a night
# make sanitize    tests of the numerics on kernels that check every index, address, operation and race, an hour
# make nightly     the parts that take hours and rarely fail: sanitizers, the demo without a compiler, prove-full
# make peers       compares with OpenFOAM, Kratos and textbook RBF, as far as they are installed (benchmarks/README.md)
# make bench       measures run times up to five million nodes, the correction, and every system that is installed: one page, twenty minutes
# make bench-quick the most important of these figures, in three minutes
# make track       measures figures of this commit with asv and shows all tracked commits: out/asv/html
#                  (COMMITS="v1..main --steps 10" for others)
# make studies     recomputes every table and figure of docs/thesis.md, beyond.md, explained.md and choosing.md (STUDY="name …" for some)
# make docs        builds the documentation site into out/docs, without a warning, every link checked (open out/docs/index.html)
# make adapters    builds and tests the clients whose tools are installed, and says which are not (adapters/README.md)
# make mok         runs the Mok benchmark in Kratos with its own mesh solver and with the server, two minutes (adapters/kratos/README.md)
# make flap        the perpendicular flap with OpenFOAM, CalculiX and the server against its published reference, six minutes
# make turek       Turek and Hron's FSI3 on three meshes against the published figures, hours; continues where it stopped
#                  (CASE=fsi2, SOLVER=kratos)
# make docker      builds the images and couples server, mock fluid and mock solid: out/docker
# make docker-openfoam  the same with OpenFOAM and CalculiX
#
# Each command makes the virtual environment itself. PYTHON=python3.12 chooses another interpreter (3.11 or newer), LOCKED=1 the
# versions of requirements/dev.lock instead of the newest.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DRIVERS := out/drivers
# Tests of so many files at a time: half of them wait for other processes, so three suit two cores.
JOBS ?= 3
PYTEST = -n $(JOBS) --dist loadfile --no-loadscope-reorder --durations 40 --durations-min 5

# Tests start some thousand processes: each would compile the same sources again.
unexport PYTHONDONTWRITEBYTECODE
# Paths and options of `make test-all`; tests that start pytest themselves must not have them.
unexport TESTS

.DEFAULT_GOAL := help
.PHONY: help demo test test-all test-fast coverage wheel release manual lock lint format prove prove-full drivers nightly sanitize sanitize-addresses sanitize-threads peers bench bench-quick track studies docs adapters mok flap turek docker docker-openfoam clean

help:
	@sed -n '1,31s/^# \{0,1\}//p' Makefile

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "Python 3.11 or newer is needed; $(PYTHON) is older. Try: make PYTHON=python3.12 …"; exit 1; }
	$(PYTHON) -m venv $(VENV)

# LOCKED=1 installs the versions of requirements/dev.lock, checked by their hashes, instead of the newest.
LOCKED_PACKAGES = $(if $(LOCKED),$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes -r requirements/dev.lock)

# What runs the server and draws. The kernels are built for this machine; MESH_MOTION_LEVELS=all builds every instruction set.
CLIENT := adapters/python
KERNELS := $(shell find numerics/kernels -type f -not -name '*.pyc')
$(VENV)/.runtime: $(BIN)/python pyproject.toml $(CLIENT)/pyproject.toml numerics/pyproject.toml $(KERNELS)
	$(LOCKED_PACKAGES)
	$(BIN)/pip install --quiet --disable-pip-version-check -e $(CLIENT) -e numerics -e '.[server,plot]'
	@touch $@

$(VENV)/.development: $(VENV)/.runtime
	$(BIN)/pip install --quiet --disable-pip-version-check -e '.[dev]'
	@touch $@

demo: $(VENV)/.runtime
	$(BIN)/mesh-motion demo --out out/demo

test: $(VENV)/.development
	$(BIN)/pytest -m "not nightly" $(PYTEST)

test-all: $(VENV)/.development
	$(BIN)/python -m pytest --hypothesis-profile many $(PYTEST) $(TESTS) || { [ $$? = 1 ] \
	  && $(BIN)/python -m pytest --hypothesis-profile many -n1 --last-failed --last-failed-no-failures none -rA --show-capture no $(TESTS) \
	  && echo "FLAKY: these tests failed next to others, and passed alone"; }

test-fast: $(VENV)/.development
	$(BIN)/pytest -m "not slow"

coverage: $(VENV)/.development
	$(BIN)/pip install --quiet --disable-pip-version-check 'coverage>=7.10'
	mkdir -p out/coverage && rm -f out/coverage/data*
	$(BIN)/coverage run -m pytest -m "not nightly" $(PYTEST)
	$(BIN)/coverage combine --quiet && $(BIN)/coverage html --quiet
	$(BIN)/coverage report --format=markdown > out/coverage/report.md && tail -n 1 out/coverage/report.md

manual: $(VENV)/.development
	$(BIN)/python -m tools.manual_pages
	$(BIN)/python -m docs.site.reference

# Every package of the four environments with its version and hashes, for each system and Python that is supported.
lock: $(BIN)/python
	$(BIN)/pip install --quiet --disable-pip-version-check uv
	for name in build client server dev; do \
	  case $$name in build) from=requirements/build.in;; client) from=$(CLIENT)/pyproject.toml;; dev) from="--extra dev --extra docs pyproject.toml";; *) from="--extra $$name pyproject.toml";; esac; \
	  $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --no-annotate \
	    --no-emit-package mesh-motion-server --no-emit-package mesh-motion-client --no-emit-package mesh-motion-numerics --custom-compile-command "make lock" $$from -o requirements/$$name.lock || exit 1; \
	done

wheel: $(VENV)/.development
	$(BIN)/python -m tools.wheel

# RELEASE='--tag --no-tests' tags what has been checked.
release: $(VENV)/.development
	@$(BIN)/python -m tools.release "$(VERSION)" $(RELEASE)

lint: $(VENV)/.development
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(VENV)/.development
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

prove: $(VENV)/.development drivers
	PATH=$(CURDIR)/$(DRIVERS):$$PATH $(BIN)/python -m tests.faults $(PROVE) --out out/prove

prove-full: $(VENV)/.development drivers
	PATH=$(CURDIR)/$(DRIVERS):$$PATH $(BIN)/python -m tests.faults --full --out out/prove-full

# The row of conformance drives the clients in C, C++ and Fortran too, where their tools are installed.
drivers:
	@if ! command -v cmake >/dev/null || ! command -v g++ >/dev/null || ! pkg-config --exists libzmq 2>/dev/null; then \
	  echo "The C, C++ and Fortran clients are left out: cmake, g++, pkg-config or libzmq's headers are not installed"; \
	else \
	  cmake -S adapters/c -B $(DRIVERS) -DMESH_MOTION_CONFORMANCE=ON --log-level=WARNING \
	    -DMESH_MOTION_FORTRAN=$$(command -v gfortran >/dev/null && echo ON || echo OFF) >/dev/null \
	  && cmake --build $(DRIVERS) >/dev/null; \
	fi

# The sanitizer's library must be loaded before Python; Python's own arenas and leaks at its end are not our matter. Without
# -S the editable install would find its own kernels first, whatever PYTHONPATH says. OpenBLAS is not instrumented: none of its threads.
# No second runs here nor in `make prove`: a race, or a broken promise, that shows itself once is a fault.
SANITIZED = cmake -S numerics/kernels -B out/sanitize/$(1) -DMESH_MOTION_LEVELS=v3 -DMESH_MOTION_SANITIZE=$(2) \
    -DPython_EXECUTABLE=$(CURDIR)/$(BIN)/python --log-level=WARNING && cmake --build out/sanitize/$(1) -j $(JOBS) \
  && LD_PRELOAD="$$($(CXX) -print-file-name=$(3)) $$($(CXX) -print-file-name=libstdc++.so)" PYTHONPATH=$(CURDIR)/out/sanitize/$(1):$(CURDIR):$(CURDIR)/$(CLIENT):$(CURDIR)/numerics:$$($(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))') \
    ASAN_OPTIONS=detect_leaks=0 UBSAN_OPTIONS=halt_on_error=1 TSAN_OPTIONS=halt_on_error=1:die_after_fork=0 MESH_MOTION_THREADS=3 OPENBLAS_NUM_THREADS=1 \
    $(BIN)/python -S -m pytest -q -m "not nightly" --timeout 3000 -o faulthandler_timeout=3600 -p no:cacheprovider $(SANITIZED_TESTS)
SANITIZED_TESTS ?= tests/kernels tests/numerics
sanitize: sanitize-addresses sanitize-threads
sanitize-addresses: $(VENV)/.development
	$(call SANITIZED,address,address$(comma)undefined,libasan.so)
sanitize-threads: $(VENV)/.development
	$(call SANITIZED,thread,thread,libtsan.so)
comma := ,

nightly: sanitize prove-full
	tools/without_compiler.sh $(MAKE) demo VENV=out/bare

peers: $(VENV)/.development
	$(BIN)/python -m benchmarks.peers --out out/peers --threads 1

bench: $(VENV)/.development
	$(BIN)/python -m benchmarks --out out/bench --meshes out/meshes

bench-quick: $(VENV)/.development
	$(BIN)/python -m benchmarks --plan quick --minutes 2.5 --repeat 2 --out out/bench-quick --meshes out/meshes

COMMITS = HEAD^!
track: $(VENV)/.development
	$(BIN)/pip install --quiet --disable-pip-version-check asv virtualenv
	$(ASV) machine --yes
	$(ASV) run --skip-existing-successful $(COMMITS)
	$(ASV) publish
ASV = $(BIN)/asv --config benchmarks/asv.conf.json

studies: $(VENV)/.development
	$(BIN)/python -m docs.studies $(STUDY)

docs: $(VENV)/.development
	$(BIN)/pip install --quiet --disable-pip-version-check -e '.[docs]'
	$(BIN)/python -m docs.site out/docs

adapters: $(VENV)/.development
	$(BIN)/python adapters/check.py

mok: $(VENV)/.development
	PYTHONPATH=adapters/kratos $(BIN)/python -m mok_benchmark --out out/mok

flap: $(VENV)/.development
	$(BIN)/python examples/perpendicular_flap/proof.py --out out/flap

CASE = fsi3
SOLVER = openfoam
turek: $(VENV)/.development
	PYTHONPATH=adapters/kratos $(BIN)/python examples/turek_hron_fsi/proof.py $(CASE) --solver $(SOLVER) --out out/turek

# The plugin of today, or docker-compose 1. The result comes from the stopped container to out/docker, as the caller's own.
COMPOSE = $$(docker compose version >/dev/null 2>&1 && echo docker compose || echo docker-compose) --profile $(1)
COMPOSED = compose="$(COMPOSE)" && $$compose up --build --abort-on-container-exit --exit-code-from $(2) \
  && mkdir -p out/docker && docker cp "$$($$compose ps -aq $(2))":/results/. out/docker && ls out/docker
docker:
	$(call COMPOSED,mock,fluid)

docker-openfoam:
	$(call COMPOSED,openfoam,flap)

clean:
	rm -rf $(VENV) out dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
