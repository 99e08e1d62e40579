# The two commands of the README, and the longer ones.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
RACE := .venv-race
INSTALLED := $(VENV)/.installed

.PHONY: run test thorough pictures site real blark soak soak-long fuzz sbom audit lint sizes nightly bench clean tables train-long blind blind-form mutate mutants example commissioning race bound kills peers pythons

run: $(INSTALLED)  ## compile the example bundle, verify the result
	$(BIN)/st-codegen examples/rv160n/models/ --target twincat --out build/rv160n
	$(BIN)/st-codegen verify examples/rv160n/models/ --generated build/rv160n

# Two processes share the cores: threads of libraries inside them would spin beside each other. A process that has nothing
# left takes tests from the other one. What is compiled is kept even where the environment says otherwise: both of them,
# and each command that a test starts, would compile the package anew.
TESTS := PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist worksteal -q

test: $(INSTALLED)  ## the quick tests, some 8 minutes of two cores: all but those marked slow or thorough
	$(TESTS)

thorough: $(INSTALLED)  ## the tests marked thorough, as many minutes again: CI runs them after the quick ones
	$(TESTS) -m 'thorough and not slow'

real: $(INSTALLED)  ## the models of the real rig on 100,000 inputs each, reconcile on its table, motions with it; needs the measured data
	$(BIN)/python -m pytest -q -m slow tests/proof/test_real_rig.py tests/reconcile/test_real_data.py tests/rig/test_example.py

blark: $(INSTALLED)  ## every generated TwinCAT file through an independent parser
	$(BIN)/python -m pytest -q -m slow tests/emit/targets/test_blark.py

# the measured tables, and how thoroughly to search: DATA=FOLDER FOLDS=10 for the paper's own number of folds
DATA ?= ../shared/data
FOLDS ?= 3

tables: $(INSTALLED)  ## tables 2 to 6 of the paper, ours beside theirs; some 3 minutes of two cores, stopped runs go on
	$(BIN)/st-codegen tables $(DATA) --folds $(FOLDS) --out build/tables --work build/fits.sqlite

train-long: $(INSTALLED)  ## the search and a fleet on a Dask cluster of which a worker is killed
	$(BIN)/python -m pytest -q -m slow tests/training tests/fleet

sizes: $(INSTALLED)  ## files and tables of millions of numbers
	$(BIN)/python -m pytest -q -m slow tests/walkers tests/st

pythons:  ## this suite on Python 3.13 and 3.14, those of Debian's trixie and sid; needs root, debootstrap and a network
	.ci/pythons

nightly: $(INSTALLED)  ## the property tests with twenty times as many examples, new ones each time
	HYPOTHESIS_PROFILE=nightly $(TESTS) -m 'not slow'

fuzz: $(INSTALLED)  ## damaged files of every kind for ten minutes of all cores, in processes with limits; build/fuzz/ keeps what fails
	$(BIN)/python -m tests.fuzz --seconds 600

kills: $(INSTALLED)  ## train, tables, simulate and reconcile killed at random moments, and run again; some 10 minutes
	$(BIN)/python -m pytest -q -m slow tests/cli/test_kills.py

sbom: requirements.lock  ## software bill of materials of the pinned packages, build/sbom.json; installs its tool: needs a network
	$(PYTHON) -m venv build/audit
	build/audit/bin/python -m pip install --quiet --disable-pip-version-check cyclonedx-bom
	build/audit/bin/cyclonedx-py requirements requirements.lock --output-file build/sbom.json

audit: requirements.lock  ## known vulnerabilities of the pinned packages; installs its tool and asks a database: needs a network
	$(PYTHON) -m venv build/audit
	build/audit/bin/python -m pip install --quiet --disable-pip-version-check pip-audit
	build/audit/bin/pip-audit --require-hashes --disable-pip --requirement requirements.lock

lint: $(INSTALLED)  ## style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(INSTALLED)  ## times and memory of the compiler and of the engine for Structured Text
	$(BIN)/python benchmarks/compiler.py
	$(BIN)/python benchmarks/interpreter.py
	$(BIN)/python benchmarks/campaign.py

soak: $(INSTALLED)  ## 100,000 hostile sequences through the blocks of the compensation, about 5 minutes
	$(BIN)/python -m pytest -q -m slow tests/te
	$(BIN)/python -m tests.te.hostile

soak-long: $(INSTALLED)  ## 5 million calls without a restart: a year's angles, counters that wrap
	$(BIN)/python -m tests.te.hostile --long

blind: $(INSTALLED)  ## hidden effects on held-out seeds: three rounds of cases, rates in build/blind.json; takes an hour
	$(BIN)/python -m tests.reconcile.blind.run --seeds heldout --cases 348 --jobs 2 --lean --json build/blind.json

blind-form: $(INSTALLED)  ## reconcile on physics that is not its catalogue's, held-out seeds; build/blind_form.json; two hours
	$(BIN)/python -m tests.reconcile.blind_form.run --seeds heldout --cases 513 --jobs 2 --json build/blind_form.json
	$(BIN)/python -m tests.reconcile.joint.run --json build/blind_joint.json
	$(BIN)/python -m pytest -q -m slow tests/reconcile

mutants: $(INSTALLED)  ## 1,000 changed texts and 1,000 changed certificates: prove and the checker must reject each
	$(BIN)/python -m tests.proof.mutants

peers: $(INSTALLED)  ## the 128 estimators of a peer's own tests, each compiled and verified; prints how many are taken
	$(BIN)/python -m pytest -q -m slow tests/peers

mutate: $(INSTALLED)  ## changes 300 places one by one and lists the changes that no test notices; build/mutate.json, hours
	$(BIN)/python -m tests.mutation --count 300 --jobs 2 --json build/mutate.json

example: $(INSTALLED)  ## campaign of the simulated rig, training, Structured Text, motions with it; build/example/motion.json
	$(BIN)/python examples/motion/run.py --out build/example

pictures: $(INSTALLED)  ## the pictures of README and site anew: simulation, training and commands; some two minutes
	$(BIN)/python -m site_tools.pictures --record

site: $(INSTALLED)  ## the documentation, build/site/index.html; links are checked, and no page needs a network
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet

commissioning: $(INSTALLED)  ## campaign, training, text, soft PLC, live comparison and a motion over ADS; build/commissioning/
	$(BIN)/python examples/commissioning/run.py --out build/commissioning

bound: $(INSTALLED)  ## the worst case that is counted against the instructions of golden blocks, by callgrind; a minute of a processor
	$(BIN)/python -m pytest -q -m slow tests/cost

race: $(RACE)/.installed  ## the emitted text, as C, against what others generate; writes build/race.json
	@command -v gcc > /dev/null || { echo "the race needs a C compiler: apt-get install gcc libc6-dev"; exit 2; }
	@command -v valgrind > /dev/null || echo "instructions are not counted without valgrind: apt-get install valgrind"
	$(RACE)/bin/python benchmarks/race.py $(CASES)

clean:
	rm -rf build $(VENV) $(RACE)

# the environment, from pinned versions with checksums
$(INSTALLED): requirements.lock pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $@

# what the race compares with: its own environment, since some of it needs old versions
$(RACE)/.installed: benchmarks/requirements-race.txt benchmarks/requirements-race-lleaves.txt
	$(PYTHON) -m venv $(RACE)
	$(RACE)/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes --no-deps --requirement benchmarks/requirements-race.txt
	$(RACE)/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes --no-deps --target $(RACE)/lleaves --requirement benchmarks/requirements-race-lleaves.txt
	touch $@
