"""Models without operations whose results nothing reads."""

from __future__ import annotations

import dataclasses

from st_codegen.ir import ModelIR


def read_values(model: ModelIR, *, answers: bool = False) -> set[int]:
    """The numbers of the values that the result of a model depends on (0: the inputs).

    `answers`: whether there is a result is part of it, so that operations that refuse numbers count as read.
    """
    refusing = {number for number, op in enumerate(model.ops, 1) if answers and getattr(op, "refuses", False)}
    read = {len(model.ops), *refusing}
    for number in range(len(model.ops), 0, -1):
        if number in read:
            read.update(model.ops[number - 1].inputs)
    return read


def without_unread(model: ModelIR, *, answers: bool = False) -> ModelIR:
    """The model without operations whose results nothing reads (scalers in front of trees that read the inputs).

    `answers`: those stay that refuse numbers, such as encoders, and what these read.
    """
    kept = sorted(number for number in read_values(model, answers=answers) if number)
    moved = {0: 0, **{number: at for at, number in enumerate(kept, 1)}}
    ops = tuple(
        dataclasses.replace(
            model.ops[number - 1],  # type: ignore[type-var]
            inputs=tuple(moved[value] for value in model.ops[number - 1].inputs),
        )
        for number in kept
    )
    return dataclasses.replace(model, ops=ops)
