"""`python -m tests.fuzz.replay`: the outcome of every seed and every file of the corpus, as JSON."""

import os

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "POLARS_MAX_THREADS": "1"}

import json
import sys
import tempfile
import warnings
from pathlib import Path

from tests.fuzz import process
from tests.fuzz.kinds import KINDS

CORPUS = Path(__file__).parent / "corpus"


def main():
    warnings.simplefilter("ignore")
    process.SECONDS = 300  # what once hung would do so for ever; what takes a second may take many on a slow machine
    files = [(path.parent.name, path.name, path.read_bytes()) for path in sorted(CORPUS.glob("*/*"))]
    files += [(name, "seed", min(kind.seeds(), key=len)) for name, kind in KINDS.items()]
    results = {}
    with tempfile.TemporaryDirectory() as folder:
        for kind, name, data in files:
            path = Path(folder) / kind
            path.write_bytes(data)
            results[f"{kind}/{name}"] = process.outcome(KINDS[kind].check, path)
    sys.stdout.write(json.dumps(results))


if __name__ == "__main__":
    main()
