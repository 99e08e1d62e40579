"""The files of a case: rig.toml, harmonic table, curve files, recordings in time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .layout import Conditions

DIRECTIONS = ("forward", "backward")
CURVE_HEADER = "Poisition_Output_Reducer_Fw,Transmission_Error_Fw,Position_Output_Reducer_Bw,Transmission_Error_Bw"


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list | tuple | np.ndarray):
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    if isinstance(value, int | np.integer):
        return str(int(value))
    return repr(float(value))


def rig(path: Path, head: Mapping[str, Mapping[str, Any]], effects: Sequence[Mapping[str, Any]]) -> None:
    """`rig.toml`: tables of `head`, then an [[effect]] for each of `effects`."""
    lines = []
    for table, values in head.items():
        lines += [f"[{table}]", *(f"{key} = {_toml(value)}" for key, value in values.items()), ""]
    for effect in effects:
        lines += ["[[effect]]", *(f"{key} = {_toml(value)}" for key, value in effect.items()), ""]
    path.write_text("\n".join(lines), encoding="utf-8")


def harmonic_table(
    path: Path,
    runs: Conditions,
    orders: Sequence[int],
    coefficients: np.ndarray,
    directions: Sequence[str] = DIRECTIONS,
) -> None:
    """One CSV: A_k >= 0 and phi_k of complex `coefficients`, shape (orders, directions, runs); A0 keeps its sign.

    The runs stand in the order of time, each direction after the other as on the rig; with one direction (forward) the
    column is left out.
    """
    named = len(directions) > 1
    phases = [order for order in orders if order != 0]
    header = (["direction"] if named else []) + ["speed_rpm", "torque_Nm", "temperature_C"]
    header += [f"A{order}" for order in orders] + [f"phi{order}" for order in phases]
    lines = [",".join(header)]
    size, angle = np.abs(coefficients), np.angle(coefficients)
    for place, order in enumerate(orders):
        if order == 0:
            size[place] = coefficients[place].real
    for side, direction in enumerate(directions):
        for run in range(len(runs)):
            row = [direction] if named else []
            row += [f"{runs.speed_rpm[run]:g}", f"{runs.torque_Nm[run]:g}", f"{runs.temperature_C[run]:g}"]
            row += [f"{value:.9g}" for value in size[:, side, run]]
            row += [f"{angle[place, side, run]:.9g}" for place, order in enumerate(orders) if order != 0]
            lines.append(",".join(row))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def curves(folder: Path, runs: Conditions, te_deg: np.ndarray, names_in_file: bool) -> list[str]:
    """Curve files, TE of shape (2, runs, samples) over 0 <= theta < 360 deg; backward rows run from 360 down to 0.

    Conditions are in the names of the files, or in `conditions.csv`. Returns the names of the files.
    """
    folder.mkdir(parents=True, exist_ok=True)
    samples = te_deg.shape[2]
    theta = np.arange(samples) * (360.0 / samples)
    names = []
    for run in range(len(runs)):
        speed, torque, heat = runs.speed_rpm[run], runs.torque_Nm[run], runs.temperature_C[run]
        name = f"{speed:.1f}rpm{torque:.1f}Nm{heat:.1f}deg.csv" if names_in_file else f"run_{run:04d}.csv"
        # backward the same angles from 360 down: 360 itself is the value at 0
        table = np.column_stack((theta, te_deg[0, run], 360.0 - theta, np.roll(te_deg[1, run][::-1], 1)))
        with (folder / name).open("w", encoding="utf-8") as file:
            file.write(CURVE_HEADER + "\n")
            np.savetxt(file, table, fmt="%.9g", delimiter=",")
        names.append(name)
    if not names_in_file:
        lines = ["file,speed_rpm,torque_Nm,temperature_C"]
        columns = (names, runs.speed_rpm, runs.torque_Nm, runs.temperature_C)
        lines += [f"{name},{speed:g},{torque:g},{heat:g}" for name, speed, torque, heat in zip(*columns, strict=True)]
        (folder / "conditions.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return names


def recording(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """One recording in time: named columns of equal length."""
    with path.open("w", encoding="utf-8") as file:
        file.write(",".join(columns) + "\n")
        np.savetxt(file, np.column_stack(list(columns.values())), fmt="%.10g", delimiter=",")
