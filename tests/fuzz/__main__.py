"""`python -m tests.fuzz`: damaged files of every kind, in processes with limits; anything but two outcomes fails.

A mutant must be refused in one line, or be accepted and then equal what its library or another reading makes of it.
A process checks many mutants; what fails there is tried again in a fresh one, and counts where it fails again. It is
kept in build/fuzz/; put it into tests/fuzz/corpus/, which the quick suite replays.
"""

import argparse
import os
import random
import sys
import time
from collections import Counter
from multiprocessing import get_context

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "POLARS_MAX_THREADS": "1"}

from tests.fuzz.kinds import KINDS
from tests.fuzz.process import GOOD, Outcome
from tests.fuzz.runner import run


def main(arguments):
    """Run the jobs and print a table; exit code 1 where a mutant did what none may do."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600, help="of each core, for all kinds together")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--seed", type=int, default=random.randrange(10**6))
    parser.add_argument("--most", type=int, default=10**9, help="mutants of each kind")
    parser.add_argument("kinds", nargs="*", default=list(KINDS))
    given = parser.parse_args(arguments)
    share = given.seconds * given.jobs / len(given.kinds)
    started, total, spent = time.monotonic(), Counter(), 0.0
    with get_context("spawn").Pool(given.jobs, maxtasksperchild=1) as pool:
        runs = [pool.apply_async(run, (name, given.seed, share, given.most)) for name in given.kinds]
        for job in runs:
            name, counts, seconds = job.get()
            total += counts
            spent += seconds
            print(f"{name:15} {sum(counts.values()):6} {seconds:5.0f} s  {_classes(counts)}", flush=True)
    mutants, passed = f"{sum(total.values()):,} mutants, seed {given.seed}", time.monotonic() - started
    print(f"fuzz: {mutants}, {passed:.0f} s, {spent:.0f} s of processors: {_classes(total)}")
    return 0 if set(total) <= set(GOOD) else 1


def _classes(counts):
    return ", ".join(f"{counts[one]:,} {one}" for one in Outcome if counts[one])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
