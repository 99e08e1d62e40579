# The two commands of the README, and the longer ones.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

.PHONY: run test real lint bench blind clean

run: $(INSTALLED)  ## compile the example bundle, verify the result
	$(BIN)/st-codegen examples/rv160n/models/ --target twincat --out build/rv160n
	$(BIN)/st-codegen verify examples/rv160n/models/ --generated build/rv160n

test: $(INSTALLED)  ## the whole test suite
	$(BIN)/python -m pytest -n 2 -q

real: $(INSTALLED)  ## the models of the real rig on 100,000 inputs each, reconcile on its table; needs the measured data
	$(BIN)/python -m pytest -q -m slow tests/test_real_rig.py tests/reconcile/test_real_data.py

lint: $(INSTALLED)  ## style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(INSTALLED)  ## times and memory of the compiler and the interpreter
	$(BIN)/python benchmarks/compiler.py

blind: $(INSTALLED)  ## hidden effects on held-out seeds: three rounds of cases, rates in build/blind.json; takes an hour
	$(BIN)/python -m tests.reconcile.blind.run --seeds heldout --cases 348 --jobs 2 --json build/blind.json

clean:
	rm -rf build $(VENV)

# the environment, from pinned versions with checksums
$(INSTALLED): requirements.lock pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $@
