"""Readings: ways in which conditions or angles may be read wrong by one number, beside what changed in the rig.

Before the search `measurement` asks about what all orders agree on. What noise hides from it there, or another effect,
is asked again of the finished fit: whether one number of the measurement does what several changes of the rig do.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.fit.fitting import Fit, fit
from st_codegen.reconcile.fit.normal import gather, inverse
from st_codegen.reconcile.fit.state import State
from st_codegen.reconcile.fit.target import Column, FitData
from st_codegen.reconcile.judge.evidence import chi_square_tail
from st_codegen.reconcile.settings import SETTINGS

#: what data are where they were read wrong by a size
Reread = Callable[[Observations, float], Observations]


@dataclass(frozen=True)
class Reading:
    """One way to read wrong: its name among alternatives, what `--accept` calls it, and the data that were meant.

    text: what is wrong, with the size in its unit and (where that says it) its sign in words; step: a size that changes
    little; most: beyond it is no slip of this kind; sizes: those that it may have where it is not a matter of degree.
    """

    name: str
    accept: str
    text: str
    meant: Reread
    step: float
    most: float
    sizes: tuple[float, ...] = ()


@dataclass(frozen=True)
class Misread:
    """A reading of a size that does what changes of the rig do: the numbers of their pieces, OFFSET for the zero's."""

    reading: Reading
    size: float
    instead_of: frozenset[int]

    @property
    def text(self) -> str:
        """What seems to be read wrong, with its size."""
        return self.reading.text.format(abs(self.size), *(["high"] if self.size > 0 else ["low"]))

    def meant(self, data: Observations) -> Observations:
        """The data as they would be, read right."""
        return self.reading.meant(data, self.size)


#: in the place of the number of a piece
OFFSET = -1


def _scaled(key: str) -> Reread:
    return lambda data, size: _with(data, key, getattr(data.at, key) / (1.0 + size / 100.0))


def _shifted(key: str) -> Reread:
    return lambda data, size: _with(data, key, getattr(data.at, key) - size)


def _with(data: Observations, key: str, values: FloatArray) -> Observations:
    return replace(data, at=replace(data.at, **{key: values}))


def _slipped(data: Observations, size: float) -> Observations:
    """Speeds that fall in proportion to the load, by a share of 1/100 at the largest."""
    load = np.abs(data.at.torque_Nm)
    return _with(data, "speed_rpm", data.at.speed_rpm * (1.0 - size / 100.0 * load / max(float(load.max()), 1e-300)))


def _turned(data: Observations, size: float) -> Observations:
    return replace(data, values=data.values * np.exp(1j * np.radians(size) * data.orders))


def _ramp_taken_out(data: Observations, size: float) -> Observations:
    """TE without a rise of so many deg from the zero of the angle to where the turn ends."""
    waves = 1j * size / (np.pi * np.maximum(data.orders, 1))
    return replace(data, values=data.values - np.where(data.orders == 0, size / 2, waves))


def _smaller(data: Observations, size: float) -> Observations:
    return data.scaled(1.0 / (1.0 + size / 100.0))


def _smaller_backward(data: Observations, size: float) -> Observations:
    factor = np.where(data.at.sign < 0, 1.0 / (1.0 + size / 100.0), 1.0)[:, None]
    spectral = None if data.spectral_deg is None else data.spectral_deg * factor
    return replace(data, values=data.values * factor, spectral_deg=spectral)


def _exchanged(data: Observations, _size: float) -> Observations:
    return _with(data, "sign", -data.at.sign)


def _of_fahrenheit(data: Observations, _size: float) -> Observations:
    return _with(data, "temperature_C", (data.at.temperature_C - 32.0) / 1.8)


READINGS = (
    Reading("misread_torque", "torque", "all torques {:.3g} % too {}", _scaled("torque_Nm"), 0.1, 100.0),
    Reading("misread_torque", "torque", "all torques {:.3g} N m too {}", _shifted("torque_Nm"), 1.0, 500.0),
    Reading(
        "misread_temperature", "conditions", "all temperatures {:.3g} K too {}", _shifted("temperature_C"), 0.1, 30.0
    ),
    Reading("misread_temperature", "conditions", "all temperatures in degF", _of_fahrenheit, 0.0, 0.0, (1.0,)),
    Reading("misread_speed", "conditions", "all speeds {:.3g} % too {}", _scaled("speed_rpm"), 0.1, 30.0),
    Reading(
        "misread_speed",
        "conditions",
        "speeds {:.3g} % too {} at the largest load, and in proportion at others",
        _slipped,
        0.1,
        30.0,
    ),
    Reading("misread_angle", "home_offset", "every angle {:.3g} deg too {}", _turned, 1e-3, 5.0),
    Reading("misread_ratio", "ratio", "TE {:.3g} deg too {} at the end of each turn", _ramp_taken_out, 1e-4, 1.0),
    Reading("misread_te", "column_scale", "all TE {:.3g} % too {}", _smaller, 0.1, 30.0),
    Reading("misread_te", "column_scale", "all TE backward {:.3g} % too {}", _smaller_backward, 0.1, 30.0),
    Reading("exchanged_directions", "direction", "forward and backward exchanged", _exchanged, 0.0, 0.0, (1.0,)),
)


def misread(final: Fit, changed: Collection[int], offset_changed: bool) -> tuple[Misread, ...]:
    """Readings that do what changes of the rig do as well as these, the one that stands for most of them first.

    final: the fit with the changes; changed: the numbers of their pieces.
    """
    everything = frozenset(changed) | ({OFFSET} if offset_changed else frozenset())
    if not everything or final.target.data.angle_rad is not None:
        return ()
    state = final.state
    for i in changed:
        state = state.replaced(i, state.pieces[i].held())
    state = replace(state, offset=state.rig.zero_offset_deg, offset_free=False)
    plain = fit(final.target, state, steps=SETTINGS.quick_steps)
    found = (_instead(final, plain, reading, everything) for reading in READINGS)
    return tuple(sorted((one for one in found if one is not None), key=lambda one: -len(one.instead_of)))


def refined(final: Fit, accepted: Collection[str]) -> Misread | None:
    """By how much a correction that was accepted is off, now that what is missing is known; None where it is not.

    What it was estimated by before held what was missing as well.
    """
    best, found = SETTINGS.order_gain, None
    for reading in READINGS:
        if reading.accept in accepted and reading.step and final.target.data.angle_rad is None:
            size, read = _read(final.target, final.state, reading)
            if final.loss - read.loss > best:
                best, found = final.loss - read.loss, Misread(reading, size, frozenset())
    return found


def _instead(final: Fit, plain: Fit, reading: Reading, everything: frozenset[int]) -> Misread | None:
    """A reading with as many of the changes as it needs to be as good as all of them; None where it needs all."""
    size, best = _read(plain.target, plain.state, reading)
    if plain.loss - best.loss < SETTINGS.order_gain:
        return None
    kept: set[int] = set()
    while _is_needed(best, final):
        if len(kept) + 1 >= min(len(everything), SETTINGS.beside_reading + 1):
            return None
        trials = {i: _read(plain.target, _freed(best.state, final, i), reading, size) for i in everything - kept}
        number = min(trials, key=lambda i: trials[i][1].loss)
        kept.add(number)
        size, best = trials[number]
    return Misread(reading, size, everything - kept)


def _is_needed(without: Fit, final: Fit) -> bool:
    """Whether the data refuse the rig's own values of what `without` holds there, as they must of any change."""
    numbers = max(len(final.prior) - len(without.prior), 1)
    return chi_square_tail(without.loss - final.loss, numbers) < SETTINGS.p_changed


def _freed(state: State, final: Fit, number: int) -> State:
    if number == OFFSET:
        return replace(state, offset_free=True)
    return state.replaced(number, final.state.pieces[number])


def _read(target: FitData, state: State, reading: Reading, size: float = 0.0) -> tuple[float, Fit]:
    """The size of a reading, and all that is free in a state beside it: the best there is near a size."""

    def fitted(size: float, state: State) -> Fit:
        # what was kept of columns is that of other conditions
        read = replace(target, data=reading.meant(target.data, size), cache={}, responses={})
        return fit(read, state, steps=SETTINGS.quick_steps)

    if reading.sizes:
        return min(((size, fitted(size, state)) for size in reading.sizes), key=lambda one: one[1].loss)
    best = fitted(size, state)
    for _ in range(SETTINGS.quick_steps):
        ahead = reading.meant(target.data, size + reading.step)
        more = replace(best.target, data=ahead).residual(best.state.model())
        column: Column = (np.arange(len(ahead.orders)), (best.residual - more) / reading.step)
        if not column[1].any():
            break
        weights = best.target.weights(best.residual)
        matrix, pull = gather(best.target, (*best.columns, column), best.residual, weights, by_cell=False).total()
        told = np.append(best.prior, 0.0)
        pull = pull - np.append(best.prior * (best.state.vector() - best.centre), 0.0)
        aim = size + float((inverse(matrix + np.diag(told)) @ pull)[-1])
        trial = fitted(aim, best.state) if abs(aim) < reading.most else best
        if trial.loss > best.loss - SETTINGS.quick_tolerance:
            break
        size, best = aim, trial
    return size, best
