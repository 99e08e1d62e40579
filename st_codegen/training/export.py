"""Fitted models as a bundle folder that the compiler takes: one file a model, and `bundle.toml`."""

from __future__ import annotations

import copy
import os
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from st_codegen.errors import InputError, MissingExtraError, counted, extra_package
from st_codegen.files.folders import check_replaceable, keep_others, replace_folder
from st_codegen.files.number_text import plain_number
from st_codegen.files.temporary import temporary_folder
from st_codegen.files.text import make_folder
from st_codegen.files.toml_tables import read_toml
from st_codegen.files.toml_text import table_lines
from st_codegen.ir.arrays import FloatArray
from st_codegen.te.bundle_file import BUNDLE_FILE
from st_codegen.te.harmonics import AxisCorrection, Direction, Quantity

#: name, unit
FEATURES = (("speed_rpm", "rpm"), ("torque_Nm", "N m"), ("temperature_C", "degC"))
_LETTERS = {Quantity.AMPLITUDE: "A", Quantity.PHASE: "phi", Quantity.COSINE: "C", Quantity.SINE: "S"}
FORMATS = ("native", "skops", "onnx")


@dataclass(frozen=True)
class FittedModel:
    """A model and what it predicts."""

    direction: Direction
    order: int
    quantity: Quantity
    estimator: Any

    @property
    def stem(self) -> str:
        """File name without suffix: `phi39_forward`."""
        return f"{_LETTERS[self.quantity]}{self.order}_{self.direction}"


#: what a direction lacks of a range, as a part of it, to be told: sensors read each run a little differently
_ANOTHER = 0.01


@dataclass(frozen=True)
class BundleHead:
    """The head of a `bundle.toml`: name, reduction ratio, range of each feature (3, 2), play where it is known."""

    name: str
    reduction_ratio: float
    ranges: FloatArray
    play_deg: float | None = None

    def narrower(self, conditions: FloatArray) -> list[str]:
        """The features that do not reach over the whole range in some rows (n, 3), and from where to where they go."""
        ends = zip(FEATURES, self.ranges, conditions.min(axis=0), conditions.max(axis=0), strict=True)
        return [
            f"{name} {plain_number(low)} to {plain_number(high)}"
            for (name, _), whole, low, high in ends
            if max(low - whole[0], whole[1] - high) > _ANOTHER * (whole[1] - whole[0])
        ]

    def constant(self) -> dict[str, float]:
        """The features of which the models know one value, and that value."""
        return {name: float(low) for (name, _), (low, high) in zip(FEATURES, self.ranges, strict=True) if low == high}


def write_bundle(
    folder: Path, head: BundleHead, models: Sequence[FittedModel], form: str = "native"
) -> tuple[str, ...]:
    """Write a bundle; the folder appears complete or not at all, and replaces an earlier bundle.

    What else is in the folder stays: of an earlier bundle, its file and those that this names are replaced. Its
    description and number of tasks, which say nothing of its models, are kept. Returns what it had for its own models.

    form: `native` (LightGBM text, XGBoost JSON, skops for scikit-learn), `skops` for all, or `onnx` for all.
    Raises InputError where the folder holds something else, or a model cannot be saved in the form.
    """
    if form not in FORMATS:
        raise InputError(f"unknown format '{form}'; known are {', '.join(FORMATS)}")
    check_place(folder)
    folder = Path(os.path.realpath(folder))
    make_folder(folder.parent)
    with temporary_folder(folder.parent) as made:
        stage = made / "bundle"
        stage.mkdir()
        files = {model.stem: save_model(model.estimator, stage, model.stem, form) for model in models}
        earlier = _earlier(folder)
        text = bundle_text(head, models, files, kept=_kept(earlier))
        (stage / BUNDLE_FILE).write_text(text, encoding="utf-8", newline="\n")
        keep_others(folder, stage, {BUNDLE_FILE, *_named(earlier)})
        replace_folder(stage, folder)
    return tuple(_dropped(earlier))


def _earlier(folder: Path) -> dict[str, Any]:
    """What the bundle.toml of a folder says; nothing where there is none. Raises InputError where it is no TOML."""
    return read_toml(folder / BUNDLE_FILE) if (folder / BUNDLE_FILE).is_file() else {}


def _tables(earlier: Mapping[str, Any], name: str) -> list[dict[str, Any]]:
    found = earlier.get(name)
    return [one for one in found if isinstance(one, dict)] if isinstance(found, list) else []


def _named(earlier: Mapping[str, Any]) -> set[str]:
    """The files of a bundle's harmonics. Those of [[term]] tables, which `train` never writes, are none of them."""
    values = [harmonic.get(quantity.value) for harmonic in _tables(earlier, "harmonic") for quantity in Quantity]
    files = [value.get("file") if isinstance(value, dict) else value for value in values]
    return {file for file in files if isinstance(file, str)}


def _kept(earlier: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of [bundle] that somebody wrote and that hold whatever the models are."""
    bundle = earlier.get("bundle")
    given = bundle if isinstance(bundle, dict) else {}
    description, tasks = given.get("description"), given.get("tasks")
    found = {"description": description} if isinstance(description, str) else {}
    return found | ({"tasks": 2} if tasks == 2 else {})


def _dropped(earlier: Mapping[str, Any]) -> Iterator[str]:
    """What an earlier bundle had beside its models that holds for these only."""
    if terms := len(_tables(earlier, "term")):
        yield f"{counted(terms, '[[term]] table')} (whose files stay)"
    for key in ("factor", "turn_rad", "offset_deg"):
        if times := sum(key in harmonic for harmonic in _tables(earlier, "harmonic")):
            yield f"{key} of {counted(times, 'harmonic')}"


def check_place(folder: Path) -> None:
    """Raise InputError where a bundle would replace something else, or one of which nobody can tell its files."""
    check_replaceable(folder)
    _earlier(folder)
    if folder.exists() and any(folder.iterdir()) and not (folder / BUNDLE_FILE).is_file():
        raise InputError(f"{folder} exists and is no bundle: name another folder")


def bundle_text(
    head: BundleHead,
    models: Sequence[FittedModel],
    files: Mapping[str, str],
    corrections: Sequence[AxisCorrection] = (),
    kept: Mapping[str, Any] | None = None,
) -> str:
    """The text of `bundle.toml`; `files` gives the file of each stem, `corrections`: what an axis has of them.

    `kept` are further keys of the table [bundle].
    """
    directions = list(dict.fromkeys(model.direction for model in models))
    orders = sorted({model.order for model in models})
    tables = [
        table_lines(
            "[bundle]",
            {
                "name": head.name,
                "reduction_ratio": float(head.reduction_ratio),
                "speed_feature": FEATURES[0][0],
                "directions": [direction.value for direction in directions],
                "orders": orders,
                **(kept or {}),
            },
        )
    ]
    for (name, unit), (low, high) in zip(FEATURES, head.ranges, strict=True):
        tables.append(table_lines("[[feature]]", {"name": name, "unit": unit, "min": float(low), "max": float(high)}))
    if head.play_deg is not None and 0 in orders and len(directions) == 2:
        tables.append(table_lines("[play]", {"angle_deg": head.play_deg, "torque_feature": FEATURES[1][0]}))
    for direction in directions:
        for order in orders:
            own = [model for model in models if (model.direction, model.order) == (direction, order)]
            named: dict[str, Any] = {model.quantity.value: files[model.stem] for model in own}
            for correction in corrections:
                if (correction.direction, correction.order) == (direction, order):
                    key = "turn_rad" if order else "offset_deg"
                    named |= {"factor": correction.factor, key: getattr(correction, key)}
            tables.append(table_lines("[[harmonic]]", {"direction": direction.value, "order": order, **named}))
    return "\n\n".join("\n".join(lines) for lines in tables) + "\n"


def save_model(estimator: Any, folder: Path, stem: str, form: str) -> str:
    """Save one model; returns the file's name. Raises InputError, MissingExtraError."""
    if form == "onnx":
        return _save_onnx(estimator, folder, f"{stem}.onnx")
    if form == "native":
        package = type(estimator).__module__.partition(".")[0]
        if package == "lightgbm":
            estimator.booster_.save_model(folder / f"{stem}.txt")
            return f"{stem}.txt"
        if package == "xgboost":
            estimator.save_model(folder / f"{stem}.json")
            return f"{stem}.json"
    skops = extra_package("skops.io", "sklearn", "saving scikit-learn models")
    skops.dump(estimator, folder / f"{stem}.skops", compression=zipfile.ZIP_DEFLATED)
    return f"{stem}.skops"


#: Class of the regressor inside -> the arrays that its last, linear step multiplies and adds: (weights, biases).
_LAST_STEP: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "SVR": (("dual_coef_", "_dual_coef_"), ("intercept_", "_intercept_")),
    "MLPRegressor": (("coefs_",), ("intercepts_",)),
}


def _folded(estimator: Any) -> Any:
    """The units of the target put into the last linear step, since ONNX has no transformed target."""
    if type(estimator).__name__ != "TransformedTargetRegressor":
        return estimator
    centre, size = float(estimator.transformer_.mean_[0]), float(estimator.transformer_.scale_[0])
    inside = copy.deepcopy(estimator.regressor_)
    last = inside.steps[-1][1] if hasattr(inside, "steps") else inside
    if type(last).__name__ not in _LAST_STEP:
        raise InputError(f"a {type(last).__name__} of scaled values")
    weights, biases = _LAST_STEP[type(last).__name__]
    for name in weights:
        _change_last(last, name, size, 0.0)
    for name in biases:
        _change_last(last, name, size, centre)
    return inside


def _change_last(regressor: Any, name: str, size: float, centre: float) -> None:
    """An array, or the last of a list of arrays, times `size` plus `centre`."""
    value = getattr(regressor, name)
    if isinstance(value, list):
        value[-1] = value[-1] * size + centre
    else:
        setattr(regressor, name, value * size + centre)


def _save_onnx(estimator: Any, folder: Path, name: str) -> str:
    """Through skl2onnx, whose conversion of trees and kernels is float32."""
    try:
        from onnx import save_model as save_onnx
        from skl2onnx import to_onnx
        from skl2onnx.common.data_types import FloatTensorType
    except ImportError:
        raise MissingExtraError("skl2onnx", "train", "saving models as ONNX") from None
    kind = type(estimator).__name__
    try:
        features = [("x", FloatTensorType([None, len(FEATURES)]))]
        made = to_onnx(_folded(estimator), initial_types=features, target_opset=17)
    except Exception as error:  # the converters raise whatever comes along
        raise InputError(f"{name}: a {kind} cannot be saved as ONNX ({error}); use --format native") from None
    # from a set of Python, whose order differs from run to run
    made.opset_import.sort(key=lambda opset: opset.domain)
    save_onnx(made, folder / name)
    return name
