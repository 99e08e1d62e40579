"""CatBoost's JSON export: oblivious trees, which ask the same questions in all nodes of a level.

Rules of CatBoost 1.2 (catboost/libs/model): inputs and borders are float32, a number above the border sets the bit of
its split, and the bits of all splits of a tree are the number of its leaf. NaN is what `nan_value_treatment` says.
Leaves are added in order in float64; the sum is multiplied with the scale, and the bias is added.
"""

from __future__ import annotations

import dataclasses
import importlib
import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.errors import InputError, UnsupportedModelError, counted
from st_codegen.ir import Feature, FloatArray, Label, Precision, Source, TreeColumn, TreeEnsemble
from st_codegen.walkers.base import Classified, GraphBuilder, LoadedModel, Walked
from st_codegen.walkers.classes import above, complement, largest, numbers_of, softmax
from st_codegen.walkers.forest import ParsedTree, flatten
from st_codegen.walkers.limits import MAX_COLUMNS, check_json
from st_codegen.walkers.objects import NOT_AS_MADE

#: Loss functions of regressions and rankings, by how `predict` answers.
_RAW = frozenset(
    "RMSE MAE Quantile MAPE Huber Expectile LogCosh Lq MultiRMSE MultiQuantile YetiRank YetiRankPairwise "
    "PairLogit PairLogitPairwise QueryRMSE QuerySoftMax StochasticRank LambdaMart".split()
)
_EXPONENT = frozenset(("Poisson", "Tweedie"))
_CLASSES = frozenset(("Logloss", "MultiClass", "MultiClassOneVsAll"))
OBJECTIVES = tuple(sorted(_RAW | _EXPONENT | _CLASSES))

#: Splits of a tree; CatBoost itself grows no deeper.
_MAX_DEPTH = 16
#: What a number that is missing does: whether it goes to the side of small numbers.
_MISSING_LEFT = {"AsIs": True, "AsFalse": True, "AsTrue": False}


def is_export(data: bytes) -> bool:
    """Whether the bytes of a JSON file are an export of CatBoost."""
    return b'"scale_and_bias"' in data and b'"features_info"' in data


def load(data: bytes, name: str, path: Path) -> LoadedModel:
    """The bytes of an export as a model; `predict` needs the package catboost, reading does not.

    Raises InputError for a damaged file, UnsupportedModelError for categories, other trees and unknown losses.
    """
    check_json(data)
    try:
        return _loaded(json.loads(data), name, path)
    except (InputError, MemoryError):
        raise
    except NOT_AS_MADE as error:
        raise InputError(
            f"not as CatBoost writes it ({type(error).__name__}: {error}); export the model again "
            "(save_model(path, format='json'))"
        ) from error


def _loaded(document: dict[str, Any], name: str, path: Path) -> LoadedModel:
    features = document["features_info"]
    if foreign := sorted(kind for kind in features if kind.endswith("_features") and kind != "float_features"):
        raise UnsupportedModelError(
            f"{', '.join(foreign).replace('_', ' ')}: CatBoost makes numbers of them by tables of counts; "
            "encode them before training, and train on numbers"
        )
    if "oblivious_trees" not in document:
        raise UnsupportedModelError("trees that are not symmetric; train with grow_policy='SymmetricTree'")
    known = _features(features["float_features"])
    trees = list(document["oblivious_trees"])
    scale, bias = float(document["scale_and_bias"][0]), np.array(document["scale_and_bias"][1], np.float64)
    if bias.ndim != 1:
        raise InputError("its bias is no list of numbers, which CatBoost takes alone; export the model again")
    if not trees or not len(bias) or not np.all(np.isfinite([scale, *bias])):
        raise InputError("no trees, or a scale or bias that is not finite; train the model again")
    builder = GraphBuilder(len(known))
    ensemble = _ensemble(trees, features["float_features"], len(bias))
    if scale == 1.0:  # the bias is the last of the numbers that are added
        value = builder.add(dataclasses.replace(ensemble, base=bias, base_last=True))
    else:
        value = builder.scale(builder.add(ensemble), "*", scale)
        value = builder.scale(value, "+", bias)
    info = document["model_info"]
    if "params" not in info:
        raise UnsupportedModelError("no training parameters, as sum_models leaves them out: its loss is not known")
    loss = str(info["params"]["loss_function"]["type"])
    result = _result(loss, info, builder, value, len(bias))
    version = str(info.get("catboost_version_info", "")).partition("CatBoost release ")[2].split(" ")[0]
    source = Source("CatBoost", version or "unknown", f"oblivious trees ({loss})")
    labels = result.labels if isinstance(result, Classified) else ()
    numbers = np.concatenate([np.ravel(tree["leaf_values"]) for tree in trees]).astype(np.float64)
    predict = _predictor(path, labels, loss, numbers, (scale, bias))
    return LoadedModel(builder.model(name, known, source, result), predict)


def _features(listed: list[dict[str, Any]]) -> tuple[Feature, ...]:
    """The features in order; f0, f1, .. where the model has no names."""
    if [int(feature["flat_feature_index"]) for feature in listed] != list(range(len(listed))) or not listed:
        raise InputError("the features are not numbered 0, 1, ..; the model file is damaged")
    if len(listed) > MAX_COLUMNS:
        raise UnsupportedModelError(f"{len(listed)} features; more than {MAX_COLUMNS} are not supported")
    names = [str(feature.get("feature_id", "")) for feature in listed]
    named = len(set(names)) == len(names) and all(names) and not all(name.isdecimal() for name in names)
    return tuple(Feature(name if named else f"f{number}") for number, name in enumerate(names))


def _ensemble(trees: list[dict[str, Any]], features: list[dict[str, Any]], outputs: int) -> TreeEnsemble:
    """The sum of the leaves in the order of the trees."""
    missing = [_MISSING_LEFT[feature["nan_value_treatment"]] for feature in features]
    return flatten(
        [_tree(tree, missing, outputs) for tree in trees],
        0,
        lambda feature, _reading, _categories: TreeColumn(feature),
        base=np.zeros(outputs),
        tree_output=np.zeros(len(trees), np.int32),
        input_precision=Precision.FLOAT32,
    )


def _tree(tree: dict[str, Any], missing: list[bool], outputs: int) -> ParsedTree:
    """A tree as nodes: the last split at the root, so that the leaves stand in the order of their numbers."""
    splits = tree["splits"] or []
    values = np.array(tree["leaf_values"], np.float64).reshape(-1, outputs)
    if len(splits) > _MAX_DEPTH or len(values) != 2 ** len(splits):
        raise InputError(
            f"a tree of {counted(len(splits), 'split')} with "
            f"{counted(len(values), 'leaf', 'leaves')}; the model file is damaged"
        )
    if kinds := {str(split["split_type"]) for split in splits} - {"FloatFeature"}:
        raise UnsupportedModelError(f"splits of {', '.join(sorted(kinds))}; train on numbers alone")
    first = len(values) - 1  # of the leaves, behind all splits
    level = np.floor(np.log2(np.arange(1, first + 1))).astype(np.int64)
    order = [splits[len(splits) - 1 - number] for number in level.tolist()]
    feature = np.array([int(split["float_feature_index"]) for split in order], np.int64)
    if np.any((feature < 0) | (feature >= len(missing))):
        raise InputError("a split of a feature that there is not; the model file is damaged")
    border = np.array([float(split["border"]) for split in order]).astype(np.float32).astype(np.float64)
    leaves, nodes = np.full(len(values), -1), np.arange(first)
    return ParsedTree(
        feature=np.concatenate([feature, np.zeros(len(values), np.int64)]),
        reading=np.zeros(2 * first + 1, np.int64),
        threshold=np.concatenate([border, np.zeros(len(values))]),
        left=np.concatenate([2 * nodes + 1, leaves]),
        right=np.concatenate([2 * nodes + 2, leaves]),
        missing_left=np.concatenate([np.array(missing)[feature], np.zeros(len(values), np.bool_)]).astype(np.bool_),
        leaf=np.concatenate([np.full(first, -1), np.arange(len(values))]),
        leaf_value=values,
    )


def _result(loss: str, info: dict[str, Any], builder: GraphBuilder, value: int, outputs: int) -> Walked:
    """What `predict` makes of the sums."""
    if loss in _RAW:
        return value
    if loss in _EXPONENT:
        return builder.function(value, "exp")
    if loss not in _CLASSES:
        raise UnsupportedModelError(f"the loss {loss}: supported are {', '.join(OBJECTIVES)}")
    if "binclass_probability_threshold" in info:
        raise UnsupportedModelError("a probability threshold of its own; decide by the probability around the block")
    labels = _labels(info, max(outputs, 2))
    if loss == "Logloss":
        if outputs != 1:
            raise InputError(f"Logloss with {outputs} sums; the model file is damaged")
        chance = complement(builder, builder.function(value, "logistic"))
        return Classified(labels, above(builder, value), chance, value)
    if loss == "MultiClass":
        return Classified(labels, largest(builder, value), softmax(builder, value), value)
    chances = builder.function(value, "logistic")
    return Classified(labels, largest(builder, value), chances, value)


def _labels(info: dict[str, Any], count: int) -> tuple[Label, ...]:
    given = info.get("class_params", {})
    names, kind = given.get("class_names", list(range(count))), given.get("class_label_type", "Integer")
    expected = {"Integer": int, "String": str, "Float": float}.get(kind)
    if expected is None:
        raise UnsupportedModelError(f"labels of the type {kind}; use numbers or text")
    if len(names) != count or not all(isinstance(label, str | int | float) for label in names):
        raise InputError(
            f"{counted(len(names), 'label')} for {counted(count, 'class', 'classes')}; the model file is damaged"
        )
    return tuple(expected(label) for label in names)


def _predictor(
    path: Path, labels: tuple[Label, ...], loss: str, leaves: FloatArray, scale_and_bias: tuple[float, FloatArray]
) -> Callable[[FloatArray], FloatArray]:
    """CatBoost itself. Its reader of JSON rounds some numbers otherwise, so it is given those of the file again."""

    @cache
    def library() -> Any:
        try:
            catboost = importlib.import_module("catboost")
        except ImportError:
            raise InputError(f"{path.name}: its own answers need the package catboost; install it") from None
        model = catboost.CatBoost()
        try:
            model.load_model(str(path), format="json")
        except catboost.CatBoostError as error:
            raise InputError(f"{path.name}: CatBoost refuses the model: {error}") from error
        model.set_leaf_values(leaves)
        model.set_scale_and_bias(scale_and_bias[0], scale_and_bias[1].tolist())
        return model

    def predict(x: FloatArray) -> FloatArray:
        def of(kind: str) -> FloatArray:
            return np.asarray(library().predict(x, prediction_type=kind, thread_count=1), np.float64).reshape(
                len(x), -1
            )

        if not labels:
            return of("Exponent" if loss in _EXPONENT else "RawFormulaVal")
        found = library().predict(x, prediction_type="Class", thread_count=1)
        return np.hstack([numbers_of(labels, np.ravel(found)), of("Probability"), of("RawFormulaVal")])

    return predict
