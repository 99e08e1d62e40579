"""Predictions of models for a table of inputs, by three ways that must agree: library, reference, emitted text."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

import numpy as np

from st_codegen.emit.output import block_of
from st_codegen.errors import InputError, Problems, counted
from st_codegen.files.csv_tables import csv_text, meant_column, read_csv, underscored, with_underscores
from st_codegen.files.number_text import plain_number
from st_codegen.ir import AnyArray, Classes, FloatArray, ModelIR, reference
from st_codegen.project.bundle import Bundle
from st_codegen.proof.isolated import answers_to
from st_codegen.proof.runner import GeneratedCode
from st_codegen.walkers.base import LoadedModel

#: Computes a model for rows (rows, features), shape (rows, outputs); NaN in rows that it has no answer to.
Answer = Callable[[LoadedModel, FloatArray], FloatArray]


def predict(
    bundle: Bundle, columns: dict[str, FloatArray], answer: Answer, *, table: str = "the table of inputs"
) -> dict[str, AnyArray]:
    """Predict every model for columns of inputs, by feature name (or `f0`, `f1`, .. by position).

    Returns a column a model, headed by its name, `name[i]` (from 0) where it has several outputs; NaN where there is
    no answer. Of a classifier, `name` holds the library's own labels, and `name[i]` the numbers beside them.
    Raises one InputError that lists all missing features, and calls the columns `table`.
    """
    problems = Problems(table)
    inputs = {}
    for model in bundle.models:
        with problems.collect():
            inputs[model.ir.name] = _rows(model.ir, columns)
    problems.raise_if_any()
    named: dict[str, AnyArray] = {}
    for model in bundle.models:
        name, values = model.ir.name, answer(model, inputs[model.ir.name])
        if model.ir.classes is not None:
            named[name] = _labels(model.ir.classes, values[:, 0])
            values = values[:, 1:]
        for output in range(values.shape[1]):
            named[f"{name}[{output}]" if name in named or values.shape[1] > 1 else name] = values[:, output]
    return named


def _labels(classes: Classes, numbers: FloatArray) -> AnyArray:
    """The label of each number of a class; NaN where there is none."""
    return np.array([classes.labels[int(number)] if number >= 0 else math.nan for number in numbers], object)


def _rows(model: ModelIR, columns: dict[str, FloatArray]) -> FloatArray:
    """The model's inputs (rows, features): by its own names, else by position."""
    known = with_underscores(columns)
    for names in ([feature.name for feature in model.features], [f"f{n}" for n in range(len(model.features))]):
        if all(name in known for name in names):
            return np.column_stack([known[name] for name in names])
    wanted = [feature.name for feature in model.features]
    missing = [name for name in wanted if name not in known]
    near = meant_column(missing[0], columns, wanted) if len(missing) == 1 else ""
    raise InputError(f"model '{model.name}': no column {', '.join(missing)}; the header has {', '.join(columns)}{near}")


def limits(models: Sequence[ModelIR], columns: dict[str, FloatArray]) -> list[str]:
    """Which inputs lie outside of a declared range: every way computes with its nearest end, as the block does.

    Models that limit an input of this name in another way, or not, are told apart by their names.
    """
    found: dict[tuple[str, str], list[str]] = {}
    having = Counter(feature.name for model in models for feature in model.features)
    for model in models:
        rows = _rows(model, columns)
        outside = np.count_nonzero((reference.limited(model, rows) != rows) & ~np.isnan(rows), axis=0)
        for feature, number in zip(model.features, outside, strict=True):
            if number:
                ends = " .. ".join(plain_number(end) for end in (feature.lower, feature.upper) if end is not None)
                text = f"{feature.name} ({ends}) in {number:,} of {counted(len(rows), 'row')}"
                found.setdefault((feature.name, text), []).append(model.name)
    return [
        text if len(own) == having[name] else f"{text} for {', '.join(own)}"
        for (name, text), own in sorted(found.items())
    ]


def by_reference(model: LoadedModel, x: FloatArray) -> FloatArray:
    """The answer of the intermediate representation, in NumPy."""
    return reference.evaluate(model.ir, x)


def by_library(model: LoadedModel, x: FloatArray) -> FloatArray:
    """The answer of the source library, to rows that a block refuses as well; NaN in rows that it refuses itself."""
    x = reference.limited(model.ir, x)
    usable = np.all(np.isfinite(by_reference(model, x)), axis=1)
    result = np.full((len(x), len(model.ir.outputs)), np.nan)
    if usable.any():
        result[usable] = model.predict(x[usable])
    result[~usable], _ = answers_to(model, x[~usable])
    return result


def by_text(code: GeneratedCode) -> Answer:
    """The answers of generated text."""

    def answer(model: LoadedModel, x: FloatArray) -> FloatArray:
        block, outputs = block_of(code.folder, model.ir)
        result = code.run_model(block, x, outputs)
        return np.where(result.valid[:, None], result.values, np.nan)

    return answer


def read_table(path: Path, features: Collection[str] = ()) -> dict[str, FloatArray]:
    """A CSV table with a header, as columns of numbers; `nan` and `inf` allowed.

    Of a table that has more than `features`, such as what is to be predicted in words, only their columns are read; the
    others have NaN. Without any all are. Raises one InputError that lists every bad cell (the first of many) with its
    line. A row without a number is one, since predictions are found by their rows.
    """
    problems = Problems(str(path))
    table = read_csv(path)
    if not all(table.names):
        raise InputError(
            f"{path}: the first line must name the features, a column has no name (pandas' index? to_csv(.., "
            "index=False) leaves it out)"
        )
    for line in table.empty:
        problems.add(f"line {line}: all cells are empty; a missing number is written nan")
    read = [name for name in table.names if not features or name in features or underscored(name) in features]
    values = table.numbers(read, problems, is_finite=False)
    problems.raise_if_any()
    others = dict.fromkeys(table.names, np.full(len(table.rows), np.nan))
    return others | dict(zip(read, values.T, strict=True))


def columns_of(models: Sequence[ModelIR]) -> set[str]:
    """The names that columns of a table may have of which models are predicted."""
    return {name for model in models for n, feature in enumerate(model.features) for name in (feature.name, f"f{n}")}


def table_text(columns: dict[str, AnyArray]) -> str:
    """Columns as CSV, numbers as `%.17g`, which reads back as the same bits, labels as they are."""
    rows = zip(*columns.values(), strict=True)
    cells = ([f"{cell:.17g}" if isinstance(cell, float) else str(cell) for cell in row] for row in rows)
    return csv_text([columns, *cells])
