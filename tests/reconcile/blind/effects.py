"""The effects of docs/effects.md, written anew from that page: a rig's transmission error as harmonics.

A rig is a mapping of what stands in [rig] and a list of [[effect]] tables, as plain dictionaries with the keys of the
page. `coefficients` gives TE(theta) = Re sum c_k exp(i k theta) for many runs: order -> complex array (2, runs),
forward first. Nothing here comes from the program under test.
"""

from __future__ import annotations

import cmath
import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from .layout import Conditions

Effect = Mapping[str, Any]
Spectrum = dict[int, np.ndarray]

HEAD = {"reduction_ratio": 81.0, "cycloid_teeth": 39, "pins": 40, "cranks": 3, "reference_temperature_C": 30.0}
MODULATION, RESONANCE, DELAY = "carrier_modulation", "structural_resonance", "measurement_delay"
IN_TIME = ("control_lag", "coupling_compliance")
#: orders of a notch that are followed; at the narrowest width (4 deg) the rest is below 1e-3 of the depth
WEAR_ORDERS = 60


class Point:
    """What an effect sees: runs and [rig], with the direction s of shape (2, 1) = +1, -1."""

    def __init__(self, runs: Conditions, head: Mapping[str, Any]) -> None:
        self.rpm, self.torque, self.heat = runs.speed_rpm, runs.torque_Nm, runs.temperature_C
        self.head = {**HEAD, **head}
        self.s = np.array([[1.0], [-1.0]])
        self.shape = (2, len(runs))
        self.warmer = self.heat - self.head["reference_temperature_C"]
        #: revolutions of the output a second
        self.f_out = self.rpm / 60.0 / self.head["reduction_ratio"]

    def spread(self, value: Any) -> np.ndarray:
        """`value` for both directions and all runs, complex."""
        return np.broadcast_to(np.asarray(value, dtype=complex), self.shape).copy()


def _wave(effect: Effect, size: str, phase: str) -> np.ndarray:
    """Complex amplitude of both flanks, shape (2, 1): `backward_` keys where there are any, else forward's."""
    forward = cmath.rect(effect.get(size, 0.0), effect.get(phase, 0.0))
    if f"backward_{size}" in effect or f"backward_{phase}" in effect:
        backward = cmath.rect(effect.get(f"backward_{size}", 0.0), effect.get(f"backward_{phase}", 0.0))
    else:
        backward = forward
    return np.array([[forward], [backward]])


def _compliance(effect: Effect, at: Point) -> Spectrum:
    degrees = at.torque / effect["stiffness_Nm_per_arcmin"] / 60.0
    return {0: at.spread(-at.s * degrees)}


def _backlash(effect: Effect, at: Point) -> Spectrum:
    half = effect["gap_arcmin"] / 2.0 / 60.0
    return {0: at.spread(-at.s * half * np.tanh(at.torque / effect["seating_torque_Nm"]))}


def _windup(effect: Effect, at: Point) -> Spectrum:
    thinner = np.exp(-effect.get("viscosity_decay_per_K", 0.04) * at.warmer)
    viscous = effect.get("viscous_arcmin_per_krpm", 0.0) * at.rpm / 1000.0 * thinner
    film = np.exp(-at.rpm * thinner / effect.get("stribeck_speed_rpm", 300.0))
    dry = effect.get("coulomb_arcmin", 0.0) + effect.get("stribeck_arcmin", 0.0) * film
    return {0: at.spread(-at.s * (dry + viscous) / 60.0)}


def _thermal(effect: Effect, at: Point) -> Spectrum:
    return {0: at.spread(effect["drift_arcmin_per_K"] * at.warmer / 60.0)}


def _shaft(effect: Effect, at: Point) -> Spectrum:
    vector = cmath.rect(effect["amplitude_deg"], effect.get("phase_rad", 0.0))
    return {1: at.spread(vector * (1.0 + effect.get("growth_per_kNm", 0.0) * at.torque / 1000.0))}


def _constant(order: int) -> Callable[[Effect, Point], Spectrum]:
    def effect_of(effect: Effect, at: Point) -> Spectrum:
        return {order: at.spread(cmath.rect(effect["amplitude_deg"], effect.get("phase_rad", 0.0)))}

    return effect_of


def _crank(effect: Effect, at: Point) -> Spectrum:
    load = _wave(effect, "slope_deg_per_kNm", "slope_phase_rad") * at.torque / 1000.0
    return {int(at.head["cranks"]): at.spread(_wave(effect, "amplitude_deg", "phase_rad") + load)}


@lru_cache(maxsize=4096)
def notch(order: int, width_deg: float) -> float:
    """exp(-K) I_k(K) by the trapezoidal rule over a period, exact to rounding for a smooth periodic function."""
    stiff = 1.0 / math.radians(width_deg) ** 2
    angle = 2.0 * np.pi * np.arange(4096) / 4096
    return float(np.mean(np.exp(stiff * (np.cos(angle) - 1.0)) * np.cos(order * angle)))


def _wear(effect: Effect, at: Point) -> Spectrum:
    depth, centre = effect["depth_arcmin"] / 60.0, math.radians(effect["centre_deg"])
    out = {0: at.spread(-at.s * depth * notch(0, effect["width_deg"]))}
    for order in range(1, WEAR_ORDERS + 1):
        turned = cmath.exp(-1j * order * centre)
        out[order] = at.spread(-at.s * 2.0 * depth * notch(order, effect["width_deg"]) * turned)
    return out


def _mesh(effect: Effect, at: Point) -> Spectrum:
    return {int(effect["order"]): at.spread(_wave(effect, "amplitude_deg", "phase_rad"))}


def _load_mesh(effect: Effect, at: Point) -> Spectrum:
    slope = _wave(effect, "slope_deg_per_kNm", "phase_rad")
    return {int(effect["order"]): at.spread(slope * at.torque / 1000.0)}


ADDITIVE: dict[str, Callable[[Effect, Point], Spectrum]] = {
    "torsional_compliance": _compliance,
    "backlash": _backlash,
    "friction_windup": _windup,
    "thermal_drift": _thermal,
    "output_shaft_eccentricity": _shaft,
    "encoder_eccentricity": _constant(1),
    "output_shaft_ovality": _constant(2),
    "crank_misalignment": _crank,
    "wear": _wear,
    "cycloid_tooth_error": _mesh,
    "pin_error": _mesh,
    "input_shaft_misalignment": _mesh,
    "load_dependent_mesh": _load_mesh,
}
NAMES = (*ADDITIVE, MODULATION, RESONANCE, DELAY, *IN_TIME)


def _modulated(effect: Effect, at: Point, bare: Mapping[int, np.ndarray]) -> Spectrum:
    mesh, step = int(effect["order"]), int(at.head["cranks"])
    carrier = bare.get(mesh, np.zeros(at.shape, dtype=complex))
    lower = cmath.rect(effect.get("lower_ratio", 0.0), effect.get("lower_phase_rad", 0.0))
    upper = cmath.rect(effect.get("upper_ratio", 0.0), effect.get("upper_phase_rad", 0.0))
    return {mesh - step: lower * carrier, mesh + step: upper * carrier}


def response(frequency_Hz: np.ndarray, natural_Hz: float, damping: float) -> np.ndarray:
    """H of docs/effects.md at an excitation frequency: 1/i at resonance."""
    r = frequency_Hz / natural_Hz
    return np.asarray(2.0 * damping * r**2 / (1.0 - r**2 + 2.0j * damping * r))


def _resonant(effect: Effect, at: Point) -> Spectrum:
    out: Spectrum = {}
    keys = [key for key in effect if key.endswith(("deg", "phase_rad", "deg_per_kNm"))]
    for place, order in enumerate(effect["orders"]):
        one = {key: effect[key][place] for key in keys}
        answer = response(order * at.f_out, effect["frequency_Hz"], effect["damping_ratio"])
        both = np.stack([answer, np.conj(answer)])
        height = _wave(one, "amplitude_deg", "phase_rad")
        if "slope_deg_per_kNm" in one:
            height = height + _wave(one, "slope_deg_per_kNm", "slope_phase_rad") * at.torque / 1000.0
        out[int(order)] = at.spread(height * both)
    return out


def _delayed(effect: Effect, at: Point, spectrum: Mapping[int, np.ndarray]) -> Spectrum:
    turning = at.s * 2.0 * math.pi * at.f_out
    late, skew = effect.get("delay_us", 0.0) * 1e-6, effect.get("skew_us", 0.0) * 1e-6
    out = {order: values * np.exp(-1j * order * turning * late) for order, values in spectrum.items()}
    out[0] = out.get(0, at.spread(0.0)) - np.degrees(turning * skew)
    return out


def coefficients(head: Mapping[str, Any], effects: Sequence[Effect], runs: Conditions) -> Spectrum:
    """c_k of a rig: order -> complex (2, runs), composed in the order of the page; effects in time add nothing."""
    at = Point(runs, head)
    total: defaultdict[int, np.ndarray] = defaultdict(lambda: np.zeros(at.shape, dtype=complex))

    def add(part: Spectrum) -> None:
        for order, values in part.items():
            # an order below zero is the same wave seen from the other side
            total[abs(order)] = total[abs(order)] + (values if order >= 0 else np.conj(values))

    add({0: at.spread(at.head.get("zero_offset_deg", 0.0))})
    for effect in effects:
        if effect["name"] in ADDITIVE:
            add(ADDITIVE[effect["name"]](effect, at))
    bare = dict(total)
    for effect in effects:
        if effect["name"] == MODULATION:
            add(_modulated(effect, at, bare))
    for effect in effects:
        if effect["name"] == RESONANCE:
            add(_resonant(effect, at))
    out: Spectrum = dict(total)
    for effect in effects:
        if effect["name"] == DELAY:
            out = _delayed(effect, at, out)
    unknown = {effect["name"] for effect in effects} - set(NAMES)
    if unknown:
        raise ValueError(f"not in docs/effects.md: {sorted(unknown)}")
    return out


def curve(spectrum: Mapping[int, np.ndarray], samples: int) -> np.ndarray:
    """TE over 0 <= theta < 360 deg, shape (2, runs, samples), term by term (no FFT, which a reader will use)."""
    theta = 2.0 * np.pi * np.arange(samples) / samples
    shape = next(iter(spectrum.values())).shape
    te = np.zeros((*shape, samples))
    for order, values in spectrum.items():
        te += values.real[..., None] * np.cos(order * theta) - values.imag[..., None] * np.sin(order * theta)
    return te
