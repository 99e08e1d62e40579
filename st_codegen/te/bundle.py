"""A folder of models with `bundle.toml`: a transmission error bundle, described as `bundle_file.py` says."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from st_codegen.errors import InputError, Problems, counted
from st_codegen.ir import Feature, FloatArray, ModelIR, Select
from st_codegen.passes.domain import limit_inputs
from st_codegen.passes.inexact import without_inexact_steps
from st_codegen.project.bundle import READERS, Bundle, Reading, check_names
from st_codegen.project.purpose import ANSWERS
from st_codegen.te.bundle_file import BUNDLE_FILE, read_description
from st_codegen.te.check import PREDICT, predicted
from st_codegen.te.harmonics import HarmonicOutput
from st_codegen.te.purpose import Compensation
from st_codegen.walkers.base import LoadedModel, Predictor


def read_bundle(path: Path, reading: Reading) -> Bundle:
    """The bundle that a `bundle.toml` describes. Raises one InputError that lists everything that is wrong."""
    described = read_description(path)
    problems = Problems(str(path))
    files = {Path(output.model).stem: path.parent / output.model for output in described.outputs}
    check_names({files[name].name: name for name in sorted(files)}, problems)
    problems.raise_if_any()
    loaded = reading.models({name: files[name] for name in sorted(files)}, problems)
    features = _with_training_data(described.features, loaded.values())
    models = {name: _for_bundle(model, features, problems) for name, model in loaded.items()}
    outputs = tuple(_output(output, models, problems) for output in described.outputs)
    problems.raise_if_any()
    te = dataclasses.replace(described, features=features, outputs=outputs)
    return Bundle(tuple(models.values()), Compensation(te))


def _output(output: HarmonicOutput, models: dict[str, LoadedModel], problems: Problems) -> HarmonicOutput:
    """An output with the name of its model in place of that of its file."""
    name = Path(output.model).stem
    if name in models and not 0 <= output.output < len(models[name].ir.outputs):
        problems.add(
            f"order {output.order} {output.direction}: output {output.output} of '{output.model}', "
            f"which has {len(models[name].ir.outputs)} (counted from 0)"
        )
    return dataclasses.replace(output, model=name)


def _for_bundle(model: LoadedModel, features: tuple[Feature, ...], problems: Problems) -> LoadedModel:
    """The model on the bundle's features: their names, units, ranges and order."""
    with problems.collect():
        if model.ir.classes is not None:
            raise InputError(f"model '{model.ir.name}' gives classes; amplitudes, phases and their parts are numbers")
        order = _feature_order(model.ir, features)
        ir, predict = model.ir, model.predict
        if order != list(range(len(features))):
            ir = _reordered(ir, order)
            predict = _reordered_predictor(predict, order)
        ir = limit_inputs(dataclasses.replace(ir, features=features))
        return LoadedModel(without_inexact_steps(ir), predict)
    return model


def _with_training_data(features: tuple[Feature, ...], models: Iterable[LoadedModel]) -> tuple[Feature, ...]:
    """The bundle's features, with what the training data of all models reach that know it of theirs."""
    ends: dict[int, list[tuple[float, float]]] = {}
    for model in models:
        with contextlib.suppress(InputError):  # said where the model is taken into the bundle
            for number, own in zip(_feature_order(model.ir, features), model.ir.features, strict=True):
                ends.setdefault(number, []).extend([own.seen] if own.seen is not None else [])
    shared = {
        number: (max(low for low, _ in known), min(high for _, high in known))
        for number, known in ends.items()
        if known
    }
    return tuple(
        dataclasses.replace(feature, seen=shared[number])
        if number in shared and shared[number][0] <= shared[number][1]
        else feature
        for number, feature in enumerate(features)
    )


def _feature_order(model: ModelIR, features: tuple[Feature, ...]) -> list[int]:
    """The position in the bundle of each feature of the model: by name where the names are the same, else in order."""
    names, given = [f.name for f in model.features], [f.name for f in features]
    if len(names) != len(given):
        raise InputError(
            f"model '{model.name}' takes {counted(len(names), 'feature')} ({', '.join(names)}), the bundle has "
            f"{len(given)} ({', '.join(given)})"
        )
    if set(names) == set(given):
        return [given.index(name) for name in names]
    if set(names) & set(given):
        raise InputError(
            f"model '{model.name}' has the features {', '.join(names)}, the bundle {', '.join(given)}: give them the "
            "same names, or train on an array without names"
        )
    return list(range(len(given)))


def _reordered(model: ModelIR, order: list[int]) -> ModelIR:
    """The model behind a selection of columns."""
    shifted = [
        dataclasses.replace(op, inputs=tuple(value + 1 for value in op.inputs))  # type: ignore[type-var]
        for op in model.ops
    ]
    return dataclasses.replace(model, ops=(Select((0,), np.array(order, np.int32)), *shifted))


def _reordered_predictor(predict: Predictor, order: list[int]) -> Predictor:
    def reordered(x: FloatArray) -> FloatArray:
        return predict(np.ascontiguousarray(x[:, order]))

    return reordered


READERS[BUNDLE_FILE] = read_bundle
ANSWERS[PREDICT] = predicted
