"""Rows and the source library's answers for `--with-tests`."""

from __future__ import annotations

import numpy as np

from st_codegen.emit.blocks.model import block_name
from st_codegen.emit.blocks.tests import ReferenceVectors
from st_codegen.ir import BoolArray, FloatArray, ModelIR, TransmissionError, reference
from st_codegen.passes.pipeline import Compiled
from st_codegen.proof import bounds
from st_codegen.proof.probes import probe_rows
from st_codegen.te.bundle import Bundle
from st_codegen.te.check import harmonics
from st_codegen.te.compensation.parts import SUFFIX
from st_codegen.walkers.base import LoadedModel

#: Rows a suite: enough to meet every kind of row that verification tries, few enough to read.
ROWS = 32
#: Numbers outside these magnitudes are left to verification: not every compiler reads their literals.
_READABLE = (1e-300, 1e300)
#: Phases nearer to half a turn may come with either sign.
_HALF_TURN = 3.1


def reference_vectors(bundle: Bundle, compiled: Compiled) -> tuple[ReferenceVectors, ...]:
    """A set for each model of the bundle, and one for FB_TEPredict where the bundle has one."""
    vectors = [_of_model(model, compiled) for model in bundle.models]
    if bundle.transmission_error is not None:
        vectors.append(_of_prediction(bundle, bundle.transmission_error))
    return tuple(vectors)


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
        x = _chosen(x, np.all(np.isfinite(reference.evaluate(ir, x)), axis=1))
    place = compiled.places[ir.name]
    limited = reference.limited(ir, x)
    return ReferenceVectors(
        name=block_name(ir.name).removeprefix("FB_"),
        block=block_name(place.model),
        results=tuple(f"fOut{output + 1}" for output in place.outputs),
        inputs=x,
        expected=model.predict(limited),
        allowed=bounds.difference_bound(ir, limited),
        refuses_nan=not compiled.block_model(ir.name).accepts_nan,
        source=ir.source,
    )


def _of_prediction(bundle: Bundle, te: TransmissionError) -> ReferenceVectors:
    """FB_TEPredict at operating points inside the trained range."""
    lower = np.array([feature.lower for feature in te.features], dtype=np.float64)
    upper = np.array([feature.upper for feature in te.features], dtype=np.float64)
    x = lower + (upper - lower) * np.random.default_rng(0).random((ROWS, len(te.features)))
    models = {model.ir.name: model for model in bundle.models}

    def by_library(model: ModelIR, rows: FloatArray) -> FloatArray:
        return models[model.name].predict(reference.limited(model, rows))

    results: list[str] = []
    expected, allowed = [], []
    sure = np.ones(len(x), np.bool_)
    for direction in te.directions:
        found = harmonics(bundle.project, te, direction, x, evaluate=by_library)
        sure &= np.all((np.abs(found.phase) < _HALF_TURN) & np.isfinite(found.phase_bound), axis=1)
        for kind, values, bound in (
            ("aAmplitude", found.amplitude, found.amplitude_bound),
            ("aPhase", found.phase, found.phase_bound),
        ):
            results += [f"{kind}{SUFFIX[direction]}[{number}]" for number in range(values.shape[1])]
            expected.append(values)
            allowed.append(bound)
    return ReferenceVectors(
        name="TEPredict",
        block="FB_TEPredict",
        results=tuple(results),
        inputs=x[sure],
        expected=np.hstack(expected)[sure],
        allowed=np.hstack(allowed)[sure],
        refuses_nan=True,
    )
