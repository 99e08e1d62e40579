"""Rows for a test suite of FB_TEPredict, and what the libraries' predictions make of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from st_codegen.emit.blocks.tests import ReferenceVectors
from st_codegen.ir import FloatArray, ModelIR, reference
from st_codegen.proof.vectors import ROWS
from st_codegen.te.check import harmonics
from st_codegen.te.compensation.parts import SUFFIX
from st_codegen.te.harmonics import TransmissionError
from st_codegen.walkers.base import LoadedModel

#: Phases nearer to half a turn may come with either sign.
_HALF_TURN = 3.1


def prediction_vectors(te: TransmissionError, models: Sequence[LoadedModel]) -> ReferenceVectors:
    """FB_TEPredict at operating points inside the declared range."""
    lower = np.array([feature.lower for feature in te.features], dtype=np.float64)
    upper = np.array([feature.upper for feature in te.features], dtype=np.float64)
    x = lower + (upper - lower) * np.random.default_rng(0).random((ROWS, len(te.features)))
    by_name = {model.ir.name: model for model in models}

    def by_library(model: ModelIR, rows: FloatArray) -> FloatArray:
        return by_name[model.name].predict(reference.limited(model, rows))

    results: list[str] = []
    expected, allowed = [], []
    sure = np.ones(len(x), np.bool_)
    for direction in te.directions:
        found = harmonics([model.ir for model in models], te, direction, x, evaluate=by_library)
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
