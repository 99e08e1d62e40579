"""Run the blind suite of other physics: `python -m tests.reconcile.blind_form.run --seeds dev|heldout --cases N`.

Each case is written to a folder of its own, `st-codegen reconcile` runs on it as a user would run it, under a limit of
time, and its report.json and rig.toml are scored. Results are kept in `FILE.partial` as soon as they are there; a run
that was interrupted goes on where it stopped, as long as program, suite and case are the same.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
import subprocess
import sys
import time
import traceback
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import cache
from pathlib import Path
from typing import Any

from . import cases, comparison, peers, summary
from .machine import ROOT, simulate, st_codegen
from .make import Truth, make
from .points import Points, spectrum
from .report import read_report
from .score import NewRig, refused, score

LIMIT_S = 240.0


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def fingerprint() -> str:
    """Of the program under test and of this suite: a change of any file makes old results worthless."""
    digest = hashlib.sha256()
    for path in sorted([*(ROOT / "st_codegen").rglob("*.py"), *Path(__file__).parent.glob("*.py")]):
        digest.update(str(path.relative_to(ROOT)).encode() + path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def options_of_reconcile() -> str:
    """Its help: which options there are."""
    return st_codegen(["reconcile", "--help"], 60.0).stdout


def new_rig(truth: Truth, path: Path) -> NewRig:
    """Curves of the written rig.toml at measured and fresh runs; those of the old rig if it is the same."""
    text = path.read_text()
    if text == truth.rig.read_text():
        return NewRig(truth.known, truth.known_fresh)
    keys = Points.__dataclass_fields__
    both = Points(*(summary.joined(getattr(truth.points, key), getattr(truth.new_points, key)) for key in keys))
    try:
        te = simulate(text, both, truth.samples)
    except ValueError as refusal:
        return NewRig(truth.known, truth.known_fresh, " ".join(str(refusal).split())[:200])
    runs = len(truth.points)
    return NewRig(te[:runs], te[runs:])


def run_case(case: cases.Case, work: Path, limit: float, keep: bool = False) -> dict[str, Any]:
    """Write, reconcile and score one case; a crash or a time over the limit is a result too."""
    # the path may stand in messages, and may not give away the answer
    folder = work / case.number
    shutil.rmtree(folder, ignore_errors=True)
    start = time.perf_counter()
    truth = make(case, folder)
    made = time.perf_counter() - start
    result: dict[str, Any] = {"case": case.plain(), "truth": truth.plain(), "made_s": round(made, 2)}
    command = ["reconcile", "--rig", str(truth.rig), "--measured", str(truth.measured), "--out", str(folder / "out")]
    if truth.bad_files and "--skip-bad" in options_of_reconcile():
        command.append("--skip-bad")
    start = time.perf_counter()
    try:
        done = st_codegen(command, limit)
        result["seconds"] = round(time.perf_counter() - start, 2)
        result |= judged(truth, done, folder / "out")
    except subprocess.TimeoutExpired:
        result |= {"seconds": limit, "status": "timeout", "right": False, "reason": f"no result in {limit:g} s"}
    if not keep:
        shutil.rmtree(folder, ignore_errors=True)
    return result


def judged(truth: Truth, done: subprocess.CompletedProcess[str], out: Path) -> dict[str, Any]:
    """Score of what the command left behind."""
    message = done.stderr + done.stdout
    if done.returncode == 2:
        marks = refused(truth, message, options_of_reconcile())
        return {"status": "refused", "message": message[-600:], "right": marks.right, "score": marks.plain()}
    if done.returncode not in (0, 1):
        reason = message.strip().splitlines()[-1:] or [""]
        return {"status": "failed", "right": False, "reason": f"exit {done.returncode}: {reason[0][:200]}"}
    try:
        text = json.loads((out / "report.json").read_text())
        report = read_report(text)
        rig = new_rig(truth, out / "rig.toml")
        marks = score(truth, report, rig)
        spoken = {round(order) for claim in (*report.effects, *report.retuned) for order in claim.orders}
        spoken |= {round(entry.order) for entry in report.unexplained if entry.order is not None}
        added = spectrum(rig.fresh - truth.known_fresh)[..., : truth.samples // 4]
        plain = None if rig.problem else comparison.judge(truth, sorted(spoken), added)
    except Exception:  # a report that cannot be read is a failure of the program, not of the run
        return {"status": "unreadable", "right": False, "reason": traceback.format_exc()[-600:]}
    said = [claim.name + "".join(f" {round(order)}" for order in claim.orders[:4]) for claim in report.effects]
    said += [f"({claim.name})" for claim in report.retuned]
    result = {"status": "scored", "verdict": report.verdict, "said": said, "right": marks.right}
    return result | {"score": marks.plain(), "comparison": plain}


# ------------------------------------------------------------------------------------------------ command line


def kept(path: Path, mark: str) -> dict[str, dict[str, Any]]:
    """Results of an earlier, interrupted run of the same program."""
    if not path.is_file():
        return {}
    found = [json.loads(line) for line in path.read_text().splitlines() if line.strip()]
    return {entry["result"]["case"]["name"]: entry["result"] for entry in found if entry["program"] == mark}


def results_in(path: Path) -> list[dict[str, Any]]:
    """Results of a finished run, or those of one that was interrupted."""
    text = path.read_text()
    if path.suffix == ".partial":
        return [json.loads(line)["result"] for line in text.splitlines() if line.strip()]
    found: list[dict[str, Any]] = json.loads(text)["cases"]
    return found


def arguments(values: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.reconcile.blind_form.run", description=__doc__)
    parser.add_argument("--seeds", choices=tuple(cases.FIRST_SEED), default="dev", help="dev: to look at; heldout")
    parser.add_argument("--cases", type=int, default=len(cases.PASS), help="how many; one pass has each kind once")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--kind", default="", help="only cases whose name contains one of these texts, comma between")
    parser.add_argument("--peer", choices=tuple(peers.PEERS), help="another method on the same cases")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--limit", type=float, default=LIMIT_S, help="seconds that a case may take")
    parser.add_argument("--json", type=Path, default=ROOT / "build" / "blind_form.json")
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "blind_form")
    parser.add_argument("--keep", action="store_true", help="keep the files of every case")
    parser.add_argument("--calibration", type=Path, nargs="+", metavar="FILE", help="of kept results, and no run")
    parser.add_argument("--fresh", action="store_true", help="forget an interrupted run")
    return parser.parse_args(values)


def line_of(result: Mapping[str, Any]) -> str:
    """One line of progress."""
    marks = result.get("score") or {}
    false = "; ".join(f"{row['kind']}: {row['text']}" for row in marks.get("false", ()))
    missing = "; ".join(marks.get("missing", ()))
    said = result.get("reason") or f"{result.get('verdict', result['status'])} {', '.join(result.get('said', ()))}"
    parts = [said, f"FALSE {false}" if false else "", f"missing {missing}" if missing else ""]
    return f"{'ok  ' if result['right'] else 'FAIL'} {result['case']['name']}: " + " | ".join(filter(None, parts))


def main(values: Sequence[str] | None = None) -> int:
    options = arguments(values)
    if options.calibration:
        results = [result for path in options.calibration for result in results_in(path)]
        say("\n".join(summary.calibration_lines(summary.calibration(results))))
        return 0
    wanted = cases.listed(options.seeds, options.cases, options.first)
    if options.kind:
        wanted = [case for case in wanted if any(text in case.name for text in options.kind.split(","))]
    options.json.parent.mkdir(parents=True, exist_ok=True)
    if options.peer:
        path = options.json.with_name(f"{options.json.stem}_{options.peer}.json")
        return peers.main(options.peer, wanted, options.work, options.jobs, path, say)
    partial, mark = options.json.with_suffix(".partial"), fingerprint()
    old = {} if options.fresh else kept(partial, mark)
    results = {case.name: old[case.name] for case in wanted if old.get(case.name, {}).get("case") == case.plain()}
    todo = [case for case in wanted if case.name not in results]
    say(f"{len(wanted)} cases on {options.seeds} seeds, {len(results)} already there, program {mark}")
    with ThreadPoolExecutor(options.jobs) as pool, partial.open("w") as file:
        for result in results.values():
            file.write(json.dumps({"program": mark, "result": result}) + "\n")
        file.flush()
        running = {pool.submit(run_case, case, options.work, options.limit, options.keep): case for case in todo}
        for future in as_completed(running):
            # through JSON, so that fresh and kept results have the same types
            result = json.loads(json.dumps(future.result()))
            results[running[future].name] = result
            file.write(json.dumps({"program": mark, "result": result}) + "\n")
            file.flush()
            say(f"[{len(results)}/{len(wanted)}] {line_of(result)}")
    ordered = [results[case.name] for case in wanted]
    table = summary.table(ordered)
    whole = {"seeds": options.seeds, "program": mark, "summary": table, "cases": ordered}
    options.json.write_text(json.dumps(whole, indent=1) + "\n")
    say("\n".join([*summary.lines(table), f"written to {options.json}"]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
