"""Run blind cases and report rates: `python -m tests.reconcile.blind.run --seeds dev|heldout --cases N --json FILE`.

Each case is written to a folder of its own, `st-codegen reconcile` runs on it as a user would run it, and its
report.json and rig.toml are scored. With `--lean` the same functions run in workers that stay, and no page is drawn:
half the time, the same report.json. A result is kept in `FILE.partial` as soon as it is there; a run that was
interrupted goes on where it stopped, as long as the case and the program are the same.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import multiprocessing.util
import os
import shutil
import subprocess
import sys
import time
import traceback
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from . import cases, check, generator, score

ROOT = Path(__file__).resolve().parents[3]
TIMEOUT_S = 600
ONE_CORE = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def fingerprint() -> str:
    """Of the program under test: a change of any of its files makes old results worthless."""
    digest = hashlib.sha256()
    for path in sorted((ROOT / "st_codegen").rglob("*.py")):
        digest.update(str(path.relative_to(ROOT)).encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def reconcile(rig: Path, measured: Path, out: Path, *more: str) -> subprocess.CompletedProcess[str]:
    """`st-codegen reconcile` in a process of its own, on one core."""
    command = [sys.executable, "-m", "st_codegen", "reconcile", "--rig", str(rig), "--measured", str(measured)]
    environment = {**os.environ, **ONE_CORE, "PYTHONPATH": str(ROOT), "NO_COLOR": "1"}
    whole = [*command, "--out", str(out), *more]
    return subprocess.run(whole, capture_output=True, text=True, timeout=TIMEOUT_S, env=environment, check=False)


#: (rig, measured, out) -> exit code and messages
Reconcile = Callable[[Path, Path, Path], subprocess.CompletedProcess[str]]


def leave_nobody() -> None:
    """Have a worker stop its own workers when it ends; else it waits for them to be idle long enough."""
    multiprocessing.util.Finalize(None, stop_workers, exitpriority=100)


def stop_workers() -> None:
    from joblib.externals.loky import get_reusable_executor

    get_reusable_executor().shutdown()


def lean(rig: Path, measured: Path, out: Path) -> subprocess.CompletedProcess[str]:
    """What `st-codegen reconcile` does up to report.json and rig.toml, in this process."""
    # only here: nothing else of the suite knows the program
    from st_codegen.errors import StCodegenError
    from st_codegen.reconcile.report.output import report_text
    from st_codegen.reconcile.run import reconcile_files
    from st_codegen.rig.effects import catalogue
    from st_codegen.rig.model import read_rig

    try:
        known = catalogue(())
        result = reconcile_files(read_rig(rig, known), measured, known)
    except StCodegenError as error:
        return subprocess.CompletedProcess([], 2, "", str(error))
    except Exception:
        return subprocess.CompletedProcess([], 1, "", traceback.format_exc())
    out.mkdir()
    (out / "report.json").write_text(report_text(result), encoding="utf-8")
    (out / "rig.toml").write_text(result.new_rig.text(), encoding="utf-8")
    return subprocess.CompletedProcess([], 0, "", "")


def run_case(case: cases.Case, work: Path, keep: bool = False, how: Reconcile = reconcile) -> dict[str, Any]:
    """Write, reconcile and score one case; a crash of the program is a result too."""
    folder = work / case.name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    made = generator.make(case, folder)
    result: dict[str, Any] = {"case": case.plain(), "made": made.plain()}
    start = time.perf_counter()
    try:
        done = how(made.rig, made.measured, folder / "out")
    except subprocess.TimeoutExpired:
        return result | {"status": "timeout", "seconds": TIMEOUT_S}
    result["seconds"] = round(time.perf_counter() - start, 2)
    if done.returncode != 0:
        message = (done.stderr or done.stdout)[-1500:]
        return result | {"status": "failed", "exit": done.returncode, "message": message}
    try:
        text = json.loads((folder / "out" / "report.json").read_text())
        report = score.read_report(text)
        result["claims"] = [{"name": claim.name, "alternatives": claim.alternatives} for claim in report.claims]
        result["unexplained_orders"] = sorted(report.unexplained_orders)[:40]
        result["suspects"] = list(report.suspects)[:40]
        result["gap"] = report.gap
        result["score"] = score.score(report, made.expected).plain()
        result["model"] = check.new_rig(folder / "out" / "rig.toml", made)
        result["status"] = "scored"
    except Exception:  # a report that cannot be read is a failure of the program, not of the run
        result |= {"status": "unreadable", "message": traceback.format_exc()[-1500:]}
    if not keep:
        shutil.rmtree(folder, ignore_errors=True)
    return result


# ------------------------------------------------------------------------------------------------ summary


def _scored(results: Sequence[Mapping[str, Any]], *kinds: str) -> list[Mapping[str, Any]]:
    """Results of these kinds; what crashed stays in, without a score."""
    return [result for result in results if not kinds or result["case"]["kind"] in kinds]


def _passed(result: Mapping[str, Any]) -> bool:
    return result["status"] == "scored" and bool(result["score"]["passed"])


def _measure(results: Sequence[Mapping[str, Any]], key: str) -> list[Any]:
    values = [result["score"][key] for result in results if result["status"] == "scored"]
    return [value for value in values if value is not None]


def _suspected(results: Sequence[Mapping[str, Any]]) -> score.Rate:
    """Of the corrupt runs, how many are named as suspects."""
    spoilt = [result for result in results if result["made"]["bad_runs"]]
    found = sum(score.suspected(result["made"]["bad_runs"], result.get("suspects", ())) for result in spoilt)
    return score.wilson(found, sum(len(result["made"]["bad_runs"]) for result in spoilt))


def summary(results: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The rates of issue and table: naming, additions, parameters, gap; each a share with its interval."""
    hidden = _scored(results, "single", "pair")
    strong = [result for result in hidden if result["case"]["size"] >= 3.0]
    named = [result["status"] == "scored" and bool(result["score"]["named"]) for result in strong]
    nothing = _scored(results, "none")
    extra = [result["status"] == "scored" and bool(result["score"]["false_additions"]) for result in results]
    parameters = [
        entry
        for result in strong
        if result["status"] == "scored"
        for table in result["score"]["parameters"].values()
        for entry in table.values()
    ]
    shares = sorted(entry["share"] for entry in parameters if entry.get("share") is not None)
    ratios = _measure(strong, "gap_ratio")
    models = [result["model"]["ratio"] for result in strong if result.get("model")]
    claimed = [result["status"] == "scored" and bool(result["claims"]) for result in nothing]
    out = {
        "cases": len(results),
        "crashed": score.rate([result["status"] != "scored" for result in results]).plain(),
        "exact_naming": score.rate(named).plain(),
        "false_addition_where_nothing_is_missing": score.rate(claimed).plain(),
        "silent_where_nothing_is_missing": score.rate([_passed(result) for result in nothing]).plain(),
        "false_addition_in_any_case": score.rate(extra).plain(),
        "weak_not_claimed": score.rate([_passed(result) for result in _scored(results, "weak")]).plain(),
        "foreign_not_misnamed": score.rate([_passed(result) for result in _scored(results, "foreign")]).plain(),
        "confounded_reported": score.rate([_passed(result) for result in _scored(results, "confounded")]).plain(),
        "parameters_right": score.rate([entry["right"] for entry in parameters]).plain(),
        "parameters_within_5_percent": score.rate([entry["within_share"] for entry in parameters]).plain(),
        "median_parameter_error": shares[len(shares) // 2] if shares else None,
        "gap_at_most_1.1_floors_as_reported": score.rate([ratio <= score.GAP_LIMIT for ratio in ratios]).plain(),
        "gap_at_most_1.1_floors_against_truth": score.rate([ratio <= score.GAP_LIMIT for ratio in models]).plain(),
        "median_seconds": sorted(result["seconds"] for result in results)[len(results) // 2] if results else None,
    }
    out |= {"corrupt_runs_suspected": _suspected(results).plain()}
    by: dict[str, dict[str, Any]] = {}
    for label in ("format", "noise", "layout", "size", "effects"):
        groups: dict[str, list[bool]] = defaultdict(list)
        for result, right in zip(strong, named, strict=True):
            value = result["case"][label]
            for key in value if isinstance(value, list | tuple) else [value]:
                groups[str(key)].append(right)
        by[label] = {key: score.rate(values).plain() for key, values in sorted(groups.items())}
    return out | {"exact_naming_by": by}


def lines(table: Mapping[str, Any]) -> list[str]:
    """The summary for a reader."""
    out = []
    for key, value in table.items():
        if isinstance(value, Mapping) and "hits" in value:
            text = str(score.wilson(int(value["hits"]), int(value["of"])))
        elif key.endswith("_by"):
            continue
        else:
            text = "none" if value is None else f"{value:.4g}"
        out.append(f"  {key.replace('_', ' '):45s} {text}")
    return out


# ------------------------------------------------------------------------------------------------ command line


def _kept(path: Path, mark: str) -> dict[str, dict[str, Any]]:
    """Results of an earlier, interrupted run of the same program."""
    if not path.is_file():
        return {}
    found = [json.loads(line) for line in path.read_text().splitlines() if line.strip()]
    return {entry["result"]["case"]["name"]: entry["result"] for entry in found if entry["program"] == mark}


def arguments(values: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.reconcile.blind.run", description=__doc__)
    parser.add_argument(
        "--seeds", choices=tuple(cases.FIRST_SEED), default="dev", help="which seeds (dev: 0.., heldout: 10000..)"
    )
    parser.add_argument("--cases", type=int, default=cases.ROUND, help="how many cases")
    parser.add_argument("--first", type=int, default=0, help="first case of the list")
    parser.add_argument("--only", default="", help="only cases whose name contains one of these texts, comma between")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", type=Path, default=ROOT / "build" / "blind.json")
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "blind")
    parser.add_argument("--lean", action="store_true", help="in workers that stay, without pages: twice as fast")
    parser.add_argument("--keep", action="store_true", help="keep the files of every case")
    parser.add_argument("--fresh", action="store_true", help="forget an interrupted run")
    return parser.parse_args(values)


def main(values: Sequence[str] | None = None) -> int:
    options = arguments(values)
    wanted = cases.listed(options.seeds, options.cases, options.first)
    if options.only:
        wanted = [case for case in wanted if any(text in case.name for text in options.only.split(","))]
    options.json.parent.mkdir(parents=True, exist_ok=True)
    partial, mark = options.json.with_suffix(".partial"), fingerprint()
    kept = {} if options.fresh else _kept(partial, mark)
    results = {case.name: kept[case.name] for case in wanted if kept.get(case.name, {}).get("case") == case.plain()}
    todo = [case for case in wanted if case.name not in results]
    say(f"{len(wanted)} cases on {options.seeds} seeds, {len(results)} already there, program {mark}")
    pool: Executor = ThreadPoolExecutor(options.jobs)
    how = reconcile
    if options.lean:
        # workers load NumPy anew, on one core each
        os.environ |= ONE_CORE
        pool = ProcessPoolExecutor(options.jobs, multiprocessing.get_context("spawn"), initializer=leave_nobody)
        how = lean
    with pool, partial.open("w") as file:
        for result in kept.values():
            file.write(json.dumps({"program": mark, "result": result}) + "\n")
        running = {pool.submit(run_case, case, options.work, options.keep, how): case for case in todo}
        for future in as_completed(running):
            result = future.result()
            # through JSON, so that fresh and kept results have the same types
            results[running[future].name] = json.loads(json.dumps(result))
            file.write(json.dumps({"program": mark, "result": result}) + "\n")
            file.flush()
            said = ", ".join(claim["name"] for claim in result.get("claims", ())) or "-"
            mark_of = "ok  " if _passed(result) else "FAIL"
            name = running[future].name
            say(f"[{len(results)}/{len(wanted)}] {mark_of} {name}: {result['status']}, {said}")
    ordered = [results[case.name] for case in wanted]
    table = summary(ordered)
    seeds = f"{options.seeds} ({cases.FIRST_SEED[options.seeds]} and up)"
    whole = {"seeds": seeds, "program": mark, "summary": table, "cases": ordered}
    options.json.write_text(json.dumps(whole, indent=1) + "\n")
    say("\n".join([f"{options.seeds} seeds, written to {options.json}", *lines(table)]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
