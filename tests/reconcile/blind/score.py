"""What a report is worth, given what was hidden: names, additions, parameters, gap; rates with Wilson intervals.

Knows `report.json` only as docs/reconcile.md describes it, and nothing of the program that wrote it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

#: a parameter is right within this part of its value, or within this many of its own standard errors
PARAMETER_SHARE = 0.05
PARAMETER_ERRORS = 3.0
#: the same share of a radian, for angles
ANGLE_SHARE_DEG = math.degrees(PARAMETER_SHARE)
#: what may be left on held-out conditions, in noise floors
GAP_LIMIT = 1.1


@dataclass(frozen=True)
class Claim:
    """One effect that a report adds."""

    name: str
    orders: tuple[int, ...]
    parameters: Mapping[str, tuple[float, float | None]]
    alternatives: tuple[str, ...]

    @property
    def names(self) -> frozenset[str]:
        return frozenset((self.name, *self.alternatives))


@dataclass(frozen=True)
class Report:
    """The part of a `report.json` that is scored."""

    verdict: str
    claims: tuple[Claim, ...]
    unexplained_orders: tuple[float, ...]
    unexplained_count: int
    gap: Mapping[str, Mapping[str, float]]
    suspects: tuple[str, ...] = ()


@dataclass(frozen=True)
class Expected:
    """What an honest and able report says about a case.

    `kind` is one of the keys of JUDGES. `hidden` holds the effects that were left out of the rig, each with its true
    parameters (those that the data can fix). `groups` holds sets of names that the data of this case cannot tell apart.
    `mesh` holds the order of those that sit on one mesh order: the right name on another order is a wrong claim.
    `orders` are those of a signature that no effect of the catalogue explains; `corrupt` the number of bad runs;
    `drifted` where the parameters of known effects are a little off, so that there is a gap and nothing to add.
    """

    kind: str
    hidden: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    groups: tuple[frozenset[str], ...] = ()
    orders: tuple[int, ...] = ()
    corrupt: int = 0
    mesh: Mapping[str, int] = field(default_factory=dict)
    drifted: bool = False

    def is_hidden(self, claim: Claim) -> bool:
        """Whether this is what was hidden: its name, and its order where it has one and the report says which."""
        order = self.mesh.get(claim.name)
        return claim.name in self.hidden and (order is None or not claim.orders or order in claim.orders)


@dataclass(frozen=True)
class Score:
    """Right or wrong by each measure; None where a measure does not apply."""

    passed: bool
    named: bool | None
    false_additions: tuple[str, ...]
    missed: tuple[str, ...]
    hedged: tuple[str, ...]
    parameters: Mapping[str, Mapping[str, Any]]
    parameters_right: bool | None
    gap_ratio: float | None
    verdict: str
    remarks: tuple[str, ...]

    def plain(self) -> dict[str, Any]:
        return asdict(self)


# ------------------------------------------------------------------------------------------------ reading a report


def _names(values: Iterable[Any]) -> tuple[str, ...]:
    """Alternatives as plain names, or as tables that hold a `name` or `effect`."""
    out: list[str] = []
    for value in values:
        said = value.get("name", value.get("effect")) if isinstance(value, Mapping) else value
        if isinstance(said, list | tuple):
            out.extend(map(str, said))
        elif said is not None:
            out.append(str(said))
    return tuple(out)


def _parameter(value: Any) -> tuple[float, float | None]:
    if isinstance(value, Mapping):
        stderr = value.get("stderr")
        return float(value["value"]), None if stderr is None else float(stderr)
    return float(value), None


def _claim(table: Mapping[str, Any]) -> Claim:
    parameters = {}
    for key, value in table.get("parameters", {}).items():
        number = value.get("value") if isinstance(value, Mapping) else value
        if isinstance(number, int | float) and not isinstance(number, bool):
            parameters[key] = _parameter(value)
    orders = tuple(int(order) for order in table.get("orders", ()))
    return Claim(str(table["name"]), orders, parameters, _names(table.get("alternatives", ())))


def read_report(report: Mapping[str, Any]) -> Report:
    """`report.json` as docs/reconcile.md has it; KeyError where a promised key is missing."""
    unexplained = report["unexplained"]
    orders = [entry["order"] for entry in unexplained if isinstance(entry, Mapping) and entry.get("order") is not None]
    gap = {
        part: {key: float(number) for key, number in values.items() if isinstance(number, int | float)}
        for part, values in _gap_by_part(report["gap"]).items()
    }
    suspects = report.get("suspect_runs", report.get("suspects", ()))
    return Report(
        verdict=str(report["verdict"]),
        claims=tuple(_claim(table) for table in report["effects"]),
        unexplained_orders=tuple(float(order) for order in orders),
        unexplained_count=len(unexplained),
        gap=gap,
        suspects=tuple(map(str, suspects)),
    )


def _gap_by_part(gap: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """`gap` as {fitted, held_out} -> {before, after, noise_floor}, whichever of the two comes first in the file."""
    parts: dict[str, dict[str, float]] = {"fitted": {}, "held_out": {}}
    for key, value in gap.items():
        if not isinstance(value, Mapping):
            continue
        for inner, number in value.items():
            if key in parts:
                parts[key][inner] = number
            elif inner in parts:
                parts[inner][key] = number
    return parts


# ------------------------------------------------------------------------------------------------ judging it


def angle_distance(one: float, other: float) -> float:
    """Smallest distance of two angles in degrees."""
    return abs((one - other + 180.0) % 360.0 - 180.0)


def judge_parameter(key: str, truth: float, estimate: float, stderr: float | None) -> dict[str, Any]:
    """Error of one parameter and whether it is within the aim; angles (`*_deg` phases) wrap, and need no share of 0."""
    is_phase = "phase" in key
    scale = 1.0
    if is_phase and key.endswith("_rad"):
        scale = 180.0 / math.pi
    error = angle_distance(scale * estimate, scale * truth) / scale if is_phase else abs(estimate - truth)
    allowed = ANGLE_SHARE_DEG / scale if is_phase else PARAMETER_SHARE * abs(truth)
    within_share = error <= allowed
    within_errors = stderr is not None and math.isfinite(stderr) and error <= PARAMETER_ERRORS * stderr
    return {
        "truth": truth,
        "estimate": estimate,
        "stderr": stderr,
        "error": error,
        "share": None if is_phase or truth == 0.0 else error / abs(truth),
        "z": error / stderr if stderr else None,
        "within_share": within_share,
        "right": within_share or within_errors,
    }


def _match(report: Report, expected: Expected) -> tuple[dict[str, Claim], list[str], list[str], list[str]]:
    """(hidden name -> claim, hidden names only among alternatives, missed names, false additions)."""
    exact = {claim.name: claim for claim in report.claims if expected.is_hidden(claim)}
    hedged, missed = [], []
    for name in expected.hidden:
        if name in exact:
            continue
        (hedged if any(name in claim.alternatives for claim in report.claims) else missed).append(name)
    false = [
        claim.name
        for claim in report.claims
        if not expected.is_hidden(claim) and not (set(claim.alternatives) & set(hedged))
    ]
    return exact, hedged, missed, false


def _judge_hidden(report: Report, expected: Expected) -> tuple[bool, list[str]]:
    """One or several effects were hidden and the data tell them from all others."""
    exact, hedged, missed, false = _match(report, expected)
    remarks = [f"{name} only among the alternatives" for name in hedged] + [f"{name} was not found" for name in missed]
    if report.verdict not in ("explained", "partly_explained"):
        remarks.append(
            f"verdict {report.verdict} although effects were named" if exact else f"verdict {report.verdict}"
        )
    return not (hedged or missed or false), remarks


def _judge_nothing(report: Report, expected: Expected) -> tuple[bool, list[str]]:
    """Nothing is missing, or it is too weak to be seen."""
    silent = ("nothing_missing", "explained") if expected.drifted else ("nothing_missing",)
    right = not report.claims and report.verdict in silent and not report.unexplained_count
    remarks = [] if right else [f"verdict {report.verdict}, {report.unexplained_count} unexplained"]
    return right, remarks


def _judge_weak(report: Report, expected: Expected) -> tuple[bool, list[str]]:
    """Too weak to be found: a claim is wrong even when its name happens to be right."""
    return not report.claims, [f"claimed {claim.name}" for claim in report.claims]


def _judge_foreign(report: Report, expected: Expected) -> tuple[bool, list[str]]:
    """No effect of the catalogue explains it: a signature, no new name beside those that were really hidden."""
    _, hedged, missed, false = _match(report, expected)
    remarks = [f"misnamed {name}" for name in false] + [f"{name} was not found" for name in (*hedged, *missed)]
    if report.verdict not in ("unexplained", "partly_explained"):
        remarks.append(f"verdict {report.verdict}")
    near = {round(order) for order in report.unexplained_orders}
    if not set(expected.orders) <= near:
        remarks.append(f"signature of orders {expected.orders} not among {sorted(near)[:12]}")
    return not false, remarks


def _judge_confounded(report: Report, expected: Expected) -> tuple[bool, list[str]]:
    """The data cannot tell: right is who names one of the group and the rest as alternatives."""
    remarks = []
    right = True
    for group in expected.groups:
        claims = [claim for claim in report.claims if claim.name in group]
        if len(claims) != 1 or not group <= claims[0].names:
            right = False
            said = [sorted(claim.names) for claim in claims]
            remarks.append(f"group {sorted(group)}: report says {said}")
    members = frozenset().union(*expected.groups)
    right &= not [claim for claim in report.claims if claim.name not in members]
    return right, remarks


JUDGES = {
    "single": _judge_hidden,
    "pair": _judge_hidden,
    "none": _judge_nothing,
    "weak": _judge_weak,
    "foreign": _judge_foreign,
    "confounded": _judge_confounded,
}


def score(report: Report, expected: Expected) -> Score:
    """All measures of one case."""
    passed, remarks = JUDGES[expected.kind](report, expected)
    exact, hedged, missed, false = _match(report, expected)
    if expected.kind == "confounded":
        members = frozenset().union(*expected.groups)
        false = [claim.name for claim in report.claims if claim.name not in members]
        hedged = missed = []
    parameters: dict[str, dict[str, Any]] = {}
    for name, claim in exact.items():
        parameters[name] = {}
        for key, truth in expected.hidden[name].items():
            if key not in claim.parameters:
                remarks = [*remarks, f"{name}: parameter {key} is not in the report"]
                parameters[name][key] = {"truth": truth, "estimate": None, "right": False, "within_share": False}
                continue
            parameters[name][key] = judge_parameter(key, truth, *claim.parameters[key])
    judged = [entry["right"] for table in parameters.values() for entry in table.values()]
    held_out = report.gap.get("held_out", {})
    floor = held_out.get("noise_floor", 0.0)
    if expected.corrupt and not report.suspects:
        remarks = [*remarks, f"{expected.corrupt} corrupt runs and no suspect named"]
    return Score(
        passed=passed,
        named=None if expected.kind not in ("single", "pair") else not (hedged or missed),
        false_additions=tuple(false),
        missed=tuple(missed),
        hedged=tuple(hedged),
        parameters=parameters,
        parameters_right=all(judged) if judged else None,
        gap_ratio=held_out["after"] / floor if floor > 0.0 and "after" in held_out else None,
        verdict=report.verdict,
        remarks=tuple(remarks),
    )


def suspected(bad_runs: Sequence[str], suspects: Sequence[str]) -> int:
    """How many of `bad_runs` ("1000 rpm, 200 N m", with "file = " in front for curves) a report suspects."""
    texts = [text.replace("Nm", "N m") for text in suspects]
    found = 0
    for bad in bad_runs:
        file, _, condition = bad.rpartition(" = ")
        # "120 rpm" is not in "1120 rpm"
        marks = [re.compile(rf"(?<![\d.]){re.escape(mark)}") for mark in condition.split(", ")]
        found += any(all(mark.search(text) for mark in marks) or (file and file in text) for text in texts)
    return found


# ------------------------------------------------------------------------------------------------ rates


@dataclass(frozen=True)
class Rate:
    """A share with its 95 % interval after Wilson."""

    hits: int
    total: int
    low: float
    high: float

    @property
    def share(self) -> float:
        return self.hits / self.total if self.total else math.nan

    def plain(self) -> dict[str, float | int | None]:
        share = self.share if self.total else None
        return {"hits": self.hits, "of": self.total, "share": share, "low": self.low, "high": self.high}

    def __str__(self) -> str:
        if not self.total:
            return "no case"
        low, high = 100 * self.low, 100 * self.high
        return f"{100 * self.share:.1f} % ({self.hits} of {self.total}; 95 %: {low:.1f} to {high:.1f})"


def wilson(hits: int, total: int, z: float = 1.959963984540054) -> Rate:
    """Wilson's score interval for `hits` of `total` (Wilson 1927, equation 8 without correction for continuity)."""
    if total == 0:
        return Rate(0, 0, 0.0, 1.0)
    share, shrink = hits / total, 1.0 + z * z / total
    centre = (share + z * z / (2 * total)) / shrink
    half = z * math.sqrt(share * (1.0 - share) / total + z * z / (4.0 * total * total)) / shrink
    return Rate(hits, total, max(0.0, centre - half), min(1.0, centre + half))


def rate(values: Sequence[bool]) -> Rate:
    return wilson(sum(values), len(values))
