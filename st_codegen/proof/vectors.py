"""Rows with known answers: the source library's for `--with-tests`, one of the reference for `--self-check`."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from st_codegen.emit.blocks.comparison import CalledBlock
from st_codegen.emit.blocks.model import block_name
from st_codegen.emit.blocks.self_check import CheckRow
from st_codegen.emit.blocks.tests import ReferenceVectors
from st_codegen.ir import BoolArray, FloatArray, ModelIR, reference
from st_codegen.passes.pipeline import Compiled
from st_codegen.project.bundle import Bundle
from st_codegen.proof import bounds
from st_codegen.proof.isolated import isolated
from st_codegen.proof.probes import probe_rows
from st_codegen.walkers.base import LoadedModel

#: Rows a suite: enough to meet every kind of row that verification tries, few enough to read.
ROWS = 32
#: Numbers outside these magnitudes are left to verification: not every compiler reads their literals.
_READABLE = (1e-300, 1e300)


def reference_vectors(
    bundle: Bundle, compiled: Compiled, called: Sequence[CalledBlock]
) -> tuple[ReferenceVectors, ...]:
    """A set for each model of the bundle, and those of the blocks that its purpose adds; `called` are these blocks as
    they were compiled."""
    calls = {block.name: block.calls for block in called}
    with isolated(bundle.models) as models:
        around = () if bundle.purpose is None else bundle.purpose.vectors(models)
        called_as = [dataclasses.replace(vectors, calls=calls.get(vectors.block, 1)) for vectors in around]
        return (*(_of_model(model, compiled) for model in models), *called_as)


def check_row(models: Sequence[ModelIR], compiled: Compiled, printed: ModelIR) -> CheckRow | None:
    """A row that a printed model's block must answer, with the answers of the models that it computes.

    None where no row has an answer that is certain.
    """
    inside = [model for model in models if compiled.locations[model.name].model == printed.name]
    rows = probe_rows(inside[0], 20 * ROWS)[::-1]  # ordinary ones stand last
    with np.errstate(all="ignore"):
        usable = np.all(
            [_certain(m, rows) & np.all(reference.limited(m, rows) == rows, axis=1) for m in inside], axis=0
        )
        x = _chosen(rows, usable)[:1]
        if not len(x) or any(model.features != inside[0].features for model in inside):
            return None
        expected, allowed = np.zeros((2, len(printed.outputs)))
        for model in inside:
            columns = list(compiled.locations[model.name].outputs)
            expected[columns] = reference.evaluate(model, x)[0]
            allowed[columns] = bounds.difference_bound(model, x)[0]
    return CheckRow(x[0], expected, allowed)


def _certain(model: ModelIR, x: FloatArray) -> BoolArray:
    """The rows that have a finite answer with a finite bound, and one label alone."""
    bound = bounds.difference_bound(model, reference.limited(model, x))
    found: BoolArray = np.all(np.isfinite(reference.evaluate(model, x)) & np.isfinite(bound), axis=1)
    return found if model.classes is None else found & (bound[:, 0] == 0)


def _chosen(x: FloatArray, usable: BoolArray) -> FloatArray:
    """ROWS of the usable rows, evenly spaced: special values come first, thresholds next, then random rows."""
    size = np.abs(x)
    readable = np.all((x == 0) | ((size >= _READABLE[0]) & (size <= _READABLE[1])), axis=1)
    rows = x[readable & usable]
    chosen: FloatArray = rows[np.unique(np.linspace(0, len(rows) - 1, ROWS).astype(np.int64))]
    return chosen


def _of_model(model: LoadedModel, compiled: Compiled) -> ReferenceVectors:
    ir = model.ir
    x = probe_rows(ir, 20 * ROWS)
    with np.errstate(all="ignore"):
        x = _chosen(x, _certain(ir, x))
    location = compiled.locations[ir.name]
    printed, limited = compiled.block_model(ir.name), reference.limited(ir, x)
    return ReferenceVectors(
        name=block_name(ir.name).removeprefix("FB_"),
        block=block_name(location.model),
        results=tuple(printed.variables[output] for output in location.outputs),
        inputs=x,
        expected=model.predict(limited),
        allowed=bounds.difference_bound(ir, limited),
        refuses_nan=not printed.accepts_nan or bool(printed.must_be_present),
        source=ir.source,
    )
