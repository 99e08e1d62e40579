"""What a `report.json` says, read as docs/reconcile.md describes it, and nothing of the program that wrote it."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

#: where a report may speak of the measurement: keys that begin so
_MEASUREMENT_KEYS = ("measur", "mistake", "question")
#: where it may say what the data cannot show
_UNSEEN_KEYS = ("not_", "unseen", "cannot", "limits", "never")
#: an entry about the measurement that was tested and not found says nothing: one of these keys is false
_FOUND_KEYS = ("found", "accepted", "passed", "likely")
_PROBABILITY_KEYS = ("probability", "confidence", "posterior")


@dataclass(frozen=True)
class Parameter:
    value: float
    stderr: float | None
    before: float | None


@dataclass(frozen=True)
class Claim:
    """An effect that a report adds (`retuned`: changes)."""

    name: str
    orders: tuple[float, ...]
    parameters: Mapping[str, Parameter]
    alternatives: frozenset[str]
    remarks: tuple[str, ...]
    probability: float | None
    share: float | None

    @property
    def is_hedged(self) -> bool:
        """It names alternatives, or says in a remark or a probability that it is not sure."""
        unsure = self.probability is not None and self.probability < 0.95
        return bool(self.alternatives) or bool(self.remarks) or unsure

    def is_about(self, orders: Iterable[float]) -> bool:
        """It has no order, or the wave is on one of its own, or there is no certain order to compare with."""
        theirs = tuple(orders)
        return not self.orders or not theirs or any(abs(a - b) < 0.5 for a in self.orders for b in theirs)


@dataclass(frozen=True)
class Leftover:
    order: float | None
    size: float | None
    direction: str
    text: str
    at_least: bool = False


@dataclass(frozen=True)
class Report:
    verdict: str
    effects: tuple[Claim, ...]
    retuned: tuple[Claim, ...]
    unexplained: tuple[Leftover, ...]
    gap: Mapping[str, Mapping[str, float]]
    orders: tuple[int, ...]
    by_order: Mapping[float, Mapping[str, float]]
    suspects: tuple[str, ...]
    zero: tuple[float, float] | None
    measurement: tuple[str, ...]
    about_unseen: str
    whole: str
    floor_is_bound: bool = False
    held_out_is_bound: bool = False

    @property
    def is_rounded(self) -> bool:
        """No parameter has more than six digits, so that a round number says nothing about a bound."""
        values = [p.value for claim in (*self.effects, *self.retuned) for p in claim.parameters.values()]
        return all(float(f"{value:.6g}") == value for value in values)


def _number(value: Any) -> float | None:
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return float(value) if is_number else None


def _names(values: Iterable[Any]) -> frozenset[str]:
    found: set[str] = set()
    for value in values:
        said = value.get("name", value.get("effect")) if isinstance(value, Mapping) else value
        found |= set(map(str, said)) if isinstance(said, list | tuple) else {str(said)} if said is not None else set()
    return frozenset(found)


def _claim(table: Mapping[str, Any]) -> Claim:
    parameters = {}
    for key, value in table.get("parameters", {}).items():
        entry = value if isinstance(value, Mapping) else {"value": value}
        number = _number(entry.get("value"))
        if number is not None:
            parameters[key] = Parameter(number, _number(entry.get("stderr")), _number(entry.get("before")))
    probability = next((_number(table[key]) for key in _PROBABILITY_KEYS if key in table), None)
    return Claim(
        str(table["name"]),
        tuple(float(order) for order in table.get("orders", ())),
        parameters,
        _names(table.get("alternatives", ())),
        tuple(str(remark) for remark in table.get("remarks", ())),
        probability,
        _number(table.get("share_of_gap")),
    )


def _leftover(entry: Any) -> Leftover:
    if not isinstance(entry, Mapping):
        return Leftover(None, None, "both", str(entry))
    direction, least = str(entry.get("direction", "both")), bool(entry.get("at_least", False))
    return Leftover(_number(entry.get("order")), _number(entry.get("size")), direction, json.dumps(entry), least)


def _about(report: Mapping[str, Any], beginnings: Iterable[str]) -> str:
    """All that stands under keys with one of these beginnings, as one text; empty where there is nothing."""
    starts = tuple(beginnings)
    return " ".join(json.dumps(value) for key, value in report.items() if key.startswith(starts) and value)


def _measurement(report: Mapping[str, Any]) -> tuple[str, ...]:
    """One text for each mistake of measuring that a report says was made."""
    found: list[str] = []
    for key, value in report.items():
        if not key.startswith(_MEASUREMENT_KEYS) or not value:
            continue
        listed = value["mistakes"] if isinstance(value, Mapping) and "mistakes" in value else value
        entries = listed if isinstance(listed, list) else [listed]
        for entry in entries:
            is_table = isinstance(entry, Mapping)
            if is_table and any(entry.get(mark) is False for mark in _FOUND_KEYS):
                continue
            found.append(str(entry["name"]) if is_table and "name" in entry else json.dumps(entry))
    return tuple(found)


def _suspect(entry: Any) -> str:
    """A suspected run as text: its file, or its conditions with their units."""
    if not isinstance(entry, Mapping):
        return str(entry)
    conditions = [entry.get(key) for key in ("speed_rpm", "torque_Nm", "temperature_C")]
    label = "{} rpm, {} N m, {} degC".format(*conditions) if None not in conditions else ""
    return f"{label} {json.dumps(entry)}"


def read_report(report: Mapping[str, Any]) -> Report:
    """KeyError or ValueError where a promised key is missing or is something else."""
    gap = {
        part: {k: float(v) for k, v in table.items() if _number(v) is not None} for part, table in report["gap"].items()
    }
    zero = report.get("zero_offset_deg")
    zeros = (float(zero["rig"]), float(zero["new"])) if isinstance(zero, Mapping) else None
    return Report(
        str(report["verdict"]),
        tuple(map(_claim, report["effects"])),
        tuple(map(_claim, report.get("retuned", ()))),
        tuple(map(_leftover, report["unexplained"])),
        gap,
        tuple(int(order) for order in report.get("orders", ())),
        {float(row["order"]): {k: float(v) for k, v in row.items() if _number(v) is not None}
         for row in report.get("gap_by_order", ())},
        tuple(map(_suspect, report.get("suspect_runs", ()))),
        zeros,
        _measurement(report),
        _about(report, _UNSEEN_KEYS),
        json.dumps(report),
        bool(report.get("noise_floor_at_most", False)),
        bool(report.get("held_out_at_least") or report.get("held_out_scatters")),
    )  # fmt: skip


def says(text: str, words: Iterable[str]) -> bool:
    """One of the words stands in the text, in any case of letters, at the beginning of a word; _ is a space."""
    text = text.replace("_", " ")
    return any(re.search(rf"(?<![a-z]){re.escape(word.lower())}", text.lower()) for word in words)
