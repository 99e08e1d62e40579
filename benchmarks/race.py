"""The race: emitted text against what others generate, one row at a time; `make race`.

    python benchmarks/race.py [CASE ..]      cases whose name contains one of the words, in their order

Writes build/race.json, a list with a row for each case and contender, rewritten after every row:
    case, contender, ns_warm, ns_cold   one row a call, the smallest of the medians of several runs; warm: many rows in
                                        a circle; cold: everything evicted from the caches before each call
    instructions                        a call, by callgrind, mean over some rows; null from Python or without valgrind
    code_bytes, data_bytes              of the object file
    generate_s, compile_s               seconds; compiled libraries stay in build/race/ with the seconds they took
    expected_most                       ours: instructions of the worst call by the cost model, for gcc -O0 (bound.py)
    exact                               every bit of every row is that of the library
    error, note                         why a contender did not finish, or what to know about it
All times are of this machine, whatever it is; only their ratios within one run mean something. Each contender runs in a
process of its own. build/race.md sets ours beside the fastest peer of each case. Without the measured table beside the
checkout the cases of the rig are left out.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))

from benchmarks.contenders import COMPILE_LIMIT, COMPILED_PEERS, PEERS, Built, Case, bundle_of, st_codegen  # noqa: E402
from benchmarks.harness import Harness, Result  # noqa: E402
from benchmarks.isolated import FailedError, all_isolated, isolated  # noqa: E402
from benchmarks.race_bundle import te_bundles  # noqa: E402
from benchmarks.race_cases import cases  # noqa: E402

OURS = "st-codegen"
#: Seconds for measuring one contender, besides compiling
LIMIT = 600.0
#: Rows on which contenders that are called from Python are compared with the library
PYTHON_ROWS = 300
#: Rows on which the translation is compared with the engine
CHECKED = 4_000


def measured(
    case: Case, name: str, make: Callable[[Case, Path], Built], harness: Harness, check: Callable[..., None] | None
) -> Result:
    """One contender on one case."""
    with tempfile.TemporaryDirectory(prefix="race-") as text:
        folder = Path(text)
        built = make(case, folder)
        if check is not None:
            check(case, built, harness, folder)
        rows = case.rows if built.call is None else case.rows[:PYTHON_ROWS]
        values = harness.values(built, rows, folder)[:, 0]
        expected = case.expected(rows)
        exact = bool(np.array_equal(values, expected))
        warm, cold = harness.times(built, case.rows, folder)
        count = harness.instructions(built, case.rows, folder)
    if count is None and built.library is not None and harness.valgrind is not None:
        built.note = "; ".join(filter(None, [built.note, "valgrind cannot run it"]))
    if not exact:
        differing = int(np.count_nonzero(values != expected))
        off = float(np.max(np.abs(values - expected)) / np.max(np.abs(expected)))
        built.note = "; ".join(
            filter(
                None,
                [
                    built.note,
                    f"other classes in {differing} of {len(rows)} rows"
                    if case.scores > 1
                    else f"off by up to {off:.1e} of the largest value",
                ],
            )
        )
    return Result(
        case.name,
        name,
        round(warm, 1),
        round(cold, 1),
        None if count is None else round(count, 1),
        built.code_bytes,
        built.data_bytes,
        round(built.generate_s, 3),
        round(built.compile_s, 3),
        exact,
        note=built.note,
        expected_most=built.expected_most,
    )


def check_translation(case: Case, built: Built, harness: Harness, folder: Path) -> None:
    """The translated C against the engine: thresholds, their neighbours, NaN, infinities, random rows.

    Bit for bit for models of trees; the others call EXP, whose last bit is the library's own, so that only two units
    in the last place of the largest result may differ.
    """
    from st_codegen.proof.probes import probe_rows
    from st_codegen.proof.runner import GeneratedCode

    (model,) = bundle_of(case).models
    x = probe_rows(model.ir, 2_000)[:CHECKED]
    expected = GeneratedCode(folder / "st" / "twincat", "twincat").run_model("FB_Model", x, 1)
    got = harness.values(built, x, folder)
    assert np.array_equal(got[:, 1] != 0.0, expected.valid), "the translation flags other rows"
    mine, theirs = got[expected.valid, 0], expected.values[expected.valid, 0]
    if model.ir.exact:
        assert np.array_equal(mine, theirs), "the translation computes other numbers"
    else:
        allowed = 1e-12 * max(1e-30, float(np.max(np.abs(theirs))))
        assert np.max(np.abs(mine - theirs)) <= allowed, "the translation computes other numbers"


def race(case: Case, harness: Harness) -> Iterator[Result]:
    """All contenders on one case."""
    # gcc takes minutes for a forest of if and else: all cores at once, before any time is taken
    all_isolated([partial(_compile, make, case) for make in COMPILED_PEERS], COMPILE_LIMIT + LIMIT)
    for name, make in {OURS: st_codegen, **PEERS}.items():
        check = check_translation if name == OURS else None
        try:
            yield isolated(partial(measured, case, name, make, harness, check), COMPILE_LIMIT + LIMIT)
        except FailedError as error:
            yield Result(case.name, name, error=str(error))


def _compile(make: Callable[[Case, Path], Built], case: Case) -> None:
    with tempfile.TemporaryDirectory(prefix="race-") as text:
        make(case, Path(text))


def _line(result: Result) -> str:
    if result.error:
        return f"{result.case:26} {result.contender:14} {result.error[:110]}"
    exact = {True: "exact", False: "NOT exact", None: ""}[result.exact]
    return (
        f"{result.case:26} {result.contender:14} warm {_number(result.ns_warm):>12} ns  "
        f"cold {_number(result.ns_cold):>12} ns  {_number(result.instructions):>10} instr  "
        f"code {_number(result.code_bytes):>11}  data {_number(result.data_bytes):>11}  "
        f"gen {_number(result.generate_s, 2):>7} s  gcc {_number(result.compile_s, 2):>7} s  {exact} {result.note}"
    )


def _number(value: float | None, digits: int = 0) -> str:
    return "-" if value is None else f"{value:,.{digits}f}"


def summary(results: list[Result]) -> str:
    """Ours beside the fastest peer of each case, within this run, as a table in Markdown."""
    lines = [
        "| case | ns warm | ns cold | instructions | at most, -O0 | fastest peer warm | ns | peer / ours "
        "| fastest peer cold | ns | peer / ours | exact |",
        "|---|--:|--:|--:|--:|---|--:|--:|---|--:|--:|---|",
    ]
    for case in dict.fromkeys(result.case for result in results):
        mine = next((r for r in results if r.case == case and r.contender == OURS and r.ns_warm), None)
        peers = [r for r in results if r.case == case and r.contender != OURS and r.ns_warm and r.ns_cold]
        if mine is None or not peers:
            continue
        warm, cold = min(peers, key=lambda r: r.ns_warm), min(peers, key=lambda r: r.ns_cold)
        lines.append(
            f"| {case} | {mine.ns_warm:,.0f} | {mine.ns_cold:,.0f} | {_number(mine.instructions)} "
            f"| {_number(mine.expected_most)} "
            f"| {warm.contender} | {warm.ns_warm:,.0f} | {warm.ns_warm / mine.ns_warm:.2f} "
            f"| {cold.contender} | {cold.ns_cold:,.0f} | {cold.ns_cold / mine.ns_cold:.2f} "
            f"| {'yes' if mine.exact else 'no'} |"
        )
    return "\n".join(lines)


class Report:
    """The rows of a run; the file has all of them at any time."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.results: list[Result] = []
        path.parent.mkdir(exist_ok=True)

    def add(self, result: Result) -> None:
        """One more row: printed, and written to a file that then takes the place of the last one."""
        self.results.append(result)
        print(_line(result), flush=True)
        partial_file = self.path.with_suffix(".partial")
        partial_file.write_text(json.dumps([asdict(result) for result in self.results], indent=1) + "\n")
        partial_file.replace(self.path)


def ordered(
    known: Iterable[tuple[str, Callable[[], Case]]], words: list[str]
) -> Iterator[tuple[str, Callable[[], Case]]]:
    """All cases, or those with one of the words in their names, in the order of the words."""
    left = dict(known)
    for word in words or [""]:
        for name in [name for name in left if word in name]:
            yield name, left.pop(name)


def main(words: list[str]) -> int:
    """Run the cases whose names contain one of the words."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    if shutil.which("gcc") is None:
        print("the race needs gcc: apt-get install gcc")
        return 2
    if shutil.which("valgrind") is None:
        print("no valgrind: instructions are not counted (apt-get install valgrind)")
    report = Report(ROOT / "build" / "race.json")

    def is_chosen(name: str) -> bool:
        return not words or any(word in name for word in words)

    with tempfile.TemporaryDirectory(prefix="race-") as text:
        harness = Harness(Path(text))
        for name, train in ordered(cases(), words):
            try:
                case = train()
            except Exception as error:
                report.add(Result(name, "training", error=f"{type(error).__name__}: {error}"))
                continue
            for result in race(case, harness):
                report.add(result)
        for result in te_bundles(harness, Path(text), report.results, is_chosen):
            report.add(result)
    if not report.results:
        print("no case has such a name")
        return 2
    table = report.path.with_suffix(".md")
    table.write_text(summary(report.results) + "\n")
    print("\n" + table.read_text())
    print(f"\n{report.path.relative_to(ROOT)}: {len(report.results)} rows")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
