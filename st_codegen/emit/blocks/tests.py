"""TcUnit suites: what the source library answers, asserted on the controller.

A suite calls a block with rows of inputs and compares its outputs with numbers that the library computed, so that the
user proves on the machine what was proved here.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

from st_codegen.emit.blocks.application import Application, Task
from st_codegen.emit.blocks.listing import Block, BlockVariable, CodeSection, Group, Table
from st_codegen.emit.blocks.model import header_lines
from st_codegen.emit.blocks.self_test import SELF_TEST
from st_codegen.errors import counted
from st_codegen.ir import FloatArray, Source

#: The task of the suites: slow and less urgent than any of the application.
TEST_TASK = Task("TestTask", 10_000, 30, ("PRG_Test",))


@dataclass(frozen=True)
class ReferenceVectors:
    """Rows for one block and what the library answers.

    `inputs` (rows, features); `expected` and `allowed` (rows, results), one column for each of `results`, which are the
    outputs as they are written in the text. `refuses_nan`: the block must call a row with NaN invalid. `calls`: so
    often it is called for a row, until all of its outputs belong to that row.
    """

    name: str
    block: str
    results: tuple[str, ...]
    inputs: FloatArray
    expected: FloatArray
    allowed: FloatArray
    refuses_nan: bool
    source: Source | None = None
    calls: int = 1


def with_tests(application: Application, vectors: Sequence[ReferenceVectors]) -> Application:
    """The application with a suite for FB_SelfTest and each of the vectors, the program that runs them and its task."""
    if not vectors:
        return application
    inputs = {block.name: [variable.name for variable in block.inputs] for block in application.blocks}
    suites = (_self_test_suite(), *(_suite(vector, inputs[vector.block]) for vector in vectors))
    instances = tuple(BlockVariable(f"fb{suite.name[3:]}", suite.name) for suite in suites)
    runner = Block(
        name="PRG_Test",
        header=header_lines(
            "PRG_Test: runs all suites; results appear in the error list of the development environment"
        ),
        kind="PROGRAM",
        variables=instances,
        sections=(CodeSection("one cycle of all suites", "tcunit_run", {}),),
    )
    return dataclasses.replace(
        application,
        tests=(*suites, runner),
        tasks=(*application.tasks, TEST_TASK),
        libraries=(*application.libraries, "TcUnit"),
    )


def _self_test_suite() -> Block:
    return Block(
        name=f"{SELF_TEST}_Test",
        header=header_lines(f"{SELF_TEST}_Test: what the equality of all other suites rests on"),
        extends="FB_TestSuite",
        variables=(BlockVariable("fbBlock", SELF_TEST, comment="what is tested"),),
        sections=(CodeSection("the test of the controller's arithmetic", "tcunit_self_test", {}),),
    )


def _suite(vectors: ReferenceVectors, inputs: list[str]) -> Block:
    rows = len(vectors.inputs)
    source = vectors.source
    header = [f"{vectors.block}_Test: {vectors.name}, {counted(rows, 'row')}"]
    if source is not None:
        header += [f"Expected values: {source.library} {source.version}, {source.model_class}".replace(" ,", ",")]
        header += [f"Model digest: {source.digest}"] if source.digest else []
    else:
        header += ["Expected values: made of the predictions of the libraries"]
    variables = [
        BlockVariable("fbBlock", vectors.block, comment="what is tested"),
        *([BlockVariable("nRow", "DINT", comment="row")] if rows > 1 else []),
        *([BlockVariable("nCall", "DINT", comment="call for the row")] if vectors.calls > 1 else []),
        BlockVariable("sRow", "STRING(255)", comment="the row, for messages"),
    ]
    if vectors.refuses_nan:
        variables.append(BlockVariable("uNan", "U_LrealBits", comment="not a number"))
    return Block(
        name=f"FB_{vectors.name}_Test",
        header=header_lines(*header),
        extends="FB_TestSuite",
        variables=tuple(variables),
        tables=(
            _table("TEST_INPUT", vectors.inputs),
            _table("TEST_EXPECTED", vectors.expected),
            _table("TEST_ALLOWED", vectors.allowed),
        ),
        sections=(
            CodeSection(
                "the library's answers",
                "tcunit_vectors",
                {
                    "inputs": inputs,
                    "results": vectors.results,
                    "last_row": rows - 1,
                    "refuses_nan": vectors.refuses_nan,
                    "calls": vectors.calls,
                },
            ),
        ),
    )


def _table(name: str, values: FloatArray) -> Table:
    rows, width = values.shape
    groups = tuple(Group(f"row {row}", row * width, (row + 1) * width) for row in range(rows))
    return Table(name, "LREAL", values.ravel(), groups, per_line=width)
