"""Fits a profile to times that were measured on the controller.

Two factors are found, `compute` and `memory`, so that

    measured = compute * (cycles of operations) + memory * (waiting for lines of memory)

with the smallest sum of squared relative errors. Relative, since blocks of 1 us and of 100 us count alike. The model
gives the worst path, so measure with inputs that take it, or the longest of many calls.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from st_codegen.cost.profile import LARGEST_FACTOR, SMALLEST_FACTOR, Profile
from st_codegen.cost.report import project_cost
from st_codegen.errors import InputError, Problems, at_most, counted, meant
from st_codegen.files.csv_tables import RowError, read_csv
from st_codegen.files.toml_text import toml_value
from st_codegen.st.tree import Project

#: Times that a call can have, us: from a cycle or two to a quarter of an hour.
_SHORTEST_US, _LONGEST_US = 1e-3, 1e9

#: Beyond this factor a controller is hardly the profile's, but its times in ns or ms.
_USUAL_FACTOR = 100.0


@dataclass(frozen=True)
class Measurement:
    """The time of one call of a block in us, with warm or with cold caches."""

    block: str
    is_cold: bool
    microseconds: float


@dataclass(frozen=True)
class Calibration:
    """The factors, and for each measurement what the fitted model gives in us.

    longest: how many times as long as that a measured time is at most; 1 where none is longer.
    """

    compute: float
    memory: float
    modelled: tuple[float, ...]
    is_memory_known: bool
    longest: float = 1.0

    def remarks(self, measurements: Sequence[Measurement]) -> list[str]:
        """What a user of the profile has to know of it."""
        found = []
        if not self.is_memory_known:
            what = "one factor for both" if self.memory == self.compute else "memory keeps the factor 1"
            found.append(
                f"these times do not tell computing from waiting for memory, or no two factors fit ({what}): measure "
                "the longest calls of the same blocks with warm and with cold caches"
            )
        if not 1.0 / _USUAL_FACTOR <= self.compute <= _USUAL_FACTOR:
            found.append(f"the times are {self.compute:.3g} times those of the profile: are they in us?")
        if self.longest > 1.0:
            longer = sum(m.microseconds > t for m, t in zip(measurements, self.modelled, strict=True))
            found.append(
                f"longer than the model gives: {longer} of {counted(len(measurements), 'measured time')}, by up to "
                f"{at_most(100.0 * (self.longest - 1.0), 3)} %: a worst case by this profile is no bound, so divide a "
                f"budget by {at_most(self.longest, 4)} at least"
            )
        return found


def read_measurements(path: Path) -> tuple[Measurement, ...]:
    """A CSV with the columns `block,caches,us`, caches being `warm` or `cold`. Raises InputError with all problems."""
    problems = Problems(str(path))
    table = read_csv(path, ("block", "caches", "us"))
    found = []
    for row in table.rows:
        with problems.collect():
            time, caches = table.number(row, "us"), table.text(row, "caches")
            if not _SHORTEST_US <= time <= _LONGEST_US:
                raise RowError(row.line, f"us: {time:g} is not in {_SHORTEST_US:g} .. {_LONGEST_US:g}")
            if caches not in ("warm", "cold"):
                raise RowError(row.line, f"caches must be warm or cold, not {caches!r}")
            found.append(Measurement(table.text(row, "block"), caches == "cold", time))
    if not table.rows:
        problems.add("no rows; give one for each measured call")
    problems.raise_if_any()
    return tuple(found)


def calibrate(project: Project, profile: Profile, measurements: tuple[Measurement, ...]) -> Calibration:
    """The factors that bring the model nearest to the measurements.

    Where these cannot tell the two apart (a single one, or none that waits for memory), `memory` stays 1. Raises
    InputError for blocks that the project does not have, or whose loops have no known bound, and for factors that no
    profile takes.
    """
    whole = project_cost(project, replace(profile, compute_factor=1.0, memory_factor=1.0))
    computing = project_cost(project, replace(profile, compute_factor=1.0, memory_factor=0.0))
    problems = Problems("measured times")
    parts = []
    for measurement in measurements:
        block = next((name for name in whole.blocks if name.upper() == measurement.block.upper()), None)
        if block is None:
            near = meant(measurement.block, whole.blocks)
            problems.add(f"no block '{measurement.block}' in the generated text{near}")
        elif not whole.blocks[block].is_bounded:
            problems.add(f"block '{block}' has no known worst case: {whole.blocks[block].unbounded[0]}")
        else:
            side = "cold_us" if measurement.is_cold else "warm_us"
            compute = getattr(computing.blocks[block], side)
            parts.append((compute, getattr(whole.blocks[block], side) - compute))
    problems.raise_if_any()
    modelled = np.array(parts)
    measured = np.array([measurement.microseconds for measurement in measurements])
    compute, memory, is_memory_known = _factors(modelled / measured[:, None])
    if not all(SMALLEST_FACTOR <= factor <= LARGEST_FACTOR for factor in (compute, memory)):
        raise InputError(
            f"the measured times are {compute:.3g} times those of the model; a profile takes {SMALLEST_FACTOR:g} .. "
            f"{LARGEST_FACTOR:g}: are they in us, and of these blocks?"
        )
    fitted = modelled @ np.array([compute, memory])
    longest = float((measured / fitted).max())
    longest = longest if longest >= 1.0005 else 1.0  # less is not seen in a tenth of a percent
    return Calibration(compute, memory, tuple(float(value) for value in fitted), is_memory_known, longest)


def _factors(relative: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> tuple[float, float, bool]:
    """Least squares for `relative @ factors = 1`, both factors above 0."""
    ones = np.ones(len(relative))
    if np.linalg.matrix_rank(relative) == 2:
        compute, memory = (float(value) for value in np.linalg.lstsq(relative, ones, rcond=None)[0])
        if compute > 0.0 and memory > 0.0:
            return compute, memory, True
    left = relative[:, 0]
    rest = ones - relative[:, 1]
    compute = float(left @ rest / (left @ left))
    if compute <= 0.0:  # the memory model alone is too slow: scale both alike
        both = relative.sum(axis=1)
        common = float(both @ ones / (both @ both))
        return common, common, False
    return compute, 1.0, False


def with_factors(profile: Profile, fit: Calibration, name: str) -> str:
    """The text of a profile with other factors, all comments kept."""
    factors = {
        "compute": f"{fit.compute:.6g}", "memory": f"{fit.memory:.6g}", "longest": at_most(fit.longest, 4)
    }  # fmt: skip
    text = re.sub(r"(?m)^name\s*=.*$", lambda _: f"name = {toml_value(name)}", profile.text, count=1)
    head, mark, tail = text.partition("[factors]")
    if not mark:
        return f"{text.rstrip()}\n\n[factors]\n" + "".join(f"{key} = {value}\n" for key, value in factors.items())
    for key, value in factors.items():
        tail, number = re.subn(rf"(?m)^{key}\s*=.*$", f"{key} = {value}", tail, count=1)
        if not number:
            tail = f"\n{key} = {value}{tail}"
    return head + mark + tail
