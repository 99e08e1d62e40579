"""Blocks that keep a window of samples, run call by call against the blocks of their models."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from st_codegen.emit.blocks.model import block_name
from st_codegen.emit.blocks.window import SUFFIX, Window
from st_codegen.ir import BoolArray, FloatArray, ModelIR
from st_codegen.project.purpose import BlockCheck
from st_codegen.proof.probes import probe_rows
from st_codegen.proof.runner import GeneratedCode

#: Calls with a full window, before it is emptied and filled again.
_FULL = 12


def window_checks(
    models: Sequence[ModelIR], windows: Mapping[str, Window], code: GeneratedCode, seed: int
) -> Iterator[BlockCheck]:
    """Each window's block on a sequence of samples, with pauses and a reset, against its model's block on each window.

    Both are the same arithmetic, so the outputs must be equal to the bit; NaN stands for outputs that are not valid.
    """
    for model in models:
        window = windows.get(model.name)
        if window is None:
            continue
        names, block = window.names(len(model.features)), f"{block_name(model.name)}{SUFFIX}"
        samples, shift, reset = _sequence(model, window, len(names), seed)
        inputs = {**dict(zip(names, samples.T, strict=True)), "bShift": shift, "bReset": reset}
        found = code.sequence(block, inputs)
        outputs = list(found)[: len(model.outputs)]
        got = np.column_stack([found[name].astype(np.float64) for name in outputs])
        rows, filled = _windows(window, samples, shift, reset)
        alone = code.run_model(block_name(model.name), rows, len(model.outputs))
        expected = np.where((filled & alone.valid)[:, None], alone.values, np.nan)
        got = np.where(found["bValid"].astype(np.bool_)[:, None], got, np.nan)
        yield BlockCheck(block, np.column_stack([samples, shift, reset]), expected, got, np.zeros(got.shape))


def _sequence(model: ModelIR, window: Window, count: int, seed: int) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Samples (calls, numbers of one) with those calls that take one and those that forget all."""
    calls = 2 * window.length + _FULL + 4
    rows = probe_rows(model, max(calls, 100), seed)
    calm = np.all(np.isfinite(rows), axis=1)
    rows = np.resize(rows[calm] if np.any(calm) else rows, (calls, len(model.features)))
    newest = slice(-count, None) if window.by_sample else slice(window.length - 1, None, window.length)
    samples = rows[:, newest].copy()
    shift, reset = np.ones(calls, np.bool_), np.zeros(calls, np.bool_)
    shift[[1, window.length + 3]] = False
    reset[window.length + _FULL] = True
    samples[window.length + _FULL - 2] = np.nan  # which stays in the window until the reset
    return samples, shift, reset


def _windows(window: Window, samples: FloatArray, shift: BoolArray, reset: BoolArray) -> tuple[FloatArray, BoolArray]:
    """The features after each call, shape (calls, features), and whether there are enough samples for them."""
    rows = np.zeros((len(samples), window.length * samples.shape[1]))
    filled = np.zeros(len(samples), np.bool_)
    kept: list[FloatArray] = []
    for call, sample in enumerate(samples):
        kept = [] if reset[call] else kept
        kept = [*kept, sample][-window.length :] if shift[call] else kept
        filled[call] = len(kept) == window.length
        if filled[call]:
            whole = np.array(kept)
            rows[call] = np.ravel(whole if window.by_sample else whole.T)
    return rows, filled
