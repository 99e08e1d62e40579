"""Compiles trained models to IEC 61131-3 Structured Text and checks it; of most tree models it proves the text equal.

>>> import st_codegen
>>> bundle = st_codegen.load("models")
>>> st_codegen.generate(bundle, "twincat", "generated")
>>> st_codegen.verify(bundle, "generated").passed
True
>>> st_codegen.prove(bundle, "generated").proved
True
>>> st_codegen.diff("generated of yesterday", "generated").changed
True
>>> st_codegen.simulate(bundle, "rig.toml", "cycloidal").outcomes
>>> st_codegen.reconcile("rig.toml", "campaign").new_rig
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

# the packages, before the functions of the same names are defined: later modules do not take the names back
import st_codegen.reconcile  # noqa: F401
from st_codegen.entries import announce
from st_codegen.files.made_by import VERSION

if TYPE_CHECKING:
    from st_codegen.driver import generate
    from st_codegen.emit.blocks.application import Packaging, ProjectForm
    from st_codegen.emit.targets.base import Target
    from st_codegen.errors import InputError
    from st_codegen.ir.decisions import OutputKind
    from st_codegen.passes.choose import CostFunction, Layout, Options
    from st_codegen.project.bundle import Bundle, load
    from st_codegen.proof.prove.prove import prove
    from st_codegen.proof.review import diff
    from st_codegen.proof.verify import verify
    from st_codegen.reconcile.result import Reconciliation
    from st_codegen.rig.motion_files import MotionStudy

__version__ = VERSION
__all__ = [
    "CostFunction",
    "InputError",
    "Layout",
    "Options",
    "OutputKind",
    "Packaging",
    "ProjectForm",
    "Target",
    "diff",
    "generate",
    "load",
    "prove",
    "reconcile",
    "simulate",
    "verify",
]

#: Public functions, and the types of their arguments and errors, that are the same in their room: it is imported when
#: they are first used.
_HOMES = {
    "CostFunction": "st_codegen.passes.choose",
    "InputError": "st_codegen.errors",
    "Layout": "st_codegen.passes.choose",
    "Options": "st_codegen.passes.choose",
    "OutputKind": "st_codegen.ir.decisions",
    "Packaging": "st_codegen.emit.blocks.application",
    "ProjectForm": "st_codegen.emit.blocks.application",
    "Target": "st_codegen.emit.targets.base",
    "generate": "st_codegen.driver",
    "load": "st_codegen.project.bundle",
    "diff": "st_codegen.proof.review",
    "verify": "st_codegen.proof.verify",
    "prove": "st_codegen.proof.prove.prove",
}
# these bring a purpose, a target and kinds of files
announce("st_codegen.te.bundle", "st_codegen.beckhoff_ml")


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return getattr(importlib.import_module(_HOMES[name]), name)


def simulate(bundle: Bundle, rig: Path | str, profile: str = "cycloidal", *, seed: int = 0) -> MotionStudy:
    """Move the axis of a rig.toml with the bundle's generated text in its loop, and once without.

    `profile`: `cycloidal`, `robot` or a CSV file. Each law and each form of the tasks with all orders; for fewer, or
    other inputs, see `st_codegen.rig.study`. Raises InputError, MissingExtraError (the extra `rig`).
    """
    from st_codegen.rig.effects import catalogue
    from st_codegen.rig.machine import read_machine
    from st_codegen.rig.study import MotionWish, parse_orders
    from st_codegen.rig.study import simulate as simulate_machine

    _, machine = read_machine(Path(rig), catalogue(()))
    return simulate_machine(machine, bundle, profile, MotionWish(parse_orders((), bundle)), seed=seed)


def reconcile(rig: Path | str, measured: Path | str) -> Reconciliation:
    """Find the effects that a rig.toml lacks in measured data: a campaign folder, a harmonic table or recordings.

    Raises InputError for data that cannot be compared with the rig, MissingExtraError (the extra `rig`).
    """
    from st_codegen.reconcile.run import reconcile_files
    from st_codegen.rig.effects import catalogue
    from st_codegen.rig.model import read_rig

    known = catalogue(())
    return reconcile_files(read_rig(Path(rig), known), Path(measured), known)
