"""What `st-codegen compare` needs on the controller: a program that runs rows of inputs and keeps outputs and times.

Rows travel in arrays of GVL_Comparison. The program has a task of its own, less urgent than any other, and instances of
its own, so that no other task sees it except for the time that it leaves them: at most `nPerCycle` rows a cycle.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from st_codegen.emit.blocks.application import Application, GlobalList, Task
from st_codegen.emit.blocks.listing import Block, BlockVariable, CodeSection
from st_codegen.emit.blocks.model import header_lines

LIST, PROGRAM = "GVL_Comparison", "PRG_Comparison"
#: What a client writes.
FROM_CLIENT = ("nRequest", "nBlock", "nRows", "nPerCycle", "fInputs")
#: Rows of one request; so many that a request is worth its way over the network.
ROWS = 500
#: Rows of a request at least, of a block with so many numbers that the arrays would be long with all of them.
_LEAST_ROWS = 50
#: The least urgent task there is.
COMPARISON_TASK = Task("ComparisonTask", 10_000, 31, (PROGRAM,))


@dataclasses.dataclass(frozen=True)
class CalledBlock:
    """A block around the models: the inputs that rows have, those that are the same for all, its outputs that count.

    `calls`: so often it is called for a row, until all of its outputs belong to that row; `truths`: the inputs that are
    truth values, which travel as 0 and 1.
    """

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    fixed: Mapping[str, str] = dataclasses.field(default_factory=dict)
    calls: int = 1
    truths: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class ComparedBlock(CalledBlock):
    """A block that can be compared: its number in a request, and the most rows that a request may have."""

    number: int = 0
    rows: int = ROWS


@dataclasses.dataclass(frozen=True)
class Compared:
    """All blocks that can be compared, and how long the arrays are in which their rows travel."""

    blocks: tuple[ComparedBlock, ...]
    inputs: int
    outputs: int

    @property
    def narrow(self) -> tuple[ComparedBlock, ...]:
        """The blocks with so many numbers that a request has fewer rows than others."""
        return tuple(block for block in self.blocks if block.rows < ROWS)


def compared_blocks(blocks: Iterable[Block], models: Collection[str], around: Sequence[CalledBlock]) -> Compared:
    """The blocks of models, with their inputs and those of their outputs that are numbers, and those around them."""
    own = [
        CalledBlock(
            block.name,
            tuple(variable.name for variable in block.inputs),
            tuple(variable.name for variable in block.outputs if variable.type in ("LREAL", "DINT")),
        )
        for block in sorted(blocks, key=lambda block: block.name)
        if block.name in models
    ]

    def length(kind: str) -> int:
        wide = [ROWS * len(getattr(block, kind)) for block in own]
        return max([1, *wide, *(_LEAST_ROWS * len(getattr(block, kind)) for block in around)])

    inputs, outputs = length("inputs"), length("outputs")
    return Compared(
        tuple(
            ComparedBlock(
                **{entry.name: getattr(block, entry.name) for entry in dataclasses.fields(block)},
                number=number,
                rows=min(ROWS, inputs // len(block.inputs), outputs // len(block.outputs)),
            )
            for number, block in enumerate((*own, *around), 1)
        ),
        inputs,
        outputs,
    )


def facts(compared: Compared, signals: GlobalList) -> dict[str, Any]:
    """What the manifest says, and what `compare` reads there."""
    return {
        "fingerprint": next(entry.initial for entry in signals.variables if entry.name == "nFingerprint")[3:].lower(),
        "rows": ROWS,
        "lengths": [compared.inputs, compared.outputs],
        "blocks": {
            block.name: {
                "number": block.number,
                "inputs": list(block.inputs),
                "outputs": list(block.outputs),
                **({"rows": block.rows} if block.rows < ROWS else {}),
                **({"calls": block.calls} if block.calls > 1 else {}),
                **({"fixed": dict(block.fixed)} if block.fixed else {}),
            }
            for block in compared.blocks
        },
    }


def with_comparison(
    application: Application, models: Collection[str], fingerprint: int, around: Sequence[CalledBlock] = ()
) -> Application:
    """The application with the program of the comparison, its signals and its task."""
    compared = compared_blocks(application.blocks, models, around)
    return dataclasses.replace(
        application,
        globals=(*application.globals, _signals(compared, fingerprint)),
        blocks=(*application.blocks, _program(compared)),
        tasks=(*application.tasks, COMPARISON_TASK),
    )


def _signals(compared: Compared, fingerprint: int) -> GlobalList:
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
            BlockVariable("fInputs", "LREAL", compared.inputs, comment="inputs, row by row"),
            BlockVariable("fOutputs", "LREAL", compared.outputs, comment="outputs, row by row"),
            BlockVariable("bValid", "BOOL", ROWS, comment="the block called its outputs valid"),
            BlockVariable("nTime", "UDINT", ROWS, comment="time of the call, 100 ns"),
        ),
    )


def _program(compared: Compared) -> Block:
    return Block(
        name=PROGRAM,
        header=header_lines(
            f"{PROGRAM}: runs the rows of {LIST} and keeps outputs and times, for st-codegen compare",
            "Not part of the application: its blocks are instances of its own, its task is the least urgent.",
        ),
        kind="PROGRAM",
        variables=(
            BlockVariable("nCurrent", "DINT", comment="number of the request that runs"),
            BlockVariable("nNext", "DINT", comment="first row that has not run"),
            BlockVariable("nEnd", "DINT", comment="first row that does not run in this cycle"),
            BlockVariable("nRow", "DINT", comment="row"),
            *([BlockVariable("nMost", "DINT", comment="most rows of a request")] if compared.narrow else []),
            BlockVariable("nStart", "UDINT", comment="clock before the call, 100 ns"),
            BlockVariable("fbClock", "GETCPUCOUNTER", comment="clock"),
            *(BlockVariable(f"fbBlock{block.number}", block.name) for block in compared.blocks),
        ),
        sections=(CodeSection("the next rows of the request", "comparison", _values(compared)),),
        needs_globals=True,
    )


def _values(compared: Compared) -> Mapping[str, Any]:
    return {
        "list": LIST,
        "rows": ROWS,
        "last_row": ROWS - 1,
        "blocks": compared.blocks,
        "narrow": compared.narrow,
        "most": "nMost" if compared.narrow else str(ROWS),
    }
