"""TwinCAT 3 source files: TcPOU, TcDUT, TcGVL."""

from __future__ import annotations

import uuid
from collections.abc import Iterable

from st_codegen.blocks.listing import Block
from st_codegen.blocks.model import Limits, model_block
from st_codegen.blocks.transmission_error import HARMONICS_TYPE, compensator_block, predict_block
from st_codegen.ir import ProjectIR
from st_codegen.literals import real
from st_codegen.targets.base import FilePlan, Target

#: Object identifiers are derived from names, so that they never change.
_NAMESPACE = uuid.uuid5(uuid.NAMESPACE_DNS, "st-codegen")


def object_id(name: str) -> str:
    """The identifier of an object in TwinCAT's files."""
    return f"{{{uuid.uuid5(_NAMESPACE, name)}}}"


class TwinCatTarget(Target):
    """One file an object, in the folders that TwinCAT projects use."""

    name = "twincat"
    summary = "TwinCAT 3 (.TcPOU, .TcDUT, .TcGVL)"
    limits = Limits(max_array=65_536)

    def plan(self, project: ProjectIR, limits: Limits) -> Iterable[FilePlan]:
        blocks = [model_block(model, limits) for model in project.models]
        te = project.transmission_error
        if te is not None:
            blocks += [predict_block(te), compensator_block(te)]
        files = [_pou(block) for block in blocks]
        files.append(_object("POUs/F_IsNan.TcPOU", "F_IsNan"))
        files.append(_object("DUTs/U_LrealBits.TcDUT", "U_LrealBits"))
        if te is not None:
            orders = ", ".join(map(str, te.orders))
            values = {"te": te, "ratio": real(te.reduction_ratio), "last": len(te.orders) - 1, "orders": orders}
            files.append(_object("GVLs/GVL_TE.TcGVL", "GVL_TE", **values))
            files.append(_object(f"DUTs/{HARMONICS_TYPE}.TcDUT", HARMONICS_TYPE, last=len(te.orders) - 1))
        return files


def _pou(block: Block) -> FilePlan:
    values = {"block": block, "id": object_id(block.name)}
    return FilePlan(f"POUs/{block.name}.TcPOU", "twincat/block.TcPOU.j2", values, twincat_xml=True)


def _object(path: str, name: str, **values: object) -> FilePlan:
    file = path.rsplit("/", 1)[1]
    return FilePlan(path, f"twincat/{file}.j2", {"id": object_id(name), **values}, twincat_xml=True)
