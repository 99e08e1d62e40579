"""What a dialect allows and which files it wants."""

from st_codegen.beckhoff_ml.target import BeckhoffMlTarget
from st_codegen.emit.targets.base import FilePlan, Target
from st_codegen.emit.targets.iec import IecTarget
from st_codegen.emit.targets.plcopen import PlcOpenTarget
from st_codegen.emit.targets.twincat import TwinCatTarget
from st_codegen.errors import InputError

TARGETS: dict[str, Target] = {
    target.name: target for target in (TwinCatTarget(), IecTarget(), PlcOpenTarget(), BeckhoffMlTarget())
}

__all__ = ["TARGETS", "FilePlan", "Target", "target_named"]


def target_named(name: str) -> Target:
    """The target of a name. Raises InputError that lists all names."""
    try:
        return TARGETS[name]
    except KeyError:
        raise InputError(f"no target '{name}'; choose from {', '.join(sorted(TARGETS))}") from None
