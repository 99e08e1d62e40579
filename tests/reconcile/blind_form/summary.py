"""Rates of the suite, for a file and for a reader."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from . import comparison
from .points import Array

Result = Mapping[str, Any]


def joined(first: Array, second: Array) -> Array:
    return np.concatenate([first, second])


def false_of(result: Result) -> list[Mapping[str, str]]:
    return list((result.get("score") or {}).get("false", ()))


def _rate(values: Sequence[bool]) -> dict[str, int]:
    return {"hits": sum(map(bool, values)), "of": len(values)}


def _row(results: Sequence[Result]) -> dict[str, Any]:
    """One row: all cases of a label."""
    scored = [result for result in results if result.get("score")]
    named = [result["score"]["named"] for result in scored if result["score"]["named"] is not None]
    return {
        "cases": len(results),
        "right": sum(result["right"] for result in results),
        "named": _rate(named),
        "with_false": sum(bool(false_of(result)) for result in results),
        "false": dict(Counter(row["kind"] for result in results for row in false_of(result))),
        "no_result": sum(result["status"] in ("failed", "timeout", "unreadable") for result in results),
        "refused": sum(result["status"] == "refused" for result in results),
    }


def _worse_with_better(results: Sequence[Result]) -> list[dict[str, Any]]:
    """Cases that are wrong, while the same case with more noise is right."""
    groups: dict[tuple[str, int], list[Result]] = defaultdict(list)
    for result in results:
        groups[result["case"]["label"], result["case"]["seed"]].append(result)
    found = []
    for (label, seed), members in sorted(groups.items()):
        rising = sorted(members, key=lambda result: float(result["case"]["noise"]))
        for clean, noisy in ((a, b) for i, a in enumerate(rising) for b in rising[i + 1 :]):
            if noisy["right"] and not clean["right"]:
                noises = [clean["case"]["noise"], noisy["case"]["noise"]]
                found.append({"label": label, "seed": seed, "wrong_at": noises[0], "right_at": noises[1]})
    return found


def calibration(results: Sequence[Result]) -> list[dict[str, float]]:
    """Stated probabilities against how often the name is true, in bins of a tenth."""
    pairs = [
        (float(p), bool(true)) for result in results for p, true in (result.get("score") or {}).get("probabilities", ())
    ]
    bins = []
    for tenth in range(10):
        inside = [(p, true) for p, true in pairs if tenth == min(int(10 * p), 9)]
        if inside:
            stated = float(np.mean([p for p, _ in inside]))
            observed = float(np.mean([true for _, true in inside]))
            low, high = wilson(sum(true for _, true in inside), len(inside))
            rate = {"stated": stated, "observed": observed, "low": low, "high": high}
            bins.append({"from": tenth / 10, "claims": len(inside), **rate})
    return bins


def wilson(hits: int, of: int) -> tuple[float, float]:
    """The 95 % interval of a share."""
    z = 1.96
    middle, half = (hits + z * z / 2) / (of + z * z), z * np.sqrt(hits * (of - hits) / of + z * z / 4) / (of + z * z)
    return float(middle - half), float(middle + half)


def calibration_lines(bins: Sequence[Mapping[str, float]]) -> list[str]:
    """A table of stated probabilities against how often the name was true."""
    head = ["| stated | names | mean stated | true | 95 % interval |", "|---|---|---|---|---|"]
    return head + [
        f"| {one['from']:.1f} to {one['from'] + 0.1:.1f} | {one['claims']} | {one['stated']:.2f} | "
        f"{one['observed']:.2f} | {one['low']:.2f} to {one['high']:.2f} |"
        for one in bins
    ]


def table(results: Sequence[Result]) -> dict[str, Any]:
    """All rates; every false statement with its case."""
    by_label: dict[str, list[Result]] = defaultdict(list)
    for result in results:
        by_label[result["case"]["label"]].append(result)
    scores = [result["score"] for result in results if result.get("score")]
    sizes = [pair for marks in scores for pair in marks["sizes"]]
    held = [marks["held_out"] for marks in scores if marks["held_out"]]
    silent = [marks["silent"] for marks in scores if marks["silent"] is not None]
    ratios = sorted(true / said for said, true, _ in held if said > 0)
    return {
        "all": _row(results),
        "by_kind": {label: _row(members) for label, members in by_label.items()},
        "by_noise": {
            str(noise): _row([result for result in results if result["case"]["noise"] == noise])
            for noise in sorted({result["case"]["noise"] for result in results})
        },
        "by_form": {
            f"{key}: {value}": _row([result for result in results if result["case"][key] == value])
            for key in ("layout", "noise_form", "form")
            for value in sorted({result["case"][key] for result in results})
        },
        "silent_where_nothing_is_missing": _rate(silent),
        "sizes_within_20_percent": _rate([abs(said - true) <= 0.2 * true for said, true in sizes]),
        "held_out_true_over_stated": {
            "median": ratios[len(ratios) // 2] if ratios else None,
            "within_a_factor_of_1.5": _rate([1 / 1.5 <= ratio <= 1.5 for ratio in ratios]),
        },
        "without_names": comparison.table(
            [{**result, **result["comparison"]} for result in results if result.get("comparison")]
        ),
        "calibration": calibration(results),
        "better_data_worse_answer": _worse_with_better(results),
        "false_statements": [
            {"case": result["case"]["name"], "noise": result["case"]["noise"], **row}
            for result in results
            for row in false_of(result)
        ],
        "reasons": [
            {"case": result["case"]["name"], "reason": result["reason"]} for result in results if result.get("reason")
        ],
    }


def _text_of(rate: Mapping[str, int]) -> str:
    return f"{rate['hits']}/{rate['of']}" if rate["of"] else "-"


def _line(label: str, row: Mapping[str, Any]) -> str:
    kinds = ", ".join(f"{kind} {count}" for kind, count in sorted(row["false"].items(), key=lambda one: -one[1]))
    none = f"{row['no_result']}" if row["no_result"] else ""
    refused = f"{row['refused']}" if row["refused"] else ""
    numbers = f"{row['cases']:5d} {row['right']:5d} {_text_of(row['named']):>7s} {row['with_false']:5d}"
    return f"{label:38s} {numbers} {refused:>7s} {none:>9s}  {kinds}"


def lines(values: Mapping[str, Any]) -> list[str]:
    """The table for a reader."""
    head = f"{'kind':38s} cases right   named false refused no result  false statements by kind"
    out = [head, *(_line(label, row) for label, row in values["by_kind"].items()), ""]
    out += [_line(f"noise {noise}", row) for noise, row in values["by_noise"].items()]
    out += ["", *(_line(label, row) for label, row in values["by_form"].items())]
    out += ["", _line("all", values["all"]), ""]
    out.append(f"silent where nothing is missing: {_text_of(values['silent_where_nothing_is_missing'])}")
    out.append(f"sizes of what is unexplained within 20 %: {_text_of(values['sizes_within_20_percent'])}")
    held = values["held_out_true_over_stated"]
    if held["median"] is not None:
        within = _text_of(held["within_a_factor_of_1.5"])
        out.append(f"held-out gap, true over stated: median {held['median']:.2f}, within a factor of 1.5: {within}")
    out += ["", "without names, as the peers are measured (a mean that a changed parameter moves has no order)"]
    out += [*comparison.lines(values["without_names"]), ""]
    out += calibration_lines(values["calibration"])
    out.append(f"better data, worse answer: {len(values['better_data_worse_answer'])}")
    out += [f"  {row['label']} ({row['seed']}): wrong at {row['wrong_at']:g} noises, right at {row['right_at']:g}"
            for row in values["better_data_worse_answer"]]  # fmt: skip
    return out
