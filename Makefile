# The two commands of the README, and the longer ones.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

.PHONY: run test lint bench race clean

run: $(INSTALLED)  ## compile the example bundle, verify the result
	$(BIN)/st-codegen examples/rv160n/models/ --target twincat --out build/rv160n
	$(BIN)/st-codegen verify examples/rv160n/models/ --generated build/rv160n

test: $(INSTALLED)  ## the whole test suite
	$(BIN)/python -m pytest -n 2 -q

lint: $(INSTALLED)  ## style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(INSTALLED)  ## times and memory of the compiler and the interpreter
	$(BIN)/python benchmarks/compiler.py

clean:
	rm -rf build $(VENV)

# the environment, from pinned versions with checksums
$(INSTALLED): requirements.lock pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $@
