"""A rig under fit: its constant offset, and its effects with their free keys."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.fit.parameters import Coordinate, Piece
from st_codegen.rig.model import RigModel

#: what stands for the rig's offset among the numbers of pieces
OFFSET = -1


@dataclass(frozen=True)
class State:
    """A rig under fit: its constant offset, and its effects with their free keys."""

    rig: RigModel
    offset: float
    pieces: tuple[Piece, ...]
    offset_free: bool = True

    def model(self) -> RigModel:
        """The rig with the present values."""
        return replace(self.rig, zero_offset_deg=self.offset, effects=tuple(piece.effect for piece in self.pieces))

    def vector(self) -> FloatArray:
        """Offset and coordinates of all pieces."""
        return np.concatenate([[self.offset], *(piece.vector() for piece in self.pieces)])

    def coordinates(self) -> list[Coordinate | None]:
        """The coordinates; None for the offset."""
        found: list[Coordinate | None] = [None]
        for piece in self.pieces:
            found += piece.coordinates()
        return found

    def slices(self) -> list[slice]:
        """Where the coordinates of each piece stand."""
        start, found = 1, []
        for piece in self.pieces:
            count = len(piece.coordinates())
            found.append(slice(start, start + count))
            start += count
        return found

    def with_vector(self, vector: FloatArray) -> State:
        """This state with the values of a vector, in the order of `vector`."""
        pieces = tuple(piece.with_vector(vector[s]) for piece, s in zip(self.pieces, self.slices(), strict=True))
        return replace(self, offset=float(vector[0]), pieces=pieces)

    def with_piece(self, piece: Piece) -> State:
        """This state with one more piece at its end."""
        return replace(self, pieces=(*self.pieces, piece))

    def without(self, *numbers: int) -> State:
        """This state without the pieces of some numbers."""
        return replace(self, pieces=tuple(piece for i, piece in enumerate(self.pieces) if i not in numbers))

    def held(self, numbers: Collection[int]) -> State:
        """This state with some pieces, or its offset (OFFSET), at the rig's own values and not free."""
        pieces = tuple(piece.held() if i in numbers else piece for i, piece in enumerate(self.pieces))
        if OFFSET in numbers:
            return replace(self, pieces=pieces, offset=self.rig.zero_offset_deg, offset_free=False)
        return replace(self, pieces=pieces)

    def replaced(self, number: int, piece: Piece) -> State:
        """This state with another piece in place of piece `number`."""
        return replace(self, pieces=(*self.pieces[:number], piece, *self.pieces[number + 1 :]))
