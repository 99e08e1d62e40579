"""What a fleet shows: a page, fleet.csv (a row for each axis), effects.csv (for each parameter), and fleet.json."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from st_codegen.errors import counted
from st_codegen.files.csv_tables import csv_text
from st_codegen.files.folders import write_texts
from st_codegen.fleet.axes import FleetAxis
from st_codegen.fleet.compare import FALSE_ALARM, LEAST_AXES, Campaigns, FleetComparison, Spread, compare
from st_codegen.fleet.estimates import Estimate
from st_codegen.fleet.shared import RULE as SHARING
from st_codegen.fleet.stages import CHECK, EARLIER, RECONCILE, TRAIN, AxisResult
from st_codegen.report import COLOURS, PageSection, PageTable, page
from st_codegen.report.picture import panels

PAGE, AXES, EFFECTS, FACTS = "fleet.html", "fleet.csv", "effects.csv", "fleet.json"
_MOST_PANELS = 24
_MOST_NAMES = 8
_LONGEST = 200
RULE = (
    f"Rule: a parameter is named where it lies farther from the median of its type than the limit, in units of the "
    "root of s^2 + e^2: s is 1.4826 times the median absolute deviation, e the standard error of the axis's own value. "
    "The limits are such that where no axis is odd, this table names one in about "
    f"{FALSE_ALARM:.0%} of all fleets or fewer, if the values of sound axes are independent and normally distributed. "
    f"Parameters that fewer than {LEAST_AXES} axes of a type have are not judged."
)
RULE_OF_GROWTH = (
    "Rule: an effect has grown where its size (of a stiffness its inverse) is larger than in the last reconciled "
    "campaign before, in the order of the file, by more than the limit, in standard errors of the difference; what "
    "became smaller is not named. Each parameter is judged by itself: a size and its growth with the load that each "
    "stay within the limit are not named, however much they do together. Where "
    f"nothing grew, this names something in {FALSE_ALARM:.0%} of all fleets or fewer, if the standard errors are right "
    "and the errors of both campaigns normally distributed. What that campaign did not find has no such rate: it may "
    "have been there, too small to be found."
)


@dataclass(frozen=True)
class FleetReport:
    """All axes with what came of them, and how they compare."""

    axes: tuple[FleetAxis, ...]
    results: Mapping[str, AxisResult]
    comparison: FleetComparison

    @classmethod
    def of(cls, axes: Sequence[FleetAxis], results: Mapping[str, AxisResult]) -> FleetReport:
        """Compare the axes of which the newest campaign was reconciled."""
        found = [_campaigns(axis, results[axis.name]) for axis in axes if RECONCILE in results[axis.name].facts]
        return cls(tuple(axes), results, compare(found))

    @property
    def passed(self) -> bool:
        """Whether all stages of all axes are done, and all text is proved, or agrees."""
        return all(not result.errors and result.facts[CHECK]["passed"] for result in self.results.values())

    @property
    def not_looked_at(self) -> tuple[str, ...]:
        """What no sentence of the page is about."""
        by_text: dict[str, list[str]] = {}
        for name, result in self.results.items():
            lines = [*result.facts.get(RECONCILE, {}).get("not_looked_at", ())]
            lines += [f"left out: {text}" for text in result.facts.get(TRAIN, {}).get("left_out", ())]
            lines += [] if RECONCILE in result.facts else ["the newest campaign, which was not reconciled"]
            lines += [f"{stage}, which failed" for stage in result.errors if stage.startswith(EARLIER)]
            for line in lines:
                by_text.setdefault(line, []).append(name)
        return (
            *self.comparison.not_looked_at,
            "phases, which depend on how an axis was mounted: they are in effects.csv",
            "what campaigns cannot show by their conditions and noise: cannot_show in fleet.json, and each report.html",
            *([] if self._shared() else ["whether models of axes of a type could be shared: share = true"]),
            *(f"{line}: {_named(names)}" for line, names in by_text.items()),
        )

    def write(self, out: Path) -> None:
        """Write the four files. Raises MissingExtraError without Matplotlib."""
        texts = {
            PAGE: self.html(),
            AXES: csv_text([_COLUMNS, *map(self._row, self.axes)]),
            EFFECTS: self._effects_csv(),
            FACTS: self._json(),
        }
        write_texts(out, texts)

    def summary(self) -> str:
        """In a sentence or two."""
        failed = [name for name, result in self.results.items() if result.errors]
        unproved = [n for n, r in self.results.items() if CHECK in r.facts and not r.facts[CHECK]["passed"]]
        compared = self.comparison
        odd = list(dict.fromkeys(axis for spread in compared.spreads for axis in spread.outliers))
        rare = list(dict.fromkeys(axis for one in compared.rare for axis in one.axes))
        grown = list(dict.fromkeys(one.axis for one in compared.growth if one.times is not None))
        new = list(dict.fromkeys(one.axis for one in compared.growth if one.times is None))
        checked = any(CHECK in result.facts for result in self.results.values())
        text = f"text that did not pass its check: {_named(unproved)}" if checked else "no text was checked"
        parts = [f"{counted(len(self.axes), 'axis', 'axes')}; failed: {_named(failed)}; {text}."]
        if any(spread.limit is not None for spread in compared.spreads):
            parts.append(f"Stand out: {_named(odd)}; with an effect that fewer than half have: {_named(rare)}.")
        judged = {spread.type for spread in compared.spreads if spread.limit is not None}
        if others := [axis.name for axis in self.axes if axis.type not in judged]:
            few = f"of whose type fewer than {LEAST_AXES} have a parameter with an error in common"
            parts.append(f"Nothing is said of who stands out among axes {few}: {_named(others)}.")
        if compared.growth_limit is not None:
            of = f"of {counted(compared.growth_axes, 'axis', 'axes')} compared with a campaign before"
            parts.append(f"With effects that have grown, {of}: {_named(grown)}.")
        if new:
            parts.append(f"With effects that their last campaign before did not find: {_named(new)}.")
        if compared.copies:
            parts.append(f"Campaigns with the very numbers of another one, as copies have: {_named(compared.copies)}.")
        return " ".join(parts)

    def _effects_csv(self) -> str:
        spreads = {(one.type, one.effect, one.key): one for one in self.comparison.spreads}
        rows = []
        for axis in self.axes:
            for one in _estimates(self.results[axis.name], RECONCILE):
                spread = spreads.get((axis.type, one.effect, one.key))
                beside: list[Any] = [None] * 4
                if spread is not None:
                    beside = [spread.median, spread.deviation, spread.distances.get(axis.name), spread.limit]
                is_odd = spread is not None and axis.name in spread.outliers
                rows.append(
                    [axis.name, axis.type, one.effect, one.key, one.unit, one.value, one.stderr, *beside, is_odd]
                )
        head = ("axis", "type", "effect", "parameter", "unit", "value", "stderr")
        return csv_text([(*head, "median", "robust_sd", "distance", "limit", "stands_out"), *rows])

    def _json(self) -> str:
        compared = self.comparison
        content = {
            "passed": self.passed,
            "axes": [
                {"name": axis.name, "type": axis.type, "errors": result.errors, **result.facts}
                for axis, result in zip(self.axes, self.results.values(), strict=True)
            ],
            "false_alarm": FALSE_ALARM,
            "outliers": self._outliers(),
            "rare": [asdict(one) for one in compared.rare],
            "growth": [asdict(one) for one in compared.growth],
            "growth_limit": compared.growth_limit,
            "growth_axes": compared.growth_axes,
            "copies": list(compared.copies),
            "spread": [asdict(one) for one in compared.spreads],
            "not_looked_at": list(self.not_looked_at),
        }
        return json.dumps(content, indent=1, allow_nan=False) + "\n"

    def _outliers(self) -> list[dict[str, Any]]:
        return [
            {
                "axis": axis, "effect": one.effect, "parameter": one.key, "unit": one.unit, "value": one.values[axis],
                "median": one.median, "distance": one.distances[axis], "limit": one.limit,
            }
            for one in self.comparison.spreads
            for axis in one.outliers
        ]  # fmt: skip

    def html(self) -> str:
        """The page."""
        return page(
            "Fleet",
            [*self._findings(), self._axes(), *self._sharing(), *self._spread(), self._unseen()],
            summary=self.summary(),
        )

    def _row(self, axis: FleetAxis) -> list[Any]:
        """What came of an axis, in the columns of `_COLUMNS`."""
        result = self.results[axis.name]
        facts = result.facts
        reconciled = facts.get(RECONCILE, {})
        gap = reconciled.get("gap", {})
        error = "; ".join(f"{stage}: {_one_line(text)}" for stage, text in result.errors.items())
        return [
            axis.name,
            axis.type,
            facts.get(TRAIN, {}).get("models"),
            facts.get(CHECK, {}).get("how"),
            reconciled.get("verdict"),
            ", ".join([*reconciled.get("effects", ()), *reconciled.get("changed", ())]),
            gap.get("before"),
            gap.get("after"),
            error,
        ]

    def _axes(self) -> PageSection:
        text = "Gaps are those of reconcile on conditions that were held out, RMS in deg."
        return PageSection("Axes", text, PageTable(_COLUMNS, list(map(self._row, self.axes))))

    def _findings(self) -> list[PageSection]:
        compared = self.comparison
        odd = [list(one.values()) for one in self._outliers()]
        rare = [(", ".join(one.axes), one.effect, f"{len(one.axes)} of {one.of}", one.type) for one in compared.rare]
        grown = [
            (
                one.axis, one.effect, one.key,
                ", ".join("not found" if value is None else f"{value:.4g}" for value in one.history),
                one.unit, one.times,
            )
            for one in compared.growth
        ]  # fmt: skip
        columns = ("axis", "effect", "parameter", "unit", "value", "median", "distance", "limit")
        sections = []
        if any(one.limit is not None for one in compared.spreads):
            sections += [
                _listed("Parameters that stand out", RULE, columns, odd),
                _listed(
                    "Effects that fewer than half of the axes of a type have",
                    "Of the rig, or named by reconcile, whose documentation says how often its names are wrong.",
                    ("axes", "effect", "how many", "type"),
                    rare,
                ),
            ]
        if compared.growth_limit is not None or grown:
            limit = compared.growth_limit
            text = RULE_OF_GROWTH + ("" if limit is None else f" The limit is {limit:.3g}.")
            history = ("axis", "effect", "parameter", "campaigns, the oldest first", "unit", "standard errors")
            sections.append(
                _listed("What has grown, or was not found in the last campaign before", text, history, grown)
            )
        return sections

    def _shared(self) -> dict[str, dict[str, Any]]:
        """What was decided of shared models, by axis."""
        facts = {name: result.facts.get(TRAIN, {}) for name, result in self.results.items()}
        return {name: own["shared"] for name, own in facts.items() if "shared" in own}

    def _sharing(self) -> list[PageSection]:
        decided = self._shared()
        if not decided:
            return []
        rows = [
            (name, "of the type" if own["taken"] else "own", own.get("rms_deg"), own.get("own_rms_deg"),
             own.get("own", own["why_not"]))
            for name, own in decided.items()
        ]  # fmt: skip
        taken = sum(own["taken"] for own in decided.values())
        columns = ("axis", "models", "left with those of the type", "left otherwise", "otherwise")
        title = f"Models of the type: taken by {taken} of {counted(len(decided), 'axis', 'axes')}"
        return [PageSection(title, f"{SHARING} Root mean squares in deg.", PageTable(columns, rows))]

    def _spread(self) -> list[PageSection]:
        rows = [
            (one.type, one.effect, one.key, len(one.values), one.median, one.deviation, one.stderr,
             min(one.values.values()), max(one.values.values()), one.unit)
            for one in self.comparison.spreads
        ]  # fmt: skip
        if not rows:
            return []
        columns = (
            "type",
            "effect",
            "parameter",
            "axes",
            "median",
            "robust sd",
            "standard error",
            "least",
            "most",
            "unit",
        )
        text = (
            "Every parameter with all others free, over the axes that have the effect. The robust standard deviation "
            "is 1.4826 times the median absolute deviation, errors of measuring included; there is none of fewer than "
            f"{LEAST_AXES} axes, whose deviations are chance. The standard error beside it is the median over the axes."
        )
        return [PageSection("Spread", text, PageTable(columns, rows), self._pictures())]

    def _pictures(self) -> list[str]:
        groups: dict[tuple[str, str], list[Spread]] = {}
        for one in self.comparison.spreads:
            if one.limit is not None:
                groups.setdefault((one.type, one.effect), []).append(one)
        farthest = {key: max(max(map(abs, one.distances.values())) for one in own) for key, own in groups.items()}
        shown = sorted(groups, key=lambda key: -farthest[key])[:_MOST_PANELS]
        drawn: list[str] = []
        for kind, effect in shown:
            own = groups[kind, effect]
            # a line for each parameter needs its height
            drawn += panels([(f"{effect} ({kind})", partial(_strip, own))], size_cm=(11, 3.0 + 0.6 * len(own)))
        return drawn

    def _unseen(self) -> PageSection:
        rows = [[text] for text in self.not_looked_at]
        return PageSection("What was not looked at", table=PageTable(("what",), rows))


_COLUMNS = ("axis", "type", "models", "text", "verdict", "found", "gap before", "gap after", "error")


def _campaigns(axis: FleetAxis, result: AxisResult) -> Campaigns:
    """What the campaigns of an axis say; those of before that failed are left out."""
    stages = [*(f"{EARLIER} {number}" for number in range(1, len(axis.earlier) + 1)), RECONCILE]
    done = [stage for stage in stages if stage in result.facts]
    measured = tuple(result.facts[stage]["measured"] for stage in done)
    return Campaigns(axis.name, axis.type, tuple(tuple(_estimates(result, stage)) for stage in done), measured)


def _estimates(result: AxisResult, stage: str) -> list[Estimate]:
    return [Estimate(**one) for one in result.facts.get(stage, {}).get("estimates", ())]


def _listed(title: str, text: str, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> PageSection:
    return PageSection(f"{title}: {len(rows)}", text, PageTable(columns, rows) if rows else None)


def _strip(spreads: Sequence[Spread], axes: Any) -> None:
    """The distances of all axes, a line for each parameter; who stands out has its name."""
    for place, one in enumerate(spreads):
        odd = set(one.outliers)
        for colour, chosen in ((COLOURS[0], set(one.distances) - odd), (COLOURS[1], odd)):
            own = [one.distances[axis] for axis in one.distances if axis in chosen]
            axes.plot(own, [place] * len(own), "o", markersize=4, alpha=0.6, color=colour)
        for axis in one.outliers:
            axes.annotate(
                axis, (one.distances[axis], place), (0, 5), textcoords="offset points", ha="center", fontsize=7
            )
        limit = one.limit or 0.0
        axes.plot([-limit, limit], [place, place], "|", color="black", markersize=12)
    axes.set_xscale("symlog", linthresh=5.0, linscale=3.0)
    axes.set_yticks(range(len(spreads)), [one.key for one in spreads], fontsize=7)
    axes.set_ylim(-0.7, len(spreads) - 0.3)
    axes.set(xlabel="robust distance (bars: limits)")


def _named(names: Sequence[str]) -> str:
    """The number of some axes, and the names of the first ones: `2 (a7, a9)`."""
    if not names:
        return "none"
    more = f", and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return f"{len(names)} ({', '.join(names[:_MOST_NAMES])}{more})"


def _one_line(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST else f"{line[:_LONGEST]} .."
