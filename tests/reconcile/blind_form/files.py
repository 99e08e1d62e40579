"""Files of a campaign as a rig or its users leave them, whole or broken."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .measuring import Measured
from .points import Array

HEADER = "Poisition_Output_Reducer_Fw,Transmission_Error_Fw,Position_Output_Reducer_Bw,Transmission_Error_Bw"


def curve_text(angle: Array, te: Array, comma: bool = False) -> str:
    """One curve file: forward up from the smallest angle, backward down from 360 deg; `comma`: ; and decimal commas."""
    up = np.argsort(angle[0], kind="stable")
    falling = np.where(angle[1] == 0.0, 360.0, angle[1])
    down = np.argsort(-falling, kind="stable")
    columns = np.stack([angle[0][up], te[0][up], falling[down], te[1][down]], axis=1)
    row = "%.9f,%.9f,%.9f,%.9f"
    header = HEADER
    text = "\n".join(row % tuple(values) for values in columns.tolist())
    if comma:
        text, header = text.replace(",", ";").replace(".", ","), header.replace(",", ";")
    return f"{header}\n{text}\n"


def write_curves(data: Measured, folder: Path, named: bool, comma: bool = False) -> list[str]:
    """One file a run; `named`: conditions in the file name, else `conditions.csv` with rows in order of measuring.

    Returns the names of the files, in the order of the rows.
    """
    folder.mkdir(parents=True)
    points = data.points
    conditions = list(zip(points.speed.tolist(), points.torque.tolist(), points.temperature.tolist(), strict=True))
    named = named and len(set(conditions)) == len(conditions)
    names = []
    for row, (speed, torque, oil) in enumerate(conditions):
        name = f"{speed:.1f}rpm{torque:.1f}Nm{oil:.1f}deg.csv" if named else f"run_{row + 1:04d}.csv"
        (folder / name).write_text(curve_text(data.angle, data.te[row], comma))
        names.append(name)
    if not named:
        rows = [f"{name},{s!r},{m!r},{c!r}" for name, (s, m, c) in zip(names, conditions, strict=True)]
        (folder / "conditions.csv").write_text("\n".join(["file,speed_rpm,torque_Nm,temperature_C", *rows]) + "\n")
    return names


def write_table(data: Measured, path: Path, orders: Sequence[int]) -> None:
    """A harmonic table: amplitudes and phases of these orders by least squares over the revolution."""
    path.parent.mkdir(parents=True, exist_ok=True)
    waves = [order for order in orders if order > 0]
    head = ["direction", "speed_rpm", "torque_Nm", "temperature_C", *(f"A{o}" for o in (0, *waves))]
    lines = [",".join([*head, *(f"phi{o}" for o in waves)])]
    points = data.points
    for side, name in enumerate(("forward", "backward")):
        theta = np.radians(data.angle[side])
        basis = np.concatenate([np.ones((1, len(theta))), *([np.cos(o * theta), np.sin(o * theta)] for o in waves)])
        found = np.linalg.lstsq(basis.T, data.te[:, side].T, rcond=None)[0].T
        turned = found[:, 1::2] - 1j * found[:, 2::2]
        for row in range(len(points)):
            conditions = (points.speed[row], points.torque[row], points.temperature[row])
            numbers = [*conditions, found[row, 0], *np.abs(turned[row]), *np.angle(turned[row])]
            lines.append(",".join([name, *(f"{float(number):.10g}" for number in numbers)]))
    path.write_text("\n".join(lines) + "\n")


# ------------------------------------------------------------------------------------------------ broken files

#: what is wrong with the files of a case; the truth of each is the list of files that cannot be used as they are
TROUBLES = ("bad_row", "coarse_file", "missing_file", "mixed_sampling", "empty_file", "truncated", "not_a_number")


def thinned(path: Path, keep_every: int) -> None:
    """Keep each n-th sample of a curve file."""
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, *rows[::keep_every]]) + "\n")


def spoil(random: np.random.Generator, folder: Path, names: Sequence[str], trouble: str) -> tuple[str, ...]:
    """Break files of a written campaign; returns the names of those that a report has to speak of."""
    chosen = names[int(random.integers(len(names)))]
    path = folder / chosen
    lines = path.read_text().splitlines()
    row = int(random.integers(20, len(lines) - 20))
    if trouble == "bad_row":
        lines[row] = "12.3,---,#####,1"
    elif trouble == "not_a_number":
        lines[row] = lines[row].rsplit(",", 1)[0] + ",nan"
    elif trouble == "truncated":
        lines = [*lines[: len(lines) // 3], lines[len(lines) // 3][:7]]
    elif trouble == "empty_file":
        lines = []
    elif trouble == "missing_file":
        path.unlink()
        # where the names alone say what was measured, nobody can know of it
        return (chosen,) if (folder / "conditions.csv").is_file() else ()
    elif trouble == "coarse_file":
        thinned(path, 4)
        return (chosen,)
    elif trouble == "mixed_sampling":
        for name in names:
            thinned(folder / name, int(random.integers(1, 3)))
        return ()
    else:
        raise ValueError(f"unknown trouble {trouble}")
    path.write_text("\n".join(lines) + ("\n" if lines else ""))
    return (chosen,)
