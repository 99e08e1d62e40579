# The two commands of the README, and the longer ones.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
RACE := .venv-race
INSTALLED := $(VENV)/.installed


blind-form: $(INSTALLED)  ## reconcile on physics that is not its catalogue's, held-out seeds; build/blind_form.json; two hours
	$(BIN)/python -m tests.reconcile.blind_form.run --seeds heldout --cases 540 --jobs 2 --json build/blind_form.json
