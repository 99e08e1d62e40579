"""What is hidden: for each effect of the catalogue a random instance, what scales it, and the rig around it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

TURN = 2.0 * np.pi
#: amplitude in deg and kind of the constant mesh orders of a healthy rig (medians of docs/effects.md)
MESH = {
    ("cycloid_tooth_error", 39): 7.2e-4,
    ("cycloid_tooth_error", 78): 3.0e-4,
    ("cycloid_tooth_error", 156): 1.7e-4,
    ("pin_error", 40): 8.0e-4,
    ("pin_error", 80): 2.1e-4,
    ("pin_error", 120): 2.5e-4,
    ("pin_error", 240): 2.5e-4,
    ("input_shaft_misalignment", 81): 2.8e-4,
    ("input_shaft_misalignment", 162): 1.0e-4,
}


@dataclass(frozen=True)
class Hidden:
    """One effect to be hidden.

    `scaled` are the keys that its size is proportional to (`inverse`: inversely), `needs` effects of which the rig must
    have a table, `bars` names the rig must not have beside it, `scored` the parameters a report is judged by.
    """

    table: Mapping[str, Any]
    scaled: tuple[str, ...]
    scored: tuple[str, ...]
    inverse: bool = False
    needs: tuple[Mapping[str, Any], ...] = ()
    bars: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        return str(self.table["name"])

    def times(self, strength: float) -> Hidden:
        """The same effect `strength` times as large."""
        factor = 1.0 / strength if self.inverse else strength
        table = dict(self.table)
        for key in self.scaled:
            value = table[key]
            table[key] = [factor * item for item in value] if isinstance(value, list) else factor * value
        return Hidden(table, self.scaled, self.scored, self.inverse, self.needs, self.bars)


def _about(rng: np.random.Generator, value: float, spread: float = 0.3) -> float:
    return float(value * rng.uniform(1.0 - spread, 1.0 + spread))


def _phase(rng: np.random.Generator) -> float:
    return float(rng.uniform(-np.pi, np.pi))


def _flanks(rng: np.random.Generator, size: str, phase: str, value: float) -> dict[str, float]:
    """Both pairs of keys, the flanks of their own."""
    return {
        size: _about(rng, value),
        phase: _phase(rng),
        f"backward_{size}": _about(rng, value),
        f"backward_{phase}": _phase(rng),
    }


def mesh(rng: np.random.Generator, name: str, order: int) -> dict[str, Any]:
    value = MESH.get((name, order), 3e-4)
    return {"name": name, "order": order, **_flanks(rng, "amplitude_deg", "phase_rad", value)}


def _make_mesh(name: str, orders: Sequence[int]) -> Callable[[np.random.Generator], Hidden]:
    def make(rng: np.random.Generator) -> Hidden:
        table = mesh(rng, name, int(rng.choice(orders)))
        keys = tuple(key for key in table if key not in ("name", "order"))
        return Hidden(table, ("amplitude_deg", "backward_amplitude_deg"), keys)

    return make


def _compliance(rng: np.random.Generator) -> Hidden:
    key = "stiffness_Nm_per_arcmin"
    return Hidden({"name": "torsional_compliance", key: _about(rng, 450.0)}, (key,), (key,), inverse=True)


def _backlash(rng: np.random.Generator) -> Hidden:
    table = {"name": "backlash", "gap_arcmin": 0.5, "seating_torque_Nm": float(rng.uniform(30.0, 140.0))}
    return Hidden(table, ("gap_arcmin",), ("gap_arcmin", "seating_torque_Nm"))


def _windup(rng: np.random.Generator) -> Hidden:
    table: dict[str, Any] = {
        "name": "friction_windup",
        "coulomb_arcmin": _about(rng, 0.25),
        "viscous_arcmin_per_krpm": _about(rng, 0.25),
    }
    if rng.random() < 0.5:
        table["viscosity_decay_per_K"] = float(rng.uniform(0.02, 0.08))
    scaled: tuple[str, ...] = ("coulomb_arcmin", "viscous_arcmin_per_krpm")
    if rng.random() < 0.33:
        table = {"name": "friction_windup", "coulomb_arcmin": table["coulomb_arcmin"]}
        table |= {"stribeck_arcmin": _about(rng, 0.5), "stribeck_speed_rpm": float(rng.uniform(200.0, 600.0))}
        scaled = ("coulomb_arcmin", "stribeck_arcmin")
    return Hidden(table, scaled, tuple(key for key in table if key != "name"))


def _thermal(rng: np.random.Generator) -> Hidden:
    key = "drift_arcmin_per_K"
    return Hidden({"name": "thermal_drift", key: _about(rng, 0.05) * float(rng.choice([-1, 1]))}, (key,), (key,))


def _shaft(rng: np.random.Generator) -> Hidden:
    growth = float(rng.uniform(0.4, 1.2))
    table = {
        "name": "output_shaft_eccentricity",
        "amplitude_deg": 0.01,
        "phase_rad": _phase(rng),
        "growth_per_kNm": growth,
    }
    keys = ("amplitude_deg", "phase_rad", "growth_per_kNm")
    return Hidden(table, ("amplitude_deg",), keys, bars=("encoder_eccentricity",))


def _encoder(rng: np.random.Generator) -> Hidden:
    table = {"name": "encoder_eccentricity", "amplitude_deg": 0.01, "phase_rad": _phase(rng)}
    keys = ("amplitude_deg", "phase_rad")
    return Hidden(table, ("amplitude_deg",), keys, bars=("output_shaft_eccentricity",))


def _ovality(rng: np.random.Generator) -> Hidden:
    table = {"name": "output_shaft_ovality", "amplitude_deg": 3e-4, "phase_rad": _phase(rng)}
    return Hidden(table, ("amplitude_deg",), ("amplitude_deg", "phase_rad"))


def _crank(rng: np.random.Generator) -> Hidden:
    table: dict[str, Any] = {"name": "crank_misalignment", **_flanks(rng, "amplitude_deg", "phase_rad", 6e-4)}
    scaled = ["amplitude_deg", "backward_amplitude_deg"]
    if rng.random() < 0.6:
        table |= _flanks(rng, "slope_deg_per_kNm", "slope_phase_rad", 4e-4)
        scaled += ["slope_deg_per_kNm", "backward_slope_deg_per_kNm"]
    return Hidden(table, tuple(scaled), tuple(key for key in table if key != "name"))


def _wear(rng: np.random.Generator) -> Hidden:
    place = {"centre_deg": float(rng.uniform(20.0, 340.0)), "width_deg": float(rng.uniform(10.0, 40.0))}
    return Hidden({"name": "wear", "depth_arcmin": 0.2, **place}, ("depth_arcmin",), ("depth_arcmin", *place))


def _load_mesh(rng: np.random.Generator) -> Hidden:
    order = int(rng.choice([39, 78, 40, 81, 240]))
    table = {"name": "load_dependent_mesh", "order": order, **_flanks(rng, "slope_deg_per_kNm", "phase_rad", 7e-4)}
    keys = tuple(key for key in table if key not in ("name", "order"))
    return Hidden(table, ("slope_deg_per_kNm", "backward_slope_deg_per_kNm"), keys)


def _carrier(rng: np.random.Generator) -> Hidden:
    name, order = [("cycloid_tooth_error", 39), ("pin_error", 40), ("pin_error", 240)][rng.integers(3)]
    table = {
        "name": "carrier_modulation",
        "order": order,
        "lower_ratio": _about(rng, 0.2),
        "lower_phase_rad": _phase(rng),
        "upper_ratio": _about(rng, 0.2),
        "upper_phase_rad": _phase(rng),
    }
    # the mesh order it modulates must be there, and be seen well: a ratio to noise is no ratio
    carrier = mesh(rng, name, order)
    carrier |= {"amplitude_deg": _about(rng, 1.5e-3), "backward_amplitude_deg": _about(rng, 1.5e-3)}
    keys = ("lower_ratio", "lower_phase_rad", "upper_ratio", "upper_phase_rad")
    return Hidden(table, ("lower_ratio", "upper_ratio"), keys, needs=(carrier,))


def resonance(rng: np.random.Generator) -> dict[str, Any]:
    orders = [[156, 162, 240], [162, 240], [156, 162, 240], [120, 156, 240]][rng.integers(4)]
    table: dict[str, Any] = {
        "name": "structural_resonance",
        "frequency_Hz": float(rng.uniform(38.0, 56.0)),
        "damping_ratio": float(rng.uniform(0.015, 0.05)),
        "orders": orders,
    }
    growth = float(rng.uniform(0.3, 1.0)) if rng.random() < 0.4 else 0.0
    for side in ("", "backward_"):
        table[f"{side}amplitude_deg"] = [_about(rng, 4e-3) for _ in orders]
        table[f"{side}phase_rad"] = [_phase(rng) for _ in orders]
        if growth:
            table[f"{side}slope_deg_per_kNm"] = [growth * size for size in table[f"{side}amplitude_deg"]]
            table[f"{side}slope_phase_rad"] = table[f"{side}phase_rad"]
    return table


def _resonance(rng: np.random.Generator) -> Hidden:
    table = resonance(rng)
    scaled = [f"{side}{key}" for key in ("amplitude_deg", "slope_deg_per_kNm") for side in ("", "backward_")]
    return Hidden(table, tuple(key for key in scaled if key in table), ("frequency_Hz", "damping_ratio"))


def _delay(rng: np.random.Generator) -> Hidden:
    table: dict[str, Any] = {"name": "measurement_delay"}
    kind = rng.integers(3)
    if kind != 1:
        table["delay_us"] = _about(rng, 1000.0)
    if kind != 0:
        table["skew_us"] = _about(rng, 100.0) * float(rng.choice([-1, 1]))
    keys = tuple(key for key in table if key != "name")
    return Hidden(table, keys, keys)


def _lag(rng: np.random.Generator) -> Hidden:
    return Hidden(
        {"name": "control_lag", "lag_ms": float(np.exp(rng.uniform(np.log(1.0), np.log(20.0))))}, (), ("lag_ms",)
    )


def _coupling(rng: np.random.Generator) -> Hidden:
    table: dict[str, Any] = {"name": "coupling_compliance", "stiffness_Nm_per_rad": float(rng.uniform(2000.0, 12000.0))}
    if rng.random() < 0.5:
        table["backlash_arcmin"] = float(rng.uniform(5.0, 20.0))
    return Hidden(table, (), tuple(key for key in table if key != "name"))


MAKERS: dict[str, Callable[[np.random.Generator], Hidden]] = {
    "backlash": _backlash,
    "torsional_compliance": _compliance,
    "friction_windup": _windup,
    "output_shaft_eccentricity": _shaft,
    "output_shaft_ovality": _ovality,
    "crank_misalignment": _crank,
    "cycloid_tooth_error": _make_mesh("cycloid_tooth_error", (39, 78, 117, 156)),
    "pin_error": _make_mesh("pin_error", (40, 80, 120, 240)),
    "input_shaft_misalignment": _make_mesh("input_shaft_misalignment", (81, 162)),
    "carrier_modulation": _carrier,
    "structural_resonance": _resonance,
    "thermal_drift": _thermal,
    "measurement_delay": _delay,
    "encoder_eccentricity": _encoder,
    "load_dependent_mesh": _load_mesh,
    "wear": _wear,
    "control_lag": _lag,
    "coupling_compliance": _coupling,
}


@dataclass(frozen=True)
class Healthy:
    """The effects that the rig model knows, in a true and in a stated form (which may have drifted apart a little)."""

    true: tuple[Mapping[str, Any], ...]
    stated: tuple[Mapping[str, Any], ...]
    head: Mapping[str, Any] = field(default_factory=dict)


def _clashes(table: Mapping[str, Any], gone: Sequence[Hidden], bars: set[str]) -> bool:
    """Whether a table of the rig is one of those hidden, or is barred beside them."""
    same = any(table["name"] == one.name and table.get("order") == one.table.get("order") for one in gone)
    return same or table["name"] in bars


def healthy(
    rng: np.random.Generator, gone: Sequence[Hidden], bars: Sequence[str] = (), drifted: bool = False
) -> Healthy:
    """A rig with effects of random sizes around those of docs/effects.md, without those in `gone` and in `bars`."""
    tables: list[dict[str, Any]] = [dict(need) for one in gone for need in one.needs]
    taken = {(table["name"], table.get("order")) for table in tables}

    def put(table: Mapping[str, Any], chance: float = 1.0) -> None:
        # drawn in any case, so that a bar changes nothing else of the rig
        if rng.random() < chance and (table["name"], table.get("order")) not in taken:
            tables.append(dict(table))

    put(_compliance(rng).table)
    put({"name": "backlash", "gap_arcmin": _about(rng, 0.4), "seating_torque_Nm": _about(rng, 60.0)}, 0.6)
    windup = {"coulomb_arcmin": _about(rng, 0.25), "viscous_arcmin_per_krpm": _about(rng, 0.05)}
    put({"name": "friction_windup", **windup}, 0.6)
    put({"name": "thermal_drift", "drift_arcmin_per_K": _about(rng, 0.02)}, 0.6)
    put({"name": "output_shaft_eccentricity", "amplitude_deg": _about(rng, 0.0172), "phase_rad": _phase(rng)})
    put({"name": "output_shaft_ovality", "amplitude_deg": _about(rng, 2.7e-4), "phase_rad": _phase(rng)}, 0.6)
    put(_crank(rng).table, 0.7)
    for name, order in MESH:
        put(mesh(rng, name, order), 1.0 if order in (39, 40, 78, 81) else 0.6)
    for order in (39, 78):
        slopes = _flanks(rng, "slope_deg_per_kNm", "phase_rad", 8e-4)
        put({"name": "load_dependent_mesh", "order": order, **slopes}, 0.6)
    put({**_carrier(rng).table, "order": 39}, 0.4)
    put(resonance(rng), 0.4)
    put({"name": "measurement_delay", "delay_us": _about(rng, 250.0)}, 0.3)
    every = {*bars, *(bar for one in gone for bar in one.bars)}
    kept = [table for table in tables if not _clashes(table, gone, every)]
    head = {"name": "blind", **_head(rng)}
    stated = [_off(rng, table) if drifted else table for table in kept]
    return Healthy(tuple(kept), tuple(stated), head)


def _head(rng: np.random.Generator) -> dict[str, Any]:
    numbers = {"reduction_ratio": 81.0, "cycloid_teeth": 39, "pins": 40, "cranks": 3, "reference_temperature_C": 30.0}
    return {**numbers, "zero_offset_deg": float(rng.uniform(-0.03, 0.03))}


def _off(rng: np.random.Generator, table: Mapping[str, Any]) -> dict[str, Any]:
    """A table as a rig model would have it that was set up some time ago: sizes 1 to 3 % off, phases by 0.02 rad."""
    out = dict(table)
    for key, value in table.items():
        if key in ("name", "order", "orders", "frequency_Hz"):
            continue
        side = float(rng.choice([-1, 1]))
        if "phase" in key:
            shift = 0.02 * side
            out[key] = [item + shift for item in value] if isinstance(value, list) else value + shift
        else:
            factor = 1.0 + side * float(rng.uniform(0.01, 0.03))
            out[key] = [item * factor for item in value] if isinstance(value, list) else value * factor
    return out
