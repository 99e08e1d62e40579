"""The race: emitted text against what others generate, one row at a time; `make race`.

    python benchmarks/race.py [CASE ..]      cases whose name contains one of the words

Writes build/race.json, a list with a row for each case and contender:
    case, contender, ns_warm, ns_cold   median of several, one row a call; warm: many rows in a circle; cold: everything
                                        evicted from the caches before each call
    instructions                        a call, by callgrind, mean over some rows; null from Python or without valgrind
    code_bytes, data_bytes              of the object file
    generate_s, compile_s               seconds
    exact                               every bit of every row is that of the library
    error, note                         why a contender did not finish, or what to know about it
All times are of this machine, whatever it is; only their ratios within one run mean something.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))

from benchmarks.contenders import PEERS, Built, Case, bundle_of, st_codegen  # noqa: E402
from benchmarks.harness import Harness, Result  # noqa: E402
from benchmarks.race_bundle import te_bundles  # noqa: E402
from benchmarks.race_cases import cases  # noqa: E402

OURS = "st-codegen"


def measured(
    case: Case, name: str, make: Callable[[Case, Path], Built], harness: Harness, check: Callable[[Built], None] | None
) -> Result:
    """One contender on one case, its error when it fails."""
    with tempfile.TemporaryDirectory(prefix="race-") as text:
        folder = Path(text)
        try:
            built = make(case, folder)
            if check is not None:
                check(built)
            values = harness.values(built, case.rows, folder)[:, 0]
            exact = bool(np.array_equal(values, case.expected(case.rows)))
            warm, cold = harness.times(built, case.rows, folder)
            count = harness.instructions(built, case.rows, folder)
            if count is None and built.library is not None and harness.valgrind is not None:
                built.note = "; ".join(filter(None, [built.note, "valgrind cannot run it"]))
        except Exception as error:
            return Result(case.name, name, error=_short(error))
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
    )


def _short(error: Exception) -> str:
    if isinstance(error, subprocess.TimeoutExpired):
        return f"gcc was stopped after {error.timeout:.0f} s"
    text = str(error) or repr(error)
    if isinstance(error, subprocess.CalledProcessError):
        text += " " + str(error.stderr)[-300:]
    elif isinstance(error, AssertionError):
        traceback.print_exc()
    return f"{type(error).__name__}: {' '.join(text.split())[:300]}"


def check_translation(case: Case, built: Built, harness: Harness, folder: Path) -> None:
    """The translated C against the interpreter: thresholds, their neighbours, NaN, infinities, random rows.

    Bit for bit for models of trees; the others call EXP, whose last bit is the library's own, so that only two units
    in the last place of the largest result may differ.
    """
    from st_codegen.engine import GeneratedCode
    from st_codegen.probes import probe_rows

    (model,) = bundle_of(case).models
    x = probe_rows(model.ir, 2_000)[:20_000]
    expected = GeneratedCode(folder / "st" / "twincat", "twincat").run_model("FB_Model", x, 1)
    got = harness.values(built, x, folder)
    assert np.array_equal(got[:, 1] != 0.0, expected.valid), "the translation flags other rows"
    mine, theirs = got[expected.valid, 0], expected.values[expected.valid, 0]
    if model.ir.exact:
        assert np.array_equal(mine, theirs), "the translation computes other numbers"
    else:
        allowed = 1e-12 * max(1e-30, float(np.max(np.abs(theirs))))
        assert np.max(np.abs(mine - theirs)) <= allowed, "the translation computes other numbers"


def race(case: Case, harness: Harness) -> list[Result]:
    """All contenders on one case."""
    results = []
    for name, make in {OURS: st_codegen, **PEERS}.items():
        with tempfile.TemporaryDirectory(prefix="race-") as text:
            kept = Path(text)

            def ours(case: Case, _: Path, kept: Path = kept) -> Built:
                return st_codegen(case, kept)

            def check(built: Built, kept: Path = kept) -> None:
                check_translation(case, built, harness, kept)

            is_ours = name == OURS
            result = measured(case, name, ours if is_ours else make, harness, check if is_ours else None)
        results.append(result)
        print(_line(result), flush=True)
    return results


def _line(result: Result) -> str:
    if result.error:
        return f"{result.case:26} {result.contender:14} {result.error[:110]}"
    count = "-" if result.instructions is None else f"{result.instructions:,.0f}"
    code, data = (("-" if size is None else f"{size:,}") for size in (result.code_bytes, result.data_bytes))
    return (
        f"{result.case:26} {result.contender:14} warm {result.ns_warm:12,.0f} ns  cold {result.ns_cold:12,.0f} ns  "
        f"{count:>10} instr  code {code:>11}  data {data:>11}  gen {result.generate_s:7.2f} s  "
        f"gcc {result.compile_s:7.2f} s  {'exact' if result.exact else 'NOT exact'} {result.note}"
    )


def summary(results: list[Result]) -> str:
    """Ours over the fastest peer, within this run."""
    lines = ["", f"{'case':26} {'warm: peer / ours':>18} {'cold: peer / ours':>18}   fastest peers"]
    for case in dict.fromkeys(result.case for result in results):
        mine = next((r for r in results if r.case == case and r.contender == OURS and r.ns_warm), None)
        peers = [r for r in results if r.case == case and r.contender != OURS and r.ns_warm]
        if mine is None or not peers:
            continue
        warm, cold = min(peers, key=lambda r: r.ns_warm), min(peers, key=lambda r: r.ns_cold)
        lines.append(
            f"{case:26} {warm.ns_warm / mine.ns_warm:18.2f} {cold.ns_cold / mine.ns_cold:18.2f}   "
            f"{warm.contender}, {cold.contender}"
        )
    return "\n".join(lines)


def main(words: list[str]) -> int:
    """Run the cases whose names contain one of the words."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    if shutil.which("gcc") is None:
        print("the race needs gcc: apt-get install gcc")
        return 2
    if shutil.which("valgrind") is None:
        print("no valgrind: instructions are not counted (apt-get install valgrind)")
    out = ROOT / "build" / "race.json"
    out.parent.mkdir(exist_ok=True)
    results: list[Result] = []
    with tempfile.TemporaryDirectory(prefix="race-") as text:
        harness = Harness(Path(text))
        for name, make in cases():
            if not words or any(word in name for word in words):
                results += race(make(), harness)
        if not words or any(word in "te-bundle" for word in words):
            for more in te_bundles(harness, Path(text), results):
                results.append(more)
                print(_line(more), flush=True)
    partial = out.with_suffix(".partial")
    partial.write_text(json.dumps([asdict(result) for result in results], indent=1) + "\n")
    partial.replace(out)
    print(summary(results))
    print(f"\n{out.relative_to(ROOT)}: {len(results)} rows")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
