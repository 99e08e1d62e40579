"""The first `st-codegen.toml` of a folder: everything that its model files know, to be completed by hand."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path

import numpy as np

from st_codegen.emit.blocks.model import input_variables
from st_codegen.emit.literals import MAX_IDENTIFIER, capitalised, identifier, spelt
from st_codegen.errors import InputError, Problems, counted
from st_codegen.files.csv_tables import meant_column, with_underscores
from st_codegen.files.toml_text import table_lines, toml_value
from st_codegen.ir import Feature, FloatArray, ModelIR
from st_codegen.passes.outputs import with_outputs
from st_codegen.project.bundle import READERS, Reading
from st_codegen.walkers.files import known_formats, suffixes

_HEAD = """\
# What the generated project is called, and what the model files do not know: complete it by hand.
# Keys that may be added: [project] name, prefix, attributes; [[input]] min, max and outside = "clamp" or "flag";
# [[model]] layout, metrics = {"MAE, kW" = 0.2}; outputs unit, min and max.
"""
#: What rounding in a table may take from a range, as a share of it: three digits.
_ROUNDING = 1e-3


def initial_configuration(
    folder: Path,
    training_data: Callable[[Collection[str]], Mapping[str, FloatArray]] | None = None,
    training_sha256: str = "",
    *,
    trust_pickle: bool = False,
) -> str:
    """The text of a configuration for a folder of models.

    `training_data` gives a table with a column of values for each feature that it is asked for, of which the range is
    written; `training_sha256` is that of its file. Raises InputError where the folder has no model file, or is
    described by a file of its own, and where a model was trained with other data.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    for name in READERS:
        if (folder / name).is_file():
            raise InputError(f"{folder / name} describes these models; it has names, units and ranges")
    files = {p.name: p for p in sorted(folder.iterdir()) if p.suffix.lower() in suffixes()}
    models, reasons = {}, {}
    for name, path in files.items():
        problems = Problems(str(folder))
        found = Reading(trust_pickle).models({"m": path}, problems)
        if found:
            models[name] = found["m"].ir
        else:
            reasons[name] = _reason(str(problems.errors[0]), name)
    if not models:
        why = "".join(f"\n  - {name}: {reason}" for name, reason in reasons.items())
        raise InputError(f"{folder}: no model files; supported are {known_formats()}{why}")
    table = None if training_data is None else training_data([feature.name for feature in _features(models)])
    if table is not None:
        _check_trained_with(table, models)
    project = _plain(folder.resolve().name, "") or "Models"
    lines = [_HEAD, "[project]", f"name = {toml_value(project)}"]
    if reasons:
        lines += ["leave_out = [", *(f"    {toml_value(name)},  # {reason}" for name, reason in reasons.items()), "]"]
    lines += ["", "[build]", 'target = ["twincat"]', 'out = "generated"']
    variables = _variables(models)
    for feature in _features(models):
        lines += ["", *_input(feature, variables[feature.name], table)]
    for file, name in _names(models).items():
        lines += ["", *_model(file, name, models[file])]
        lines += [f"training_sha256 = {toml_value(training_sha256)}"] if training_sha256 else []
    return "\n".join(lines) + "\n"


def _reason(message: str, name: str) -> str:
    """Why a file is left out, as a comment beside its name: without the name and the advice to leave it out."""
    line = message.splitlines()[0].removeprefix(f"{name}: ").partition("; if it is no model, name it in leave_out")[0]
    return "".join(c if " " <= c <= "~" else "?" for c in line)


def _check_trained_with(table: Mapping[str, FloatArray], models: Mapping[str, ModelIR]) -> None:
    """Raise InputError where the table has no rows, or lacks a column, or what a model's file knows of one.

    A file knows both ends of a range that was there (`Feature.seen`); a table with fewer digits may miss them by some.
    """
    if not any(column.size for column in table.values()):
        raise InputError("training data: the table has no rows below its header")
    problems = Problems("training data")
    columns = with_underscores(table)
    wanted = [feature.name for feature in _features(models)]
    for name in wanted:
        if name not in columns:
            near = meant_column(name, table, wanted)
            problems.add(f"no column '{name}'; there are {', '.join(table)}{near}")
    for file, feature in ((file, feature) for file, model in models.items() for feature in model.features):
        values = columns.get(feature.name, np.empty(0))
        if feature.seen is None or not values.size:
            continue
        low, high = feature.seen
        rounding = _ROUNDING * (high - low)
        numbers = values[np.isfinite(values)]
        # with use_missing=false LightGBM reads a missing number as 0, and its file has the range of what it read
        read = np.append(numbers, np.zeros(int(np.isnan(values).any())))
        if not read.size or read.min() > low + rounding or read.max() < high - rounding:
            reaches = "has no finite number"
            if numbers.size:
                reaches = f"reaches from {numbers.min():.6g} to {numbers.max():.6g}"
            problems.add(
                f"column '{feature.name}' {reaches}, and {file} was trained with values from {low:.6g} to "
                f"{high:.6g}: give the table that it was trained with"
            )
    problems.raise_if_any()


def _features(models: Mapping[str, ModelIR]) -> list[Feature]:
    """Each feature of any model once, as the first model has it that knows it."""
    found: dict[str, Feature] = {}
    for feature in (feature for model in models.values() for feature in model.features):
        found.setdefault(feature.name, feature)
    return list(found.values())


def _input(feature: Feature, variable: str, training_data: Mapping[str, FloatArray] | None) -> list[str]:
    values = {"feature": feature.name, "name": variable, "unit": feature.unit}
    lines = table_lines("[[input]]", values)
    if training_data is None:
        return lines  # a file that knows its range states it anew whenever its model is trained again
    column = with_underscores(training_data)[feature.name]
    if np.isinf(column).any():
        return [*lines, f"# no range: {np.isinf(column).sum()} of {counted(column.size, 'value')} infinite"]
    column = column[np.isfinite(column)]
    if not column.size:
        return [*lines, "# no range: no value is there"]
    return [*lines, f"trained = {toml_value((float(column.min()), float(column.max())))}"]


def _variables(models: Mapping[str, ModelIR]) -> dict[str, str]:
    """A name for the input of each feature, no two alike in one model, whatever their case."""
    beside = [{feature.name for feature in model.features} for model in models.values()]
    found: dict[str, str] = {}
    for feature in _features(models):
        near = set().union(*(names for names in beside if feature.name in names))
        taken = {variable.lower() for name, variable in found.items() if name in near}
        name = first = _variable(feature)[:MAX_IDENTIFIER].rstrip("_")
        alike = itertools.count(2)
        while name.lower() in taken:
            name = f"{first[: MAX_IDENTIFIER - 4].rstrip('_')}_{next(alike)}"
        found[feature.name] = name
    return found


def _variable(feature: Feature) -> str:
    """The name that the block's input has by itself, or one of the ASCII letters in the feature's name."""
    try:
        return input_variables((feature,))[0].name
    except InputError:
        return f"fInput_{_plain(feature.name, 'x')}"


def _names(files: Iterable[str]) -> dict[str, str]:
    """A name for the model of each file, in the letters of Structured Text, no two alike."""
    names: dict[str, str] = {}
    taken: set[str] = set()
    for file in files:
        stem = Path(file).stem
        try:
            text = identifier(stem, "model name", "FB_")
        except InputError:
            text = stem = _plain(stem, "model")
        alike = itertools.count(2)
        name = stem
        while text.lower() in taken:
            name = text = f"{_plain(stem, 'model')}_{next(alike)}"
        taken.add(text.lower())
        names[file] = name
    return names


def _model(file: str, name: str, model: ModelIR) -> list[str]:
    if model.classes is not None:  # the outputs of a classifier have names of their own
        return table_lines("[[model]]", {"file": file, "name": name})
    given, _ = with_outputs(model, ())  # what is given on demand only is no output of the first block
    outputs = ", ".join(f'{{name = "{variable}", unit = ""}}' for variable in given.variables)
    return [*table_lines("[[model]]", {"file": file, "name": name}), f"outputs = [{outputs}]"]


def _plain(text: str, otherwise: str) -> str:
    """The ASCII letters and digits of a name."""
    words = re.sub(r"\W+", "_", re.sub(r"_+", "_", spelt(text))).strip("_")[: MAX_IDENTIFIER - 10]
    return capitalised(words) if words[:1].isalpha() else otherwise + words
