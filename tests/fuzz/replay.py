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
    results = {}
    with tempfile.TemporaryDirectory() as folder:
        for kind, checked in KINDS.items():
            files = {path.name: path.read_bytes() for path in sorted(CORPUS.glob(f"{kind}/*"))}
            path = Path(folder) / kind
            with process.Server(checked.check, path) as server:  # libraries are imported once a kind
                for name, data in (files | {"seed": min(checked.seeds(), key=len)}).items():
                    path.write_bytes(data)
                    results[f"{kind}/{name}"] = server.outcome()
    sys.stdout.write(json.dumps(results))


if __name__ == "__main__":
    main()
