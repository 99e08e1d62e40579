"""Portable Structured Text: the subset that strict compilers outside TwinCAT accept."""

from __future__ import annotations

from collections.abc import Iterable

from st_codegen.blocks.listing import Block
from st_codegen.blocks.model import Limits, model_block
from st_codegen.blocks.transmission_error import HARMONICS_TYPE, compensator_block, predict_block
from st_codegen.ir import ProjectIR
from st_codegen.literals import identifier
from st_codegen.targets.base import FilePlan, Target


class IecTarget(Target):
    """One `.st` file a model; a bundle is one file, in the order in which strict compilers want declarations."""

    name = "iec"
    summary = "portable Structured Text (.st)"
    limits = Limits(max_array=65_536, real_range=(1e-37, 1e37))

    def plan(self, project: ProjectIR, limits: Limits) -> Iterable[FilePlan]:
        blocks = [model_block(model, limits) for model in project.models]
        te = project.transmission_error
        if te is None:
            return [_file(block.name, [block], None) for block in blocks]
        blocks += [predict_block(te), compensator_block(te)]
        return [_file(identifier(te.name, "bundle name"), blocks, {"name": HARMONICS_TYPE, "last": len(te.orders) - 1})]


def _file(name: str, blocks: list[Block], array_type: dict[str, object] | None) -> FilePlan:
    return FilePlan(f"{name}.st", "iec/blocks.st.j2", {"blocks": blocks, "array_type": array_type})
