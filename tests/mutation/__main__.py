"""`make mutate`: changes one place at a time, runs the tests that execute it, and lists the changes nobody noticed.

First every test runs once below coverage, folder by folder, which shows the tests that execute a line, and their
seconds. A mutant is tried in a copy of the repository with the tests of its own room first, most specific ones first.
A declaration, which the import executes, is tried with the tests that execute its uses. Coverage sees neither machine
code nor other processes: a line that no test seems to execute is tried with the tests of its file, or else of its room.
Templates are not Python, so theirs are all tests of their rooms. Limits are processor time, so that a busy machine does
not turn a survivor into an endless loop. Tests that fail in an unchanged copy would notice everything: they are left
out. What a limit ended no test noticed: it counts as not found, and the list says that it was too slow.

With `--rooms`, mutants of these rooms only are tried, and only with the tests of these rooms: what is found then is a
lower limit of what the whole suite finds.
"""

from __future__ import annotations

import argparse
import collections
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import coverage

from tests.mutation.executed import Executed
from tests.mutation.limits import LIMITS
from tests.mutation.mutants import Mutant, sample

ROOT = Path(__file__).resolve().parents[2]
#: What a measured run depends on.
_CHANGED = ("st_codegen", "templates", "tests")
#: A test counts as too slow beyond so many times its seconds unchanged, and so many seconds for the start of all.
_SLOWER = 4
_START_SECONDS = 60
#: A run is stuck that takes so many times its limit of processor time on the clock.
_STUCK = 10


@dataclass(frozen=True)
class Verdict:
    """What became of a mutant: `noticed`, `survived`, `not executed`, `too slow` (an endless loop, too) or `stuck`."""

    mutant: Mutant
    verdict: str
    seconds: float

    @property
    def found(self) -> bool:
        """Whether the tests noticed it."""
        return self.verdict == "noticed"


def measure(folder: Path, copy: Path, jobs: int, rooms: list[str]) -> None:
    """Run every folder of tests, or those of these rooms, below coverage, in a copy in which mutants are tried.

    What is measured already stays, unless a file of the program or of the tests has changed since.
    """
    folder.mkdir(parents=True, exist_ok=True)
    changed = max(path.stat().st_mtime for room in _CHANGED for path in (copy / room).rglob("*") if path.is_file())
    for path in folder.iterdir():
        if path.stat().st_mtime < changed:
            path.unlink()
    groups = [path for path in sorted((copy / "tests").iterdir()) if path.is_dir() and any(path.rglob("test_*.py"))]
    groups = [path for path in groups if not rooms or path.name in rooms]
    groups += sorted((copy / "tests").glob("test_*.py")) if not rooms else []
    with ThreadPoolExecutor(jobs) as pool:
        for name, seconds in pool.map(lambda path: _measure_one(path, folder, copy), groups):
            print(f"executed lines of {name}: {seconds:.0f} s", flush=True)


def _measure_one(path: Path, folder: Path, copy: Path) -> tuple[str, float]:
    target = folder / f"{path.stem}.coverage"
    start = time.perf_counter()
    if not target.exists():
        partial = target.with_suffix(".part")
        command = [sys.executable, "-m", "coverage", "run", "--source=st_codegen", f"--data-file={partial}"]
        command += ["-m", "pytest", "-q", "-m", "not slow", "-p", "tests.mutation.contexts", "-p", "no:cacheprovider"]
        command.append(path.relative_to(copy).as_posix())
        environment = _environment(copy)
        quiet = subprocess.DEVNULL
        subprocess.run(command, cwd=copy, env=environment, check=False, stdout=quiet, stderr=quiet)
        Path(f"{partial}.seconds").rename(f"{target}.seconds")
        partial.rename(target)
    return path.name, time.perf_counter() - start


def _environment(copy: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "PYTHONPATH": str(copy)}


def copy_repository(target: Path) -> None:
    """Copy what git knows, with the folder of measured data beside it."""
    names = subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.split("\n")
    for name in filter(None, names):
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).exists():
            shutil.copy2(ROOT / name, target / name)
    if (ROOT.parent / "shared").exists() and not (target.parent / "shared").exists():
        (target.parent / "shared").symlink_to(ROOT.parent / "shared")


def try_mutant(mutant: Mutant, tests: Mapping[str, float], copy: Path) -> Verdict:
    """Run tests, with their seconds unchanged, against one mutant in a copy of the repository."""
    start, hard = time.perf_counter(), resource.getrlimit(resource.RLIMIT_CPU)[1]
    if not tests:
        return Verdict(mutant, "not executed", 0.0)
    file = copy / mutant.path
    source = file.read_text(encoding="utf-8")
    file.write_text(mutant.apply(source), encoding="utf-8")
    limits = {test: _START_SECONDS + _SLOWER * seconds for test, seconds in tests.items()}
    own = copy.parent / f"{copy.name}.limits"
    own.write_text(json.dumps(limits))
    try:
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-m", "not slow", "-p", "no:cacheprovider"]
        done = subprocess.run(
            [*command, "-p", "tests.mutation.limits", *tests],
            cwd=copy,
            env={**_environment(copy), LIMITS: str(own)},
            timeout=_STUCK * (_START_SECONDS + _SLOWER * sum(tests.values())),
            capture_output=True,
            check=False,
            # the hard limit stays: tests give limits of their own to processes, which none could raise
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (_START_SECONDS, hard)),
        )
        # 5: none of the tests exists, so that nothing was tried
        verdicts = {0: "survived", 5: "not executed", -signal.SIGXCPU: "too slow"}
        verdict = verdicts.get(done.returncode, "noticed")
    except subprocess.TimeoutExpired:
        verdict = "stuck"
    finally:
        file.write_text(source, encoding="utf-8")
    return Verdict(mutant, verdict, time.perf_counter() - start)


def main() -> int:
    """Measure, try a sample of mutants, list the survivors; exit 1 where fewer than `--aim` were found."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    rooms = sorted(path.parent.name for path in ROOT.glob("st_codegen/*/__init__.py"))
    parser.add_argument(
        "--rooms", nargs="*", choices=rooms, default=[], help="only these rooms, tried with their own tests"
    )
    parser.add_argument("--aim", type=float, default=0.9)
    parser.add_argument("--json", type=Path, default=ROOT / "build" / "mutate.json")
    options = parser.parse_args()
    lines = ROOT / "build" / "executed"
    mutants = sample(ROOT, options.count, options.seed, options.rooms)
    random.Random(options.seed).shuffle(mutants)  # so that a run that is interrupted has tried a fair sample
    with tempfile.TemporaryDirectory(prefix="st-codegen-mutate-") as name:
        copies = [Path(name) / str(number) / "copy" for number in range(options.jobs)]
        for copy in copies:
            copy_repository(copy)
        measure(lines, copies[0], options.jobs, options.rooms)
        executed = Executed(lines, options.rooms)
        free = list(copies)

        def one(mutant: Mutant) -> Verdict:
            copy = free.pop()
            try:
                return try_mutant(mutant, executed.seconds(executed.tests(mutant)), copy)
            finally:
                free.append(copy)

        verdicts = []
        with ThreadPoolExecutor(options.jobs) as pool:
            for verdict in pool.map(one, mutants):
                verdicts.append(verdict)
                print(f"{len(verdicts)}/{len(mutants)} {verdict.verdict:12} {verdict.mutant}", flush=True)
    found = sum(verdict.found for verdict in verdicts)
    survivors = [str(verdict.mutant) for verdict in verdicts if not verdict.found]
    counts = collections.Counter(verdict.verdict for verdict in verdicts)
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_text(json.dumps({"tried": len(verdicts), "counts": counts, "survivors": survivors}, indent=1))
    print(f"\n{found} of {len(verdicts)} mutants found ({found / len(verdicts):.1%}); not found:")
    print("\n".join(survivors))
    return 0 if found >= options.aim * len(verdicts) else 1


if __name__ == "__main__":
    assert coverage.version_info >= (7,)
    sys.exit(main())
