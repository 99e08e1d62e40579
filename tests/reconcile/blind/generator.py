"""Writes the files of a case: a rig.toml that lacks something, measured data that have it, what a report should say.

The formulas are those of docs/effects.md; it imports nothing of the program under test.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from . import effects, foreign, hidden, layout, noise, timed, write
from .cases import CONFOUNDED, Case
from .effects import Spectrum
from .layout import Conditions
from .score import Expected

SAMPLES = 2048
#: orders of a harmonic table: shafts and notches, mesh orders and their sidebands
TABLE_ORDERS = (
    *range(13),
    36,
    37,
    39,
    40,
    42,
    43,
    75,
    78,
    80,
    81,
    84,
    117,
    120,
    123,
    156,
    159,
    162,
    165,
    237,
    240,
    243,
)
#: standard deviation of the mean from run to run and of other coefficients (each part), deg, times a factor
MEAN_SIGMA, WAVE_SIGMA = 1.0e-3, 2.0e-5
SAMPLE_SIGMA = 5.0e-4
FACTOR = (0.5, 2.0)
CORRUPT_SHARE = 0.03
#: a coefficient counts as touched by an effect from this share of its largest one on
TOUCHED = 0.02


@dataclass(frozen=True)
class Made:
    """A case on disk, and what it is made of: `true` tables give the data, `snr` is the size that came out."""

    rig: Path
    measured: Path
    expected: Expected
    head: Mapping[str, Any]
    true: tuple[Mapping[str, Any], ...]
    orders: tuple[int, ...]
    floor_deg: float
    snr: float
    runs: int
    bad_runs: tuple[str, ...] = ()

    def plain(self) -> dict[str, Any]:
        hidden_tables = {name: dict(values) for name, values in self.expected.hidden.items()}
        numbers = {"floor_deg": self.floor_deg, "snr": self.snr, "runs": self.runs}
        return {
            "hidden": hidden_tables,
            **numbers,
            "bad_runs": list(self.bad_runs),
            "orders": list(self.expected.orders),
        }


# ------------------------------------------------------------------------------------------------ conditions


def plan_runs(case: Case, rng: np.random.Generator) -> Conditions:
    """The conditions of a case; those of confounded ones lack what would tell the effects apart."""
    # a resonance is narrow: it takes the real rig's step of 100 rpm to see it, whatever the files
    resonant = "structural_resonance" in case.effects
    density = "fine" if resonant else "sparse" if case.format == "curves" else "dense"
    runs = layout.conditions(rng, case.layout, density)
    if "far_from_no_load" in case.variant:
        # far above any seating torque tanh is 1 to the last digit that is written
        runs = replace(runs, torque_Nm=(800.0 + runs.torque_Nm * (1000.0 / 1800.0)).round(1))
    if "below_seating" in case.variant:
        # seated at 150 N m, tanh(M/150) is straight within 1 % up to 25 N m
        runs = replace(runs, torque_Nm=(runs.torque_Nm * (25.0 / 1800.0)).round(2))
    if "at_one_temperature" in case.variant:
        runs = replace(runs, temperature_C=np.full(len(runs), 30.0))
    return runs


def plan_hidden(case: Case, rng: np.random.Generator) -> list[hidden.Hidden]:
    """Random instances of the effects of a case; confounded ones are made to look alike."""
    chosen = [hidden.MAKERS[name](rng) for name in case.effects]
    if case.kind == "pair" and {"load_dependent_mesh", "carrier_modulation"} <= set(case.effects):
        # a load part on the very order that is modulated makes the sidebands grow too
        chosen[0] = replace(chosen[0], table={**chosen[0].table, "order": chosen[1].table["order"]})
    if case.kind != "confounded":
        return chosen
    table = dict(chosen[0].table)
    if case.variant == "order_1_of_shaft":
        table.pop("growth_per_kNm")
        scored: tuple[str, ...] = ("amplitude_deg", "phase_rad")
    elif case.variant == "dry_friction_far_from_no_load":
        table = {"name": "friction_windup", "coulomb_arcmin": 0.3}
        scored = ("coulomb_arcmin",)
    elif case.variant.endswith("below_seating") and table["name"] == "backlash":
        table["seating_torque_Nm"] = 150.0
        scored = ()
    elif case.variant == "skew_at_one_temperature":
        table = {"name": "measurement_delay", "skew_us": 100.0}
        scored = ("skew_us",)
    elif case.variant == "viscous_at_one_temperature":
        table = {"name": "friction_windup", "viscous_arcmin_per_krpm": 0.3}
        scored = ("viscous_arcmin_per_krpm",)
    else:
        scored = chosen[0].scored
    return [
        replace(chosen[0], table=table, scored=scored, scaled=tuple(key for key in chosen[0].scaled if key in table))
    ]


# ------------------------------------------------------------------------------------------------ sizes


def difference(one: Mapping[int, np.ndarray], other: Mapping[int, np.ndarray]) -> Spectrum:
    """one - other, order by order."""
    shape = next(iter(one.values())).shape
    zero = np.zeros(shape, dtype=complex)
    return {order: one.get(order, zero) - other.get(order, zero) for order in sorted({*one, *other})}


def snr_of(change: Mapping[int, np.ndarray], sigma: Mapping[int, float]) -> tuple[float, int]:
    """(root mean square of a change over the noise of the coefficients it touches, how many real numbers that are).

    `sigma` is the noise of each part of a coefficient; orders that are not measured are left out.
    """
    # in noises, not in degrees: the mean is measured far worse than a wave
    peak = max((np.abs(change[order]).max() / sigma[order] for order in change if order in sigma), default=0.0)
    touched = [
        order for order in change if order in sigma and np.abs(change[order]).max() / sigma[order] > TOUCHED * peak
    ]
    parts, count = 0.0, 0
    for order in touched:
        values = change[order] / sigma[order]
        real_numbers = values.size * (1 if order == 0 else 2)
        parts += float((np.abs(values) ** 2).sum())
        count += real_numbers
    return (np.sqrt(parts / count) if count else 0.0), count


def te_rms(change: Mapping[int, np.ndarray], orders: Sequence[int]) -> float:
    """Root mean square in deg of the TE of `change` over the angle and all runs, in these orders."""
    power = sum(
        float(np.mean(np.abs(values) ** 2)) * (1.0 if order == 0 else 0.5)
        for order, values in change.items()
        if order in orders
    )
    return float(np.sqrt(power))


def fit_size(
    gone: Sequence[hidden.Hidden], known: hidden.Healthy, runs: Conditions, sigma: Mapping[int, float], case: Case
) -> tuple[list[hidden.Hidden], float]:
    """(the hidden effects, scaled until the trace of each in the data has the size of the case; the smallest size)."""
    out, sizes = list(gone), []
    for place, one in enumerate(gone):
        others = [*known.true, *(other.table for number, other in enumerate(out) if number != place)]
        bare = effects.coefficients(known.head, others, runs)

        def size(strength: float, one: hidden.Hidden = one, others: Any = others, bare: Any = bare) -> float:
            with_it = effects.coefficients(known.head, [*others, one.times(strength).table], runs)
            ratio, count = snr_of(difference(with_it, bare), sigma)
            return ratio * (np.sqrt(count) if case.kind == "weak" else 1.0)

        low, high = 1e-6, 1e3
        for _ in range(40):
            middle = np.sqrt(low * high)
            low, high = (middle, high) if size(middle) < case.size else (low, middle)
        out[place] = one.times(float(np.sqrt(low * high)))
        sizes.append(size(float(np.sqrt(low * high))))
    return out, min(sizes, default=0.0)


# ------------------------------------------------------------------------------------------------ corruption


def corrupt_table(
    rng: np.random.Generator, runs: Conditions, values: np.ndarray
) -> tuple[Conditions, np.ndarray, np.ndarray]:
    """A few runs spoilt in both directions: a wrong label, moved, or with high orders that are not its own."""
    count = max(1, round(CORRUPT_SHARE * len(runs)))
    bad = rng.choice(len(runs), count, replace=False)
    columns = [runs.speed_rpm.copy(), runs.torque_Nm.copy(), runs.temperature_C]
    values = values.copy()
    for run in bad:
        kind = rng.integers(3)
        if kind == 0:
            other = int(rng.integers(len(runs)))
            columns[0][run], columns[1][run] = runs.speed_rpm[other], runs.torque_Nm[other]
        elif kind == 1:
            values[0, :, run] += rng.choice([-1, 1]) * rng.uniform(0.03, 0.1)
        else:
            values[1:, :, run] *= rng.uniform(2.0, 5.0)
    return Conditions(*columns), values, bad


def corrupt_curves(rng: np.random.Generator, te: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A few curves spoilt: moved as a whole, stuck over a part of the revolution, or with a burst in it."""
    count = max(1, round(CORRUPT_SHARE * te.shape[1]))
    bad = rng.choice(te.shape[1], count, replace=False)
    te = te.copy()
    for run in bad:
        kind, start = rng.integers(3), int(rng.integers(te.shape[2] // 2))
        if kind == 0:
            te[:, run] += rng.choice([-1, 1]) * rng.uniform(0.03, 0.1)
        elif kind == 1:
            te[:, run, start : start + te.shape[2] // 8] = te[:, run, start : start + 1]
        else:
            te[:, run, start : start + 60] += rng.uniform(0.02, 0.08) * rng.choice([-1, 1], 60)
    return te, bad


# ------------------------------------------------------------------------------------------------ making a case


def expectation(case: Case, gone: Sequence[hidden.Hidden], corrupt: int) -> Expected:
    """What an honest report says about this case."""
    scored = {one.name: {key: float(one.table[key]) for key in one.scored if key in one.table} for one in gone}
    on_mesh = ("cycloid_tooth_error", "pin_error", "input_shaft_misalignment", "load_dependent_mesh")
    mesh = {one.name: int(one.table["order"]) for one in gone if one.name in on_mesh}
    groups = (frozenset(CONFOUNDED[case.variant][1]),) if case.kind == "confounded" else ()
    orders = foreign.KINDS[case.variant].orders if case.kind == "foreign" else ()
    return Expected(case.kind, scored, groups, orders, corrupt, mesh, case.drifted)


def _bars(case: Case) -> tuple[str, ...]:
    """Effects that the known rig of a confounded case must not have: they would take up what is hidden."""
    if case.kind != "confounded":
        return ()
    return CONFOUNDED[case.variant][1]


def _coefficient_noise(
    case: Case, rng: np.random.Generator, runs: int, orders: Sequence[int]
) -> tuple[np.ndarray, np.ndarray | None]:
    """(noise of coefficients (orders, 2, runs), noise of the samples it comes from where curves are measured)."""
    factor = float(np.exp(rng.uniform(*np.log(FACTOR))))
    if case.format == "table":
        sigma = np.full(len(orders), WAVE_SIGMA * factor)
        # what 25 N m do to the mean is small: such a campaign is of use only with a steady zero
        sigma[0] = MEAN_SIGMA * factor * (0.05 if "below_seating" in case.variant else 1.0)
        return noise.of_coefficients(rng, case.noise, sigma, 2, runs), None
    samples = noise.of_samples(rng, case.noise, SAMPLE_SIGMA * factor, (2, runs, SAMPLES))
    samples += MEAN_SIGMA * factor * rng.standard_normal((2, runs, 1))
    spectrum = np.fft.rfft(samples, axis=2) / SAMPLES
    parts = np.moveaxis(spectrum[:, :, list(orders)], 2, 0).copy()
    parts[1:] *= 2.0
    return parts, samples


def make(case: Case, folder: Path) -> Made:
    """Write the files of `case` into `folder`."""
    rng = np.random.default_rng([case.seed, 2])
    gone = plan_hidden(case, rng)
    if case.format == "recording":
        return _make_recording(case, rng, gone, folder)
    known = hidden.healthy(rng, gone, _bars(case), case.drifted)
    runs = plan_runs(case, rng)
    orders = tuple(sorted({*TABLE_ORDERS, *(foreign.KINDS[case.variant].orders if case.kind == "foreign" else ())}))
    wave_noise, sample_noise = _coefficient_noise(case, rng, len(runs), orders)
    sigma = {
        order: float(np.sqrt(np.mean(np.abs(wave_noise[place]) ** 2) / (1 if order == 0 else 2)))
        for place, order in enumerate(orders)
    }
    gone, snr = fit_size(gone, known, runs, sigma, case)
    true = (*known.true, *(one.table for one in gone))
    spectrum = effects.coefficients(known.head, true, runs)
    strange, more = _strange(case, rng, runs, sigma)
    for order, values in strange.items():
        spectrum[order] = spectrum.get(order, 0.0) + values
    floor = te_rms({order: wave_noise[place] for place, order in enumerate(orders)}, orders)
    rig = folder / "rig.toml"
    # curves tell the noise within a run, but not how far its mean differs from the next: a rig says that
    offset = {} if sample_noise is None else {"noise": {"run_offset_deg": sigma[0]}}
    write.rig(rig, {"rig": known.head, **offset}, known.stated)
    bad = np.array([], dtype=int)
    if sample_noise is None:
        zero = np.zeros((2, len(runs)), dtype=complex)
        values = np.stack([spectrum.get(order, zero) for order in orders]) + wave_noise
        labels = runs
        if case.corrupt:
            labels, values, bad = corrupt_table(rng, runs, values)
        measured = folder / "harmonics.csv"
        write.harmonic_table(measured, labels, orders, values)
        names = [_condition(labels, run) for run in bad]
    else:
        te = effects.curve(spectrum, SAMPLES) + sample_noise + more
        if case.corrupt:
            te, bad = corrupt_curves(rng, te)
        measured = folder / "campaign"
        # off a grid two runs could share a rounded name
        files = write.curves(measured, runs, te, names_in_file=case.layout != "scattered" and case.seed % 2 == 0)
        names = [f"{files[run]} = {_condition(runs, run)}" for run in bad]
    expected = expectation(case, gone, len(bad))
    return Made(rig, measured, expected, known.head, true, orders, floor, snr, len(runs), tuple(names))


def _condition(runs: Conditions, run: int) -> str:
    return f"{runs.speed_rpm[run]:g} rpm, {runs.torque_Nm[run]:g} N m"


def _strange(
    case: Case, rng: np.random.Generator, runs: Conditions, sigma: Mapping[int, float]
) -> tuple[Spectrum, np.ndarray | float]:
    """What a `foreign` case has outside the catalogue, as harmonics and as curves, in the size of the case."""
    if case.kind != "foreign":
        return {}, 0.0
    kind = foreign.KINDS[case.variant]
    if kind.spectrum is not None:
        unit = kind.spectrum(rng, runs)
        ratio, _ = snr_of(unit, sigma)
        return {order: values * (case.size / ratio) for order, values in unit.items()}, 0.0
    assert kind.curve is not None
    # spread over many orders: the size of one wave, in noises of a coefficient
    typical = float(np.median([sigma[order] for order in sigma if order > 12]))
    return {}, case.size * typical * np.sqrt(2.0) * kind.curve(rng, runs, SAMPLES)


def _make_recording(case: Case, rng: np.random.Generator, gone: list[hidden.Hidden], folder: Path) -> Made:
    """Recordings in time, three in a folder or one long one: an axis with a lag and a coupling."""
    known = hidden.healthy(rng, gone, _bars(case), case.drifted)
    axis = [hidden.MAKERS[name](rng).table for name in effects.IN_TIME if name not in case.effects]
    true_known = (*known.true, *axis)
    # the axis' own two are stated as they are: their size is not measured in TE
    stated = (*known.stated, *axis)
    head = known.head
    snr = case.size
    if gone and gone[0].scaled:
        key = gone[0].scaled[0]
        torque = 750.0  # typical of the profile's loads
        stiffness = torque / (60.0 * case.size * timed.OUT_NOISE_DEG)
        gone = [replace(gone[0], table={**gone[0].table, key: float(min(stiffness, 20000.0))})]
    true = (*true_known, *(one.table for one in gone))
    if case.seed % 2:
        measured, counts = folder / "recordings", (4, 4, 4)
        measured.mkdir()
    else:
        measured, counts = folder / "recording.csv", (12,)
    rows = 0
    for number, moves in enumerate(counts):
        columns = timed.record(rng, head, true, moves)
        write.recording(measured / f"recording_{number}.csv" if measured.is_dir() else measured, columns)
        rows += len(columns["t"])
    rig = folder / "rig.toml"
    write.rig(rig, {"rig": head}, stated)
    expected = expectation(case, gone, 0)
    return Made(rig, measured, expected, head, true, TABLE_ORDERS, timed.OUT_NOISE_DEG, snr, rows)
