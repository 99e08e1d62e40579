"""What `st-codegen compare` needs on the controller: a program that runs rows of inputs and keeps outputs and times.

Rows travel in arrays of GVL_Comparison. The program has a task of its own, less urgent than any other, and instances of
its own, so that no other task sees it except for the time that it leaves them: at most `nPerCycle` rows a cycle.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from st_codegen.emit.blocks.application import Application, GlobalList, Task
from st_codegen.emit.blocks.listing import Block, BlockVariable, CodeSection
from st_codegen.emit.blocks.model import header_lines

LIST, PROGRAM = "GVL_Comparison", "PRG_Comparison"
#: What a client writes.
FROM_CLIENT = ("nRequest", "nBlock", "nRows", "nPerCycle", "fInputs")
#: Rows of one request; so many that a request is worth its way over the network.
ROWS = 500
#: The least urgent task there is.
COMPARISON_TASK = Task("ComparisonTask", 10_000, 31, (PROGRAM,))


@dataclasses.dataclass(frozen=True)
class ComparedBlock:
    """A block that can be compared: its number in a request, and its numbers in the order of the arrays."""

    number: int
    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]


def compared_blocks(blocks: Iterable[Block], models: Collection[str]) -> tuple[ComparedBlock, ...]:
    """The blocks of models, with their inputs and those of their outputs that are numbers."""
    chosen = sorted((block for block in blocks if block.name in models), key=lambda block: block.name)
    return tuple(
        ComparedBlock(
            number,
            block.name,
            tuple(variable.name for variable in block.inputs),
            tuple(variable.name for variable in block.outputs if variable.type in ("LREAL", "DINT")),
        )
        for number, block in enumerate(chosen, 1)
    )


def facts(blocks: tuple[ComparedBlock, ...], signals: GlobalList) -> dict[str, Any]:
    """What the manifest says, and what `compare` reads there."""
    return {
        "fingerprint": next(entry.initial for entry in signals.variables if entry.name == "nFingerprint")[3:].lower(),
        "rows": ROWS,
        "blocks": {
            block.name: {"number": block.number, "inputs": list(block.inputs), "outputs": list(block.outputs)}
            for block in blocks
        },
    }


def with_comparison(application: Application, models: Collection[str], fingerprint: int) -> Application:
    """The application with the program of the comparison, its signals and its task."""
    compared = compared_blocks(application.blocks, models)
    return dataclasses.replace(
        application,
        globals=(*application.globals, _signals(compared, fingerprint)),
        blocks=(*application.blocks, _program(compared)),
        tasks=(*application.tasks, COMPARISON_TASK),
    )


def _signals(blocks: tuple[ComparedBlock, ...], fingerprint: int) -> GlobalList:
    inputs = max((len(block.inputs) for block in blocks), default=1)
    outputs = max((len(block.outputs) for block in blocks), default=1)
    return GlobalList(
        LIST,
        ("Rows of st-codegen compare: a request is a new number in nRequest, written last.",),
        (
            BlockVariable("nFingerprint", "LWORD", initial=f"16#{fingerprint:016X}", comment="of this project's text"),
            BlockVariable("nRequest", "DINT", comment="number of the request"),
            BlockVariable("nAnswer", "DINT", comment="number of the request whose rows are done"),
            BlockVariable("nBlock", "DINT", comment="which block runs"),
            BlockVariable("nRows", "DINT", comment="how many rows there are"),
            BlockVariable("nPerCycle", "DINT", initial="1", comment="rows in a cycle of the task"),
            BlockVariable("fInputs", "LREAL", ROWS * inputs, comment="inputs, row by row"),
            BlockVariable("fOutputs", "LREAL", ROWS * outputs, comment="outputs, row by row"),
            BlockVariable("bValid", "BOOL", ROWS, comment="the block called its outputs valid"),
            BlockVariable("nTime", "UDINT", ROWS, comment="time of the call, 100 ns"),
        ),
    )


def _program(blocks: tuple[ComparedBlock, ...]) -> Block:
    return Block(
        name=PROGRAM,
        header=header_lines(
            (
                f"{PROGRAM}: runs the rows of {LIST} and keeps outputs and times, for st-codegen compare",
                "Not part of the application: its blocks are instances of its own, its task is the least urgent.",
            )
        ),
        kind="PROGRAM",
        variables=(
            BlockVariable("nCurrent", "DINT", comment="number of the request that runs"),
            BlockVariable("nNext", "DINT", comment="first row that has not run"),
            BlockVariable("nEnd", "DINT", comment="first row that does not run in this cycle"),
            BlockVariable("nRow", "DINT", comment="row"),
            BlockVariable("nStart", "UDINT", comment="clock before the call, 100 ns"),
            BlockVariable("fbClock", "GETCPUCOUNTER", comment="clock"),
            *(BlockVariable(f"fbBlock{block.number}", block.name) for block in blocks),
        ),
        sections=(CodeSection("the next rows of the request", "comparison", _values(blocks)),),
        needs_globals=True,
    )


def _values(blocks: tuple[ComparedBlock, ...]) -> Mapping[str, Any]:
    return {"list": LIST, "rows": ROWS, "last_row": ROWS - 1, "blocks": blocks}
