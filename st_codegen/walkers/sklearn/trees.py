"""Walkers for scikit-learn's tree models.

Rules (scikit-learn 1.9; `tree/_tree.pyx: _apply_dense`, `ensemble/_forest.py`, `ensemble/_gradient_boosting.pyx`,
`ensemble/_hist_gradient_boosting/_predictor.pyx`): DecisionTree, ExtraTree, RandomForest, ExtraTrees and
GradientBoosting, of numbers and of classes, round x to float32 and go left on `x <= threshold` (float64); forests add
float64 in tree order and divide by their number; GradientBoosting adds learning_rate * leaf in order to its initial
value.
HistGradientBoosting compares float64 and adds leaves to its baseline.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from st_codegen.errors import UnsupportedModelError, counted
from st_codegen.ir import (
    FLOAT32_OVERFLOW,
    AnyArray,
    BoolArray,
    Clip,
    FloatArray,
    Int32Array,
    IntArray,
    Label,
    Precision,
    Round,
    SummationOrder,
    TreeColumn,
)
from st_codegen.walkers.base import (
    Classified,
    GraphBuilder,
    SingleError,
    Walked,
    walk_classifier,
    walk_estimator,
    walks,
)
from st_codegen.walkers.classes import above, complement, labels_of, largest, numbered, softmax
from st_codegen.walkers.fitted import Fitted
from st_codegen.walkers.forest import laid_out, side_by_side
from st_codegen.walkers.sklearn.compose import selected_columns
from st_codegen.walkers.sklearn.native import TREE, is_tree

_TREE = (TREE,)


@walks("DecisionTreeRegressor ExtraTreeRegressor RandomForestRegressor ExtraTreesRegressor", trusts=_TREE, single=True)
def walk_trees(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """Sum of the trees in order, divided by their number (`ForestRegressor.predict` with n_jobs=1)."""
    trees = _trees(fitted)
    return add_float32_trees(builder, value, trees, fitted, TreeSum(divisor=len(trees)))


def _trees(fitted: Fitted) -> list[Any]:
    """The trees of a forest, or a tree itself."""
    from sklearn.ensemble import BaseEnsemble

    return fitted.items("estimators_") if isinstance(fitted.estimator, BaseEnsemble) else [fitted.estimator]


@walks(
    "DecisionTreeClassifier ExtraTreeClassifier RandomForestClassifier ExtraTreesClassifier", trusts=_TREE, single=True
)
def walk_class_trees(fitted: Fitted, builder: GraphBuilder, value: int) -> Walked:
    """The mean of the fractions of the classes in the leaves, and the first of the largest (`predict`).

    Of several outputs the number of each one's class; the library's leaves have for each as many fractions as the most
    have classes.
    """
    given = fitted.get("classes_")
    if not isinstance(given, list):
        shares = walk_trees(fitted, builder, value)
        return Classified(labels_of(fitted), largest(builder, shares), probability=shares)
    trees, sizes = _trees(fitted), [len(labels) for labels in given]
    fitted.integer("n_outputs_", len(given), len(given))
    own = np.arange(max(sizes)) < np.array(sizes)[:, None]
    if any(tree.tree_.value.shape[1:] != own.shape for tree in trees):
        raise fitted.fail("tree_", f"leaves that do not hold {counted(own.size, 'number')}")
    leaves = [tree.tree_.value[:, own] for tree in trees]
    shares = add_float32_trees(builder, value, trees, fitted, TreeSum(divisor=len(trees), leaves=leaves))
    found, start = [], 0
    for labels in given:
        index = largest(builder, builder.select(start + np.arange(len(labels)), shares))
        found.append(numbered(builder, index, labels, fitted.kind))
        start += len(labels)
    return builder.beside(*found)


def _boosted(fitted: Fitted, builder: GraphBuilder, value: int, count: int) -> int:
    """Initial value plus learning_rate * leaf, tree by tree (`_predict_regression_tree_inplace_fast_dense`)."""
    trees = _iterations(fitted, count)
    given = fitted.estimator._raw_predict_init(np.zeros((2, builder.width(value))))
    initial = fitted.floats_of("init_", given, (2, count))[0]
    rule = TreeSum(initial, fitted.number("learning_rate"))
    return add_float32_trees(builder, value, list(trees.ravel()), fitted, rule)


def _iterations(fitted: Fitted, count: int) -> AnyArray:
    """The trees (iterations, `count`), of which native code looks at no shape where it adds them to an array."""
    trees = fitted.get("estimators_")
    if not isinstance(trees, np.ndarray) or trees.ndim != 2 or trees.shape[1] != count or not len(trees):
        raise fitted.fail("estimators_", f"not an array of {counted(count, 'tree')} an iteration")
    return trees


@walks("GradientBoostingRegressor", trusts=_TREE, single=True)
def walk_gradient_boosting(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The sum of the trees, which starts from a constant or from what another model gives for the row in float32."""
    init = fitted.get("init_")
    if isinstance(init, str):  # "zero"
        return _boosted(fitted, builder, value, 1)
    if type(init).__name__ == "DummyRegressor":
        Fitted(init).floats("constant_", (1, 1))
        return _boosted(fitted, builder, value, 1)
    start = _start(fitted, init, builder, value, walk_estimator)
    if builder.width(start) != 1:
        raise UnsupportedModelError(f"GradientBoostingRegressor with init={type(init).__name__} of several outputs")
    return _boosted_from(fitted, builder, value, start)


_Started = TypeVar("_Started")


def _start(
    fitted: Fitted, init: Any, builder: GraphBuilder, value: int, walk: Callable[[Any, GraphBuilder, int], _Started]
) -> _Started:
    """What the model gives from which the trees start: it was fitted on float32, as they were, and reads that."""
    read = value if builder.is_single(value) else builder.add(Round((value,), builder.width(value)))
    try:
        return walk(init, builder, read)
    except UnsupportedModelError as error:
        why = str(error)
        if isinstance(error, SingleError):
            why = "that is fitted on float32 whatever the data are, and computed in float32 in parts: take another init"
        raise UnsupportedModelError(f"{fitted.kind} with init={type(init).__name__}: {why}") from error


def _boosted_from(fitted: Fitted, builder: GraphBuilder, value: int, start: int) -> int:
    """The trees of each output, which are added in turn to what hangs on the row: each tree by itself."""
    count = builder.width(start)
    trees = list(_iterations(fitted, count).ravel())
    rule = TreeSum(np.zeros(len(trees)), fitted.number("learning_rate"))
    each = builder.beside(start, add_float32_trees(builder, value, trees, fitted, rule))
    own = np.tile(np.eye(count), len(trees) // count + 1)
    return builder.linear(each, own, order=SummationOrder.SEQUENTIAL)


@walks("GradientBoostingClassifier", trusts=_TREE, single=True)
def walk_class_gradient_boosting(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """Scores are sums of trees; of two classes the second from 0 on (`_gb.py: predict`)."""
    init, labels = fitted.get("init_"), labels_of(fitted)
    count = len(labels) if len(labels) > 2 else 1
    if isinstance(init, str) or type(init).__name__ == "DummyClassifier":
        raw = _boosted(fitted, builder, value, count)
    else:
        raw = _boosted_from(fitted, builder, value, _linked(fitted, builder, value, init, labels))
    if count > 1:
        return Classified(labels, largest(builder, raw), softmax(builder, raw), raw)
    score = builder.scale(raw, "*", 2.0) if _is_half(fitted) else raw
    probability = builder.function(score, "logistic")
    return Classified(labels, above(builder, raw, inclusive=True), complement(builder, probability), raw)


def _linked(fitted: Fitted, builder: GraphBuilder, value: int, init: Any, labels: tuple[Label, ...]) -> int:
    """Scores of the probabilities of another classifier (`_gb.py: _init_raw_predictions`, `_loss/link.py`).

    Their logarithms, less the mean of these, for more than two classes; else that of p / (1 - p), or half of it. scipy
    takes another form of the latter near 1/2, where its own digits are those of a number of the size of 1.
    """
    found = _start(fitted, init, builder, value, walk_classifier)
    if found.probability is None or len(found.labels) != len(labels):
        raise UnsupportedModelError(
            f"GradientBoostingClassifier with init={type(init).__name__}, whose probabilities are not compiled"
        )
    eps, count = float(np.finfo(np.float64).eps), len(labels)
    ends = np.full(count, eps), np.full(count, 1.0 - eps)
    shares = builder.add(Clip((found.probability,), *ends))
    if count > 2:
        logarithms = builder.function(shares, "log")
        mean = builder.linear(logarithms, np.full((count, count), 1.0 / count))
        return builder.combine(logarithms, "-", mean)
    share = builder.select([1], shares)
    odds = builder.combine(share, "/", builder.scale(share, "-", 1.0, reverse=True))
    logit = builder.function(builder.scale(odds, "*", 1.0, doubt=np.full(1, 4 * eps)), "log")
    return builder.scale(logit, "*", 0.5) if _is_half(fitted) else logit


def _is_half(fitted: Fitted) -> bool:
    """Whether a score is half of the logarithm of p / (1 - p)."""
    return type(fitted.estimator._loss.link).__name__ == "HalfLogitLink"


@dataclass(frozen=True)
class TreeSum:
    """What trees add up to: `(base + leaf_scale * leaf + ..) / divisor`, each product rounded once.

    A leaf has a number for each output or for each class; leaves of one number add to the outputs in turn, of which
    there is one for each `base`. `leaves`: numbers of the nodes of each tree that stand in place of the trees' own.
    `columns`: those that each tree reads, where it does not read all.
    """

    base: FloatArray | float = 0.0
    leaf_scale: float = 1.0
    divisor: float = 1.0
    leaves: Sequence[FloatArray] | None = None
    columns: Sequence[IntArray] | None = None


def add_float32_trees(builder: GraphBuilder, value: int, trees: Sequence[Any], fitted: Fitted, rule: TreeSum) -> int:
    """The trees of `sklearn.tree`; `leaf_scale * leaf` is rounded once here as the library rounds it at run time."""
    columns = [np.arange(builder.width(value))] * len(trees) if rule.columns is None else rule.columns
    structures = [_structure(Fitted(tree), len(own)) for tree, own in zip(trees, columns, strict=True)]
    wanted = (1, 1)
    if hasattr(trees[0], "classes_"):
        several = fitted.get("classes_")
        several = several if isinstance(several, list) else [labels_of(fitted)]
        wanted = fitted.integer("n_outputs_", len(several), len(several)), max(map(len, several))
    elif hasattr(fitted.estimator, "n_outputs_"):  # boosting has one output and does not say so
        wanted = fitted.integer("n_outputs_", 1, 2**31 - 1), 1
    if any(tree.value.shape[1:] != wanted for tree in structures):
        raise fitted.fail("tree_", f"leaves that do not hold {counted(wanted[0] * wanted[1], 'number')}")
    # in a sparse matrix no tree of the library takes NaN
    if builder.is_sparse(value) or not fitted.estimator.__sklearn_tags__().input_tags.allow_nan:
        builder.refuse_nan(value)
    builder.refuse_magnitude(FLOAT32_OVERFLOW)

    def joined(attribute: str) -> AnyArray:
        return np.concatenate([getattr(tree, attribute) for tree in structures])

    sizes = np.array([tree.node_count for tree in structures])
    # (nodes, outputs, classes), of which one is 1
    numbers = joined("value") if rule.leaves is None else np.concatenate(rule.leaves)
    layout = side_by_side(sizes, joined("children_left"), joined("children_right"))
    order = layout.order
    leaves = rule.leaf_scale * numbers.reshape(len(numbers), -1)[order[layout.left < 0]]
    return builder.add(
        laid_out(
            value,
            layout,
            columns=tuple(TreeColumn(column) for column in range(builder.width(value))),
            split=np.concatenate(
                [own[np.maximum(tree.feature, 0)] for own, tree in zip(columns, structures, strict=True)]
            )[order],
            threshold=joined("threshold")[order],
            missing_left=joined("missing_go_to_left")[order].astype(np.bool_),
            leaf_value=leaves,
            tree_output=(np.arange(len(structures)) % np.size(rule.base)).astype(np.int32),
            base=np.broadcast_to(rule.base, max(leaves.shape[1], np.size(rule.base))),
            input_precision=Precision.FLOAT32,
            divisor=float(rule.divisor),
        )
    )


def _structure(tree: Fitted, width: int) -> Any:
    """The nodes of a tree: arrays of equal length and of fixed types, of which scikit-learn takes no others."""
    from sklearn.tree import BaseDecisionTree

    structure = tree.get("tree_")
    if not is_tree(structure) or not isinstance(tree.estimator, BaseDecisionTree):
        raise tree.fail("tree_", "not a tree of scikit-learn")
    tree.integers("n_features_in_", (), low=width, high=width)
    if structure.n_features != width:
        raise tree.fail("tree_", f"splits of {counted(structure.n_features, 'feature')}, expected {width}")
    return structure


@walks(
    "HistGradientBoostingRegressor HistGradientBoostingClassifier",
    trusts=(
        "sklearn.ensemble._hist_gradient_boosting.predictor.TreePredictor",
        # the encoder of categories; a partial can only hold a function that is itself trusted
        "functools.partial",
        "sklearn.utils.validation.check_array",
    ),
    single=True,
)
def walk_hist_gradient_boosting(fitted: Fitted, builder: GraphBuilder, value: int) -> Walked:
    """Baseline plus leaves in order, then the inverse of the loss's link; missing values and categories included.

    Of two classes the second is taken above 0 (`gradient_boosting.py: HistGradientBoostingClassifier.predict`).
    """
    labels = labels_of(fitted) if hasattr(fitted.estimator, "classes_") else ()
    count = len(labels) if len(labels) > 2 else 1
    columns = _hist_columns(fitted, builder.width(value))
    iterations = fitted.items("_predictors")
    if any(not isinstance(iteration, list) or len(iteration) != count for iteration in iterations):
        raise fitted.fail("_predictors", f"not {counted(count, 'tree')} an iteration")
    predictors = [predictor for iteration in iterations for predictor in iteration]
    nodes = np.concatenate([_hist_nodes(Fitted(predictor), columns) for predictor in predictors])
    sizes = np.array([len(predictor.nodes) for predictor in predictors])
    left, right = (np.where(nodes["is_leaf"], -1, nodes[side].astype(np.int64)) for side in ("left", "right"))
    layout = side_by_side(sizes, left, right)
    nodes = nodes[layout.order]
    if np.any((nodes["is_categorical"] == 0) & (nodes["is_leaf"] == 0) & (nodes["num_threshold"] == -np.inf)):
        raise UnsupportedModelError(
            f"{fitted.kind} has a split at -infinity, as training data with infinities give it: train on finite numbers"
        )
    if value == 0:  # the encoder of categories refuses infinities
        builder.refuse_magnitude(np.inf, [column.column for column in columns if column.categorical])
    tree = np.repeat(np.arange(len(predictors)), sizes)[layout.order]
    category_row, category_left = _category_table(predictors, fitted, columns, nodes, tree)
    raw = builder.add(
        laid_out(
            value,
            layout,
            columns=columns,
            split=nodes["feature_idx"].astype(np.int64),
            threshold=np.where(nodes["is_categorical"] == 0, nodes["num_threshold"], 0.0),
            missing_left=nodes["missing_go_to_left"] != 0,
            leaf_value=nodes["value"][layout.left < 0][:, None].astype(np.float64),
            tree_output=(np.arange(len(predictors)) % count).astype(np.int32),
            base=np.ravel(fitted.floats("_baseline_prediction", (1, count))),
            category_row=category_row,
            category_left=category_left,
        )
    )
    link = type(fitted.estimator._loss.link).__name__
    if link == "LogitLink":
        probability = builder.function(raw, "logistic")
        return Classified(labels, above(builder, raw), complement(builder, probability), raw)
    if link == "MultinomialLogit":
        return Classified(labels, largest(builder, raw), softmax(builder, raw), raw)
    if link == "IdentityLink":
        return raw
    if link == "LogLink":
        return builder.function(raw, "exp")
    raise UnsupportedModelError(f"{fitted.kind} with loss={fitted.estimator.loss!r}: unknown link {link}")


def _hist_columns(fitted: Fitted, n_features: int) -> tuple[TreeColumn, ...]:
    """The columns as the nodes number them: with categories, the encoder puts the categorical ones first."""
    from sklearn.utils.validation import check_array

    if fitted.get("_preprocessor") is None:
        if fitted.get("is_categorical_") is not None:
            raise fitted.fail("_preprocessor", "missing, though there are categories")
        return tuple(TreeColumn(column) for column in range(n_features))
    is_categorical = fitted.flags("is_categorical_", (n_features,))
    categorical, numeric = np.flatnonzero(is_categorical), np.flatnonzero(~is_categorical)
    preprocessor = Fitted(fitted.get("_preprocessor"))
    parts = preprocessor.items("transformers_")
    # with other ones there may be fewer columns than native code reads
    function = getattr(parts[1][1], "func", None) if len(parts) > 1 else None
    if type(parts[0][1]).__name__ != "OrdinalEncoder" or getattr(function, "func", None) is not check_array:
        raise preprocessor.fail("transformers_", "not an encoder of categories, and a check of the other columns")
    for (name, _, given), meant in zip(parts, (categorical, numeric), strict=False):
        if not np.array_equal(selected_columns(preprocessor, name, given, n_features), meant):
            raise preprocessor.fail("transformers_", "other columns than is_categorical_ names")
    encoder = Fitted(parts[0][1])
    columns = []
    for column, known in zip(categorical, encoder.items("categories_", len(categorical)), strict=True):
        if not isinstance(known, np.ndarray) or not np.issubdtype(known.dtype, np.number):
            raise UnsupportedModelError(
                f"feature {column} has categories that are no numbers ({', '.join(map(str, known[:3]))}, ..); a PLC "
                "block takes numbers: encode the categories as integers before training"
            )
        values = np.ravel(encoder.floats_of("categories_", known[~np.isnan(known)], (None,)))
        if np.any(np.diff(values) <= 0) or len(values) > _CATEGORIES:
            raise encoder.fail("categories_", f"not a rising list of at most {_CATEGORIES} numbers")
        columns.append(TreeColumn(int(column), n_categories=len(values), categories=tuple(values.tolist())))
    return (*columns, *(TreeColumn(int(column)) for column in numeric))


#: Bits of a set of categories, in eight words of 32.
_CATEGORIES = 256


def _hist_nodes(predictor: Fitted, columns: tuple[TreeColumn, ...]) -> AnyArray:
    """The nodes of a tree, of which native code of scikit-learn follows each number without a look."""
    from sklearn.ensemble._hist_gradient_boosting.common import PREDICTOR_RECORD_DTYPE

    nodes = predictor.get("nodes")
    if predictor.kind != "TreePredictor":
        raise predictor.fail("nodes", "not those of a tree")
    if not isinstance(nodes, np.ndarray) or nodes.dtype != PREDICTOR_RECORD_DTYPE or nodes.ndim != 1 or not len(nodes):
        raise predictor.fail("nodes", "not a list of nodes of this version of scikit-learn")
    inner = nodes[nodes["is_leaf"] == 0]
    if np.any((inner["feature_idx"] < 0) | (inner["feature_idx"] >= len(columns))):
        raise predictor.fail("nodes", "a split of a feature that does not exist")
    categorical = np.array([column.categorical for column in columns])
    if np.any(categorical[inner["feature_idx"]] != (inner["is_categorical"] != 0)):
        raise predictor.fail("nodes", "a split by categories of a feature that has none, or the other way round")
    bits = predictor.integers("raw_left_cat_bitsets", (None, _CATEGORIES // 32), low=0, high=2**32 - 1)
    if np.any(inner["bitset_idx"][inner["is_categorical"] != 0] >= len(bits)):
        raise predictor.fail("nodes", "a split by categories that are not there")
    return nodes


def _known_categories(fitted: Fitted, columns: tuple[TreeColumn, ...]) -> BoolArray:
    """For each feature with categories, in the order of the columns, those that the training data had."""
    mapper = Fitted(fitted.get("_bin_mapper"))
    categorical = [column.categorical for column in columns]
    if not np.array_equal(mapper.integers("is_categorical_", (len(columns),), low=0, high=1), categorical):
        raise mapper.fail("is_categorical_", "not the features that have categories")
    thresholds = mapper.items("bin_thresholds_", len(columns))
    known = np.zeros((sum(categorical), _CATEGORIES), np.bool_)
    for column in range(len(known)):
        codes = mapper.floats_of("bin_thresholds_", thresholds[column], (None,))
        if np.any((codes < 0) | (codes >= _CATEGORIES)):
            raise mapper.fail("bin_thresholds_", "a category without a bit")
        known[column, codes.astype(np.int64)] = True
    return known


def _category_table(
    predictors: Sequence[Any], fitted: Fitted, columns: tuple[TreeColumn, ...], nodes: AnyArray, tree: IntArray
) -> tuple[Int32Array, BoolArray]:
    """`category_row` and `category_left` (see `TreeEnsemble`) of nodes, of which `tree` is the number of the tree."""
    known = _known_categories(fitted, columns)  # which native code reads, needed or not
    row = np.zeros(len(nodes), np.int32)
    if not any(column.categorical for column in columns):
        return row[:0], np.zeros(0, np.bool_)
    bitsets = [np.asarray(predictor.raw_left_cat_bitsets) for predictor in predictors]
    first = np.concatenate([[0], np.cumsum([len(bits) for bits in bitsets])[:-1]])
    bits = _unpacked(np.concatenate([b for b in bitsets if len(b)] or [np.zeros((0, 8), np.uint32)]))
    pieces: list[BoolArray] = []
    length = 0
    for node in np.flatnonzero((nodes["is_categorical"] != 0) & (nodes["is_leaf"] == 0)):
        column = int(nodes["feature_idx"][node])
        n = columns[column].n_categories
        in_left = bits[first[tree[node]] + nodes["bitset_idx"][node]][:n]
        missing = bool(nodes["missing_go_to_left"][node])
        # a category of the left side goes there, known or not (`_predictor.pyx: _predict_one_from_raw_data`)
        answer = np.where(known[column][:n] | in_left, in_left, missing)
        pieces.append(np.append(answer, [missing, missing]).astype(np.bool_))
        row[node] = length
        length += n + 2
    return row, np.concatenate(pieces) if pieces else np.zeros(0, np.bool_)


def _unpacked(bitsets: AnyArray) -> BoolArray:
    """Bitsets of eight 32-bit words as booleans, shape (bitsets, 256)."""
    words = np.ascontiguousarray(bitsets, dtype="<u4")
    return np.unpackbits(words.view(np.uint8), axis=1, bitorder="little").astype(np.bool_)
