"""From a folder of curve files to the harmonic table that models learn from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from st_codegen.campaign.choice import OrderReason, choose_orders
from st_codegen.campaign.curves import BadFileError
from st_codegen.campaign.harmonic_table import HarmonicTable
from st_codegen.campaign.orders import BAND
from st_codegen.campaign.reader import Progress, read_campaign


@dataclass(frozen=True)
class Measured:
    """A harmonic table and where it comes from: why these orders, and what was left out; both empty for a table."""

    table: HarmonicTable
    reasons: tuple[OrderReason, ...] = ()
    bad: tuple[BadFileError, ...] = ()
    samples: int = 0


def measured_table(
    folder: Path,
    orders: Sequence[int] | None,
    most: int,
    *,
    skip_bad: bool = False,
    jobs: int | None = None,
    cache: Path | None = None,
    progress: Progress | None = None,
) -> Measured:
    """Read a campaign and fit its orders; None chooses them from the data, `most` at most. Raises InputError."""
    band = max([BAND, *(orders or ())])
    campaign = read_campaign(folder, skip_bad=skip_bad, band=band, jobs=jobs, cache=cache, progress=progress)
    always = (0,) if orders is None else tuple(orders)
    reasons = choose_orders(campaign.fits((), progress), most=most, always=always)
    if orders is None:
        chosen = [reason.order for reason in reasons if reason.chosen]
    else:
        chosen, reasons = list(orders), tuple(_asked(reason, orders) for reason in reasons)
    fits = campaign.fits(chosen, progress)
    return Measured(campaign.table(fits), reasons, campaign.bad, campaign.samples)


def _asked(reason: OrderReason, orders: Sequence[int]) -> OrderReason:
    """What the curves say about an order where the orders were given."""
    if reason.order in orders:
        return replace(reason, chosen=True, reason=reason.reason.replace("always wanted", "asked for", 1))
    return replace(reason, chosen=False, reason=f"not asked for; {reason.reason}")
