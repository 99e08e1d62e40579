"""The known part of a machine: a rig.toml, and its curves as `st-codegen simulate campaign` writes them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .points import Array, Points

ROOT = Path(__file__).resolve().parents[3]
EXAMPLE = ROOT / "examples" / "rv160n" / "rig.toml"
#: parameters of size, which differ a little between machines; the others keep the values of the example
_SIZES = ("amplitude_deg", "stiffness_Nm_per_arcmin", "arcmin", "slope_deg", "ratio")
#: one core, so that times can be compared
ONE_CORE = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
#: of motion only: they make no error at constant speed
_IN_MOTION = ("control_lag", "coupling_compliance")


@dataclass(frozen=True)
class Machine:
    """Numbers of teeth, and the effects that its rig.toml holds."""

    ratio: int
    teeth: int
    pins: int
    effects: tuple[Mapping[str, Any], ...]
    run_offset_deg: float = 0.0
    zero_offset_deg: float = -0.0174

    def without(self, *names: str, order: int | None = None) -> Machine:
        """The same machine without these effects, or without those of one order."""
        kept = [
            effect
            for effect in self.effects
            if effect["name"] not in names or (order is not None and effect.get("order") != order)
        ]
        return Machine(self.ratio, self.teeth, self.pins, tuple(kept), self.run_offset_deg, self.zero_offset_deg)

    def orders(self) -> tuple[int, ...]:
        """Orders that the known effects make, as the rig.toml lists them."""
        found = {0, 1, 2, 3}
        for effect in self.effects:
            if effect["name"] == "carrier_modulation":
                found |= {effect["order"] - 3, effect["order"] + 3}
            elif "order" in effect:
                found.add(effect["order"])
            found |= set(effect.get("orders", ()))
        return tuple(sorted(found))

    def text(self) -> str:
        """The rig.toml."""
        lines = ["[rig]", 'name = "blind_form"', f"reduction_ratio = {float(self.ratio)}"]
        lines += [f"cycloid_teeth = {self.teeth}", f"pins = {self.pins}", "cranks = 3"]
        lines += ["reference_temperature_C = 30.0", f"zero_offset_deg = {self.zero_offset_deg!r}", ""]
        lines += ["[noise]", "white_deg = 0.0001", f"run_offset_deg = {self.run_offset_deg!r}"]
        for effect in self.effects:
            lines += ["", "[[effect]]", *(f"{key} = {_toml(value)}" for key, value in effect.items())]
        return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return repr(value)


def _moved_order(order: int, ratio: int, teeth: int, pins: int) -> int:
    """The order of the example (39 teeth, 40 pins, ratio 81) that the same part makes in another gear."""
    for old, new in ((39, teeth), (40, pins), (81, ratio)):
        if order % old == 0:
            return order // old * new
    return order


def draw_machine(random: np.random.Generator, small: bool) -> Machine:
    """A machine like the example, its sizes off by some 10 %, its phases turned; `small`: another gear."""
    ratio, teeth, pins = (61, 29, 30) if small else (81, 39, 40)
    effects = []
    for table in tomllib.loads(EXAMPLE.read_text())["effect"]:
        if table["name"] in _IN_MOTION or table["name"] == "structural_resonance":
            continue
        effect = dict(table)
        for key, value in table.items():
            if key == "order":
                effect[key] = _moved_order(value, ratio, teeth, pins)
            elif "phase_rad" in key:
                effect[key] = float(np.round(value + random.uniform(-1.0, 1.0), 3))
            elif any(size in key for size in _SIZES):
                effect[key] = float(f"{value * np.exp(0.1 * random.standard_normal()):.4g}")
        effects.append(effect)
    return Machine(ratio, teeth, pins, tuple(effects))


# ------------------------------------------------------------------------------------------------ the program


def st_codegen(arguments: Sequence[str], timeout: float, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command line of this checkout in a process of its own, and end it with its workers after `timeout` s.

    Raises subprocess.TimeoutExpired.
    """
    environment = {**os.environ, **ONE_CORE, "PYTHONPATH": str(ROOT), "NO_COLOR": "1"}
    command = [sys.executable, "-m", "st_codegen", *arguments]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment, cwd=cwd,
        start_new_session=True,
    ) as process:  # fmt: skip
        try:
            out, error = process.communicate(timeout=timeout)
        except BaseException:
            # the whole session: a worker that outlives its parent would keep the pipes open
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            raise
    return subprocess.CompletedProcess(command, process.returncode, out, error)


def silent_rig(text: str) -> str:
    """The same rig without scatter from run to run, so that its simulated curves are free of noise."""
    lines = ["run_offset_deg = 0.0" if line.startswith("run_offset_deg") else line for line in text.splitlines()]
    return "\n".join(lines) + "\n"


def simulate(rig: str, points: Points, samples: int) -> Array:
    """Curves of a rig.toml free of noise, (points, 2, samples) at even angles. Raises ValueError if it is refused."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "rig.toml").write_text(silent_rig(rig))
        rows = [f"{s!r},{t!r},{c!r}" for s, t, c in zip(points.speed, points.torque, points.temperature, strict=True)]
        rows = [row.replace("np.float64(", "").replace(")", "") for row in rows]
        # one point twice: then files are numbered, not named by their conditions
        text = "\n".join(["speed_rpm,torque_Nm,temperature_C", *rows, rows[0]])
        (folder / "c.csv").write_text(text + "\n")
        options = ["--samples", str(samples), "--noise", "0", "--quiet"]
        paths = ["--rig", "rig.toml", "--conditions", "c.csv", "--out", "out"]
        done = st_codegen(["simulate", "campaign", *paths, *options], 120.0, folder)
        if done.returncode != 0:
            raise ValueError((done.stderr or done.stdout)[-800:])
        te = np.empty((len(points), 2, samples))
        for row in range(len(points)):
            text = (folder / "out" / f"run_{row + 1:05d}.csv").read_text()
            numbers = np.array(text[text.index("\n") + 1 :].replace("\n", ",").rstrip(",").split(","), dtype=np.float64)
            columns = numbers.reshape(samples, 4).T
            te[row, 0] = columns[1]
            # the backward column runs from 360 deg down
            te[row, 1] = np.concatenate([columns[3][:1], columns[3][:0:-1]])
    return te
