# The two commands of the README, and the longer ones.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
RACE := .venv-race
INSTALLED := $(VENV)/.installed

.PHONY: run test real lint bench race soak clean

run: $(INSTALLED)  ## compile the example bundle, verify the result
	$(BIN)/st-codegen examples/rv160n/models/ --target twincat --out build/rv160n
	$(BIN)/st-codegen verify examples/rv160n/models/ --generated build/rv160n

test: $(INSTALLED)  ## the whole test suite
	$(BIN)/python -m pytest -n 2 -q

real: $(INSTALLED)  ## the models of the real rig, each on 100,000 inputs; needs the measured tables
	$(BIN)/python -m pytest -q -m slow tests/test_real_rig.py

lint: $(INSTALLED)  ## style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(INSTALLED)  ## times and memory of the compiler and the interpreter
	$(BIN)/python benchmarks/compiler.py

race: $(RACE)/.installed  ## the emitted text, as C, against what others generate; writes build/race.json
	@command -v gcc > /dev/null || { echo "the race needs a C compiler: apt-get install gcc libc6-dev"; exit 2; }
	@command -v valgrind > /dev/null || echo "instructions are not counted without valgrind: apt-get install valgrind"
	$(RACE)/bin/python benchmarks/race.py $(CASES)

soak: $(INSTALLED)  ## 100,000 hostile sequences through the blocks of the compensation, about 5 minutes
	$(BIN)/python -m pytest -q -m slow tests/application
	$(BIN)/python -m tests.application.hostile

clean:
	rm -rf build $(VENV) $(RACE)

# the environment, from pinned versions with checksums
$(INSTALLED): requirements.lock pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $@

# what the race compares with: its own environment, since some of it needs old versions
$(RACE)/.installed: benchmarks/requirements-race.txt
	$(PYTHON) -m venv $(RACE)
	$(RACE)/bin/python -m pip install --quiet --disable-pip-version-check --requirement benchmarks/requirements-race.txt
	touch $@
