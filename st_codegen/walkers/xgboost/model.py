"""XGBoost: `.json` and `.ubj` files, the classes XGBRegressor, XGBClassifier, XGBRanker, XGBRF.. and Booster objects.

Rules of prediction, from XGBoost 3.2: inputs are rounded to float32, compared by `<`, missing values take the default
child, categories of the set go right (src/predictor/predict_fn.h, src/common/categorical.h); leaves are added in tree
order to the base score, in float32 (src/predictor/cpu_predictor.cc). The base score in the file has passed the
objective's link, whose inverse gives the start of the sum (`ProbToMargin`, src/objective/regression_loss.h).

There are two paths. `Booster.predict` on a DMatrix refuses infinities; `XGBRegressor.predict` predicts in place, takes
them, and stops at the best iteration. With dart they round differently (`Dart::PredictBatchImpl` and
`Dart::InplacePredict`, src/gbm/gbtree.cc). With gblinear both go through a DMatrix.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from operator import methodcaller
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen import ir
from st_codegen.errors import InputError, UnsupportedModelError, counted, errors_name, extra_package
from st_codegen.ir.arrays import AnyArray, Float32Array, FloatArray
from st_codegen.walkers.base import (
    BoosterPredictor,
    Classified,
    GraphBuilder,
    LoadedModel,
    Predictor,
    Walked,
    booster_of,
    walks,
)
from st_codegen.walkers.catboost import model as catboost
from st_codegen.walkers.classes import above, complement, largest, last_below, most_probable, numbers_of, softmax
from st_codegen.walkers.forest import ParsedTree, category_note, flatten
from st_codegen.walkers.xgboost import ubjson
from st_codegen.walkers.xgboost.document import READ_CATEGORY, BoosterModel, loads

#: What an objective does to the sum of the trees; its inverse was applied to the base score.
_LINKS = {
    **dict.fromkeys(
        (
            *("reg:squarederror", "reg:linear", "reg:squaredlogerror", "reg:pseudohubererror", "reg:absoluteerror"),
            *("reg:quantileerror", "rank:ndcg", "rank:map", "rank:pairwise"),
        ),
        ir.Function.IDENTITY,
    ),
    **dict.fromkeys(("reg:gamma", "reg:tweedie", "count:poisson", "survival:cox", "survival:aft"), ir.Function.EXP),
    "reg:logistic": ir.Function.LOGISTIC,
}

#: Objectives of classes, and what their base score has passed.
_CLASSES = {
    "binary:logistic": ir.Function.LOGISTIC,
    **dict.fromkeys(("binary:logitraw", "binary:hinge", "multi:softmax", "multi:softprob"), ir.Function.IDENTITY),
}

#: All objectives.
OBJECTIVES = tuple(sorted(_LINKS | _CLASSES))

#: `kRtEps`, include/xgboost/base.h: how near to 0 and 1 the base score of reg:logistic may come.
_LOGISTIC_MARGIN = np.float32(1e-6)


@dataclass(frozen=True)
class _Path:
    """Which of the library's ways to predict is meant, and up to which round."""

    sklearn: bool
    classifier: bool = False
    missing: float = math.nan
    best_round: int | None = None
    labels: tuple[Any, ...] = ()

    @property
    def sentinel(self) -> float | None:
        """The number that means "missing" besides NaN, as the library compares it."""
        return None if math.isnan(self.missing) else float(np.float32(self.missing))


def load_file(path: Path, name: str) -> LoadedModel:
    """Read an XGBoost `.json` or `.ubj` file, or a `.json` file of CatBoost.

    `predict` of the result needs the library's package; reading does not.

    A file saved from a class such as XGBRegressor predicts as that class does, any other as Booster on a DMatrix.
    Raises InputError for a file that is no such model or is damaged, UnsupportedModelError for unknown objectives.
    """
    with errors_name(path.name):
        try:
            data = path.read_bytes()
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}") from None
        if path.suffix.lower() == ".json" and catboost.is_export(data):
            return catboost.load(data, name, path)
        model = loads(data, binary=path.suffix.lower() == ".ubj")
        changed = _as_saved(model, data)
        model = model if changed is None else loads(changed, binary=False)
        return _loaded(model, _path_of(model), name, lambda: _load_booster(path, changed))


def _as_saved(model: BoosterModel, data: bytes) -> bytes | None:
    """A file of an old version as 3.2 has to be given it to compute what that version did; None of all others.

    A gblinear file of before XGBoost 1.5 with rounds: without them 3.2 adds the base score before its link. One of
    `binary:logitraw` of before 1.3.1 with the margin of its base score, which was a probability then.
    """
    unlinked = model.booster == "gblinear" and b"boosted_rounds" not in data
    was_share = model.objective == "binary:logitraw" and model.version.startswith(("1.0.", "1.1.", "1.2.", "1.3.0"))
    if not unlinked and not was_share:
        return None
    try:
        document = json.loads(data)
    except ValueError:  # a binary one, whose format is younger than 1.5
        return None
    if unlinked:
        document["learner"]["gradient_booster"]["model"]["boosted_rounds"] = 1
    share = model.base_score[0].astype(np.float32)
    if was_share and 0 < share < 1:
        margin = -np.log(np.float32(1.0) / share - np.float32(1.0))
        document["learner"]["learner_model_param"]["base_score"] = str(margin)
    return json.dumps(document).encode()


def load_object(estimator: Any, name: str) -> LoadedModel:
    """A fitted XGBRegressor, XGBRFRegressor or Booster as a model of its own; errors as in `load_file`."""
    with errors_name(type(estimator).__name__):
        model, way = _model_of(estimator)
        booster = _booster(estimator)
        return _loaded(model, way, name, lambda: booster, estimator if way.classifier else None)


@walks(
    "xgboost.XGBRegressor",
    "xgboost.XGBRFRegressor",
    "xgboost.XGBClassifier",
    "xgboost.XGBRFClassifier",
    "xgboost.XGBRanker",
    "xgboost.Booster",
    trusts=(
        f"{__name__}.XgboostBooster",
        "xgboost.callback.EarlyStopping",  # a parameter of training: numbers and names
        *(
            f"xgboost.sklearn.XGB{kind}"
            for kind in ("Classifier", "RFClassifier", "RFRegressor", "Ranker", "Regressor")
        ),
    ),
    single=True,
)
def walk(estimator: Any, builder: GraphBuilder, value: int) -> Walked:
    """Add a fitted estimator (up to its best iteration), or a Booster (all rounds)."""
    with errors_name(type(estimator).__name__):
        model, way = _model_of(estimator)
        if builder.is_sparse(value):  # what a sparse matrix does not store is missing to XGBoost
            if way.sentinel is not None:
                raise UnsupportedModelError(f"missing={way.missing} behind a sparse matrix: {_DENSE}")
            if any(_least(builder, value, column) < _FAR_FROM_ZERO for column in range(builder.width(value))):
                raise UnsupportedModelError(f"takes the zeros of a sparse matrix for missing values: {_DENSE}")
            way = replace(way, missing=0.0)
        return _add(model, builder, value, way)


#: What to do where a sparse matrix is in front of XGBoost.
_DENSE = "train it behind dense columns (sparse_output=False of encoders, sparse_threshold=0 of a ColumnTransformer)"
#: Far above all numbers that are not 0 and become 0 in float32.
_FAR_FROM_ZERO = 1e-30


def _least(builder: GraphBuilder, value: int, column: int) -> float:
    """What the magnitudes of a column, but for 0, reach at least, as far as it is known: of codes and flags."""
    op = builder.ops[value - 1] if value else None
    if isinstance(op, ir.Select):
        return _least(builder, *op.source(column, builder.width))
    if isinstance(op, ir.Exceeds):
        return 1.0
    if isinstance(op, ir.Combine) and op.operator is ir.Operator.SUBTRACT:  # the flag of a category
        flags = all(isinstance(builder.ops[source - 1], ir.Exceeds) for source in op.inputs if source)
        return 1.0 if flags and all(op.inputs) else 0.0
    if isinstance(op, ir.Scale) and not op.reverse:
        size, factor = _least(builder, op.inputs[0], column), abs(float(op.constant[column]))
        return {ir.Operator.MULTIPLY: size * factor, ir.Operator.DIVIDE: size / (factor or 1.0)}.get(op.operator, 0.0)
    return 0.0


class XgboostBooster:
    """A Booster in a `.skops` file: XGBoost reads its bytes after our reader has taken them, and not before.

    Only the model is taken; the configuration beside it (threads, device, evaluation) plays no part in prediction.
    """

    def __setstate__(self, state: Any) -> None:
        """Become the library's Booster. Raises InputError for bytes that our reader refuses."""
        with errors_name("Booster"):
            data = state.get("handle") if isinstance(state, dict) else None
            if not isinstance(data, bytearray | bytes):
                raise InputError("no model; it was saved before training, or is damaged")
            model = ubjson.entry(bytes(data), "Model")
            loads(model, binary=True)
            xgboost = extra_package("xgboost", "xgboost", "a model of XGBoost in a .skops file")
            self.__class__ = xgboost.Booster
            _load(lambda: xgboost.Booster.__init__(self, model_file=bytearray(model)))


def _booster(estimator: Any) -> Any:
    return booster_of(estimator, methodcaller("get_booster"))


def _model_of(estimator: Any) -> tuple[BoosterModel, _Path]:
    booster = _booster(estimator)
    model = loads(bytes(booster.save_raw("ubj")), binary=True)
    if booster is estimator:
        return model, _Path(sklearn=False)
    classifier = type(estimator).__name__ in ("XGBClassifier", "XGBRFClassifier")
    return model, _Path(True, classifier, _missing(estimator.missing), _best_round(model))


def _missing(given: Any) -> float:
    try:
        missing = math.nan if given is None else float(given)
    except OverflowError:
        missing = math.inf
    with np.errstate(over="ignore"):
        if np.isinf(np.float32(missing)):
            raise UnsupportedModelError(f"missing={missing}: use NaN or a finite number for missing values")
    return missing


def _path_of(model: BoosterModel) -> _Path:
    """How the library that saved a file predicts, by what the file says of it.

    Files of XGBoost 1.0 to 1.7 hold the parameters of the estimator. Those to 1.5 have no trees per round elsewhere:
    newer versions, which do not read the parameters, take fewer trees.
    """
    if "scikit_learn" not in model.attributes:
        return _Path(sklearn=False)
    try:
        saved = json.loads(model.attributes["scikit_learn"])
    except (ValueError, RecursionError):
        saved = None
    saved = saved if isinstance(saved, dict) else {}
    classifier = saved.get("_estimator_type") == "classifier" or str(saved.get("type")).endswith("Classifier")
    missing, labels, best = saved.get("missing"), saved.get("classes_"), _best_round(model)
    if best is not None:
        text, parallel = model.attributes.get("best_ntree_limit", ""), saved.get("num_parallel_tree")
        trees = (best + 1) * (parallel if isinstance(parallel, int) else 0)
        if text.isdecimal() and len(text) <= 9:
            trees = int(text)
        ends = np.flatnonzero(model.round_starts[1:] == trees * (int(model.tree_output.max()) + 1))
        best = max([best, *ends[:1].tolist()])
    return _Path(
        True,
        classifier,
        _missing(missing if isinstance(missing, int | float) else None),
        best,
        tuple(labels) if classifier and isinstance(labels, list) else (),
    )


def _best_round(model: BoosterModel) -> int | None:
    """The attribute that early stopping leaves; gblinear ignores it."""
    if "best_iteration" not in model.attributes or model.booster == "gblinear":
        return None
    text = model.attributes["best_iteration"]
    rounds = len(model.round_starts) - 1
    if not text.isdecimal() or len(text) > 9 or int(text) >= rounds:
        raise InputError(f"learner.attributes.best_iteration: '{text[:40]}' in a model of {counted(rounds, 'round')}")
    return int(text)


def _loaded(
    model: BoosterModel, way: _Path, name: str, load_booster: Callable[[], Any], classifier: Any | None = None
) -> LoadedModel:
    builder = GraphBuilder(model.n_features)
    result = _add(model, builder, 0, way)
    made = builder.model(name, tuple(ir.Feature(feature) for feature in model.names), _source(model, way), result)
    predict: Predictor = (_LabelsPredictor if way.classifier else _XgboostPredictor)(load_booster, model, way)
    if isinstance(result, Classified):
        predict = _ClassPredictor(load_booster, model, way, result, classifier)
    return LoadedModel(made, predict)


def _load_booster(path: Path, data: bytes | None = None) -> Any:
    xgboost = extra_package("xgboost", "xgboost", f"the prediction of {path.name} by XGBoost")
    with errors_name(path.name):
        booster = xgboost.Booster()
        _load(lambda: booster.load_model(str(path) if data is None else bytearray(data)))
        # on a busy machine, threads that wait for each other cost more than they save
        booster.set_param("nthread", "1")
    return booster


def _load(read: Callable[[], Any]) -> None:
    """Let XGBoost read a model; InputError with its reason where it refuses."""
    import xgboost

    try:
        with xgboost.config_context(verbosity=0):  # it warns of files of older versions
            read()
    except (xgboost.core.XGBoostError, OSError, ValueError, TypeError) as error:
        raise InputError(f"XGBoost cannot load it: {_first_line(error)}") from None


def _first_line(error: Exception) -> str:
    """An error of the library without its stack trace."""
    return str(error).partition("\n")[0]


class _XgboostPredictor(BoosterPredictor):
    """XGBoost's own prediction."""

    def __init__(self, load_booster: Callable[[], Any], model: BoosterModel, way: _Path) -> None:
        super().__init__(load_booster, model.n_outputs)
        self.feature_names, self.feature_types = model.feature_names, model.feature_types
        self.in_place = way.sklearn and model.booster != "gblinear"
        self.missing = way.missing
        self.iteration_range = (0, 0 if way.best_round is None else way.best_round + 1)

    def numbers(self, rows: FloatArray, *, raw: bool = False) -> AnyArray:
        booster = self.booster
        import xgboost

        try:
            found = self._in_place(booster, rows, raw) if self.in_place else self._by_matrix(booster, rows, raw)
        except xgboost.core.XGBoostError as error:
            raise InputError(f"XGBoost cannot predict: {_first_line(error)}") from None
        return np.asarray(found)

    def _in_place(self, booster: Any, rows: FloatArray, margin: bool) -> Any:
        return booster.inplace_predict(
            rows,
            iteration_range=self.iteration_range,
            predict_type="margin" if margin else "value",
            missing=self.missing,
        )

    def _by_matrix(self, booster: Any, rows: FloatArray, margin: bool) -> Any:
        import xgboost

        matrix = xgboost.DMatrix(
            rows, missing=self.missing, feature_names=self.feature_names, feature_types=self.feature_types, nthread=1
        )
        return booster.predict(matrix, iteration_range=self.iteration_range, output_margin=margin)


class _LabelsPredictor(_XgboostPredictor):
    """0 or 1 for each of several labels (`XGBClassifier.predict`)."""

    def numbers(self, rows: FloatArray, *, raw: bool = False) -> AnyArray:
        return np.asarray(super().numbers(rows, raw=raw) > np.float32(0.5))


class _ClassPredictor(_XgboostPredictor):
    """Number of the class, probabilities where the objective gives them, and margins.

    The class is that of XGBClassifier where there is one; of a booster that gives probabilities, by the same rule: of
    two the second above 0.5, of more the first of the largest (`XGBClassifier.predict`).
    """

    def __init__(
        self,
        load_booster: Callable[[], Any],
        model: BoosterModel,
        way: _Path,
        result: Classified,
        classifier: Any | None,
    ) -> None:
        super().__init__(load_booster, model, way)
        self.objective, self.labels, self.classifier = model.objective, result.labels, classifier
        self.has_probability = result.probability is not None

    def __call__(self, x: FloatArray) -> FloatArray:
        """Rows (rows, features) -> (rows, 1 + probabilities + margins)."""
        rows = np.ascontiguousarray(x, np.float64)
        if len(x) == 0:
            return np.zeros((0, 1 + len(self.labels) * self.has_probability + self.n_outputs))
        found = self.numbers(rows)
        if self.classifier is not None:
            number = numbers_of(self.labels, self.classifier.predict(rows))
        elif self.objective == "multi:softprob":
            found = found.reshape(len(rows), -1)  # of one class there is no second dimension
            number = np.argmax(found, axis=1)[:, None].astype(np.float64)
        elif self.objective == "multi:softmax":
            number = found.reshape(-1, 1).astype(np.float64)
        else:
            number = (found > np.float32(0.5)).reshape(-1, 1).astype(np.float64)
        parts = [number, self.numbers(rows, raw=True).reshape(len(rows), -1)]
        if self.has_probability:
            parts.insert(1, found if found.ndim > 1 else np.column_stack([np.float32(1) - found, found]))
        return np.hstack([np.asarray(part, np.float64) for part in parts])


def _source(model: BoosterModel, way: _Path) -> ir.Source:
    notes = [f"predicts as {_caller(way)}"]
    if way.sentinel is not None:
        notes.append(f"missing values: NaN and {way.sentinel:.9g}")
    if way.labels not in ((), tuple(range(len(way.labels)))):
        named = ", ".join([str(label)[:80] for label in way.labels[:20]] + [".."] * (len(way.labels) > 20))
        notes.append(f"classes 0, 1, .. are the labels {named} of the library that saved the file")
    rounds = len(model.round_starts) - 1
    if way.best_round is not None and way.best_round + 1 < rounds:
        notes.append(f"early stopping: the first {way.best_round + 1} of {rounds} rounds are used")
    elif not way.sklearn and model.attributes.get("best_iteration", str(rounds - 1)) != str(rounds - 1):
        notes.append(
            f"early stopping: all {rounds} rounds are used, as by Booster.predict; XGBRegressor and XGBClassifier "
            "would stop at the best one"
        )
    notes += [
        category_note(feature, categories)
        for feature, categories in zip(model.names, model.categories, strict=False)
        if categories
    ]
    return ir.Source(
        library="XGBoost",
        version=model.version,
        model_class=f"XGBoost model ({model.booster}, {model.objective})",
        notes=tuple(notes),
    )


def _caller(way: _Path) -> str:
    if not way.sklearn:
        return "Booster.predict on a DMatrix"
    return f"XGB{'Classifier' if way.classifier else 'Regressor'}.predict"


def _add(model: BoosterModel, builder: GraphBuilder, value: int, way: _Path) -> Walked:
    """Add the booster and what its objective makes of the margin."""
    if builder.width(value) != model.n_features:
        raise InputError(
            f"the model has {counted(model.n_features, 'feature')}, its input {counted(builder.width(value), 'column')}"
        )
    if way.classifier and model.objective == "reg:logistic":  # the same sum and sigmoid
        model = replace(model, objective="binary:logistic")
    known = _CLASSES if way.classifier else _LINKS | _CLASSES
    if model.objective not in known:
        raise UnsupportedModelError(
            f"objective '{model.objective}' is not supported; supported: {', '.join(sorted(known))}"
        )
    link = known[model.objective]
    base = _margin(link, model.base_score, exact=model.objective in _CLASSES)
    if value == 0 and (model.booster == "gblinear" or not way.sklearn):
        builder.refuse_magnitude(ir.FLOAT32_OVERFLOW)
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows float32 is refused as not finite
        if model.linear is not None:
            result = _add_linear(model.linear, builder, value, base[0], way.sentinel)
        else:
            result = _add_trees(model, builder, value, base, way)
    if model.objective in _CLASSES:
        return _classified(model, builder, result, way)
    if link is not ir.Function.IDENTITY:
        result = builder.function(result, link, precision=ir.Precision.FLOAT32)
    return result


def _classified(model: BoosterModel, builder: GraphBuilder, raw: int, way: _Path) -> Walked:
    """What objectives of classes make of the margin (`regression_loss.h`, `hinge.cc`, `multiclass_obj.cc`)."""
    objective, binary = model.objective, model.objective.startswith("binary:")
    if binary and model.n_outputs > 1:
        return _several_labels(model, builder, raw, way)
    labels = tuple(range(2 if binary else model.n_outputs))
    if objective == "binary:logistic":
        probability = builder.function(raw, "logistic", precision=ir.Precision.FLOAT32)
        both = complement(builder, probability, ir.Precision.FLOAT32)
        return Classified(labels, above(builder, raw, last_below(_is_second, np.float32)), both, raw)
    if objective == "binary:logitraw":  # the booster gives the margin, in which its class looks for 0.5
        return Classified(labels, above(builder, raw, 0.5), decision=raw) if way.classifier else raw
    if objective == "binary:hinge":
        return Classified(labels, above(builder, raw), decision=raw)
    if objective == "multi:softmax":
        return Classified(labels, largest(builder, raw), decision=raw)
    if way.classifier and len(labels) == 2:
        raise UnsupportedModelError("XGBClassifier with multi:softprob and two classes predicts a matrix, not a class")
    single = ir.Precision.FLOAT32
    return Classified(labels, most_probable(builder, raw, single), softmax(builder, raw, single), raw)


def _several_labels(model: BoosterModel, builder: GraphBuilder, raw: int, way: _Path) -> int:
    """0 or 1 for each of several labels a row (`XGBClassifier.predict`), or probabilities (`Booster.predict`)."""
    if model.objective != "binary:logistic":
        raise UnsupportedModelError(
            f"objective '{model.objective}' with {counted(model.n_outputs, 'output')}: train one for each of them"
        )
    if way.classifier:
        return above(builder, raw, last_below(_is_second, np.float32))
    return builder.function(raw, "logistic", precision=ir.Precision.FLOAT32)


def _is_second(x: Any) -> bool:
    """Whether the sigmoid of a margin exceeds 0.5, in float32 (`Sigmoid`, src/common/math.h)."""
    one = np.float32(1)
    return bool(one / (np.float32(math.exp(-float(x))) + one) > np.float32(0.5))


def _margin(link: ir.Function, base_score: FloatArray, *, exact: bool) -> FloatArray:
    """The start of the sum, (outputs,): `ProbToMargin` in float32.

    `exact`: with the logarithm of this machine's C library, which is XGBoost's, since margins of classes are exact.
    """
    if link is ir.Function.IDENTITY:
        return base_score
    score = base_score.astype(np.float32)
    if np.any(score < 0) or np.any(score > 1 if link is ir.Function.LOGISTIC else score == 0):
        expected = "0 .. 1" if link is ir.Function.LOGISTIC else "a number above 0"
        raise InputError(f"learner.learner_model_param.base_score: {base_score}, the objective needs {expected}")
    if link is ir.Function.LOGISTIC:
        one = np.float32(1)
        odds = one / np.clip(score, _LOGISTIC_MARGIN, one - _LOGISTIC_MARGIN) - one
        return -(_library_logarithm(odds) if exact else _logarithm(odds))
    return _logarithm(score)


def _library_logarithm(values: Float32Array) -> FloatArray:
    """`logf` of the C library; without one, the rounded logarithm."""
    try:
        logf = ctypes.CDLL(ctypes.util.find_library("m")).logf
    except (OSError, AttributeError, TypeError):
        return _logarithm(values)
    logf.restype, logf.argtypes = ctypes.c_float, [ctypes.c_float]
    return np.array([logf(float(value)) for value in values], np.float64)


def _logarithm(values: Float32Array) -> FloatArray:
    """Natural logarithms rounded to float32, on every machine the same.

    The library takes `logf` of the C library it runs on, which may be one ulp off: about one base score in a hundred
    with glibc 2.36. Objectives with a link are never exact, so this adds to their bound, not to exact models.
    """
    return np.array([math.log(float(value)) for value in values], np.float32).astype(np.float64)


def _add_linear(weights: FloatArray, builder: GraphBuilder, value: int, base: float, sentinel: float | None) -> int:
    """gblinear: bias + base score, then products in feature order; a missing value adds nothing.

    `GBLinear::PredictBatchInternal` (src/gbm/gblinear.cc) starts every output from the base score of the first.
    """
    width = len(weights) - 1
    rounded = builder.add(ir.Round((value,), width))
    filled = builder.add(ir.FillMissing((rounded,), np.zeros(width), sentinel))
    bias = (weights[-1] + base).astype(np.float32).astype(np.float64)
    return builder.linear(
        filled, weights[:-1].T, bias, order=ir.SummationOrder.SEQUENTIAL, precision=ir.Precision.FLOAT32
    )


def _add_trees(model: BoosterModel, builder: GraphBuilder, value: int, base: FloatArray, way: _Path) -> int:
    end = len(model.trees) if way.best_round is None else int(model.round_starts[way.best_round + 1])
    if end == 0:
        raise InputError("learner.attributes.best_iteration: no tree belongs to the rounds up to the best iteration")
    trees = list(model.trees[:end])
    if model.vector_leaves:
        if model.tree_weight is not None:
            raise UnsupportedModelError("dart with vector leaves (multi_output_tree)")
        if any(tree.leaf_value.shape[1] != model.n_outputs for tree in trees):
            raise UnsupportedModelError("trees with vector leaves beside trees with single ones")
    if model.tree_weight is not None:
        in_place_base = base[model.tree_output] if way.sklearn else None
        trees = [
            _weighted(tree, model.tree_weight[number], None if in_place_base is None else in_place_base[number])
            for number, tree in enumerate(trees)
        ]

    def column(feature: int, reading: int, n_categories: int) -> ir.TreeColumn:
        sentinel = way.sentinel
        return ir.TreeColumn(
            feature,
            missing_interval=None if sentinel is None else (sentinel, sentinel),
            n_categories=n_categories if reading == READ_CATEGORY else 0,
        )

    single: dict[str, Any] = {"input_precision": ir.Precision.FLOAT32, "sum_precision": ir.Precision.FLOAT32}
    outputs = model.tree_output[:end]
    return builder.add(
        flatten(trees, value, column, base=base, tree_output=outputs, comparison=ir.Comparison.LESS, **single)
    )


def _weighted(tree: ParsedTree, weight: float, in_place_base: float | None) -> ParsedTree:
    """Leaves of a dart tree as they are added: leaf * weight, or, in place, ((base + leaf) - base) * weight."""
    leaf = tree.leaf_value.astype(np.float32)
    if in_place_base is not None:
        base = np.float32(in_place_base)
        leaf = (base + leaf) - base
    return replace(tree, leaf_value=(leaf * np.float32(weight)).astype(np.float64))
