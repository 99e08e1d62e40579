"""Models without operations whose results nothing reads."""

from __future__ import annotations

import dataclasses

from st_codegen.ir import ModelIR


def read_values(model: ModelIR) -> set[int]:
    """The numbers of the values that the result of a model depends on (0: the inputs)."""
    read = {len(model.ops)}
    for number in range(len(model.ops), 0, -1):
        if number in read:
            read.update(model.ops[number - 1].inputs)
    return read


def without_unread(model: ModelIR) -> ModelIR:
    """The model without operations whose results nothing reads (scalers in front of trees that read the inputs)."""
    kept = sorted(number for number in read_values(model) if number)
    moved = {0: 0, **{number: at for at, number in enumerate(kept, 1)}}
    ops = tuple(
        dataclasses.replace(
            model.ops[number - 1],  # type: ignore[type-var]
            inputs=tuple(moved[value] for value in model.ops[number - 1].inputs),
        )
        for number in kept
    )
    return dataclasses.replace(model, ops=ops)
