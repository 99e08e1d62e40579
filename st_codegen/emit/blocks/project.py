"""A project in the intermediate representation -> the application that is generated for it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from st_codegen.emit.blocks.application import Application, GlobalList
from st_codegen.emit.blocks.listing import Block, Table, Variable
from st_codegen.emit.literals import identifier, real
from st_codegen.ir import ModelIR, ProjectIR, TransmissionError
from st_codegen.te.compensation import compensation

#: The name of a project of models that have nothing to do with each other.
LONE_NAME = "Models"


def application_of(project: ProjectIR, block_of: Callable[[ModelIR], Block]) -> Application:
    """All that is generated for a project, before a target lays it out; `block_of` makes the block of a model.

    Raises InputError for names that Structured Text cannot have, TargetError for tables that the target cannot hold.
    """
    blocks = tuple(block_of(model) for model in project.models)
    te = project.transmission_error
    if te is None:
        return Application(LONE_NAME, connected=False, blocks=blocks)
    parts = compensation(te)
    return Application(
        name=identifier(te.name, "bundle name"),
        types=parts.types,
        globals=(bundle_globals(te), *parts.globals),
        blocks=(*blocks, *parts.blocks),
        tasks=parts.tasks,
    )


def bundle_globals(te: TransmissionError) -> GlobalList:
    """GVL_TE: what the bundle is for."""
    ratio = Variable("REDUCTION_RATIO", "LREAL", initial=real(te.reduction_ratio), comment="theta_in / theta_out")
    return GlobalList(
        "GVL_TE",
        (f"What FB_TEPredict and FB_Compensator were generated for: bundle {te.name}.",),
        (ratio,),
        (Table("ORDER", "DINT", np.array(te.orders, np.int32)),),
        constant=True,
    )
