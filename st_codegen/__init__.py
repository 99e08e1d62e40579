"""Compiles trained models to IEC 61131-3 Structured Text and proves that the code computes the same numbers.

>>> import st_codegen
>>> bundle = st_codegen.load("models")
>>> st_codegen.generate(bundle, "twincat", "generated")
>>> st_codegen.verify(bundle, "generated").passed
True
>>> st_codegen.diff("generated of yesterday", "generated").changed
True
>>> st_codegen.simulate(bundle, "rig.toml", "cycloidal").outcomes
>>> st_codegen.reconcile("rig.toml", "campaign").new_rig
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

__version__ = "0.1.0"

# these enter what they bring into the tables below them: a target, a purpose, kinds of files
import st_codegen.beckhoff_ml

# the package, before the function of the same name is defined: its later modules do not take the name back
import st_codegen.reconcile
import st_codegen.te  # noqa: F401
from st_codegen.driver import generate
from st_codegen.project.bundle import Bundle, load
from st_codegen.proof.review import diff
from st_codegen.proof.verify import verify

if TYPE_CHECKING:
    from st_codegen.reconcile.run import Result
    from st_codegen.rig.motion_files import Study

__all__ = ["diff", "generate", "load", "reconcile", "simulate", "verify"]


def simulate(bundle: Bundle, rig: Path | str, profile: str = "cycloidal", *, seed: int = 0) -> Study:
    """Move the axis of a rig.toml with the bundle's generated text in its loop, and once without.

    `profile`: `cycloidal`, `robot` or a CSV file. Each law and each form of the tasks with all orders; for fewer, or
    other inputs, see `st_codegen.rig.study`. Raises InputError, MissingExtraError (the extra `rig`).
    """
    from st_codegen.rig.effects import catalogue
    from st_codegen.rig.machine import read_machine
    from st_codegen.rig.study import Wish, parse_orders
    from st_codegen.rig.study import simulate as simulate_machine

    _, machine = read_machine(Path(rig), catalogue(()))
    return simulate_machine(machine, bundle, profile, Wish(parse_orders((), bundle)), seed=seed)


def reconcile(rig: Path | str, measured: Path | str) -> Result:
    """Find the effects that a rig.toml lacks in measured data: a campaign folder, a harmonic table or recordings.

    Raises InputError for data that cannot be compared with the rig, MissingExtraError (the extra `rig`).
    """
    from st_codegen.reconcile.run import reconcile_files
    from st_codegen.rig.effects import catalogue
    from st_codegen.rig.model import read_rig

    known = catalogue(())
    return reconcile_files(read_rig(Path(rig), known), Path(measured), known)
