"""Mutants of one kind, one after another, in a process that has imported what they need."""

import gc
import importlib
import random
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

from tests.fuzz.kinds import KINDS
from tests.fuzz.process import GOOD, Outcome, Server, outcome

KEPT = Path("build/fuzz")


def run(name, seed, seconds, most):
    """Mutants of one kind until the time is over, or so many were tried: their outcomes by class."""
    warnings.simplefilter("ignore")
    kind, source, counts = KINDS[name], random.Random(f"{name} {seed}"), Counter()
    seeds = kind.seeds()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(seeds[0])
        if name.startswith("curve"):  # polars in a child hangs where it has threads in its parent: it is imported only
            importlib.import_module("polars")
        else:
            kind.check(path)  # imports what the children need
        gc.collect()
        gc.freeze()  # so that no child copies pages only to count what refers to them
        for data in seeds:  # a seed must be accepted, else its mutants show nothing
            path.write_bytes(data)
            result, shown = outcome(kind.check, path)
            assert result is Outcome.ACCEPTED, (name, shown)
        end = time.monotonic() + seconds
        with Server(kind.check, path) as server:
            while time.monotonic() < end and sum(counts.values()) < most:
                data = kind.mutant(source.choice(seeds), source)
                path.write_bytes(data)
                result, shown = server.outcome()
                counts[result] += 1
                if result not in GOOD:
                    KEPT.mkdir(parents=True, exist_ok=True)
                    stem = f"{seed}_{sum(counts.values())}"
                    (KEPT / f"{stem}_{name}").write_bytes(data)
                    (KEPT / f"{stem}_{name}.log").write_text(f"{result}\n{shown}", encoding="utf-8")
    return name, counts
