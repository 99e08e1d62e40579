"""What commands say about time: options, and the table of who spends what."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import ROUND_CEILING, Decimal
from itertools import count
from typing import TYPE_CHECKING

import click
from rich.table import Table
from rich.text import Text

from st_codegen.cli.console import Number, console, say, table_of, tell
from st_codegen.cost.profile_files import DEFAULT, profile_names
from st_codegen.errors import counted
from st_codegen.files.number_text import percent, plain_number

if TYPE_CHECKING:
    from st_codegen.cost.report import ProjectCost, UnitPart
    from st_codegen.proof.explain import InputLimit, Price

#: Parts of a cycle that take less than this share are added up in one row.
_SMALL = 0.002


#: The options --cycle-us, --profile and --entry.
cycle_option = click.option(
    "--cycle-us",
    type=Number(min=0.0, min_open=True),
    help="Budget of one cycle in us: fail when the worst case, with cold caches, is longer.",
)
profile_option = click.option(
    "--profile",
    default=DEFAULT,
    metavar="NAME|FILE",
    help=f"The controller: {', '.join(profile_names())}, or a .toml file that `calibrate` wrote.",
)
entry_option = click.option(
    "--entry",
    "entries",
    multiple=True,
    metavar="BLOCK",
    help="A block or program that one cycle runs, may be given several times. Default: what the tasks call.",
)


@dataclass(frozen=True)
class Explanation:
    """What `--explain` says of a target: refused inputs, prices of layouts, and the worst case of a cycle."""

    target: str
    limits: tuple[InputLimit, ...]
    prices: tuple[Price, ...]
    cost: ProjectCost


def print_explanation(found: Explanation) -> None:
    """Print the limits of the inputs, the price of a doubled range, and the costs of the project as tables."""
    console.print(limits_table(found.limits))
    if found.prices:
        console.print(price_table(found.target, found.cost.profile.name, found.prices))
    print_budget(found.target, found.cost, None)


def print_budget(target: str, cost: ProjectCost, cycle_us: float | None) -> None:
    """Who spends what, in a cycle that does not fit."""
    for text in cost.unbounded:
        say(Text.assemble((target, "red"), f": {text}"))
    console.print(cost_table(f"{target}: worst case of a cycle on {cost.profile.name}", cost.parts))
    print_verdict(target, cost, cycle_us)


def print_verdict(target: str, cost: ProjectCost, cycle_us: float | None) -> None:
    """One line: the worst case, and whether it fits."""
    times = times_text(cost, cycle_us)
    if cost.unbounded:
        times = f"no bound; what has none counted once: {times}"
    line = Text(f"{target}: {times} on {cost.profile.name}")
    if cycle_us is not None:
        line.append(f", budget {plain_number(cycle_us)} us: ")
        fits = cost.fits(cycle_us)
        line.append(cost.profile.judged(fits=fits), "green" if fits else "bold red")
    say(line)
    if cost.profile.remark:
        tell(cost.profile.remark)


def times_text(cost: ProjectCost, cycle_us: float | None = None) -> str:
    """Both times; the worst case is rounded up, but not beyond a budget that it fits into."""
    most = math.inf if cycle_us is None or cost.cold_us > cycle_us else cycle_us
    digits = next(n for n in count(1) if float(rounded_up(cost.cold_us, n)) <= most)
    return f"{cost.warm_us:.1f} us with warm caches, {rounded_up(cost.cold_us, digits)} us with cold ones"


def rounded_up(time_us: float, digits: int) -> str:
    """A time rounded up to so many digits behind the point."""
    return f"{Decimal(repr(float(time_us))).quantize(Decimal(1).scaleb(-digits), ROUND_CEILING):f}"


def cost_table(title: str, parts: Sequence[UnitPart]) -> Table:
    """A row for each unit whose text a cycle runs, the slowest first; times are its own, without what it calls."""
    numbers = (">operations", ">tables B", ">touched B", ">code B", ">warm us", ">cold us", ">share")
    table = table_of(title, "block", *numbers)
    total = sum(part.cold_us for part in parts) or 1.0
    large = [part for part in parts if part.cold_us >= _SMALL * total]
    for part in large:
        table.add_row(part.unit, *_cells([part], total))
    if len(large) < len(parts):
        rest = parts[len(large) :]
        table.add_row(counted(len(rest), "other"), *_cells(rest, total))
    table.add_section()
    table.add_row("sum", *_cells(parts, total))
    return table


def price_table(target: str, profile: str, priced: Iterable[Price]) -> Table:
    """A row for each layout that a model could have; the first one was taken."""
    numbers = (">operations", ">tables B", ">code B", ">touched lines", ">warm us", ">cold us")
    table = table_of(f"{target}: layouts, a block alone on {profile}", "model", "layout", *numbers)
    for price in priced:
        cost = price.cost
        table.add_row(
            price.model if price.is_chosen else "",
            Text(str(price.layout), "bold" if price.is_chosen else "dim"),
            f"{cost.instructions:,.0f}",
            f"{cost.table_bytes:,}",
            f"{cost.code_bytes:,}",
            f"{cost.lines:,.0f}",
            f"{cost.warm_us:.2f}",
            rounded_up(cost.cold_us, 2),
        )
    return table


def limits_table(limits: Iterable[InputLimit]) -> Table | str:
    """A row for each input that a block refuses beyond a magnitude, or a sentence where there is none."""
    title = "inputs that are refused: bValid is FALSE from this magnitude on"
    table = table_of(title, "model", "input", "magnitude")
    for limit in limits:
        table.add_row(limit.model, limit.feature, magnitude_text(limit))
    return table if table.row_count else "no model refuses an input for its magnitude"


def magnitude_text(limit: InputLimit) -> str:
    """From which magnitude on an input is refused."""
    return "infinite" if math.isinf(limit.magnitude) else repr(float(limit.magnitude))


def _cells(parts: Sequence[UnitPart], total: float) -> list[str]:
    cold = sum(part.cold_us for part in parts)
    return [
        f"{sum(part.total_operations for part in parts):,}",
        f"{sum(part.table_bytes for part in parts):,}",
        f"{64 * sum(part.lines for part in parts):,}",
        f"{sum(part.code_bytes for part in parts):,}",
        f"{sum(part.warm_us for part in parts):.1f}",
        rounded_up(cold, 1),
        percent(cold / total),
    ]
