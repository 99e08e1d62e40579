"""SCL for S7-1500: external sources (.scl), from which TIA Portal generates blocks.

What the language has not, or not surely, is not written: enumerations, unions, constant arrays (tables are static
variables with start values), array types by name, programs and tasks. The forms are those of public sources; no
development environment of the vendor was asked.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping

from st_codegen.emit.blocks.application import Application, ArrayAlias, Structure
from st_codegen.emit.blocks.listing import Block, BlockVariable
from st_codegen.emit.blocks.model import Limits
from st_codegen.emit.targets.base import FilePlan, Target, enter_target
from st_codegen.errors import InputError, TargetError


class SclTarget(Target):
    """One `.scl` file a model; a bundle is one file, users behind what they use."""

    name = "scl"
    summary = "Siemens SCL for S7-1500, external source (.scl)"
    dialect = "scl"
    templates = "iec"
    lreal_note = (
        " (S7-1200, S7-1500; S7-300 and S7-400 know no blocks with optimised access, as this target writes them)"
    )
    #: LREAL's normal numbers; the largest optimised data block of the smallest S7-1500.
    limits = Limits(real_range=(2.2250738585072014e-308, 1.7976931348623157e308), data_bytes=2**20)

    def files(self, application: Application) -> Iterable[FilePlan]:
        blocks = tuple(block for block in application.blocks if block.kind != "PROGRAM")
        for block in blocks:
            if block.extends:
                raise TargetError(f"{block.name} extends {block.extends}: SCL has no inheritance; use --target twincat")
        names = _Names.of(application, blocks)
        if not application.connected:
            alone = dataclasses.replace(application, blocks=blocks, tasks=(), tests=()).alone()
            return [names.file(name, (), group) for name, group in alone]
        types = tuple(item for item in application.types if isinstance(item, Structure))
        return [names.file(application.name, types, blocks)]


@dataclasses.dataclass(frozen=True)
class _Names:
    """What names mean: array types, which are written out, and blocks and structures, which are quoted."""

    arrays: Mapping[str, ArrayAlias]
    quoted: frozenset[str]
    used: frozenset[str]

    @classmethod
    def of(cls, application: Application, blocks: tuple[Block, ...]) -> _Names:
        arrays = {item.name: item for item in application.types if isinstance(item, ArrayAlias)}
        structures = (item.name for item in application.types if isinstance(item, Structure))
        used = {variable.type for block in blocks for variable in block.variables}
        return cls(arrays, frozenset((*structures, *(block.name for block in blocks))), frozenset(used))

    def file(self, name: str, types: tuple[Structure, ...], blocks: tuple[Block, ...]) -> FilePlan:
        """A file with its types, blocks, and an instance of each block that no other block has."""
        own = {block.name.lower() for block in blocks}
        instances = [
            (f"DB_{block.name.removeprefix('FB_')}", block.name)
            for block in blocks
            if block.kind == "FUNCTION_BLOCK" and block.name not in self.used
        ]
        for instance, block_name in instances:
            if instance.lower() in own:
                raise InputError(f"the instance of {block_name} would be called {instance}, as another block is")
        values = {
            "types": [dataclasses.replace(item, fields=self._typed(item.fields)) for item in types],
            "blocks": [self._block(block) for block in blocks],
            "instances": instances,
            "names": self.quoted,
        }
        return FilePlan(f"{name}.scl", "scl/blocks.scl.j2", values)

    def _block(self, block: Block) -> Block:
        if block.kind == "FUNCTION" and any(variable.initial for variable in block.variables):
            raise TargetError(f"{block.name}: variables of a function have no start values in SCL")
        return dataclasses.replace(
            block,
            inputs=self._typed(block.inputs),
            outputs=self._typed(block.outputs),
            in_outs=self._typed(block.in_outs),
            variables=self._typed(block.variables),
        )

    def _typed(self, variables: Iterable[BlockVariable]) -> tuple[BlockVariable, ...]:
        return tuple(self._variable(variable) for variable in variables)

    def _variable(self, variable: BlockVariable) -> BlockVariable:
        alias = self.arrays.get(variable.type)
        if alias is not None:
            if variable.length is not None:
                raise TargetError(f"{variable.name}: arrays of {variable.type} are not written in SCL")
            return dataclasses.replace(variable, type=alias.element, length=alias.length)
        if variable.type in self.quoted:
            return dataclasses.replace(variable, type=f'"{variable.type}"')
        return variable


enter_target(SclTarget())
