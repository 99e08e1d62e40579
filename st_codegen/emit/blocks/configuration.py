"""What makes portable text run as it is: programs that call the blocks, and the tasks of a CONFIGURATION."""

from __future__ import annotations

import dataclasses

from st_codegen.emit.blocks.application import Application, Task
from st_codegen.emit.blocks.listing import Block, BlockVariable, CodeSection
from st_codegen.emit.blocks.model import header_lines
from st_codegen.emit.blocks.self_test import SELF_TEST

#: The task of models that have nothing around them.
_LONE_TASK = Task("PlcTask", 10_000, 10, ("PRG_Models",))


def with_programs(application: Application) -> Application:
    """The application with a program for FB_SelfTest and, for lone models, one that calls them all; each has a task.

    Programs that share global variables with others are left out with their calls.
    """
    blocks = [block for block in application.blocks if not block.needs_globals]
    tests = [block for block in blocks if block.name == SELF_TEST]
    models = [block for block in blocks if block.kind == "FUNCTION_BLOCK" and block not in tests]
    programs, tasks = [], application.own_tasks
    if not application.connected:
        header = ("PRG_Models: calls every block once in each cycle", "Link its inputs and outputs to your signals.")
        programs.append(_calling("PRG_Models", models, header))
        tasks = (_LONE_TASK,)
    if tests:
        programs.append(_calling("PRG_SelfTest", tests, ("PRG_SelfTest: does this controller compute as assumed?",)))
    present = {block.name for block in (*blocks, *programs)}
    kept = [
        dataclasses.replace(task, programs=tuple(name for name in task.programs if name in present))
        for task in tasks
        if present & set(task.programs)
    ]
    if tests:
        kept[0] = dataclasses.replace(kept[0], programs=("PRG_SelfTest", *kept[0].programs))
    return dataclasses.replace(application, blocks=(*blocks, *programs), tasks=tuple(kept), tests=())


def _free(name: str, taken: set[str]) -> str:
    """The name, with a number behind it where the port of another block has it."""
    number = 1
    free = name
    while free.lower() in taken:
        number += 1
        free = f"{name}_{number}"
    return free


def _calling(name: str, blocks: list[Block], header: tuple[str, ...]) -> Block:
    """A program that calls blocks; each of its inputs and outputs has the name of the port and of its block."""
    calls = []
    inputs: list[BlockVariable] = []
    outputs: list[BlockVariable] = []
    for block in blocks:
        taken = {port.name.lower() for port in (*inputs, *outputs)}
        own = {
            port.name: _free(f"{port.name}_{block.name.removeprefix('FB_')}", taken)
            for port in (*block.inputs, *block.outputs)
        }
        inputs += [dataclasses.replace(port, name=own[port.name]) for port in block.inputs]
        outputs += [dataclasses.replace(port, name=own[port.name]) for port in block.outputs]
        calls.append(
            {
                "instance": f"fb{block.name.removeprefix('FB_')}",
                "inputs": [(port.name, own[port.name]) for port in block.inputs],
                "outputs": [(port.name, own[port.name]) for port in block.outputs],
            }
        )
    return Block(
        name=name,
        header=header_lines(*header),
        kind="PROGRAM",
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        variables=tuple(
            BlockVariable(str(call["instance"]), block.name) for call, block in zip(calls, blocks, strict=True)
        ),
        sections=(CodeSection("one call of each block", "call_blocks", {"calls": calls}),),
    )
