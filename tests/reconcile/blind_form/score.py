"""What a report is worth: every false statement as a row, and what it should have said.

A statement is judged against the truth of the case, never against what another program would have found. Where a size
is judged, what the written rig.toml makes is simulated free of noise and compared with what was hidden.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from .make import Truth
from .measuring import HIDDEN, TRUE_NAMES, WORDS
from .points import Array, Part, rms_by_order, spectrum
from .report import Claim, Leftover, Report, says

#: a part this many standard deviations strong, over all samples, has to be spoken of; a weaker one may be
STRONG = 15.0
#: sizes are right within this share
SIZE_SHARE = 0.2
#: a stated noise floor is right within this factor, a held-out gap within the next
FLOOR_FACTOR = 1.5
HELD_OUT_FACTOR = 2.0
#: a known parameter counts as changed from this share on, and from this many of its standard errors
CHANGED_SHARE = 0.05
CHANGED_ERRORS = 4.0


@dataclass(frozen=True)
class Statement:
    """Something that a report says and that is false; `kind` is a row of the summary."""

    kind: str
    text: str


@dataclass(frozen=True)
class NewRig:
    """Curves of the rig.toml that was written, free of noise, at the measured runs and at fresh ones.

    `problem`: why the program refuses the file that it wrote; then the curves are those of the old rig.
    """

    measured: Array
    fresh: Array
    problem: str = ""


@dataclass(frozen=True)
class Score:
    """`right`: no false statement, and everything said that had to be said (`missing` is empty)."""

    right: bool
    false: tuple[Statement, ...]
    missing: tuple[str, ...]
    named: bool | None
    silent: bool | None
    sizes: tuple[tuple[float, float], ...]
    held_out: tuple[float, float, float] | None
    floor: tuple[float, float] | None
    probabilities: tuple[tuple[float, bool], ...]

    def plain(self) -> dict[str, Any]:
        return asdict(self)


# ------------------------------------------------------------------------------------------------ names


def true_of(claim: Claim, parts: Sequence[Part]) -> bool:
    """The name is true of a hidden part, or it is hedged and the part allows that."""
    for part in parts:
        orders = (*part.orders, *part.near)
        if not claim.is_about(orders):
            continue
        if claim.name in part.names or set(part.names) & claim.alternatives:
            return True
        if claim.name in part.hedged and claim.is_hedged:
            return True
        # a formula without a name says nothing about a cause
        if claim.name == "empirical":
            return True
    return False


def _is_named_by(claim: Claim, part: Part) -> bool:
    """The name itself is true of the part; what stands among the alternatives does not count."""
    return claim.name in part.names and claim.is_about((*part.orders, *part.near))


def _false_names(truth: Truth, report: Report) -> list[Statement]:
    absorbed = "mistake absorbed" if truth.case.mistakes else "name"
    allowed = {name for mistake in truth.case.mistakes for name in TRUE_NAMES.get(mistake, ())}
    rows = []
    for claim in report.effects:
        if claim.name not in allowed and not true_of(claim, truth.parts):
            on = f" on orders {[round(o) for o in claim.orders][:6]}" if claim.orders else ""
            rows.append(Statement(absorbed, f"names {claim.name}{on}, which is not there"))
    touched = allowed | {name for part in truth.parts for name in (*part.touches, *part.names)}
    for claim in report.retuned:
        changed = [key for key, value in claim.parameters.items() if _is_changed(value.before, value)]
        if changed and not {claim.name, *claim.alternatives} & touched:
            kind = absorbed if truth.case.mistakes else "known parameter"
            rows.append(Statement(kind, f"says that {claim.name} of the rig is wrong ({', '.join(changed[:3])})"))
    return rows


def _is_changed(before: float | None, parameter: Any) -> bool:
    if before is None:
        return False
    change = abs(parameter.value - before)
    errors = parameter.stderr or 0.0
    return bool(change > CHANGED_SHARE * abs(before) and change > CHANGED_ERRORS * errors)


def _bounds(report: Report) -> list[Statement]:
    """A fitted number that is round stands at a bound: least squares gives 16 digits."""
    rows = []
    for claim in report.effects:
        if claim.name == "empirical" or report.is_rounded:
            continue  # its exponents are whole numbers
        for key, value in claim.parameters.items():
            # what has no error is a guess beside what was fitted, and said to be one
            is_fitted = key.split("[")[0] not in ("order", "orders", "cranks") and value.stderr is not None
            if is_fitted and value.value != 0.0 and float(f"{value.value:.3g}") == value.value:
                rows.append(Statement("bound", f"{claim.name}: {key} = {value.value:g} stands at a bound"))
    return rows


# ------------------------------------------------------------------------------------------------ sizes


def remaining(truth: Truth, rig: NewRig, fresh: bool = False) -> Array:
    """RMS in deg by integer order of what the written rig leaves of the truth, free of noise."""
    truth_te = truth.known_fresh + truth.hidden_fresh if fresh else truth.known + truth.hidden
    left = truth_te - (rig.fresh if fresh else rig.measured)
    return rms_by_order(spectrum(left))


def _seen_orders(truth: Truth, report: Report) -> Array:
    """Orders that the report looked at, and those that hold what is hidden."""
    by_order = truth.by_order()
    power = by_order**2
    strong = np.flatnonzero(power > 0.01 * max(float(power.sum()), 1e-30))
    return np.unique([*(order for order in report.orders if order < len(by_order)), *strong]).astype(int)


def _total(by_order: Array, orders: Array) -> float:
    return float(np.sqrt(np.sum(by_order[orders] ** 2)))


def _verdict(truth: Truth, report: Report, rig: NewRig, is_measured_right: bool) -> list[Statement]:
    if report.verdict not in ("explained", "nothing_missing"):
        return []
    if not is_measured_right:
        return [Statement("verdict", f"says {report.verdict} although the measurement has a mistake")]
    if "delay" in truth.case.mistakes:
        return []  # a rig that has the delay predicts what was measured, not the truth without it
    orders = _seen_orders(truth, report)
    left, floor = _total(remaining(truth, rig), orders), _total(truth.noise_by_order, orders)
    strongest = max(truth.strength, default=0.0)
    if left > floor and strongest >= STRONG:
        return [Statement("verdict", f"says {report.verdict}: {left:.2g} deg are left, {left / floor:.1f} floors")]
    # one order may be far above its own floor and below that of all orders together
    ratios = remaining(truth, rig)[orders] / np.maximum(truth.noise_by_order[orders], 1e-12)
    worst = int(np.argmax(ratios))
    if ratios[worst] > max(1.0, STRONG / np.sqrt(4 * len(truth.points))):
        text = f"order {orders[worst]} has {ratios[worst]:.1f} of its own floors left"
        return [Statement("verdict", f"says {report.verdict}: {text}")]
    return []


def _leftover_truth(entry: Leftover, truth: Truth, rig: NewRig) -> tuple[float, float]:
    """(RMS in deg that is truly left in this order, over both directions; over those that the entry speaks of)."""
    left = spectrum(truth.known + truth.hidden - rig.measured)
    order = round(entry.order or 0.0)
    if order >= left.shape[-1]:
        return 0.0, 0.0
    chosen = {"forward": left[:, :1], "backward": left[:, 1:]}.get(entry.direction, left)
    return float(rms_by_order(left)[order]), float(rms_by_order(chosen)[order])


def _sizes(truth: Truth, report: Report, rig: NewRig) -> tuple[list[Statement], list[tuple[float, float]]]:
    """Sizes of what is unexplained, and frequencies of resonances."""
    rows, sizes = [], []
    for entry in report.unexplained:
        if entry.order is None or entry.size is None:
            continue
        true, one_way = _leftover_truth(entry, truth, rig)
        order = round(entry.order)
        noise = truth.noise_by_order[order] if order < len(truth.noise_by_order) else 0.0
        if max(true, entry.size) > noise:
            sizes.append((entry.size, true))
        apart = [entry.size - value for value in (true, one_way)]
        # a size that is said to be the least may be smaller
        apart = [x if entry.at_least else abs(x) for x in apart]
        errors = [x - SIZE_SHARE * value - noise for x, value in zip(apart, (true, one_way), strict=True)]
        if min(errors) > 0:
            rows.append(Statement("size", f"order {order}: says {entry.size:.2g} deg are unexplained, true {true:.2g}"))
    for claim in report.effects:
        value = claim.parameters.get("frequency_Hz")
        for part in truth.parts:
            if claim.name != "structural_resonance" or part.hertz is None or value is None:
                continue
            low, high = part.hertz
            if not 0.97 * low <= value.value <= 1.03 * high:
                text = f"resonance of {value.value:.1f} Hz, true {low:.1f} to {high:.1f}"
                rows.append(Statement("size", text))
    rows += [
        Statement("share", f"{claim.name}: share of the gap {claim.share:.2f}")
        for claim in (*report.effects, *report.retuned)
        if claim.share is not None and not -1e-6 <= claim.share <= 1.05
    ]
    return rows, sizes


def _floor(truth: Truth, report: Report) -> tuple[list[Statement], tuple[float, float] | None]:
    said = report.gap.get("fitted", {}).get("noise_floor")
    if said is None or not report.orders or truth.case.mistakes:
        return [], None
    orders = np.array([order for order in report.orders if order < len(truth.noise_by_order)])
    true = _total(truth.noise_by_order, orders)
    # a floor that is said to be the most may be larger
    if true / FLOOR_FACTOR <= said and (report.floor_is_bound or said <= true * FLOOR_FACTOR):
        return [], (said, true)
    return [Statement("floor", f"noise floor {said:.2g} deg, true {true:.2g}")], (said, true)


def _held_out(truth: Truth, report: Report, rig: NewRig) -> tuple[list[Statement], tuple[float, float, float] | None]:
    """The gap on fresh runs, free of noise: (stated, true after, true before)."""
    said = report.gap.get("held_out", {}).get("after")
    if said is None or not report.orders:
        return [], None
    limit = len(truth.noise_by_order)
    orders = np.array([order for order in report.orders if order < limit])
    after = _total(remaining(truth, rig, fresh=True), orders)
    before = _total(truth.by_order(fresh_runs=True), orders)
    noise = _total(truth.noise_by_order, orders)
    rows = []
    stated = report.gap["held_out"]
    # a delay is a known effect: a rig that has it predicts what will be measured, and is judged on nothing else here
    absorbs = "delay" in truth.case.mistakes
    progress = (
        not absorbs and bool(report.effects or report.retuned) and report.verdict in ("explained", "partly_explained")
    )
    if progress and after > 1.05 * before and after > noise:
        rows.append(Statement("held out", f"new rig is worse on fresh runs: {before:.2g} -> {after:.2g} deg"))
    elif progress and stated.get("before") is not None and said > 1.05 * stated["before"]:
        rows.append(Statement("held out", f"claims progress, and its own held-out gap rises to {said:.2g} deg"))
    true = float(np.hypot(after, noise))
    # a gap that is said to be the least may be larger
    if not truth.case.mistakes and not report.held_out_is_bound and true > HELD_OUT_FACTOR * said:
        rows.append(Statement("held out", f"says that {said:.2g} deg are left on held-out runs, true {true:.2g}"))
    return rows, (said, true, before)


# ------------------------------------------------------------------------------------------------ runs and mistakes


def is_said_bad(truth: Truth, text: str, row: int) -> bool:
    """A suspect's text is about this run: by its file, or by speed, torque and temperature of its label."""
    numbered = re.findall(r"run_0*(\d+)\.csv", text)
    if numbered:
        return str(row + 1) in numbered
    points = truth.labelled
    found = [re.search(rf"([\d.]*\d) ?{unit}", text) for unit in ("rpm", "N ?m", "(?:deg|°)")]
    label = (points.speed[row], points.torque[row], points.temperature[row])
    return all(one is not None and float(one[1]) == value for one, value in zip(found, label, strict=True))


def _suspects(truth: Truth, report: Report) -> tuple[list[Statement], float | None]:
    """Right runs that are called bad; and the share of the wrong ones that are."""
    named = {row for row in range(len(truth.points)) if any(is_said_bad(truth, text, row) for text in report.suspects)}
    if set(truth.case.mistakes) & {"labels", "block"}:
        wrong = set(truth.wrong)
        share = len(wrong & named) / len(wrong) if wrong else None
    else:
        wrong, share = set(), None
    innocent = named - wrong
    rows = [Statement("suspect", f"calls {len(innocent)} right runs bad")] if innocent else []
    return rows, share


def mistakes_named(truth: Truth, report: Report | None, message: str, recall: float | None = None) -> list[str]:
    """Mistakes of the case that the report, or the message of a refusal, speaks of."""
    text = message if report is None else " ".join(report.measurement)
    found = [mistake for mistake in truth.case.mistakes if says(text, WORDS[mistake])]
    if report is not None:
        names = {claim.name for claim in (*report.effects, *report.retuned)}
        for mistake in truth.case.mistakes:
            if mistake not in found and names & set(TRUE_NAMES.get(mistake, ())):
                found.append(mistake)
            if mistake in ("labels", "block") and mistake not in found and recall is not None and recall >= 0.5:
                found.append(mistake)
    return found


def _false_mistakes(truth: Truth, report: Report) -> list[Statement]:
    """Mistakes of measuring that were not made. A step or a trend in time may be called a block of runs."""
    made = set(truth.case.mistakes)
    if made & {"labels", "block"} or any(part.in_time for part in truth.parts):
        made |= {"labels", "block"}
    words = [word for mistake in made for word in WORDS[mistake]]
    known = [word for each in WORDS.values() for word in each]
    return [
        Statement("measurement", f"says that the measurement has a mistake that was not made: {text[:80]}")
        for text in report.measurement
        if says(text, known) and not says(text, words)
    ]


# ------------------------------------------------------------------------------------------------ the whole


def _unsaid(truth: Truth, report: Report) -> tuple[list[str], bool | None]:
    """What had to be said and was not; and whether all strong parts with a name are named."""
    missing, named = [], []
    for part, strength in zip(truth.parts, truth.strength, strict=True):
        if strength < STRONG:
            continue
        about = (*part.orders, *part.near)
        claims = [claim for claim in report.effects if claim.is_about(about)]
        is_named = any({claim.name, *claim.alternatives} & set(part.names) for claim in claims)
        described = any(
            entry.order is None or not part.orders or any(abs(entry.order - order) < 0.5 for order in about)
            for entry in report.unexplained
        )
        described |= any(claim.name == "empirical" or claim.name in part.hedged for claim in claims)
        described |= any(claim.name in part.touches and claim.is_about(about) for claim in report.retuned)
        if part.names:
            named.append(is_named)
        # what has no name, or changes in time, is right as a signature
        if not is_named and not (described and (part.in_time or not part.names)):
            word = "described, not named" if described else "not spoken of"
            missing.append(f"{part.title}: {word}")
    return missing, all(named) if named else None


def score(truth: Truth, report: Report, rig: NewRig) -> Score:
    """All measures of one case."""
    suspect_rows, recall = _suspects(truth, report)
    found = mistakes_named(truth, report, "", recall)
    false = _false_names(truth, report) + _bounds(report) + _false_mistakes(truth, report)
    floor_rows, floor = _floor(truth, report)
    false += floor_rows + suspect_rows
    sizes: list[tuple[float, float]] = []
    held_out = None
    if rig.problem:
        false.append(Statement("rig", f"the rig.toml that it wrote is refused: {rig.problem}"))
    else:
        # a mistake that is said to be beyond what the data can show is not denied
        hidden = [mistake for mistake in HIDDEN if says(report.about_unseen, HIDDEN[mistake])]
        false += _verdict(truth, report, rig, set(truth.case.mistakes) <= {*found, *hidden})
        held_rows, held_out = _held_out(truth, report, rig)
        rows, sizes = _sizes(truth, report, rig) if not truth.case.mistakes else ([], [])
        false += rows + held_rows
    missing, named = _unsaid(truth, report)
    missing += [f"mistake of measuring not named: {mistake}" for mistake in truth.case.mistakes if mistake not in found]
    missing += [f"file not spoken of: {name}" for name in truth.bad_files if name not in report.whole]
    nothing = not truth.parts and not truth.case.mistakes
    says_something = bool(report.effects or report.retuned or report.unexplained)
    silent = (report.verdict == "nothing_missing" and not says_something) if nothing else None
    if silent is False:
        missing.append(f"silence: verdict {report.verdict}, {len(report.unexplained)} unexplained")
    if truth.case.kind == "one_temperature" and not says(report.about_unseen, ("temperature", "oil")):
        false.append(Statement("unseen", "does not say that the temperature never varied"))
    # a parameter of a rig that is wrong by a mistake of measuring is no claim about effects
    probabilities = [
        (claim.probability, any(_is_named_by(claim, part) for part in truth.parts))
        for claim in report.effects
        if claim.probability is not None and claim.name != "empirical"
    ]
    return Score(
        not false and not missing, tuple(false), tuple(missing), named, silent, tuple(sizes), held_out, floor,
        tuple(probabilities),
    )  # fmt: skip


def refused(truth: Truth, message: str, options: str) -> Score:
    """A refusal (exit code 2) is right where it names the mistake, or the file that cannot be used."""
    false = [
        Statement("advice", f"advises {option}, which the command does not have")
        for option in sorted(set(re.findall(r"--[a-z][a-z-]+", message)))
        if option not in options
    ]
    found = mistakes_named(truth, None, message)
    missing = [f"mistake of measuring not named: {one}" for one in truth.case.mistakes if one not in found]
    if not truth.case.mistakes:
        missing.append("refused: " + message.strip().splitlines()[-1][:100] if message.strip() else "refused")
    return Score(not false and not missing, tuple(false), tuple(missing), None, None, (), None, None, ())
