"""Walkers for scikit-learn's tree models.

Rules (scikit-learn 1.9; `tree/_tree.pyx: _apply_dense`, `ensemble/_forest.py`, `ensemble/_gradient_boosting.pyx`,
`ensemble/_hist_gradient_boosting/_predictor.pyx`): DecisionTree, ExtraTree, RandomForest, ExtraTrees and
GradientBoosting round x to float32 and go left on `x <= threshold` (float64); forests add float64 in tree order and
divide by their number; GradientBoosting adds learning_rate * leaf in order to its initial value.
HistGradientBoosting compares float64 and adds leaves to its baseline.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import (
    FLOAT32_OVERFLOW,
    Activation,
    AnyArray,
    BoolArray,
    Comparison,
    FloatArray,
    Function,
    Int32Array,
    IntArray,
    Precision,
    TreeColumn,
    TreeEnsemble,
)
from st_codegen.ir.preorder import preorder
from st_codegen.walkers.base import GraphBuilder, require_fitted, walks

#: Arrays of nodes, checked by scikit-learn when they are loaded.
_TREE = ("sklearn.tree._tree.Tree",)


@walks("sklearn.DecisionTreeRegressor", "sklearn.ExtraTreeRegressor", trusts=_TREE)
def walk_tree(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """One tree; several outputs are wide leaves."""
    require_fitted(estimator, "tree_")
    return _add_float32_trees(builder, value, [estimator], estimator)


@walks("sklearn.RandomForestRegressor", "sklearn.ExtraTreesRegressor", trusts=_TREE)
def walk_forest(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """Sum of the trees in order, divided by their number (`ForestRegressor.predict` with n_jobs=1)."""
    require_fitted(estimator, "estimators_")
    return _add_float32_trees(builder, value, estimator.estimators_, estimator, divisor=len(estimator.estimators_))


@walks("sklearn.GradientBoostingRegressor", trusts=_TREE)
def walk_gradient_boosting(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """Initial value plus learning_rate * leaf, tree by tree (`_predict_regression_tree_inplace_fast_dense`)."""
    require_fitted(estimator, "estimators_")
    initial = 0.0
    if not isinstance(estimator.init_, str):  # the string is "zero"
        if type(estimator.init_).__name__ != "DummyRegressor":
            raise UnsupportedModelError(
                f"GradientBoostingRegressor with init={type(estimator.init_).__name__}: only the default initial value "
                "and init='zero' are supported; train without `init`, or put that model into a pipeline of its own"
            )
        initial = float(np.ravel(estimator.init_.constant_)[0])
    return _add_float32_trees(
        builder,
        value,
        list(estimator.estimators_[:, 0]),
        estimator,
        base=initial,
        leaf_scale=float(estimator.learning_rate),
    )


def _add_float32_trees(
    builder: GraphBuilder,
    value: int,
    trees: Sequence[Any],
    estimator: Any,
    *,
    base: float = 0.0,
    leaf_scale: float = 1.0,
    divisor: float = 1.0,
) -> int:
    """The trees of `sklearn.tree`; `leaf_scale * leaf` is rounded once here as the library rounds it at run time."""
    allows_nan = estimator.__sklearn_tags__().input_tags.allow_nan
    if not allows_nan:
        builder.refuse_nan()
    builder.refuse_magnitude(FLOAT32_OVERFLOW)
    structures = [tree.tree_ for tree in trees]
    sizes = np.array([tree.node_count for tree in structures])
    offset = np.concatenate([[0], np.cumsum(sizes)[:-1]])

    def joined(attribute: str) -> AnyArray:
        return np.concatenate([getattr(tree, attribute) for tree in structures])

    shift = np.repeat(offset, sizes)
    left, right = joined("children_left"), joined("children_right")
    layout = preorder(offset, np.where(left < 0, -1, left + shift), np.where(right < 0, -1, right + shift))
    order = layout.order
    inner = layout.left >= 0
    leaf_values: FloatArray = leaf_scale * joined("value")[:, :, 0][order[~inner]]
    n_outputs = leaf_values.shape[1]
    return builder.add(
        TreeEnsemble(
            inputs=(value,),
            columns=tuple(TreeColumn(column) for column in range(builder.width(value))),
            roots=layout.roots,
            split=np.where(inner, joined("feature")[order], -1),
            threshold=np.where(inner, joined("threshold")[order], 0.0),
            left=layout.left,
            right=layout.right,
            missing_left=inner & joined("missing_go_to_left")[order].astype(np.bool_),
            leaf=np.where(inner, -1, np.cumsum(~inner) - 1),
            leaf_value=leaf_values,
            tree_output=np.zeros(len(structures), np.int32),
            base=np.full(n_outputs, base),
            comparison=Comparison.LESS_OR_EQUAL,
            input_precision=Precision.FLOAT32,
            divisor=float(divisor),
        )
    )


@walks(
    "sklearn.HistGradientBoostingRegressor",
    trusts=(
        "sklearn.ensemble._hist_gradient_boosting.predictor.TreePredictor",
        # the encoder of categories; a partial can only hold a function that is itself trusted
        "functools.partial",
        "sklearn.utils.validation.check_array",
    ),
)
def walk_hist_gradient_boosting(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """Baseline plus leaves in order, then the inverse of the loss's link; missing values and categories included."""
    require_fitted(estimator, "_predictors")
    predictors = [predictor for iteration in estimator._predictors for predictor in iteration]
    nodes = np.concatenate([predictor.nodes for predictor in predictors])
    sizes = np.array([len(predictor.nodes) for predictor in predictors])
    offset = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    shift = np.repeat(offset, sizes)
    is_leaf = nodes["is_leaf"].astype(np.bool_)
    layout = preorder(
        offset,
        np.where(is_leaf, -1, nodes["left"].astype(np.int64) + shift),
        np.where(is_leaf, -1, nodes["right"].astype(np.int64) + shift),
    )
    nodes = nodes[layout.order]
    inner = layout.left >= 0
    columns = _hist_columns(estimator, builder.width(value))
    if value == 0:  # the encoder of categories refuses infinities
        builder.refuse_magnitude(np.inf, [column.column for column in columns if column.categorical])
    categories = _HistCategories(predictors, sizes, estimator)
    category_row, category_left = categories.table(nodes, layout.order, columns)
    raw = builder.add(
        TreeEnsemble(
            inputs=(value,),
            columns=columns,
            roots=layout.roots,
            split=np.where(inner, nodes["feature_idx"].astype(np.int64), -1),
            threshold=np.where(inner & (nodes["is_categorical"] == 0), nodes["num_threshold"], 0.0),
            left=layout.left,
            right=layout.right,
            missing_left=inner & (nodes["missing_go_to_left"] != 0),
            leaf=np.where(inner, -1, np.cumsum(~inner) - 1),
            leaf_value=nodes["value"][~inner][:, None].astype(np.float64),
            tree_output=np.zeros(len(predictors), np.int32),
            base=np.ravel(estimator._baseline_prediction).astype(np.float64),
            comparison=Comparison.LESS_OR_EQUAL,
            category_row=category_row,
            category_left=category_left,
        )
    )
    link = type(estimator._loss.link).__name__
    if link == "IdentityLink":
        return raw
    if link == "LogLink":
        return builder.add(Activation((raw,), Function.EXP, 1))
    raise UnsupportedModelError(f"HistGradientBoostingRegressor with loss={estimator.loss!r}: unknown link {link}")


def _hist_columns(estimator: Any, n_features: int) -> tuple[TreeColumn, ...]:
    """The columns as the nodes number them: with categories, the encoder puts the categorical ones first."""
    if estimator._preprocessor is None:
        return tuple(TreeColumn(column) for column in range(n_features))
    categorical = np.flatnonzero(estimator.is_categorical_)
    numeric = np.flatnonzero(~np.asarray(estimator.is_categorical_))
    encoder = estimator._preprocessor.named_transformers_["encoder"]
    columns = []
    for column, known in zip(categorical, encoder.categories_, strict=True):
        if not np.issubdtype(np.asarray(known).dtype, np.number):
            raise UnsupportedModelError(
                f"feature {column} has categories that are no numbers ({', '.join(map(str, known[:3]))}, ..); a PLC "
                "block takes numbers: encode the categories as integers before training"
            )
        values = tuple(float(v) for v in known if not np.isnan(v))
        columns.append(TreeColumn(int(column), n_categories=len(values), categories=values))
    return (*columns, *(TreeColumn(int(column)) for column in numeric))


class _HistCategories:
    """The bitsets of categorical splits as one table of booleans (see `TreeEnsemble.category_left`)."""

    def __init__(self, predictors: Sequence[Any], sizes: AnyArray, estimator: Any) -> None:
        self.bitsets = [np.asarray(predictor.raw_left_cat_bitsets) for predictor in predictors]
        self.first_bitset = np.concatenate([[0], np.cumsum([len(bits) for bits in self.bitsets])[:-1]])
        self.tree_of_node = np.repeat(np.arange(len(predictors)), sizes)
        self.known: AnyArray | None = None
        if estimator._preprocessor is not None:
            self.known = _unpacked(estimator._bin_mapper.make_known_categories_bitsets()[0])

    def table(self, nodes: AnyArray, order: IntArray, columns: tuple[TreeColumn, ...]) -> tuple[Int32Array, BoolArray]:
        """`category_row` and `category_left` of the nodes in their new order."""
        if self.known is None:
            return np.zeros(0, np.int32), np.zeros(0, np.bool_)
        bits = _unpacked(np.concatenate([b for b in self.bitsets if len(b)] or [np.zeros((0, 8), np.uint32)]))
        row = np.zeros(len(nodes), np.int32)
        pieces: list[BoolArray] = []
        length = 0
        for node in np.flatnonzero(nodes["is_categorical"]):
            column = int(nodes["feature_idx"][node])
            n = columns[column].n_categories
            in_left = bits[self.first_bitset[self.tree_of_node[order[node]]] + nodes["bitset_idx"][node]][:n]
            missing = bool(nodes["missing_go_to_left"][node])
            answer = np.where(self.known[column][:n], in_left, missing)
            pieces.append(np.append(answer, [missing, missing]).astype(np.bool_))
            row[node] = length
            length += n + 2
        return row, np.concatenate(pieces) if pieces else np.zeros(0, np.bool_)


def _unpacked(bitsets: AnyArray) -> BoolArray:
    """Bitsets of eight 32-bit words as booleans, shape (bitsets, 256)."""
    words = np.ascontiguousarray(bitsets, dtype="<u4")
    return np.unpackbits(words.view(np.uint8), axis=1, bitorder="little").astype(np.bool_)
