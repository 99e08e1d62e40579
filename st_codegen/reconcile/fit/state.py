"""A rig under fit: its constant offset, and its effects as vectors of fit coordinates.

A phasor is two coordinates (real and imaginary part) a direction, in which the model is linear; a stiffness is its
inverse; only what is left (frequencies, widths, decays) is non-linear.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from st_codegen.ir.arrays import FloatArray
from st_codegen.rig.effects import Effect, Form, Phasor, Scalar, Stage
from st_codegen.rig.model import RigModel


@dataclass(frozen=True)
class Coordinate:
    """One number of a fit. part: 0 for a scalar, 1 or 2 for the real or imaginary part of a phasor."""

    key: str
    form: Form
    lower: float
    upper: float
    scale: float
    phase_key: str = ""
    place: int = 0
    part: int = 0

    @property
    def linear(self) -> bool:
        """Whether the model is linear in it."""
        return self.form is not Form.SHAPE


@dataclass(frozen=True)
class Piece:
    """An effect of the fit and the keys that are free.

    added: it is not in the rig. origin: the rig's own values, where the effect is in the rig.
    """

    effect: Effect
    free: frozenset[str]
    added: bool = False
    origin: Effect | None = None

    @property
    def own(self) -> Effect:
        """The effect as the rig has it; as it is now where the rig has none."""
        return self.origin or self.effect

    def told_keys(self) -> set[str]:
        """The keys of its parameters that the fit tells, phases among them."""
        return {key for c in self.coordinates() for key in (c.key, c.phase_key)}

    def coordinates(self) -> tuple[Coordinate, ...]:
        """The free coordinates, in the order of the catalogue."""
        places = len(self.effect.orders) if self.effect.orders_key == "orders" else 1
        return _coordinates(type(self.effect), places, self.free)

    def vector(self) -> FloatArray:
        """The values of the coordinates."""
        return np.array([_read(self.effect, coordinate) for coordinate in self.coordinates()])

    def with_vector(self, vector: FloatArray) -> Piece:
        """This piece with other values of its coordinates, (p,)."""
        return self.with_values(_written(self.effect, self.coordinates(), vector))

    def with_values(self, values: Mapping[str, Any], free: frozenset[str] = frozenset()) -> Piece:
        """This piece with these values in place of all of its own, and more of its keys free."""
        return replace(self, effect=self.effect.with_values(values), free=self.free | free)

    def without(self, keys: Collection[str]) -> Piece:
        """This piece without some of its keys."""
        values = {key: x for key, x in self.effect.values.items() if key not in keys}
        return replace(self, effect=self.effect.with_values(values), free=self.free.difference(keys))

    def held(self) -> Piece:
        """The rig's own values, none of them free."""
        return Piece(self.own, frozenset(), False, self.own)

    def unit(self, *chosen: Coordinate) -> Effect:
        """The effect with these linear coordinates at 1 and the other linear ones at 0."""
        if not chosen:
            return self._still
        return self.effect.with_values(_written(self._still, chosen, np.ones(len(chosen))))

    @property
    def absent(self) -> Effect:
        """The effect with nothing of it left; one of the measuring chain, as a delay, is there by its shape alone."""
        effect = self.unit()
        if effect.stage is not Stage.MEASURING:
            return effect
        return effect.with_values({**effect.values, **{scalar.key: 0.0 for scalar in effect.scalars}})

    @cached_property
    def _still(self) -> Effect:
        """The effect with all linear coordinates at 0."""
        coordinates = self.coordinates()
        vector = np.array([_read(self.effect, c) if c.form is Form.SHAPE else 0.0 for c in coordinates])
        values = _written(self.effect, coordinates, vector)
        for scalar in self.effect.scalars:
            if scalar.key not in self.free and scalar.form in (Form.LINEAR, Form.INVERSE):
                values[scalar.key] = math.inf if scalar.form is Form.INVERSE else 0.0
        for phasor in self.effect.phasors:
            for backward in (False, True):
                amplitude = phasor.keys(backward)[0]
                if amplitude not in self.free and amplitude in values:
                    values[amplitude] = _zero(values[amplitude])
        return self.effect.with_values(values)


def piece_of(effect: Effect, *, added: bool, origin: Effect | None = None) -> Piece:
    """A piece in which all that the effect states is free."""
    fixed = {scalar.key for scalar in effect.scalars if scalar.form is Form.FIXED}
    return Piece(effect, frozenset(set(effect.values) - {"order", "orders"} - fixed), added, origin)


def _zero(value: Any) -> Any:
    return tuple(0.0 for _ in value) if isinstance(value, tuple) else 0.0


@lru_cache(maxsize=1024)
def _coordinates(kind: type[Effect], places: int, free: frozenset[str]) -> tuple[Coordinate, ...]:
    """The coordinates of an effect whose lists have so many places; a search asks for them thousands of times."""
    found = [_of_scalar(scalar) for scalar in kind.scalars if scalar.key in free]
    for phasor in kind.phasors:
        found += list(_of_phasor(phasor, places, free))
    return tuple(found)


def _of_scalar(scalar: Scalar) -> Coordinate:
    lower, upper = scalar.lower, scalar.upper
    if scalar.form is Form.INVERSE:
        lower, upper = 1 / scalar.upper, 1 / scalar.lower
    return Coordinate(scalar.key, scalar.form, lower, upper, scalar.typical or upper - lower)


def _of_phasor(phasor: Phasor, places: int, free: frozenset[str]) -> Iterator[Coordinate]:
    high, usual = phasor.upper, phasor.typical or phasor.upper
    for backward in (False, True) if phasor.own_flanks else (False,):
        amplitude, phase = phasor.keys(backward)
        if amplitude not in free:
            continue
        for place in range(places):
            for part in (1, 2):
                yield Coordinate(amplitude, Form.LINEAR, -high, high, usual, phase, place, part)


def _read(effect: Effect, c: Coordinate) -> float:
    if c.part == 0:
        value = effect.scalar(c.key)
        return 1 / value if c.form is Form.INVERSE else value
    amplitude, phase = (_entry(effect.values.get(key, 0.0), c.place) for key in (c.key, c.phase_key))
    return amplitude * (math.cos(phase) if c.part == 1 else math.sin(phase))


def _entry(value: Any, place: int) -> float:
    return float(value[place]) if isinstance(value, tuple) else float(value)


def _written(effect: Effect, coordinates: Sequence[Coordinate], vector: FloatArray) -> dict[str, Any]:
    values: dict[str, Any] = dict(effect.values)
    parts: dict[tuple[str, str, int], list[float]] = {}
    for c, x in zip(coordinates, vector, strict=True):
        if c.part:
            parts.setdefault((c.key, c.phase_key, c.place), [0.0, 0.0])[c.part - 1] = float(x)
        elif c.form is Form.INVERSE:
            values[c.key] = 1 / float(x) if x else math.inf
        else:
            values[c.key] = float(x)
    for (key, phase_key, place), (re, im) in parts.items():
        _put(values, effect, key, place, math.hypot(re, im))
        _put(values, effect, phase_key, place, math.atan2(im, re))
    return values


def _put(values: dict[str, Any], effect: Effect, key: str, place: int, value: float) -> None:
    if effect.orders_key != "orders":
        values[key] = value
        return
    entries = list(values.get(key, (0.0,) * len(effect.orders)))
    entries[place] = value
    values[key] = tuple(entries)


#: what stands for the rig's offset among the numbers of pieces
OFFSET = -1

#: the offset and whether it is free, and of each effect its values and the keys that are free
Numbers = tuple[float, bool, tuple[tuple[dict[str, Any], frozenset[str]], ...]]


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

    @property
    def numbers(self) -> Numbers:
        """What tells this state from another one with the same pieces, but for values and what is free."""
        return self.offset, self.offset_free, tuple((dict(piece.effect.values), piece.free) for piece in self.pieces)

    def with_numbers(self, numbers: Numbers) -> State:
        """This state with the numbers of another one with the same pieces."""
        offset, offset_free, of_pieces = numbers

        def numbered(piece: Piece, values: dict[str, Any], free: frozenset[str]) -> Piece:
            is_own = piece.own.values == values
            return replace(piece, effect=piece.own if is_own else piece.effect.with_values(values), free=free)

        pieces = tuple(numbered(piece, *its) for piece, its in zip(self.pieces, of_pieces, strict=True))
        return replace(self, offset=offset, offset_free=offset_free, pieces=pieces)

    def replaced(self, number: int, piece: Piece) -> State:
        """This state with another piece in place of piece `number`."""
        return replace(self, pieces=(*self.pieces[:number], piece, *self.pieces[number + 1 :]))
