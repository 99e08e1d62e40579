"""A folder of model files, with or without `bundle.toml`: named, typed, checked models.

Without `bundle.toml` every model file becomes a block of its own. With it the folder is a transmission error bundle,
described as `bundle_file.py` says.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from st_codegen.emit.literals import identifier
from st_codegen.errors import InputError, Problems, with_subject
from st_codegen.ir import (
    Feature,
    FloatArray,
    HarmonicOutput,
    ModelIR,
    ProjectIR,
    Select,
    TransmissionError,
)
from st_codegen.passes.domain import limit_inputs
from st_codegen.te.bundle_file import BUNDLE_FILE, Reference, read_description
from st_codegen.walkers.base import LoadedModel, Predictor
from st_codegen.walkers.files import KNOWN_FORMATS, SUFFIXES, load_model

#: Called with (number of files done, number of files, name of the next one).
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Bundle:
    """Models ready for compilation, in the order of their names."""

    models: tuple[LoadedModel, ...]
    transmission_error: TransmissionError | None

    @property
    def project(self) -> ProjectIR:
        """What the targets are given."""
        return ProjectIR(tuple(model.ir for model in self.models), self.transmission_error)


def load(folder: Path | str, *, trust_pickle: bool = False, progress: Progress | None = None) -> Bundle:
    """Load a folder of models (or one model file).

    Raises one InputError that lists everything that is wrong: files, models, names, and the bundle's description.
    """
    folder = Path(folder)
    if not folder.exists():
        raise InputError(f"{folder}: no such folder")
    if folder.is_dir() and (folder / BUNDLE_FILE).is_file():
        return _load_bundle(folder, trust_pickle, progress)
    files = [folder] if folder.is_file() else sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES)
    if not files:
        raise InputError(f"{folder}: no model files; supported are {KNOWN_FORMATS}")
    problems = Problems(str(folder))
    _check_names([path.stem for path in files], problems)
    models = _load_files({path.stem: path for path in files}, trust_pickle, progress, problems)
    finished = tuple(_finished(model, problems) for model in models.values())
    problems.raise_if_any()
    return Bundle(finished, None)


def _check_names(names: Sequence[str], problems: Problems) -> None:
    """Names must differ as Structured Text sees them: without case, punctuation as underscores."""
    taken: dict[str, str] = {}
    for name in names:
        with problems.collect():
            key = identifier(name, "model name").lower()
            if key in taken:
                raise InputError(
                    f"two models would be called FB_{identifier(name, 'model name')}: {taken[key]} and {name}; "
                    "rename one of the files"
                )
            taken[key] = name


def _load_files(
    files: dict[str, Path], trust_pickle: bool, progress: Progress | None, problems: Problems
) -> dict[str, LoadedModel]:
    models = {}
    for number, (name, path) in enumerate(files.items()):
        if progress is not None:
            progress(number, len(files), path.name)
        with problems.collect():
            try:
                models[name] = load_model(path, name, trust_pickle=trust_pickle)
            except InputError as error:
                if path.name in str(error):
                    raise
                raise with_subject(error, path.name) from error
    if progress is not None:
        progress(len(files), len(files), "")
    return models


def _finished(model: LoadedModel, problems: Problems) -> LoadedModel:
    """The model with the limits of its inputs."""
    with problems.collect():
        return LoadedModel(limit_inputs(model.ir), model.predict)
    return model


def _load_bundle(folder: Path, trust_pickle: bool, progress: Progress | None) -> Bundle:
    description = read_description(folder / BUNDLE_FILE)
    problems = Problems(str(folder / BUNDLE_FILE))
    files = {Path(reference.file).stem: folder / reference.file for reference in description.references}
    _check_names(sorted(files), problems)
    problems.raise_if_any()
    loaded = _load_files({name: files[name] for name in sorted(files)}, trust_pickle, progress, problems)
    models = {name: _for_bundle(model, description.features, problems) for name, model in loaded.items()}
    outputs = tuple(_output(reference, models, problems) for reference in description.references)
    problems.raise_if_any()
    error = TransmissionError(
        name=description.name,
        features=description.features,
        speed_feature=description.speed_feature,
        reduction_ratio=description.reduction_ratio,
        orders=description.orders,
        directions=description.directions,
        outputs=outputs,
        tasks=description.tasks,
    )
    return Bundle(tuple(models.values()), error)


def _output(reference: Reference, models: dict[str, LoadedModel], problems: Problems) -> HarmonicOutput:
    name = Path(reference.file).stem
    if name in models and not 0 <= reference.output < len(models[name].ir.outputs):
        problems.add(
            f"order {reference.order} {reference.direction}: output {reference.output} of '{reference.file}', "
            f"which has {len(models[name].ir.outputs)} (counted from 0)"
        )
    return HarmonicOutput(
        reference.direction, reference.order, reference.quantity, name, reference.output, reference.added
    )


def _for_bundle(model: LoadedModel, features: tuple[Feature, ...], problems: Problems) -> LoadedModel:
    """The model on the bundle's features: their names, units, ranges and order."""
    with problems.collect():
        order = _feature_order(model.ir, features)
        ir, predict = model.ir, model.predict
        if order != list(range(len(features))):
            ir = _reordered(ir, order)
            predict = _reordered_predictor(predict, order)
        return LoadedModel(limit_inputs(dataclasses.replace(ir, features=features)), predict)
    return model


def _feature_order(model: ModelIR, features: tuple[Feature, ...]) -> list[int]:
    """For each feature of the model, its place in the bundle: by name where the names are the same, else in order."""
    names, given = [f.name for f in model.features], [f.name for f in features]
    if len(names) != len(given):
        raise InputError(
            f"model '{model.name}' takes {len(names)} features ({', '.join(names)}), the bundle has {len(given)} "
            f"({', '.join(given)})"
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
