# warm, demo, test, test-fast, soak, fuzz, lint, bench, engines, tables, board, docs: each sets itself up on a fresh Debian or Ubuntu with Python >= 3.11.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
SYSTEM_READY := $(VENV)/.system-ready

# EGL and Mesa's software renderer for the GL methods; libusb and libgomp for Open3D.
SYSTEM_PACKAGES := libegl1 libgl1 libgl1-mesa-dri libegl-mesa0 libusb-1.0-0 libgomp1
# Only the tests: real models that nobody here wrote, a browser for the pages, and what compiles and
# runs the recorders.
TEST_PACKAGES := assimp-testmodels chromium gcc g++ libc6-dev nodejs

# Where the environment forbids bytecode to be kept, every process that a test starts would compile
# all source again.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: board demo docs test test-fast warm soak fuzz lint bench engines tables setup clean
.DELETE_ON_ERROR:

setup: $(READY) $(SYSTEM_READY)

$(READY): pyproject.toml constraints.txt tools/pip-install
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "visref needs Python 3.11 or newer; run: make PYTHON=python3.11 ..." >&2; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); \
	  tools/apt-install python3-venv && $(PYTHON) -m venv $(VENV); }
	@tools/pip-install $(BIN)/python --editable '.[dev,docs,plots,open3d,collada,usd,ifc,dask]'
	@touch $@

$(SYSTEM_READY): $(READY) tools/apt-install
	@tools/apt-install $(SYSTEM_PACKAGES) $(TEST_PACKAGES)
	@touch $@

# What is compiled, ahead: in as many processes as there are cores, and once for all of them.
warm: setup
	@$(BIN)/visref warm

demo: warm
	@$(BIN)/visref demo --out demo

# The rules of accessibility that a browser asks of the report's page. Where there is no npm, or
# nothing can be fetched, that test says that it was left out.
AXE := node_modules/axe-core/axe.min.js

$(AXE):
	-@npm install --silent --no-save --no-package-lock axe-core

test: warm $(AXE)
	$(BIN)/python -m pytest -n auto --dist worksteal --durations=40

test-fast: warm
	$(BIN)/python -m pytest -n auto --dist worksteal -m "not slow"

# Random cases against a brute force in whole numbers, and runs killed at random moments; `make
# test` holds the first of each.
soak: setup
	$(BIN)/python -u -m tests.fuzz_verdicts
	$(BIN)/python -u -m tests.kills
	$(BIN)/python -u -m tests.kills going-on
	VISREF_WHOLE=1 $(BIN)/python -m pytest -q -n auto --dist worksteal tests/mutants \
	  tests/conformance tests/culling/test_plp.py \
	  -k "conforms or passes_the_cases_as_files or passes_every_check or convicted_by_its_name"
	VISREF_WHOLE=1 $(BIN)/python -m pytest -q -n auto --dist worksteal tests/property tests/exact \
	  tests/engines

# Spoilt files of every kind, for so many seconds; `make test` holds a short run of each target.
FUZZ_SECONDS := 600
FUZZ_JOBS := 2
fuzz: setup
	FUZZ_SECONDS=$(FUZZ_SECONDS) FUZZ_JOBS=$(FUZZ_JOBS) $(BIN)/python -m tests.fuzz

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# A JSON file in benchmarks/history, and docs/benchmarks.md made of all of them; some 15 minutes.
# BENCH="--only cast" measures one kind; `python -m benchmarks --help` has the rest.
BENCH :=
bench: warm
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	  --constraint constraints.txt --editable '.[bench]' || echo "without Mitsuba" >&2
	$(BIN)/python -m benchmarks $(BENCH)

# Other people's engines, which examples/engines records and docs/engines tells of, and their tests.
# What cannot be had here skips its tests, with the reason.
ENGINE_PACKAGES := g++ libopenscenegraph-dev openarena-081-maps
engines: warm
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	  --constraint constraints.txt --editable '.[engines]'
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps \
	  --editable examples/engines/bsp
	@tools/apt-install $(ENGINE_PACKAGES) || echo "without OpenSceneGraph and maps" >&2
	@command -v npm >/dev/null || tools/apt-install npm || echo "without npm" >&2
	cd examples/engines && { npm install --no-package-lock --ignore-scripts --no-audit --no-fund \
	  --silent || echo "without the engines of the web" >&2; }
	$(BIN)/python -m pytest -q tests/examples/engines

# The papers' tables, on so many frames of each path, and the documentation made from them.
TABLES := tables
tables: setup
	$(BIN)/visref tables --frames 20 --out $(TABLES)
	tools/tables-to-docs $(TABLES)

# The documentation as a site, with warnings as errors.
docs: $(READY)
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo "site/index.html"

# Every method on board on scenes of ours and of others, and docs/board.md made from it.
MODELS := /usr/share/assimp/models
board: setup
	mkdir -p board
	$(BIN)/visref path orbit $(MODELS)/glTF2/2CylinderEngine-glTF-Binary/2CylinderEngine.glb \
	  --frames 8 --out board/engine.path.json
	$(BIN)/visref path walk $(MODELS)/IFC/AC14-FZK-Haus.ifc --frames 8 --out board/house.path.json
	$(BIN)/visref batch docs/board.toml --out board/batch || test $$? -eq 1
	$(BIN)/visref report board/batch/runs/* --board docs/board.md || test $$? -eq 1

clean:
	rm -rf $(VENV) board demo tables build dist site examples/engines/node_modules examples/engines/openscenegraph/build
