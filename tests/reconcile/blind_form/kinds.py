"""The kinds of cases: which machine, what its rig model lacks, and what may be said about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from . import mesh, resonance, slow, waves
from .machine import Machine
from .oscillator import Oscillator, Stribeck
from .points import Part, Points, Waves


@dataclass(frozen=True)
class Draw:
    """What a kind is drawn from: its random numbers, the machine with all known effects, the planned runs."""

    random: np.random.Generator
    machine: Machine
    points: Points

    def size(self, low: float, high: float) -> float:
        """A size, evenly in its logarithm."""
        return float(np.exp(self.random.uniform(np.log(low), np.log(high))))

    def wave(self, low: float, high: float) -> complex:
        return complex(self.size(low, high) * np.exp(1j * self.random.uniform(-np.pi, np.pi)))

    def pick(self, *values: int) -> int:
        return int(values[self.random.integers(len(values))])

    def foreign_order(self) -> int:
        """An order that no part makes: no multiple of teeth, pins or ratio, no sideband of one, no low order."""
        gear = (self.machine.teeth, self.machine.pins, self.machine.ratio)
        free = [order for order in range(9, 235) if all(min(order % part, part - order % part) > 4 for part in gear)]
        return self.pick(*free)

    def high_orders(self, count: int) -> tuple[int, ...]:
        """Orders whose frequencies pass a resonance of 30 to 50 Hz within the speeds."""
        orders = (4 * self.machine.teeth, 2 * self.machine.ratio, 6 * self.machine.pins)
        return tuple(sorted(int(order) for order in self.random.choice(orders, count, replace=False)))

    def mesh_order(self) -> tuple[int, str]:
        """A mesh order and the effect that makes it."""
        gear = self.machine
        order = self.pick(gear.teeth, 2 * gear.teeth, gear.pins, 2 * gear.pins, gear.ratio, 4 * gear.teeth)
        return order, mesh.mesh_name(order, gear.ratio, gear.teeth, gear.pins)


Drawn = tuple[Machine, tuple[Part, ...]]
Kind = Callable[[Draw], Drawn]


# ------------------------------------------------------------------------------------------------ resonances


def two_mass(draw: Draw) -> Drawn:
    """Integrated in time: mesh excitation of a load behind a spring with play, with Stribeck friction."""
    gear = draw.machine
    orders = draw.high_orders(2)
    excitation = {order: draw.wave(3e-4, 1.2e-3) for order in orders}
    friction = Stribeck(draw.size(40, 90), draw.size(100, 180), draw.size(1.5, 5.0), draw.size(0.5, 3.0))
    system = Oscillator(
        draw.random.uniform(32.0, 48.0), draw.random.uniform(0.02, 0.05), 454.0 * 60, 2.5e-3, excitation, friction
    )
    names = {mesh.mesh_name(order, gear.ratio, gear.teeth, gear.pins) for order in orders}

    def dynamic(points: Points) -> Waves:
        return system.waves(points, gear.ratio)

    part = Part(
        "two-mass oscillator with play and Stribeck friction, integrated in time",
        ("structural_resonance", "friction_windup", *sorted(names)),
        (0, *orders),
        dynamic,
        touches=("backlash", "friction_windup", "zero", *sorted(names)),
        hertz=(0.6 * system.frequency_Hz, 1.03 * system.frequency_Hz),
    )
    return gear.without("friction_windup"), (part,)


def _one_mode(draw: Draw, title: str, hertz: Callable[[Points], np.ndarray], low: float, high: float) -> Drawn:
    damping = draw.random.uniform(0.02, 0.04)
    orders = draw.high_orders(draw.pick(1, 2, 3))
    mode = resonance.Mode(hertz, resonance.constant(damping), bool(draw.random.integers(2)))
    sizes = resonance.draw_sizes(draw.random, orders, 1, damping)
    return draw.machine, (resonance.modal_part(title, (mode,), sizes, draw.machine.ratio, (low, high)),)


def resonance_drift_torque(draw: Draw) -> Drawn:
    value, share = draw.random.uniform(34.0, 48.0), draw.random.uniform(0.06, 0.14)
    hertz = resonance.falling(value, share, "torque", 0.0, 1600.0)
    return _one_mode(draw, f"{value:.1f} Hz, falls by {share:.0%} with load", hertz, value * (1 - share), value)


def resonance_drift_temperature(draw: Draw) -> Drawn:
    value, share = draw.random.uniform(34.0, 48.0), draw.random.uniform(0.05, 0.10)
    hertz = resonance.falling(value, share, "temperature", 25.0, 35.0)
    return _one_mode(draw, f"{value:.1f} Hz, falls by {share:.0%} when warm", hertz, value * (1 - share), value)


def resonance_states(draw: Draw) -> Drawn:
    value, share = draw.random.uniform(34.0, 48.0), draw.random.uniform(0.05, 0.10)
    hertz = resonance.states(value, value * (1 - share), 27.5)
    return _one_mode(draw, f"{value:.1f} Hz cold, {value * (1 - share):.1f} Hz warm", hertz, value * (1 - share), value)


def resonance_plain(draw: Draw) -> Drawn:
    value = draw.random.uniform(34.0, 48.0)
    return _one_mode(draw, f"one mode of {value:.1f} Hz", resonance.constant(value), value, value)


def resonance_split(draw: Draw) -> Drawn:
    value, apart = draw.random.uniform(34.0, 44.0), draw.random.uniform(0.06, 0.12)
    damping = draw.random.uniform(0.02, 0.035)
    hertz = (value, value * (1 + apart))
    modes = tuple(resonance.Mode(resonance.constant(one), resonance.constant(damping), True) for one in hertz)
    sizes = resonance.draw_sizes(draw.random, draw.high_orders(2), 2, damping)
    title = f"two modes of {hertz[0]:.1f} and {hertz[1]:.1f} Hz"
    return draw.machine, (resonance.modal_part(title, modes, sizes, draw.machine.ratio, hertz),)


# ------------------------------------------------------------------------------------------------ mesh orders


def _loaded_mesh(draw: Draw, law: mesh.Law, title: str) -> Drawn:
    order, name = draw.mesh_order()
    known = draw.machine.without("load_dependent_mesh", order=order)
    names = ("load_dependent_mesh", name)
    size = draw.wave(6e-4, 3e-3)
    backward = size * complex(draw.random.uniform(0.7, 1.2)) * np.exp(1j * draw.random.uniform(-1, 1))
    # sidebands of the rig keep their size, so that their ratio to what is now their mesh order truly is another
    touches = (name, "carrier_modulation")
    part = mesh.wave_part(f"order {order} {title}", names, order, law, size, complex(backward), touches=touches)
    return known, (part,)


def mesh_two_thirds(draw: Draw) -> Drawn:
    return _loaded_mesh(draw, mesh.power(2.0 / 3.0), "grows with the torque to the power 2/3")


def mesh_square(draw: Draw) -> Drawn:
    return _loaded_mesh(draw, mesh.power(2.0), "grows with the square of the torque")


def mesh_saturating(draw: Draw) -> Drawn:
    return _loaded_mesh(draw, mesh.saturating(draw.random.uniform(250, 600)), "saturates with the torque")


def plain_wave(draw: Draw) -> Drawn:
    """A constant wave that a part does make; the rig model lacks it. The control: any catalogue has it."""
    gear = draw.machine
    order, name = (
        (2, "output_shaft_ovality"),
        (2 * gear.pins, "pin_error"),
        (3 * gear.pins, "pin_error"),
        (gear.ratio, "input_shaft_misalignment"),
    )[draw.pick(0, 1, 2, 3)]
    known = gear.without(name, order=None if order == 2 else order)
    part = mesh.wave_part(f"order {order}, constant", (name,), order, mesh.one(), draw.wave(3e-4, 2e-3))
    return known, (part,)


def one_direction(draw: Draw) -> Drawn:
    gear = draw.machine
    order = draw.pick(3 * gear.teeth, 3 * gear.pins, 5 * gear.teeth)
    name = mesh.mesh_name(order, gear.ratio, gear.teeth, gear.pins)
    sizes = [draw.wave(5e-4, 3e-3), 0j]
    if draw.random.integers(2):
        sizes.reverse()
    part = mesh.wave_part(f"order {order} in one direction only", (name,), order, mesh.one(), *sizes)
    return gear.without(name, order=order), (part,)


def wear_step(draw: Draw) -> Drawn:
    order, name = draw.mesh_order()
    law = mesh.step(draw.random.uniform(0.35, 0.65), draw.random.uniform(2.0, 4.0))

    def grown(points: Points) -> np.ndarray:
        return law(points) - 1.0

    title = f"order {order} grows by a step in mid-campaign"
    touches = (name, "carrier_modulation")
    part = mesh.wave_part(title, ("wear", name), order, grown, draw.wave(4e-4, 2e-3), touches=touches, in_time=True)
    return draw.machine, (part,)


def exchange(draw: Draw) -> Drawn:
    """A coupling mounted anew in mid-campaign: the once-a-turn error has another size and phase from then on."""
    names = ("output_shaft_eccentricity", "encoder_eccentricity")
    at = draw.random.uniform(0.35, 0.65)
    part = mesh.exchange_part(
        "order 1 of another size and phase after a coupling was mounted anew",
        names, 1, at, 0j, draw.wave(2e-3, 1e-2),
    )  # fmt: skip
    return draw.machine, (replace(part, touches=names),)


# ------------------------------------------------------------------------------------------------ modulations, waves


def constant_sidebands(draw: Draw) -> Drawn:
    """Sidebands of +-3 that keep their size while the mesh order between them grows with the load."""
    order = draw.pick(draw.machine.teeth, 2 * draw.machine.ratio, 6 * draw.machine.pins)
    known = draw.machine.without("carrier_modulation", order=order)
    sizes = (draw.wave(4e-4, 3e-3), draw.wave(2e-4, 2e-3))
    title = f"sidebands of +-3 around order {order}, of constant size"
    return known, (waves.sideband_part(title, ("carrier_modulation",), order, 3, *sizes, mesh.one()),)


def runout_sidebands(draw: Draw) -> Drawn:
    """Lines at +-1: a mesh order modulated once a turn of the output."""
    order = draw.pick(2, 4) * draw.machine.teeth
    law = mesh.power(draw.random.uniform(0.3, 1.0))
    sizes = (draw.wave(3e-4, 2e-3), draw.wave(3e-4, 2e-3))
    return draw.machine, (waves.sideband_part(f"sidebands of +-1 around order {order}", (), order, 1, *sizes, law),)


def foreign(draw: Draw) -> Drawn:
    order = draw.foreign_order()
    part = mesh.wave_part(f"order {order}, which no part makes", (), order, mesh.one(), draw.wave(2e-4, 3e-3))
    return draw.machine, (part,)


def foreign_square(draw: Draw) -> Drawn:
    order = draw.foreign_order()
    title = f"order {order}, which no part makes, grows with the square of the torque"
    return draw.machine, (mesh.wave_part(title, (), order, mesh.power(2.0), draw.wave(2e-4, 3e-3)),)


def foreign_multiple(draw: Draw) -> Drawn:
    """From outside of the gear, yet its order is a multiple of the teeth: nothing in the data speaks for teeth."""
    gear = draw.machine
    order = draw.pick(3 * gear.teeth, 5 * gear.teeth, 5 * gear.pins)
    name = mesh.mesh_name(order, gear.ratio, gear.teeth, gear.pins)
    part = mesh.wave_part(f"order {order} from outside of the gear", (), order, mesh.one(), draw.wave(3e-4, 3e-3))
    return gear, (replace(part, hedged=(name,)),)


def foreign_loose(draw: Draw) -> Drawn:
    """The order of a multiple of the teeth, but its phase is another in each run: it cannot be teeth."""
    gear = draw.machine
    order = draw.pick(3 * gear.teeth, 5 * gear.teeth, 5 * gear.pins)
    seed = int(draw.random.integers(2**31))
    return gear, (waves.loose_part(f"order {order}, not locked to the output", order, draw.size(4e-4, 3e-3), seed),)


def mains(draw: Draw) -> Drawn:
    seed = int(draw.random.integers(2**31))
    part = waves.mains_part(float(draw.pick(50, 100)), draw.size(5e-4, 3e-3), draw.machine.ratio, seed)
    return draw.machine, (part,)


# ------------------------------------------------------------------------------------------------ the mean


def linear_spring(draw: Draw) -> Drawn:
    stiffness = draw.random.uniform(250.0, 700.0)
    part = slow.mean_part("spring", ("torsional_compliance", "hanging_load_compliance"), slow.linear_spring(stiffness))
    return draw.machine.without("torsional_compliance"), (part,)


def hertz_spring(draw: Draw) -> Drawn:
    value = slow.hertz_spring(draw.random.uniform(0.03, 0.09), 1600.0)
    part = slow.mean_part(
        "spring of Hertzian contact, power 2/3", ("torsional_compliance", "hanging_load_compliance"), value
    )
    return draw.machine.without("torsional_compliance"), (part,)


def stepped_spring(draw: Draw) -> Drawn:
    first = draw.random.uniform(200.0, 320.0)
    stiffness = (first, first * draw.random.uniform(1.3, 1.8), first * draw.random.uniform(2.0, 2.8))
    value = slow.stepped_spring(stiffness, (draw.random.uniform(200, 400), draw.random.uniform(600, 1000)))
    part = slow.mean_part("stiffness in three steps", ("torsional_compliance", "hanging_load_compliance"), value)
    return draw.machine.without("torsional_compliance"), (part,)


def stribeck(draw: Draw) -> Drawn:
    friction = Stribeck(draw.size(60, 150), draw.size(160, 350), draw.size(2.0, 7.0), draw.size(1.0, 8.0))
    value = slow.stribeck_windup(friction, 454.0, draw.machine.ratio)
    part = slow.mean_part("wind-up by Stribeck friction", ("friction_windup",), value, signed=True)
    return draw.machine.without("friction_windup"), (part,)


def play(draw: Draw) -> Drawn:
    value = slow.shifted_by(draw.size(2e-3, 1e-2), draw.random.uniform(60.0, 300.0))
    # its part without load has the form of dry friction to the last digit: which of the two moved no data can tell
    touches = ("friction_windup",)
    part = slow.mean_part("play that load takes up gradually", ("backlash",), value, signed=True, touches=touches)
    return draw.machine.without("backlash"), (part,)


def thermal_lag(draw: Draw) -> Drawn:
    lag = draw.size(0.02, 0.25)
    value = slow.thermal_lag(draw.points, draw.size(1e-4, 6e-4), lag)
    title = f"drift with a body that follows the oil with a lag of {lag:.2f} campaigns"
    part = slow.mean_part(title, ("thermal_drift",), value, touches=("zero",), in_time=True)
    return draw.machine.without("thermal_drift"), (part,)


def zero_creep(draw: Draw) -> Drawn:
    value = slow.creep(draw.size(2e-3, 1e-2), draw.random.uniform(0.15, 0.6))
    part = slow.mean_part("a mount that settles", (), value, touches=("zero",), in_time=True)
    return draw.machine, (part,)


def nothing(draw: Draw) -> Drawn:
    return draw.machine, ()


def one_temperature(draw: Draw) -> Drawn:
    """Drift with temperature was left out, and the oil never had another temperature: the data cannot show it."""
    return draw.machine.without("thermal_drift"), ()


def two_hidden(draw: Draw) -> Drawn:
    """Two of the others at once, on different orders."""
    pairs = (
        (hertz_spring, foreign_square),
        (resonance_drift_torque, stribeck),
        (constant_sidebands, thermal_lag),
        (foreign, resonance_split),
    )
    first, second = pairs[draw.pick(0, 1, 2, 3)]
    known, parts = first(draw)
    kept, more = second(Draw(draw.random, known, draw.points))
    return kept, (*parts, *more)


#: effects of the rig whose waves what stands in all orders truly changes
_WAVES = (
    "cycloid_tooth_error", "pin_error", "input_shaft_misalignment", "crank_misalignment", "output_shaft_eccentricity",
    "output_shaft_ovality", "encoder_eccentricity", "load_dependent_mesh", "carrier_modulation", "zero",
)  # fmt: skip


def spall(draw: Draw) -> Drawn:
    at = draw.random.uniform(0.0, 360.0)
    return draw.machine, (waves.spall_part(-draw.size(1e-3, 8e-3), draw.random.uniform(2.0, 6.0), at, _WAVES),)


def crack(draw: Draw) -> Drawn:
    order, _ = draw.mesh_order()
    law = mesh.power(draw.random.uniform(0.3, 1.0))
    width, at = draw.random.uniform(10.0, 25.0), draw.random.uniform(0.0, 360.0)
    return draw.machine, (waves.crack_part(order, draw.wave(1e-3, 6e-3), width, at, law, _WAVES),)


def texture(draw: Draw) -> Drawn:
    """Each order of it on one of teeth or pins may be called theirs, if that is said to be by its order alone."""
    seed = int(draw.random.integers(2**31))
    return draw.machine, (waves.texture_part(draw.size(3e-4, 3e-3), seed, _WAVES, _WAVES),)


#: in the order of the list of cases
KINDS: dict[str, Kind] = {
    kind.__name__: kind
    for kind in (
        constant_sidebands, foreign_multiple, resonance_drift_torque, linear_spring, exchange, mesh_square,
        foreign_square, two_mass, nothing, stribeck, hertz_spring, foreign_loose, resonance_split, wear_step,
        thermal_lag, one_direction, mesh_two_thirds, plain_wave, resonance_states, foreign, mains, mesh_saturating,
        stepped_spring, play, zero_creep, runout_sidebands, resonance_drift_temperature, resonance_plain,
        one_temperature, two_hidden, spall, crack, texture,
    )
}  # fmt: skip
#: those that came later, see cases.LONG_PASS
LATER = ("spall", "crack", "texture")
#: resonances need many speeds
MANY_SPEEDS = frozenset(name for name in KINDS if name.startswith("resonance") or name in ("two_mass", "two_hidden"))
