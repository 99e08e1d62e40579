"""The list of cases, the same for everybody: what is hidden, how large, in which files, with which noise.

Case i of a list has the seed FIRST_SEED + i, and everything random about it comes from that seed. Development seeds are
there to be looked at; held-out seeds are for the numbers that are published, and nobody tunes anything on them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from . import foreign, hidden, layout, noise

FIRST_SEED = {"dev": 0, "heldout": 10000}
LAST_SEED = {"dev": 9999, "heldout": 19999}

CURVES_ONLY = tuple(name for name, kind in foreign.KINDS.items() if kind.curve is not None)
TABLES = tuple(name for name in foreign.KINDS if name not in CURVES_ONLY)
IN_TIME = ("control_lag", "coupling_compliance")
#: hidden one at a time; `encoder_eccentricity` can never be told from the output shaft's: see CONFOUNDED
SINGLES = tuple(name for name in hidden.MAKERS if name not in (*IN_TIME, "encoder_eccentricity"))
PAIRS = (
    ("torsional_compliance", "backlash"),
    ("cycloid_tooth_error", "load_dependent_mesh"),
    ("structural_resonance", "measurement_delay"),
    ("wear", "crank_misalignment"),
    ("thermal_drift", "friction_windup"),
    ("carrier_modulation", "pin_error"),
    ("output_shaft_eccentricity", "output_shaft_ovality"),
    ("structural_resonance", "pin_error"),
    ("input_shaft_misalignment", "measurement_delay"),
    ("thermal_drift", "torsional_compliance"),
    ("wear", "backlash"),
    ("load_dependent_mesh", "carrier_modulation"),
    ("crank_misalignment", "output_shaft_eccentricity"),
    ("friction_windup", "structural_resonance"),
)
#: name -> (hidden effect, names that these data cannot tell apart)
CONFOUNDED = {
    "order_1_of_encoder": ("encoder_eccentricity", ("encoder_eccentricity", "output_shaft_eccentricity")),
    "order_1_of_shaft": ("output_shaft_eccentricity", ("encoder_eccentricity", "output_shaft_eccentricity")),
    "backlash_far_from_no_load": ("backlash", ("backlash", "friction_windup")),
    "dry_friction_far_from_no_load": ("friction_windup", ("backlash", "friction_windup")),
    "backlash_below_seating": ("backlash", ("backlash", "torsional_compliance")),
    "compliance_below_seating": ("torsional_compliance", ("backlash", "torsional_compliance")),
    "skew_at_one_temperature": ("measurement_delay", ("measurement_delay", "friction_windup")),
    "viscous_at_one_temperature": ("friction_windup", ("measurement_delay", "friction_windup")),
}
SIZES = (3.0, 10.0)
#: a weak effect: what somebody who knew its exact shape would see of it, in standard errors of its size
WEAK_SIGMAS = 0.7


@dataclass(frozen=True)
class Case:
    """One case; `size` in noises (for `weak` in standard errors of the effect's size), `effects` what is hidden."""

    name: str
    seed: int
    kind: str
    effects: tuple[str, ...]
    size: float
    format: str
    layout: str
    noise: str
    corrupt: bool = False
    drifted: bool = False
    variant: str = ""

    def plain(self) -> dict[str, Any]:
        """As JSON has it."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}


@dataclass(frozen=True)
class Slot:
    """A place in a round of cases: what is fixed about it whatever the seed."""

    kind: str
    effects: tuple[str, ...] = ()
    size: float = 0.0
    format: str = ""
    variant: str = ""
    drifted: bool | None = None


def _slots() -> tuple[Slot, ...]:
    """One round, the kinds mixed so that every part of the list has some of each."""
    kinds = [
        [Slot("single", (name,), size) for size in SIZES for name in SINGLES],
        [Slot("single", (name,), size, "recording") for size in SIZES for name in (*IN_TIME, "torsional_compliance")],
        [Slot("pair", pair, SIZES[place % 2]) for place, pair in enumerate(PAIRS)],
        [Slot("none", drifted=place % 3 == 2, format="recording" if place == 7 else "") for place in range(30)],
        [Slot("foreign", (), 10.0, "curves" if name in CURVES_ONLY else "", name) for name in foreign.KINDS],
        [
            Slot("foreign", ("torsional_compliance",), 10.0, "", TABLES[0]),
            Slot("foreign", ("pin_error",), 10.0, "", TABLES[5]),
        ],
        [Slot("weak", (name,), WEAK_SIGMAS) for name in SINGLES[::2] + SINGLES[1::2]],
        [Slot("confounded", (effect,), 10.0, "table", name) for name, (effect, _) in CONFOUNDED.items()],
    ]
    placed = [
        ((place + 0.5) / len(slots), number, slot)
        for number, slots in enumerate(kinds)
        for place, slot in enumerate(slots)
    ]
    return tuple(slot for _, _, slot in sorted(placed, key=lambda entry: entry[:2]))


SLOTS = _slots()
#: cases of a round
ROUND = len(SLOTS)


def _effects_text(slot: Slot) -> str:
    return "+".join((*slot.effects, *((slot.variant,) if slot.variant else ()))) or "nothing"


def case(split: str, index: int) -> Case:
    """Case `index` of the list for `split`."""
    seed = FIRST_SEED[split] + index
    if index < 0 or seed > LAST_SEED[split]:
        raise ValueError(f"seeds of {split} go from {FIRST_SEED[split]} to {LAST_SEED[split]}")
    slot = SLOTS[index % ROUND]
    rng = np.random.default_rng([seed, 1])
    form = slot.format or ("curves" if rng.random() < 0.22 else "table")
    plan = str(rng.choice(list(layout.LAYOUTS)))
    model = str(rng.choice(noise.MODELS))
    corrupt = bool(rng.random() < 0.15) and form != "recording" and slot.kind in ("single", "none")
    drifted = bool(rng.random() < 0.15) and slot.kind == "single" if slot.drifted is None else slot.drifted
    size = f"-{slot.size:g}x" if slot.kind in ("single", "pair") else ""
    name = f"{seed:05d}-{slot.kind}-{_effects_text(slot)}{size}"
    return Case(name, seed, slot.kind, slot.effects, slot.size, form, plan, model, corrupt, drifted, slot.variant)


def listed(split: str, count: int, first: int = 0) -> Sequence[Case]:
    """`count` cases of the list for `split`, from number `first` on."""
    return [case(split, index) for index in range(first, first + count)]
