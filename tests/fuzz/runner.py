"""Mutants of one kind, one after another, in a process that has imported what they need."""

import gc
import importlib
import random
import resource
import tempfile
import warnings
from collections import Counter
from pathlib import Path

from tests.fuzz.kinds import KINDS
from tests.fuzz.process import GOOD, Outcome, Server, outcome

KEPT = Path("build/fuzz")


def run(name, seed, seconds, most):
    """Mutants of one kind until this process has used so much of a processor, or so many were tried.

    Gives their outcomes by class, and the seconds of processors in all.
    """
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
        with Server(kind.check, path) as server:
            while _spent() < seconds and sum(counts.values()) < most:
                data = kind.mutant(source.choice(seeds), source)
                path.write_bytes(data)
                result, shown = server.outcome()
                counts[result] += 1
                if result not in GOOD:
                    KEPT.mkdir(parents=True, exist_ok=True)
                    stem = f"{seed}_{sum(counts.values())}"
                    (KEPT / f"{stem}_{name}").write_bytes(data)
                    (KEPT / f"{stem}_{name}.log").write_text(f"{result}\n{shown}", encoding="utf-8")
    return name, counts, _spent()


def _spent():
    """The seconds of processors that this process and its children that have ended took: others may use them, too."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
