"""Pages of `diff` and `verify`: what they found, with pictures, for a review or a file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from st_codegen.cli.costs import magnitude_text, rounded_up, times_text
from st_codegen.cli.prove import VERDICT_COLUMNS, sentence, verdict_rows
from st_codegen.emit.output import MANIFEST
from st_codegen.errors import at_most, counted
from st_codegen.files.number_text import percent, plain_number
from st_codegen.files.text import file_sha256, write_text
from st_codegen.proof.review import tried_text
from st_codegen.proof.runner import changes_by_hand, target_folders
from st_codegen.proof.verify_report import but_for
from st_codegen.report import COLOURS, PageSection, PageTable, figures, markdown, page
from st_codegen.report.picture import panels

if TYPE_CHECKING:
    from st_codegen.cli.costs import Explanation
    from st_codegen.cost.report import ProjectCost
    from st_codegen.project.bundle import Bundle
    from st_codegen.proof.prove.prove import ProveReport
    from st_codegen.proof.review import Review, Sweep
    from st_codegen.proof.verify_report import VerifyReport

#: Outputs whose curves a page shows: those that moved most.
_MOST_DRAWN = 12
#: Blocks and calls whose times a page lists.
_MOST_PARTS = 20
#: Width of a picture of bars: its words can be read on a telephone, too.
_BARS_CM = 12


def write_pages(
    title: str, sections: list[PageSection], summary: str, html: Path | None, markdown_file: Path | None
) -> None:
    """Write the page as HTML and as Markdown, where a file is given."""
    if html is not None:
        write_text(html, page(title, sections, summary=summary))
    if markdown_file is not None:
        write_text(markdown_file, markdown(title, sections, summary=summary))


# --- diff


def review_sections(found: Review, lines: list[str], *, draw: bool) -> tuple[str, list[PageSection]]:
    """The summary of a review, and its sections: the model, the numbers, the text; `draw`: with pictures."""
    changed = [model for model in found.models if model.changed]
    same = [model.name for model in found.models if not model.changed]
    counts = f"{len(changed)} of {counted(len(found.models), 'model')} changed in the target {found.target}."
    summary = counts if found.changed else "No difference."
    if parts := sum(len(block.outputs) for block in found.around):
        summary += f" {counted(parts, 'harmonic')} changed."
    if found.added or found.removed:
        summary += f" {len(found.added)} added, {len(found.removed)} removed."
    sections = [PageSection("What changed", "\n\n".join(lines))]
    moved = [(model, output) for model in (*changed, *found.around) for output in model.outputs]
    moved.sort(key=lambda entry: -entry[1].largest)
    drawn = [(model, output) for model, output in moved if output.curves][:_MOST_DRAWN]
    if moved:
        rows = [
            (
                model.label(output),
                *output.sizes,
                percent(output.moved),
                ", ".join(f"{name} = {value:.6g}" for name, value in output.where.items()) if output.largest else "",
            )
            for model, output in moved
        ]
        columns = ("output", "largest change", "mean change", "points that moved", "largest at")
        pictures = tuple(svg for m, o in drawn for svg in _curves(m.label(o), o.curves)) if draw else ()
        sections.append(
            PageSection(
                "Numbers",
                f"{tried_text(changed, found.target, found.around)} Curves go through the point of the largest change.",
                PageTable(columns, rows),
                pictures,
            )
        )
    if found.files:
        sections.append(PageSection("Files", table=PageTable(("file", "is"), sorted(found.files.items()))))
    if same:
        sections.append(PageSection(f"What did not change, {found.target}", ", ".join(same) + "."))
    return summary, sections


def _curves(title: str, curves: Iterable[Sweep]) -> list[str]:
    def draw(curve: Sweep) -> Callable[[Any], None]:
        def panel(axes: Any) -> None:
            axes.plot(curve.x, curve.before, color=COLOURS[0], linewidth=2.2, alpha=0.6, label="old")
            axes.plot(curve.x, curve.after, color=COLOURS[1], linewidth=1.1, label="new")
            axes.set(xlabel=curve.feature)
            axes.legend(loc="best")

        return panel

    return panels([(title, draw(curve)) for curve in curves])


# --- verify


def verify_sections(
    report: VerifyReport, proof: ProveReport, bundle: Bundle, generated: Path
) -> tuple[str, list[PageSection]]:
    """The summary of a verification, and its sections: agreement, proof, provenance, cost."""
    failed = [model.name for model in report.models if not model.passed]
    tried = sum(model.n for model in report.models)
    summary = (
        f"{'FAILED: ' + ', '.join(failed) if failed else 'All agree'}: library, reference and generated text on a "
        f"sample of {tried:,} rows{but_for(report.models)}."
    )
    if report.over_budget:
        summary += f"\n\nThe cycle DOES NOT FIT: {', '.join(report.over_budget)}."
    summary += f"\n\nAsked of all inputs: {proof.summary}."
    rows = [
        (m.name, m.n, m.max_abs_err, at_most(m.bound, 4), m.max_ulp, m.verdict, ", ".join(m.targets))
        for m in report.models
    ]
    columns = ("model", "rows", "largest error", "allowed", "ulp", "result", "targets")
    strong = {(row, 5) for row, model in enumerate(report.models) if not model.passed}
    remarks = [remark for model in report.models for remark in model.remarks]
    notes = "\n\n".join([*(f"{name}: {note}" for name, note in report.notes.items()), *remarks, report.guessed])
    sections = [PageSection("Agreement", notes, PageTable(columns, rows, strong)), _proof_section(proof)]
    sources = [
        (ir.name, ir.source.file, f"{ir.source.library} {ir.source.version}", ir.source.model_class, ir.source.digest)
        for ir in bundle.irs
    ]
    head = ("model", "file", "library", "class", "digest of what was read")
    served = bundle.purpose.served(bundle.irs) if bundle.purpose else ()
    texts = [
        f"{folder.name}: the generated files are listed with their SHA-256 in {MANIFEST}, whose own is "
        f"{file_sha256(folder / MANIFEST)}."
        for folder in target_folders(generated)
    ]
    notes = "\n\n".join([*texts, *changes_by_hand(generated), *served])
    sections.append(PageSection("Provenance", notes, PageTable(head, sources)))
    return summary, sections + [_cost_section(target, cost, report.cycle_us) for target, cost in report.costs.items()]


def _proof_section(proof: ProveReport) -> PageSection:
    """The verdicts on the text for every input, and why some are no proof."""
    text = (
        "A proof executes the text on all inputs at once. Proved: it gives the model's bits. Same expression: it "
        "computes the model's operations one by one; how far that lies from the library at most is the bound, where "
        "one is known. Never fails: no call of the block stops the controller. docs/proof.md says what is assumed."
    )
    others = [sentence(result) for result in proof.results if not result.is_proved]
    strong = {(number, 2) for number, result in enumerate(proof.results) if not result.is_proved}
    table = PageTable(VERDICT_COLUMNS, list(verdict_rows(proof)), strong)
    return PageSection("Proof", "\n\n".join([text, *others]), table)


def _cost_section(target: str, cost: ProjectCost, cycle_us: float | None) -> PageSection:
    parts = cost.parts[:_MOST_PARTS]
    rows = [(p.unit, p.total_operations, p.table_bytes, p.warm_us, p.cold_us) for p in parts]
    text = f"{times_text(cost, cycle_us)} on {cost.profile.name}."
    if cost.unbounded:
        text += f" This is no bound; what has none was counted once: {'; '.join(cost.unbounded)}."
    if cycle_us is not None:
        text += f" Budget: {plain_number(cycle_us)} us: it {cost.profile.judged(fits=cost.fits(cycle_us))}."
    if len(parts) < len(cost.parts):
        text += f" Of {len(cost.parts)} units the {len(parts)} slowest are listed."
    if cost.profile.remark:
        text += f" {cost.profile.remark}."

    def bars(axes: Any) -> None:
        names = [part.unit for part in parts][::-1]
        axes.barh(names, [part.cold_us for part in parts][::-1], color=COLOURS[0], label="cold caches")
        axes.barh(names, [part.warm_us for part in parts][::-1], color=COLOURS[1], height=0.4, label="warm caches")
        axes.set(xlabel="us in a cycle")

    pictures = [figures([("", bars)], columns=1, size_cm=(_BARS_CM, 2.5 + 0.7 * len(parts)))] if parts else []
    columns = ("block", "operations", "bytes of tables", "warm us", "cold us")
    return PageSection(f"Worst case of a cycle, {target}", text, PageTable(columns, rows), pictures)


# --- generate --explain


def explain_sections(found: Sequence[Explanation]) -> tuple[str, list[PageSection]]:
    """The summary of what `--explain` says, and its sections: refused inputs once, layouts and times of each target."""
    limits = [(limit.model, limit.feature, magnitude_text(limit)) for limit in found[0].limits] if found else []
    text, table = "No model refuses an input for its magnitude.", None
    if limits:
        text = "From these magnitudes on, bValid is FALSE and the outputs keep their last valid values."
        table = PageTable(("model", "input", "magnitude"), limits)
    sections = [PageSection("Inputs that are refused", text, table)]
    for entry in found:
        if entry.prices:
            sections.append(_layouts_section(entry))
        sections.append(_cost_section(entry.target, entry.cost, None))
    times = "; ".join(f"{entry.target}: {_worst_text(entry.cost)}" for entry in found)
    return f"{times}. Times are of the cost model, for {found[0].cost.profile.name}." if found else "", sections


def _worst_text(cost: ProjectCost) -> str:
    return "no bound is known" if cost.unbounded else f"{rounded_up(cost.cold_us, 1)} us in the worst case"


def _layouts_section(entry: Explanation) -> PageSection:
    """What each layout would take, the one that was taken in bold; a bar for the largest models."""
    rows = [
        (p.model, p.layout, round(p.cost.instructions), p.cost.table_bytes, p.cost.warm_us, p.cost.cold_us)
        for p in entry.prices
    ]
    strong = {(row, 1) for row, price in enumerate(entry.prices) if price.is_chosen}
    largest = sorted((p for p in entry.prices if p.is_chosen), key=lambda p: -p.cost.cold_us)[:_MOST_DRAWN]
    names = {p.model for p in largest}
    shown = [p for p in entry.prices if p.model in names]

    def bars(axes: Any) -> None:
        labels = [f"{p.model}: {p.layout}" for p in shown][::-1]
        colours = [COLOURS[0] if p.is_chosen else COLOURS[4] for p in shown][::-1]
        axes.barh(labels, [p.cost.cold_us for p in shown][::-1], color=colours)
        axes.set(xlabel="us of a call with cold caches; blue: taken")

    picture = figures([("", bars)], columns=1, size_cm=(_BARS_CM, 2.5 + 0.6 * len(shown)))
    columns = ("model", "layout", "operations", "bytes of tables", "warm us", "cold us")
    text = f"A block alone on {entry.cost.profile.name}; the layout in bold was taken."
    return PageSection(f"Layouts, {entry.target}", text, PageTable(columns, rows, strong), (picture,))
