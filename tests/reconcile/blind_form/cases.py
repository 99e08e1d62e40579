"""The list of cases: each kind of physics, each mistake of measuring, two at once, broken files, nothing at all.

The list goes in passes. A pass has every kind once; three passes that follow each other share machine, hidden physics
and runs and differ in noise alone, so that better data can be compared with worse.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from . import kinds, measuring
from .files import TROUBLES
from .kinds import KINDS
from .measuring import MISTAKES, NOISES

FIRST_SEED = {"dev": 0, "heldout": 1_000_000}
#: levels of noise of three passes, in noises of 1e-4 deg
LEVELS = ((0.1, 1.0, 10.0), (1.0, 10.0, 100.0), (0.3, 3.0, 30.0))
#: mistakes alone, two at once, and over hidden physics: (kind, mistakes)
MEASURED: tuple[tuple[str, tuple[str, ...]], ...] = (
    *(("nothing", (name,)) for name in MISTAKES if name not in measuring.LATER),
    ("nothing", ("home_offset", "sign")),
    ("nothing", ("arcsec", "direction")),
    ("nothing", ("column_scale", "labels")),
    ("foreign_square", ("home_offset",)),
    ("resonance_plain", ("labels",)),
    ("hertz_spring", ("direction",)),
)
#: order of one pass
PASS: tuple[tuple[str, tuple[str, ...], str], ...] = (
    *((kind, (), "") for kind in KINDS if kind not in kinds.LATER),
    *((kind, mistakes, "") for kind, mistakes in MEASURED),
    *(("plain_wave", (), trouble) for trouble in TROUBLES),
    *(("nothing", (), "") for _ in range(3)),
)
#: what came later is in the passes from that number on: the numbers before keep their cases
LONG_PASS = (
    *PASS,
    *((kind, (), "") for kind in kinds.LATER),
    *(("nothing", (name,), "") for name in measuring.LATER),
    ("foreign_square", ("eccentric_angle",), ""),
    ("linear_spring", ("own_zeros",), ""),
)
FIRST_LONG = 33 * len(PASS)
#: nine passes: each machine at three levels of noise, three times
HELD_OUT_CASES = 9 * len(PASS)


@dataclass(frozen=True)
class Case:
    """`seed` fixes machine, runs and hidden physics; `noise` the level, in noises of 1e-4 deg."""

    name: str
    kind: str
    mistakes: tuple[str, ...]
    trouble: str
    seed: int
    level: int
    noise: float
    noise_form: str
    layout: str
    form: str
    small: bool

    @property
    def label(self) -> str:
        """The row of the table that this case counts in."""
        if self.trouble:
            return f"file: {self.trouble}"
        if self.mistakes:
            return " + ".join(self.mistakes) + ("" if self.kind == "nothing" else f" over {self.kind}")
        return self.kind

    @property
    def number(self) -> str:
        """The name without what is hidden."""
        return "-".join(self.name.split("-")[:2])

    def plain(self) -> dict[str, Any]:
        return asdict(self) | {"mistakes": list(self.mistakes), "label": self.label}


def listed(seeds: str, count: int, first: int = 0) -> list[Case]:
    """Cases number `first` to `first + count - 1` of the list."""
    return [_case(seeds, number) for number in range(first, first + count)]


def _case(seeds: str, number: int) -> Case:
    turn, place = divmod(number, len(PASS))
    kind, mistakes, trouble = PASS[place]
    if number >= FIRST_LONG:
        turn, place = divmod(number - FIRST_LONG, len(LONG_PASS))
        turn, (kind, mistakes, trouble) = turn + FIRST_LONG // len(PASS), LONG_PASS[place]
    group = turn // 3
    level = (turn + place) % 3
    seed = FIRST_SEED[seeds] + group * 1000 + place
    random = np.random.default_rng([seed, 7])
    layouts, shares = ("grid", "scattered", "twelve"), (0.5, 0.35, 0.15)
    if mistakes or trouble:
        shares = (0.6, 0.4, 0.0)
    layout = str(random.choice(layouts, p=shares))
    noise_form = str(random.choice(list(NOISES), p=(0.55, 0.15, 0.15, 0.15)))
    table = random.uniform() < 0.2
    named, comma = random.uniform() < 0.3, random.uniform() < 0.1
    form = "table" if table and not mistakes and not trouble else "named" if named else "numbered"
    if kind == "mains" and form == "table":
        form = "numbered"  # its order is no order of a table
    if form == "numbered" and comma and not trouble:
        form = "comma"
    name = f"{seeds}-{number:04d}-" + "-".join(filter(None, (kind, *mistakes, trouble)))
    small = bool(random.uniform() < 0.25)
    noise = LEVELS[(group + place // 3) % 3][level]
    return Case(name, kind, mistakes, trouble, seed, level, noise, noise_form, layout, form, small)
