"""What the prover raises where it cannot go on."""

from __future__ import annotations


class NotProvedError(Exception):
    """The text holds something that the prover cannot follow, or that would stop a controller."""

    def __init__(self, reason: str, place: object = None) -> None:
        super().__init__(reason if place is None else f"{place}: {reason}")
        self.reason, self.place = reason, place

    def at(self, place: object) -> NotProvedError:
        """This error, with a place in the text if it has none yet."""
        return self if self.place is not None else type(self)(self.reason, place)
