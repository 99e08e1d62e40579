"""What a comparison came to: in one word of report.json, and how far model and measurement are apart."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


@dataclass(frozen=True)
class Gap:
    """RMS in deg between model and measurement over all good runs and angles, and what noise alone gives."""

    before: float
    after: float
    noise_floor: float


class Outcome(StrEnum):
    """Whether something was found missing, and whether what is left of the differences is more than noise."""

    EXPLAINED = "explained"
    PARTLY_EXPLAINED = "partly_explained"
    NOTHING_MISSING = "nothing_missing"
    UNEXPLAINED = "unexplained"

    @classmethod
    def of(cls, *, named: bool, is_more_left: bool) -> Outcome:
        """The outcome where something has a name or not, and where more than noise is left or not."""
        if is_more_left:
            return cls.PARTLY_EXPLAINED if named else cls.UNEXPLAINED
        return cls.EXPLAINED if named else cls.NOTHING_MISSING
