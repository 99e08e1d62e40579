"""From a campaign, a folder of curve files or a table, to the harmonic table that models learn from."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from st_codegen.campaign.choice import OrderReason, choose_orders
from st_codegen.campaign.harmonic_table import HarmonicTable, read_table
from st_codegen.campaign.orders import BAND
from st_codegen.campaign.reader import AROUND, read_campaign
from st_codegen.processes import Progress
from st_codegen.training.search import Backend


@dataclass(frozen=True)
class Measured:
    """A harmonic table and where it comes from: why these orders, and which files and samples were left out; both
    empty for a table.
    """

    table: HarmonicTable
    reasons: tuple[OrderReason, ...] = ()
    left_out: tuple[str, ...] = ()
    samples: int = 0


def measured_table(
    campaign: Path,
    orders: Sequence[int] | None,
    most: int,
    *,
    skip_bad: bool = False,
    where: Backend | None = None,
    cache: Path | None = None,
    progress: Progress | None = None,
) -> Measured:
    """Read a folder of curves and fit its orders; None chooses them from the data, `most` at most.

    Of a harmonic table, a file, None takes all orders. The files of a folder are read by processes here (None: as
    many as `read_campaign` takes), or by the workers of a scheduler, which see them under the same paths. Raises
    InputError.
    """
    if not campaign.is_dir():
        table = read_table(campaign)
        return Measured(table if orders is None else table.only(tuple(orders)))
    band = max([BAND, *(orders or ())])
    jobs = where.jobs if where is not None and where.jobs > 0 else None
    with contextlib.ExitStack() as stack:
        if where is not None and where.scheduler is not None:
            campaign, jobs = campaign.resolve(), AROUND  # a worker stands in a folder of its own
            stack.enter_context(where.configured())
        read = read_campaign(campaign, skip_bad=skip_bad, band=band, jobs=jobs, cache=cache, progress=progress)
    always = (0,) if orders is None else tuple(orders)
    # how many there may be is no reason where they are given
    reasons = choose_orders(read.fits((), progress), most=most if orders is None else sys.maxsize, always=always)
    if orders is None:
        chosen = [reason.order for reason in reasons if reason.chosen]
    else:
        chosen, reasons = list(orders), tuple(_asked(reason, orders) for reason in reasons)
    fits = read.fits(chosen, progress)
    left_out = (*map(str, read.bad), *filter(None, (read.spikes, read.rounded)))
    return Measured(read.table(fits), reasons, left_out, read.samples)


def _asked(reason: OrderReason, orders: Sequence[int]) -> OrderReason:
    """What the curves say about an order where the orders were given."""
    if reason.order in orders:
        return replace(reason, chosen=True, reason=reason.reason.replace("always wanted", "asked for", 1))
    return replace(reason, chosen=False, reason=f"not asked for; {reason.reason}")
