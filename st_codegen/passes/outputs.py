"""Which outputs of a classifier, a Gaussian process or a PCA are computed."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

import numpy as np

from st_codegen.errors import InputError
from st_codegen.ir import MAX_DEVIATION_ROWS, Classes, Int32Array, ModelIR, OutputKind, Select
from st_codegen.passes.unread import without_unread

#: What is always computed, and what only other models have: classifiers or those of numbers.
_ALWAYS = (OutputKind.CLASS, OutputKind.MEAN, OutputKind.COLUMN)
#: What classifiers alone give.
OF_CLASSES = frozenset({OutputKind.CLASS, OutputKind.PROBABILITY, OutputKind.DECISION})


def with_outputs(model: ModelIR, wanted: Collection[OutputKind]) -> tuple[ModelIR, Int32Array]:
    """The model with what it always gives and the wanted outputs only, and which of its outputs these are.

    What classifiers give is nothing to other models. Raises InputError for outputs that the model does not have.
    """
    ignored = OF_CLASSES if model.classes is None else ()
    missing = [kind for kind in wanted if kind not in (*model.kinds, *ignored)]
    if missing:
        known = ", ".join(dict.fromkeys(model.kinds)) or "numbers"
        limit = (
            f" (a GaussianProcessRegressor of at most {MAX_DEVIATION_ROWS} training rows does, alone or in a Pipeline)"
        )
        raise InputError(
            f"model '{model.name}': the block of {model.source.model_class} gives no {' and no '.join(missing)}; it "
            f"has: {known}{limit if OutputKind.DEVIATION in missing else ''}"
        )
    if not model.kinds:
        return model, np.arange(len(model.outputs), dtype=np.int32)
    chosen = np.flatnonzero([kind in _ALWAYS or kind in wanted for kind in model.kinds]).astype(np.int32)
    kinds = tuple(model.kinds[number] for number in chosen)
    picked = dataclasses.replace(
        model,
        ops=(*model.ops, Select((len(model.ops),), chosen)),
        outputs=tuple(model.outputs[number] for number in chosen),
        classes=None if model.classes is None else Classes(model.classes.labels, kinds),
        estimates=kinds if model.classes is None else (),
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
