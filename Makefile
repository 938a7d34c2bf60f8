# Everything a newcomer needs is `make demo` and `make test`; the rest says so with `make help`.
# A virtual environment in .venv is made on first use; nothing outside this folder is touched.

SHELL := /bin/bash
.DEFAULT_GOAL := help

# The first of these that is Python 3.11 or later makes the environment; `make PYTHON=…` overrides.
PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11 python; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo $$p; break; }; done)

VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
SDK := clients/python
BENCHMARK := clients/benchmark
GYM := clients/gym
PROJECTS := pyproject.toml $(SDK)/pyproject.toml constraints.txt $(BENCHMARK)/pyproject.toml $(GYM)/pyproject.toml

# What only computes gives way to what has a clock at once, where the system can say so (Linux).
BESIDE := $(shell command -v chrt >/dev/null 2>&1 && echo 'chrt --idle 0' || echo 'nice -n 19')

export PIP_NO_INPUT := 1
# each process of a test would read every source anew
unexport PYTHONDONTWRITEBYTECODE

.PHONY: race sdks build-sdks help demo dog test test-clients test-all test-computing test-computing-beside test-clocked test-clocked-alone socketcan socketcan-long faults ros-peer fire fuzz schedules laws lint format docs bench pictures clean

help:  ## this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*##/\t/' | expand -t 16

demo: $(VENV)/.for-demo  ## arcs, then a walking robot dog, over Zenoh; the paths really taken: out/demo.png, out/dog.png
	@$(BIN)/python examples/demo.py examples/arcs.gcode --output out/demo.png
	@$(BIN)/python examples/demo.py examples/robot-dog.gcode --machine robot-dog --output out/dog.png

dog: $(VENV)/.for-demo  ## the robot dog of the demo alone: out/dog.png
	@$(BIN)/python examples/demo.py examples/robot-dog.gcode --machine robot-dog --output out/dog.png

# what has a clock mostly waits, three at a time; what only computes takes what is left of the cores, and is shown
# when it is through; both run whatever the other says. FIRST=…: targets to be made before those with a clock
test: $(VENV)/.for-development  ## the tests of the server, its commands, its drives and the Python SDK
ifdef ARGS
	$(BIN)/python -m pytest $(ARGS)
else
	@mkdir -p out; code=0; clocked=0; \
		$(MAKE) --no-print-directory test-computing-beside >out/test-computing.log 2>&1 & computing=$$!; \
		trap 'kill $$computing 2>/dev/null' EXIT; \
		echo "the tests that compute: beside these, out/test-computing.log"; \
		for each in $(FIRST); do $(MAKE) --no-print-directory $$each || code=1; done; \
		$(MAKE) --no-print-directory test-clocked || clocked=1; \
		wait $$computing || code=1; cat out/test-computing.log; \
		[ $$clocked = 0 ] || $(MAKE) --no-print-directory test-clocked-alone || code=1; exit $$code
endif

test-clients: build-sdks  ## the tests of SDKs in other languages, of the pages in Chromium and of editors
	@$(MAKE) --no-print-directory test-clocked CLOCKED=clients

test-all: build-sdks  ## both, together: every test
	@$(MAKE) --no-print-directory test CLOCKED='realtime or clients'

# beside others they get a core now and then: only what never ends is stopped
test-computing: $(VENV)/.for-development  ## the tests that only compute, on all cores
	$(BIN)/python -m pytest -m computing --numprocesses auto --dist worksteal --timeout 900 $(ARGS)

test-computing-beside:
	@exec $(BESIDE) $(MAKE) --no-print-directory test-computing ARGS="$(ARGS)"

CLOCKED := realtime
KEPT := .pytest_cache/clocked
PYTEST_CLOCKED := $(BIN)/python -m pytest -m '$(CLOCKED)' -o cache_dir=$(KEPT)
test-clocked: $(VENV)/.for-development  ## the tests with servers and buses, three at a time
	$(PYTEST_CLOCKED) --numprocesses 3 --dist loadscope --no-loadscope-reorder $(ARGS)

# a server, its drives and their reader that shared two cores with other tests may have been late, which is a
# fault for a machine: few of them get the computer for themselves, once, and are named
ALONE := 3
test-clocked-alone: $(VENV)/.for-development
	@failed=$$(grep -c '": true' $(KEPT)/v/cache/lastfailed); \
		[ "$$failed" -le $(ALONE) ] || { echo "$$failed tests failed, more than $(ALONE): not a matter of time"; exit 1; }; \
		echo "failed beside others, once more alone:"; cat $(KEPT)/v/cache/lastfailed; echo
	$(PYTEST_CLOCKED) --last-failed --last-failed-no-failures none

# QEMU, busybox and (once) Debian's kernel: deploy/qemu/README.md
# the emulated processor is an order of magnitude slower, and its files cannot be written: whatever its Python
# would compile or load in vain is compiled or left out here
GUEST := -m deploy.qemu -- env PYTEST_DISABLE_PLUGIN_AUTOLOAD=1 $(BIN)/python -m pytest \
	-p pytest_asyncio.plugin -p pytest_timeout -p no:cacheprovider
SOURCES := mcserver kinematics/mckinematics clients/python/mcclient tests
socketcan: $(VENV)/.for-development  ## the tests that need CAN interfaces, on vcan in QEMU
	@$(BIN)/python -m compileall -q $(SOURCES)
	@$(BIN)/python $(GUEST) $(or $(ARGS),-m 'not long' tests/socketcan)

socketcan-long: $(VENV)/.for-development  ## the gait and the arcs on four buses there: a quarter of an hour
	@$(BIN)/python -m compileall -q $(SOURCES)
	@$(BIN)/python $(GUEST) -m long tests/socketcan

# before the tests: several that build at once wait for each other
build-sdks: $(VENV)/.for-development
	@$(BIN)/python -m tests.sdks.build
	@$(BIN)/python -m tests.peers

sdks: $(VENV)/.for-development build-sdks  ## build the SDKs of other languages and drive them against a real server
	$(BIN)/python -m pytest tests/sdks $(ARGS)

race:  ## the tests of the Go SDK under the race detector, which needs a C compiler
	cd clients/go && go test -race -timeout 300s ./...

faults: $(VENV)/.for-development  ## each fault of a CAN drive in a moving group: what happened, in cycles
	@$(BIN)/python -m tests.e2e_can.faults $(ARGS)

lint: $(VENV)/.for-development  ## ruff (rules and format), mypy --strict, links of the pages
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(MAKE) --no-print-directory docs

docs: $(VENV)/.for-development  ## the pages as a site with a search, in out/site; make docs ARGS=--serve shows it while one writes
	@$(BIN)/python -m deploy.site $(ARGS)

format: $(VENV)/.for-development  ## rewrite the sources in the one format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(VENV)/.for-development  ## every figure beside a floor measured in the same run (decides no test)
	@$(BIN)/python -m tests.bench $(ARGS)

ros-peer:  ## a peer of another make for the tests of `mcserver ros`; needs cargo, takes minutes (tests/e2e/test_ros_peer.py)
	cargo build --locked --manifest-path tests/ros/peer/Cargo.toml

fire: $(VENV)/.for-development  ## programs over a bad link with stopped and killed processes; make fire ARGS="--minutes 60" (default: 10; root)
	@$(BIN)/python -m tests.fire $(ARGS)

fuzz: $(VENV)/.for-development  ## random inputs for all that takes bytes; make fuzz ARGS="--seconds 3600 --seed 2" (default: a minute)
	@$(BIN)/python -m tests.fuzz $(ARGS)

schedules: $(VENV)/.for-development  ## runs of the simulated cell; make schedules ARGS="--first 5000 --count 1000" (default: 20 000)
	@$(BIN)/python -m tests.bench.schedules $(ARGS)

laws: $(VENV)/.for-development  ## laws of motion on random programs; make laws ARGS="--first 0 --count 1000 --orders", or --servo (default: 10 000)
	@$(BIN)/python -m tests.bench.motion_laws $(ARGS)

pictures: $(VENV)/.for-development  ## draw the pictures of the documentation anew, by the product itself
	$(BIN)/mcserver plot examples/arcs.gcode --output docs/images/arcs.png
	$(BIN)/mcserver plot examples/helix.gcode --output docs/images/helix.png
	$(BIN)/mcserver plot examples/clearance.gcode --machine examples/post-and-door.toml --no-limits \
		--output docs/images/clearance.png || [ $$? = 1 ]  # it ends in a contact
	$(BIN)/mcserver plot examples/robot-dog.gcode --machine robot-dog --no-limits --output docs/images/dog.png
	$(BIN)/mcserver plot examples/mill-part.gcode --machine examples/mill.toml --no-limits \
		--output docs/images/mill-part.png
	$(BIN)/python -m tests.bench.pictures servo docs/images/servo.png
	$(BIN)/python -m tests.bench.pictures shaping docs/images/shaping.png
	$(BIN)/python -m tests.bench.pictures backlash docs/images/backlash.png
	$(BIN)/python -m tests.bench.pictures threading docs/images/threading.png
	$(BIN)/python -m tests.bench.pictures conveyor docs/images/conveyor.png
	$(BIN)/python -m tests.bench.pictures arm_conveyor docs/images/arm-conveyor.png
	$(BIN)/python -m tests.browser.picture docs/images
	$(BIN)/python -m tests.motion.picture docs/images/chords.png docs/images/stretches.png

clean:  ## remove what the other targets made
	rm -rf $(VENV) .qemu out build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(BIN)/python:
	@if [ -z "$(PYTHON)" ]; then \
		echo "Python 3.11 or later is needed and was not found: install it, or give make PYTHON=/path/to/python" >&2; exit 1; fi
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
		echo "$(PYTHON) has no venv module: on Debian and Ubuntu, apt-get install python3-venv" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(PIP) install --quiet --no-compile --upgrade 'pip>=25.1'

# pip ≥ 25.1 reads [dependency-groups]; the stamps are remade when a project file changes. pip would compile one
# module after the other, those of its packages' own tests too. What few or none of the modules are imported of is
# compiled by whoever does: pip itself, what has machine code beside its sources (mypy), lexers of other languages
CONSTRAINTS := constraints.txt
INSTALL := $(PIP) install --quiet --no-compile --constraint $(CONSTRAINTS)
SELDOM := /(tests|cuda|docutils|fontTools|graphql|lexers|mypyc?|pip|pkg_resources|schemathesis|scipy|setuptools)/
COMPILE = $(BIN)/python -m compileall -qq -j 0 -x '$(SELDOM)' $(VENV)/lib >/dev/null || true
# beside what comes next: a server does not wait for it, tests do
WARM_UP = $(BIN)/python -m mcserver.motion.warm_up background >/dev/null 2>&1 &

$(VENV)/.for-demo: $(PROJECTS) | $(BIN)/python
	$(INSTALL) --editable '.[plot]' --editable '$(SDK)[cli]'
	@$(WARM_UP)
	@$(COMPILE)
	@touch $@

# on a new clone not behind the other one: what both need is looked for and installed once
$(VENV)/.for-development: $(PROJECTS) | $(BIN)/python
	$(INSTALL) --editable '.[plot,web,lsp,mcp]' --editable '$(SDK)[cli]' --editable $(BENCHMARK) --editable $(GYM) --group dev
	@$(WARM_UP)
	@$(COMPILE)
	@touch $(VENV)/.for-demo $@
