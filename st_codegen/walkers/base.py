"""What all walkers share: the object they build, the registry they enter, and the flattening of trees."""

from __future__ import annotations

import importlib
import math
import pkgutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, wraps
from typing import Any, Generic, TypeVar

import numpy as np

from st_codegen.errors import InputError, UnsupportedModelError, extra_package
from st_codegen.ir import (
    Activation,
    AnyArray,
    Classes,
    Combine,
    Feature,
    FloatArray,
    Function,
    Label,
    Linear,
    ModelIR,
    NanRule,
    Operation,
    Operator,
    OutputKind,
    Precision,
    Round,
    Scale,
    Select,
    Source,
    SummationOrder,
    TreeEnsemble,
    WeightedMedian,
)
from st_codegen.ir.model import Origins, origins_after
from st_codegen.walkers.fitted import Fitted

#: Rows (rows, features) -> predictions (rows, outputs), computed by the source library alone. Only rows that the
#: library accepts (`reference.valid_rows`) are passed.
Predictor = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class LoadedModel:
    """A model as the compiler sees it, beside the library's own answer."""

    ir: ModelIR
    predict: Predictor = field(repr=False)


@dataclass(frozen=True)
class Classified:
    """What a classifier (or a detector, or a clustering) computes, each as a value of a builder.

    `index` is the number of the label, from 0. `probability` has a column for each label; `decision` is the library's
    own score, which its method `decision_function` gives, one column or several. None: the library has no such thing.
    """

    labels: tuple[Label, ...]
    index: int
    probability: int | None = None
    decision: int | None = None


@dataclass(frozen=True)
class Estimated:
    """Numbers that are always there, and what adds others that are told on demand (None: too large for a block).

    By default the mean of a Gaussian process and its standard deviation.
    """

    mean: int
    on_demand: Callable[[], int] | None
    kinds: tuple[OutputKind, OutputKind] = (OutputKind.MEAN, OutputKind.DEVIATION)


#: What outputs are called whose kind has another name.
_ESTIMATES = {OutputKind.DEVIATION: "standard deviation", OutputKind.RECONSTRUCTION: "squared reconstruction error"}

#: What a walker adds to a builder: a value of numbers, or the values of a classifier.
Walked = int | Classified | Estimated


class NoColumnError(UnsupportedModelError):
    """A transformer that leaves no column. Beside others it adds none; `sparse`: it gives a sparse matrix."""

    def __init__(self, message: str, sparse: bool = False) -> None:
        super().__init__(message)
        self.sparse = sparse


class SingleError(UnsupportedModelError):
    """A model that scikit-learn computes in float32, at least in parts, where its walker does not."""


#: What is said where something else than trees reads a NaN that an encoder makes.
_ABSENT = (
    "an encoder makes NaN of unknown categories, and what reads it is no model of trees that takes missing values: "
    "choose a number for them (unknown_value=-1)"
)


class GraphBuilder:
    """Collects the operations of one model; value 0 is its inputs.

    `on_demand`: what adds the reconstruction error of a value that is the columns of a PCA.
    `present` (inputs in which NaN is refused) and `magnitude_limits` start at "takes everything"; each part of the
    model narrows them. `widened`: values that the library computes in float32 and hands on in float64.
    `sparse`: whether the library holds a value as a sparse matrix, which stores no zeros, where an operation alone does
    not tell. `open_zeros`: whether operations give 0 where the library may give -0.
    `absent`: for each column of a value the number that stands for a NaN that the library makes there, or None; only
    trees read it, as a missing value.
    """

    def __init__(self, n_features: int) -> None:
        self.n_features = n_features
        self.open_zeros = False
        self.ops: list[Operation] = []
        self.on_demand: dict[int, Callable[[], int]] = {}
        self.present: set[int] = set()
        self.widened: set[int] = set()
        self.sparse: dict[int, bool] = {}
        self.absent: dict[int, tuple[float | None, ...]] = {}
        self.magnitude_limits: list[float | None] = [None] * n_features
        self._origins: list[Origins] = [tuple(range(n_features))]

    def add(self, op: Operation) -> int:
        """Append an operation; returns the number of the value it makes."""
        stand_ins = [one for value in op.inputs for one in self.absent.get(value, (None,) * self.width(value))]
        if any(one is not None for one in stand_ins):
            op = self._with_absent(op, stand_ins)
        self.ops.append(op)
        self._origins.append(origins_after(op, [self._origins[value] for value in op.inputs]))
        return len(self.ops)

    def _with_absent(self, op: Operation, stand_ins: Sequence[float | None]) -> Operation:
        """An operation that reads columns with numbers that stand for NaN; of its result they are noted."""
        if isinstance(op, Select):
            self.absent[len(self.ops) + 1] = tuple(stand_ins[column] for column in op.columns)
            return op
        if isinstance(op, Round):
            self.absent[len(self.ops) + 1] = tuple(stand_ins)
            return op
        if not isinstance(op, TreeEnsemble) or any(
            stand_ins[column.column] is not None
            and (column.nan is not NanRule.MISSING or column.missing_interval is not None)
            for column in op.columns
        ):
            raise UnsupportedModelError(_ABSENT)
        columns = [(column, stand_ins[column.column]) for column in op.columns]
        return replace(
            op,
            columns=tuple(
                column if number is None else replace(column, missing_interval=(number, number))
                for column, number in columns
            ),
        )

    def width(self, value: int) -> int:
        """Number of columns of a value."""
        return self.n_features if value == 0 else self.ops[value - 1].width

    def is_single(self, value: int) -> bool:
        """Whether the library holds a value in float32, so that NumPy goes on computing in float32."""
        if value == 0 or value in self.widened:
            return False
        op = self.ops[value - 1]
        if isinstance(op, Select | WeightedMedian):
            return all(map(self.is_single, op.inputs))
        precision = op.sum_precision if isinstance(op, TreeEnsemble) else getattr(op, "precision", None)
        return isinstance(op, Round) or precision is Precision.FLOAT32

    def held_like(self, value: int, result: int) -> int:
        """The result, which the library holds as a sparse matrix where it holds the value so."""
        self.sparse[result] = self.is_sparse(value)
        return result

    def is_sparse(self, value: int) -> bool:
        """Whether the library holds a value as a sparse matrix, which stores no zeros."""
        if value == 0 or value in self.sparse:
            return self.sparse.get(value, False)
        op = self.ops[value - 1]
        return isinstance(op, Select) and all(map(self.is_sparse, op.inputs))

    def precision(self, *values: int) -> Precision:
        """What NumPy computes in with values that stand in one array: float32 where the library holds all in it."""
        return Precision.FLOAT32 if all(map(self.is_single, values)) else Precision.FLOAT64

    def scale(
        self,
        value: int,
        operator: str,
        constant: FloatArray | float,
        *,
        precision: Precision = Precision.FLOAT64,
        reverse: bool = False,
        doubt: FloatArray | None = None,
    ) -> int:
        """`value <operator> constant`, or the constant first (`reverse`); one number is meant for all columns."""
        each = np.broadcast_to(np.asarray(constant, np.float64), self.width(value))
        return self.add(Scale((value,), Operator(operator), each, precision, reverse, doubt=doubt))

    def chain(self, value: int, *steps: tuple[str, FloatArray | float]) -> int:
        """Several steps of `scale`, one after another."""
        for operator, constant in steps:
            value = self.scale(value, operator, constant)
        return value

    def combine(self, one: int, operator: str, other: int, *, precision: Precision = Precision.FLOAT64) -> int:
        """`one <operator> other`, column by column."""
        return self.add(Combine((one, other), Operator(operator), self.width(one), precision))

    def function(
        self, value: int, function: str, parameter: float = 1.0, *, precision: Precision = Precision.FLOAT64
    ) -> int:
        """A function of each column, by its name in `ir.Function`."""
        return self.add(Activation((value,), Function(function), self.width(value), parameter, precision))

    def select(self, columns: AnyArray | Sequence[int], *values: int) -> int:
        """Columns of values that stand side by side."""
        return self.add(Select(values, np.asarray(columns, np.int32)))

    def beside(self, *values: int) -> int:
        """All columns of several values, one value after another."""
        return self.select(np.arange(sum(map(self.width, values))), *values)

    def drop_since(self, count: int) -> list[int]:
        """Drop operations behind the first so many that refuse no number; the values of those that do."""
        while len(self.ops) > count and not getattr(self.ops[-1], "refuses", False):
            for noted in (self.on_demand, self.sparse, self.absent):
                noted.pop(len(self.ops), None)
            self.widened.discard(len(self.ops))
            self.ops.pop()
            self._origins.pop()
        return [number for number in range(count + 1, len(self.ops) + 1) if getattr(self.ops[number - 1], "refuses", 0)]

    def linear(
        self,
        value: int,
        weights: FloatArray,
        bias: FloatArray | float = 0.0,
        *,
        order: SummationOrder = SummationOrder.UNSPECIFIED,
        precision: Precision = Precision.FLOAT64,
        bias_terms: FloatArray | None = None,
    ) -> int:
        """Weighted sums of the columns, weights (outputs, columns); one number is meant as the bias of all."""
        each = np.broadcast_to(np.asarray(bias, np.float64), len(weights))
        return self.add(Linear((value,), weights, each, order, precision, bias_terms))

    def refuse_nan(self, value: int = 0) -> None:
        """The library raises for a row with NaN in a value: in inputs that reach it without being replaced."""
        if any(one is not None for one in self.absent.get(value, ())):
            raise UnsupportedModelError(_ABSENT)
        self.present.update(origin for origin in self._origins[value] if origin is not None)

    def refuse_special(self, value: int) -> None:
        """The library raises for NaN in a value, and for infinite inputs (scikit-learn's `check_array`)."""
        self.refuse_nan(value)
        self.refuse_magnitude(math.inf)

    def refuse_magnitude(self, limit: float, features: Iterable[int] | None = None) -> None:
        """The library raises for numbers of magnitude `limit` and above (infinity: for infinities only) in features."""
        for feature in range(self.n_features) if features is None else features:
            known = self.magnitude_limits[feature]
            self.magnitude_limits[feature] = limit if known is None else min(limit, known)

    def model(self, name: str, features: tuple[Feature, ...], source: Source, result: Walked | None = None) -> ModelIR:
        """The finished model. Its outputs are the columns of the last value, or all that a classifier computes."""
        outputs: tuple[str, ...]
        classes = None
        estimates: tuple[OutputKind, ...] = ()
        if not self.ops:  # a scaler that is told to do nothing
            self.add(Select((0,), np.arange(self.n_features, dtype=np.int32)))
        if len(self.ops) in self.absent:
            raise UnsupportedModelError(_ABSENT)
        present, read = self.present, self._read()
        if isinstance(result, Classified):
            outputs, classes = self._select_outputs(result)
        elif isinstance(result, Estimated):
            outputs, estimates = self._select_estimates(result)
        else:
            width = self.width(len(self.ops))
            outputs = ("out1",) if width == 1 else tuple(f"out{number + 1}" for number in range(width))
        return ModelIR(
            name=name,
            features=features,
            ops=tuple(self.ops),
            outputs=outputs,
            source=source,
            accepts_nan=not present.issuperset(read),
            must_be_present=() if present.issuperset(read) else tuple(sorted(present)),
            magnitude_limits=tuple(self.magnitude_limits),
            classes=classes,
            estimates=estimates,
            open_zeros=self.open_zeros,
        )

    def _read(self) -> set[int]:
        """The inputs that any operation reads; no model takes NaN for the sake of the others alone."""
        direct = any(0 in op.inputs and not isinstance(op, Select) for op in self.ops)
        used = {origin for origins in self._origins[1:] for origin in origins if origin is not None}
        return set(range(self.n_features)) if direct else used

    def _select_estimates(self, result: Estimated) -> tuple[tuple[str, ...], tuple[OutputKind, ...]]:
        """The numbers, and those on demand behind them, as the last value; their names, and what each is."""
        always, other = result.kinds
        values = {always: result.mean}
        if result.on_demand is not None:
            values[other] = result.on_demand()
        self.beside(*values.values())
        kinds = tuple(kind for kind, value in values.items() for _ in range(self.width(value)))
        counts = [kinds[: number + 1].count(kind) for number, kind in enumerate(kinds)]
        names = [
            f"out{count}"
            if kind is OutputKind.COLUMN
            else _ESTIMATES.get(kind, kind.value) + ("" if kinds.count(kind) == 1 else f" {count}")
            for kind, count in zip(kinds, counts, strict=True)
        ]
        return tuple(names), kinds

    def _select_outputs(self, result: Classified) -> tuple[tuple[str, ...], Classes]:
        """Pick the outputs of a classifier as the last value; their names, and what each is."""
        values = {OutputKind.CLASS: result.index}
        if result.probability is not None:
            values[OutputKind.PROBABILITY] = result.probability
        if result.decision is not None:
            values[OutputKind.DECISION] = result.decision
        kinds = tuple(kind for kind, value in values.items() for _ in range(self.width(value)))
        self.add(Select(tuple(values.values()), np.arange(len(kinds), dtype=np.int32)))
        names = ["class"]
        for kind, value in list(values.items())[1:]:
            width = self.width(value)
            of = "of class " if width == len(result.labels) else ""
            names += [kind.value if width == 1 else f"{kind.value} {of}{number}" for number in range(width)]
        return tuple(names), Classes(result.labels, kinds)


#: Packages whose fitted objects are walked, each by the modules of the folder of its name, and the libraries' names.
LIBRARIES = {"sklearn": "scikit-learn", "lightgbm": "LightGBM", "xgboost": "XGBoost", "statsmodels": "statsmodels"}

_Result = TypeVar("_Result")
_Walker = TypeVar("_Walker", bound=Callable[..., Any])
_TRUSTED: set[str] = set()


class _Registry(Generic[_Result]):
    """What adds the operations of a fitted estimator that reads a value to a builder, by library and class."""

    def __init__(self) -> None:
        self._walkers: dict[tuple[str, str], Callable[[Any, GraphBuilder, int], _Result]] = {}

    def __call__(
        self,
        *classes: str,
        trusts: Iterable[str] = (),
        finite: bool = False,
        double: str = "",
        single: bool = False,
    ) -> Callable[[_Walker], _Walker]:
        """A decorator that enters the walker of classes, such as 'SVR NuSVR' of scikit-learn or 'xgboost.Booster'.

        `trusts` names the types that a file with such an object holds beyond those that skops trusts itself; none of
        them may run code from the file when it is loaded. `finite`: the library raises for NaN and infinities.
        `double`: an attribute with which the library computes in float32 where it was fitted on float32. `single`: the
        walker does with numbers that the library holds in float32 as the library does. Walkers of scikit-learn are
        given an estimator as what `fit` left in it, those of other libraries as it is.
        """
        names = [name.rpartition(".") for name in " ".join(classes).split()]

        def register(walker: _Walker) -> _Walker:
            @wraps(walker)
            def checked(estimator: Any, builder: GraphBuilder, value: int) -> Any:
                if finite:
                    builder.refuse_special(value)
                found = getattr(estimator, double, None) if double else None
                arrays = found if isinstance(found, list) else [found]
                if any(getattr(one, "dtype", None) == np.float32 for one in arrays):
                    raise SingleError(
                        f"{type(estimator).__name__} was fitted on float32, and scikit-learn computes parts of its "
                        "answers in that: fit it on X.astype('float64') and a y of that kind"
                    )
                if not single and builder.is_single(value):
                    raise SingleError(
                        f"{type(estimator).__name__} reads numbers of float32 here, as encoders with dtype=float32 and "
                        "models of XGBoost give them, and scikit-learn computes in float32 with them: use "
                        "dtype='float64', or passthrough=True in a stack"
                    )
                result = walker(estimator if names[0][0] else Fitted(estimator), builder, value)
                if isinstance(result, int) and not builder.width(result):
                    raise NoColumnError(f"{type(estimator).__name__} keeps no column", builder.is_sparse(result))
                return result

            _TRUSTED.update(trusts)
            for package, _, name in names:
                self._walkers[package or "sklearn", name] = checked
            return walker

        return register

    def of(self, package: str) -> dict[str, Callable[[Any, GraphBuilder, int], _Result]]:
        """The walkers of a library by the names of their classes; none of a package that is no library of ours."""
        if package in LIBRARIES:
            _import_walkers(package)
        return {name: walker for (owner, name), walker in self._walkers.items() if owner == package}


#: Enters what classes compute by `predict`.
walks: _Registry[Walked] = _Registry()
#: Enters what classes compute by `transform`: inside a Pipeline, or alone where they predict nothing.
transforms: _Registry[int] = _Registry()


def trusted_types() -> frozenset[str]:
    """The types that the files of all supported estimators may name."""
    for package in LIBRARIES:
        _import_walkers(package)
    return frozenset(_TRUSTED)


def booster_of(estimator: Any, made: Callable[[Any], Any]) -> Any:
    """A Booster itself, or that of a fitted estimator of LightGBM or XGBoost. Raises InputError where there is none.

    Raises MissingExtraError where the library is older than those whose rules are known.
    """
    package = type(estimator).__module__.partition(".")[0]
    extra_package(package, package, "compiling this model")
    if type(estimator).__name__ == "Booster":
        return estimator
    if not estimator.__sklearn_is_fitted__():
        raise InputError("not fitted: call fit() before saving it")
    booster = made(estimator)
    if type(booster).__name__ != "Booster":
        raise InputError("the fitted Booster is missing; the file is damaged")
    return booster


class BoosterPredictor:
    """The own prediction of LightGBM or XGBoost; a file is loaded at the first call."""

    def __init__(self, load_booster: Callable[[], Any], n_outputs: int) -> None:
        self.load_booster = load_booster
        self.n_outputs = n_outputs

    @cached_property
    def booster(self) -> Any:
        return self.load_booster()

    def __call__(self, x: FloatArray) -> FloatArray:
        """Rows (rows, features) -> (rows, outputs)."""
        if len(x) == 0:
            return np.zeros((0, self.n_outputs))
        rows = np.ascontiguousarray(x, np.float64)
        return np.asarray(self.numbers(rows), np.float64).reshape(len(rows), self.n_outputs)

    def numbers(self, rows: FloatArray, *, raw: bool = False) -> AnyArray:
        """What the booster gives for some rows, or its raw scores before the objective transforms them."""
        raise NotImplementedError(type(self).__name__)


@cache
def _import_walkers(package: str) -> None:
    """Import the walkers of a library; none of them imports the library itself."""
    folder = importlib.import_module(f"{__package__}.{package}")
    for module in pkgutil.iter_modules(folder.__path__):
        importlib.import_module(f"{folder.__name__}.{module.name}")


def walk_transform(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """Add the operations of a fitted estimator's `transform`. Raises UnsupportedModelError where it has no walker."""
    package, name = type(estimator).__module__.partition(".")[0], type(estimator).__name__
    walker = transforms.of(package).get(name)
    if walker is not None:
        return walker(estimator, builder, value)
    if name in walks.of(package):
        raise UnsupportedModelError(f"{name} is compiled where it predicts, not as a step that transforms")
    raise unsupported(package, name)


def walk_estimator(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """Add the operations of a fitted estimator that computes numbers; errors as in `walk_any`."""
    result = walk_any(estimator, builder, value)
    if isinstance(result, Classified):
        raise UnsupportedModelError(f"{type(estimator).__name__} gives classes where numbers are needed")
    return result.mean if isinstance(result, Estimated) else result


def walk_classifier(estimator: Any, builder: GraphBuilder, value: int) -> Classified:
    """Add the operations of a fitted classifier; errors as in `walk_any`."""
    result = walk_any(estimator, builder, value)
    if not isinstance(result, Classified):
        raise UnsupportedModelError(f"{type(estimator).__name__} gives numbers where classes are needed")
    return result


def walk_any(estimator: Any, builder: GraphBuilder, value: int) -> Walked:
    """Add the operations of any fitted estimator. Raises UnsupportedModelError for a class that has no walker."""
    package = type(estimator).__module__.partition(".")[0]
    walker = walks.of(package).get(type(estimator).__name__)
    if walker is None and not hasattr(estimator, "predict"):
        walker = transforms.of(package).get(type(estimator).__name__)
    if walker is None:
        raise unsupported(package, type(estimator).__name__)
    return walker(estimator, builder, value)


def is_known(package: str, name: str) -> bool:
    """Whether a class of a library is compiled."""
    return name in walks.of(package) or name in transforms.of(package)


#: What does the work of a class that is not compiled, for messages.
_NEAR = {
    "IterativeImputer": "SimpleImputer and KNNImputer",
    "LabelBinarizer": "OneHotEncoder for inputs (labels of scikit-learn's classifiers need none)",
    "LabelEncoder": "OrdinalEncoder for inputs (labels of scikit-learn's classifiers need none)",
    **dict.fromkeys(("DictionaryLearning", "MiniBatchDictionaryLearning", "MiniBatchNMF", "NMF", "SparsePCA"), "PCA"),
    **dict.fromkeys(
        ("AgglomerativeClustering", "DBSCAN", "HDBSCAN", "OPTICS", "SpectralClustering"),
        "KMeans (this one labels no new rows in scikit-learn either)",
    ),
}


def unsupported(package: str, name: str) -> UnsupportedModelError:
    """The error for a class that is not compiled."""
    owner = f"{LIBRARIES[package]}'s {name}" if package in LIBRARIES else f"{package}.{name}"
    if name in transforms.of(package):
        return UnsupportedModelError(f"{owner} is supported in front of an estimator, not as what gives the answer")
    near = f"; near it: {_NEAR[name]}" if name in _NEAR else ""
    return UnsupportedModelError(f"{owner} is not supported{near}; `st-codegen models` lists what is")
