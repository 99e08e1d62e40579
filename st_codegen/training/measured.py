"""From a folder of curve files to the harmonic table that models learn from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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
    reasons = choose_orders(campaign.fits((), progress), most=most)
    chosen = [reason.order for reason in reasons if reason.chosen] if orders is None else list(orders)
    fits = campaign.fits(chosen, progress)
    return Measured(campaign.table(fits), reasons, campaign.bad, campaign.samples)
