"""The shares of several classes from those of each two of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from st_codegen.errors import InputError
from st_codegen.ir.base import ReadsWhole


@dataclass(frozen=True)
class CoupledPairs(ReadsWhole):
    """The shares of `count` classes, from that of the first class of each pair: those of class 0 first, then of 1, ..

    With the share r of a class beside another one, the matrix Q has the sum of the squares of the others' shares beside
    class t at (t, t), and -r (1 - r) of each pair elsewhere. Equal shares p are moved class by class until no number of
    Q p lies `epsilon` or further from p Q p, or for `rounds` rounds (Wu, Lin and Weng, Probability Estimates for
    Multi-class Classification by Pairwise Coupling, algorithm 2). All r have to lie between 0 and 1, without the ends.

    A step adds d to the share of t and divides all by 1 + d, which is 1/2 or more: with S the sum of -Q(t, j) p(j) over
    the others, d + p(t) = (S + p Q p) / Q(t, t) is at least 0, and p Q p at least Q(t, t) p(t)**2 - 2 p(t) S, so that
    for a p(t) of 1/2 or more it is at least p(t) / 2, whether S lies below Q(t, t) p(t) / 2 or not.
    """

    inputs: tuple[int, ...]
    count: int
    exact: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if self.count < 2:
            raise InputError(f"CoupledPairs: {self.count} classes, there are two or more")

    @property
    def operand_width(self) -> int:
        return self.count * (self.count - 1) // 2

    @property
    def width(self) -> int:
        return self.count

    @property
    def epsilon(self) -> float:
        """How far numbers may lie apart in the end."""
        return 0.005 / self.count

    @property
    def rounds(self) -> int:
        """Rounds that are the most."""
        return max(100, self.count)
