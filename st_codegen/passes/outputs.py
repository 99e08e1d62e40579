"""Which outputs of a classifier are computed."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

import numpy as np

from st_codegen.errors import InputError
from st_codegen.ir import Classes, Int32Array, ModelIR, OutputKind, Select
from st_codegen.passes.unread import without_unread


def with_outputs(model: ModelIR, wanted: Collection[OutputKind]) -> tuple[ModelIR, Int32Array]:
    """The model with the class and the wanted outputs only, and which of the given model's outputs these are.

    A model that is no classifier stays as it is. Raises InputError for outputs that the model does not have.
    """
    classes = model.classes
    if classes is None:
        return model, np.arange(len(model.outputs), dtype=np.int32)
    missing = [kind for kind in wanted if kind not in classes.kinds]
    if missing:
        known = ", ".join(dict.fromkeys(classes.kinds))
        raise InputError(
            f"model '{model.name}': {model.source.model_class} gives no {' and no '.join(missing)}; it has: {known}"
        )
    chosen = np.flatnonzero([kind is OutputKind.CLASS or kind in wanted for kind in classes.kinds]).astype(np.int32)
    picked = dataclasses.replace(
        model,
        ops=(*model.ops, Select((len(model.ops),), chosen)),
        outputs=tuple(model.outputs[number] for number in chosen),
        classes=Classes(classes.labels, tuple(classes.kinds[number] for number in chosen)),
    )
    return without_unread(_joined_selections(picked)), chosen


def _joined_selections(model: ModelIR) -> ModelIR:
    """The last two selections as one, which reads only the values that it picks from."""
    *before, first, last = model.ops
    if not isinstance(first, Select) or not isinstance(last, Select):
        return model
    columns = first.columns[last.columns]
    owner = np.repeat(np.arange(len(first.inputs)), [model.value_width(value) for value in first.inputs])
    start = np.flatnonzero(np.diff(owner, prepend=-1))
    read = np.unique(owner[columns])
    shift = np.cumsum([0, *(model.value_width(first.inputs[at]) for at in read)])[:-1]
    moved = columns - start[owner[columns]] + shift[np.searchsorted(read, owner[columns])]
    return dataclasses.replace(model, ops=(*before, Select(tuple(first.inputs[at] for at in read), moved)))
