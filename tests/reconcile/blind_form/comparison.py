"""Measures that need no names, so that methods that name nothing can be compared with the program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .make import Truth
from .points import Complex, rms_by_order, spectrum
from .score import STRONG


def judge(truth: Truth, orders: Sequence[int], added: Complex) -> dict[str, Any]:
    """The measures that need no names."""
    limit = added.shape[-1]
    hidden = truth.by_order()
    near = {round(order + k) for part in truth.parts for order in part.orders for k in (-1, 0, 1)}
    real = {int(order) for order in np.flatnonzero(hidden > 0.1 * truth.noise_by_order[: len(hidden)])} | near
    strong = [
        part for part, strength in zip(truth.parts, truth.strength, strict=True) if strength >= STRONG and part.orders
    ]
    fresh = spectrum(truth.hidden_fresh)[..., :limit]
    before = float(np.sqrt(np.sum(rms_by_order(fresh) ** 2)))
    after = float(np.sqrt(np.sum(rms_by_order(fresh - added) ** 2)))
    noise = float(np.sqrt(np.sum(truth.noise_by_order[:limit] ** 2)))
    return {
        "orders": list(orders)[:40],
        "spoken_of": [any(order in part.orders for order in orders) for part in strong],
        "false_orders": len([order for order in orders if order not in real]),
        "fresh_gap": [after, before, noise],
    }


def table(results: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Rates over cases without a mistake of measuring, and the same of those with one."""
    out: dict[str, Any] = {}
    for label, chosen in (
        ("without mistakes of measuring", [one for one in results if not one["case"]["mistakes"]]),
        ("with mistakes of measuring", [one for one in results if one["case"]["mistakes"]]),
    ):
        nothing = [one for one in chosen if not one["truth"]["parts"]]
        spoken = [said for one in chosen for said in one["spoken_of"]]
        ratios = [one["fresh_gap"][0] / one["fresh_gap"][1] for one in chosen if one["spoken_of"]]
        rose = [one["fresh_gap"][0] > max(1.05 * one["fresh_gap"][1], one["fresh_gap"][2]) for one in chosen]
        out[label] = {
            "cases": len(chosen),
            "strong_parts_spoken_of": [sum(spoken), len(spoken)],
            "cases_with_false_orders": [sum(one["false_orders"] > 0 for one in chosen), len(chosen)],
            "silent_where_nothing_is_missing": [sum(not one["orders"] for one in nothing), len(nothing)],
            "median_of_fresh_gap_after_over_before": float(np.median(ratios)) if ratios else None,
            "fresh_gap_rises_beyond_the_noise": [sum(rose), len(rose)],
        }
    return out


def lines(values: Mapping[str, Any]) -> list[str]:
    out = []
    for label, row in values.items():
        out.append(f"{label}: {row['cases']} cases")
        for key, value in row.items():
            if key == "cases":
                continue
            text = f"{value[0]}/{value[1]}" if isinstance(value, list) else "-" if value is None else f"{value:.3f}"
            out.append(f"  {key.replace('_', ' '):40s} {text}")
    return out
