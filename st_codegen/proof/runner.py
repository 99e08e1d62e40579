"""Runs generated text: rows in, predictions out, through the engine of `st` alone."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.cost.report import table_bytes
from st_codegen.emit.output import MANIFEST, changed_since
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import GeneratedCodeError
from st_codegen.files.made_by import command_line
from st_codegen.files.text import read_text
from st_codegen.ir import BoolArray, FloatArray
from st_codegen.proof.arithmetic import libraries_of
from st_codegen.st import (
    DIALECTS,
    Machine,
    Problem,
    Project,
    StCheckError,
    StError,
    StRuntimeError,
    check_source,
    read_paths,
)
from st_codegen.st.run.machine import Instance
from st_codegen.st.syntax.source import PLAIN
from st_codegen.st.syntax.xml_file import open_xml
from st_codegen.st.tree import Pou, Section

#: Rows that are run at once: their records stay in the caches of a processor.
_BATCH = 4_000
#: Rows after which is decided whether the rest is worth optimised code, and how many times the seconds of compiling
#: without it the rest would have to take: optimising takes four times as long, and one thread at a time can compile.
_TRIAL, _WORTH = 500, 12.0
#: Rows of a block that is called several times, from which on its code is optimised without a trial.
_MANY_ROWS = 20_000

#: Where a block begins and ends in files that hold several.
_PART_OF_FILE = {
    **dict.fromkeys(PLAIN, r'^FUNCTION_BLOCK "?{}"?$.*?^END_FUNCTION_BLOCK'),
    ".xml": r'^ *<pou name="{}" .*?</pou>',
}


class _InvalidTextError(GeneratedCodeError):
    """The text of a folder is no Structured Text."""


class _StopsError(GeneratedCodeError):
    """The text of a folder does what stops a controller."""


def target_folders(generated: Path) -> list[Path]:
    """The generated folders in `generated`, or `generated` itself when it is one."""
    candidates = [generated, *(generated / name for name in TARGETS)]
    folders = [folder for folder in candidates if folder.name in TARGETS and (folder / MANIFEST).is_file()]
    if not folders:
        made = command_line("st-codegen", "generate", "MODELS", "--out", generated)
        raise GeneratedCodeError(f"{generated}: no generated files; run {made}")
    return folders


def changes_by_hand(generated: Path) -> list[str]:
    """For each generated folder with files that are not as they were written, a sentence that names them."""
    changed = {folder.name: changed_since(folder) for folder in target_folders(generated)}
    return [
        f"{target}: not as generated: {', '.join(names)}; what is said here is of the text as it is now"
        for target, names in changed.items()
        if names
    ]


@dataclass(frozen=True)
class BlockResult:
    """Outputs of a block for some rows: (rows, outputs), and whether it called them valid."""

    values: FloatArray
    valid: BoolArray


class GeneratedCode:
    """The checked text of one target's folder.

    Every batch of rows starts from a new machine, so that no row sees what an earlier one left behind.
    """

    def __init__(self, folder: Path, dialect: str | None = None) -> None:
        """Parse and check, by default in the dialect of the target that the folder is named after.

        Raises GeneratedCodeError that lists what is wrong with the text.
        """
        if not folder.is_dir():
            raise GeneratedCodeError(f"{folder}: no generated files; run st-codegen generate first")
        self.folder, self._dialect = folder, DIALECTS[dialect or TARGETS[folder.name].dialect]
        self.libraries = libraries_of(folder)
        self._optimised: set[str] = set()
        try:
            self.source = read_paths([folder])
            self.project: Project = check_source(self.source, self._dialect, self.libraries)
        except StError as error:
            raise _InvalidTextError(f"{folder}: the text is not valid Structured Text\n{error}") from error

    @cached_property
    def implicit_conversions(self) -> tuple[Problem, ...]:
        """Where the text leaves a conversion to the compiler, or computes with bit strings."""
        try:
            check_source(self.source, self._dialect.without_implicit_conversions(), self.libraries)
        except StCheckError as error:
            return tuple(error.problems)
        return ()

    @property
    def task_programs(self) -> tuple[str, ...]:
        """The programs that the tasks of a TwinCAT project call, in order; empty where there is no task."""
        return tuple(dict.fromkeys(name for _, _, programs in tasks_in(self.folder) for name in programs))

    def table_bytes(self, block: str) -> int:
        """Bytes of a block's constant arrays."""
        return table_bytes(self._pou(block), self.project)

    def text(self, block: str) -> str:
        """The block's own text: its file, or its part of a file with several blocks."""
        for path in sorted(self.folder.rglob("*")):
            if path.suffix == ".TcPOU" and path.stem == block:
                return path.read_text(encoding="utf-8-sig")
            if path.suffix in _PART_OF_FILE:
                pattern = _PART_OF_FILE[path.suffix].format(block)
                found = re.search(pattern, path.read_text(encoding="utf-8"), re.M | re.S)
                if found is not None:
                    return found[0]
        raise GeneratedCodeError(f"{self.folder}: no block {block}")

    def _pou(self, block: str) -> Pou:
        try:
            return self.project.pous[block.upper()]
        except KeyError:
            raise GeneratedCodeError(
                f"{self.folder}: no block {block}; text or models have changed: generate again"
            ) from None

    def check_block(self, block: str, inputs: int, outputs: Sequence[int]) -> None:
        """Raise GeneratedCodeError where a block has not so many inputs, or not all of these outputs."""
        sections = [variable.section for variable in self._pou(block).variables]
        if sections.count(Section.INPUT) != inputs or max(outputs, default=0) >= sections.count(Section.OUTPUT):
            raise GeneratedCodeError(
                f"{self.folder}: {block} has other inputs or outputs than {MANIFEST} says: generate again"
            )

    def variables(self, block: str, section: Section) -> list[str]:
        """The names of a block's inputs or outputs, in the order of their declaration."""
        return [variable.name for variable in self._pou(block).variables if variable.section is section]

    def run_model(self, block: str, x: FloatArray, outputs: int | Sequence[int]) -> BlockResult:
        """Call a model's block once for each row of `x` (rows, features), its inputs in order.

        `outputs`: how many outputs, or the numbers (from 0, in the order of their declaration) of those that are
        wanted.
        Raises GeneratedCodeError where the controller would stop: a floating point exception, an index out of range.
        """
        wanted = range(outputs) if isinstance(outputs, int) else outputs
        self.check_block(block, x.shape[1], wanted)
        if not len(x):
            return BlockResult(np.zeros((0, len(wanted))), np.zeros(0, np.bool_))
        parts, done = [], 0
        while done < len(x):
            end = done + (_BATCH if done or block in self._optimised else _TRIAL)
            parts.append(self._batch(block, x[done:end], wanted, len(x) - end))
            done = end
        return BlockResult(np.vstack([p.values for p in parts]), np.concatenate([p.valid for p in parts]))

    def _batch(self, block: str, x: FloatArray, outputs: Sequence[int], to_come: int) -> BlockResult:
        """Run some rows, and decide with what code the rows `to_come` run."""
        instance = self._instance(block, len(x))
        inputs = dict(zip((port.name for port in instance.inputs), x.T, strict=True))
        compiling = instance.compile()
        start = time.perf_counter()
        result = self._run(instance, block, inputs)
        if (time.perf_counter() - start) * to_come > _WORTH * compiling * len(x):
            self._optimised.add(block)
        names = [port.name for port in instance.outputs]
        values = np.column_stack([result[names[number]].astype(np.float64) for number in outputs])
        return BlockResult(values, result["bValid"].astype(np.bool_))

    def call(self, block: str, inputs: Mapping[str, FloatArray], rows: int, *, calls: int = 1) -> dict[str, FloatArray]:
        """Call a block `calls` times with an array for each named input; returns all its outputs, rows first."""
        instance = self._instance(block, rows, calls)
        for _ in range(calls - 1):
            self._run(instance, block, inputs)
        return self._run(instance, block, inputs)

    def sequence(self, block: str, inputs: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Call one instance of a block again and again, with the values of each named input in turn.

        Returns all its outputs, shape (calls,).
        """
        instance = self._instance(block, 1)
        calls = len(next(iter(inputs.values())))
        found = [self._run(instance, block, {name: values[n] for name, values in inputs.items()}) for n in range(calls)]
        return {name: np.concatenate([np.atleast_1d(outputs[name]) for outputs in found]) for name in found[0]}

    def _instance(self, block: str, rows: int, calls: int = 1) -> Instance:
        optimised = block in self._optimised or rows * calls > _MANY_ROWS
        machine = Machine(self.project, rows, libraries=self.libraries, optimised=optimised)
        return machine.instance(self._pou(block).name)

    def _run(self, instance: Instance, block: str, inputs: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        try:
            for name, value in inputs.items():
                instance[name] = value
            instance()
        except StRuntimeError as error:
            raise _StopsError(f"{self.folder}: the controller would stop in {block}\n{error}") from error
        return {port.name: np.asarray(instance[port.name]) for port in instance.outputs}


def tasks_in(folder: Path) -> Iterator[tuple[Path, Any, tuple[str, ...]]]:
    """The files of the tasks of a TwinCAT project: the root element of each, and the programs that it calls.

    Raises InputError for a file that is no XML.
    """
    for path in sorted(folder.rglob("*.TcTTO")):
        root = open_xml(str(path), read_text(path).encode()).root
        yield path, root, tuple(filter(None, ((name.text or "").strip() for name in root.iterfind(".//PouCall/Name"))))
