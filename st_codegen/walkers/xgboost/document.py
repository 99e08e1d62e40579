"""XGBoost's JSON and UBJSON model files: document -> checked arrays, without the xgboost package.

Format: `SaveModel` of `LearnerIO` (src/learner.cc), `GBTreeModel`, `Dart` and `GBLinearModel` (src/gbm), `RegTree` and
`MultiTargetTree` (src/tree) in XGBoost 3.2; files of versions 1.0 to 3.1 lack fields, have `default_left` as booleans,
or one `base_score` for all outputs.
"""

from __future__ import annotations

import itertools
import json
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from st_codegen.errors import InputError, UnsupportedModelError, counted
from st_codegen.ir import BoolArray, FloatArray, Int32Array, IntArray
from st_codegen.walkers.forest import CategorySets, ParsedTree
from st_codegen.walkers.limits import MAX_COLUMNS, check_json
from st_codegen.walkers.xgboost import ubjson

#: How a split reads its column.
READ_NUMBER, READ_CATEGORY = range(2)

#: `OutOfRangeCat`, src/common/categorical.h: codes from here on are not exact in float32.
_MAX_CATEGORY = 2**24

#: Lists of numbers of this length and above become arrays while JSON is read, so that memory is bounded by one tree.
_LONG_LIST = 16

_INT32 = 2**31


@dataclass(frozen=True)
class BoosterModel:
    """An XGBoost model.

    `base_score` is as in the file (after the objective's link), one number an output. Trees of boosting round `i` are
    `round_starts[i] .. round_starts[i+1]-1`; tree `t` adds to output `tree_output[t]`, or to all where leaves are
    vectors, after multiplication with `tree_weight[t]` (dart; otherwise None). `linear` is (features + 1, outputs) for
    gblinear, the last row being the bias. `categories` has the names of the category codes of each feature, where the
    model was trained on a data frame.
    """

    version: str
    booster: str
    objective: str
    n_features: int
    n_outputs: int
    base_score: FloatArray
    feature_names: tuple[str, ...] | None
    feature_types: tuple[str, ...] | None
    attributes: Mapping[str, str]
    categories: tuple[tuple[object, ...], ...]
    trees: tuple[ParsedTree, ...]
    tree_output: Int32Array
    round_starts: IntArray
    tree_weight: FloatArray | None
    linear: FloatArray | None

    @property
    def names(self) -> tuple[str, ...]:
        """Feature names; f0, f1, .. where the model has none, as XGBoost calls them."""
        return self.feature_names or tuple(f"f{number}" for number in range(self.n_features))

    @property
    def vector_leaves(self) -> bool:
        return any(tree.leaf_value.shape[1] > 1 for tree in self.trees)


def loads(data: bytes, *, binary: bool) -> BoosterModel:
    """Read the bytes of a `.json` file, or of a `.ubj` file (`binary`).

    Raises InputError that names the field where the data is no XGBoost model, cut or inconsistent.
    """
    if not data.lstrip().startswith(b"{") and any(name in data[:1024] for name in (b"gbtree", b"gblinear", b"dart")):
        raise UnsupportedModelError(
            "XGBoost's binary format, which new versions do not read either: load it with XGBoost 1.0 to 2.1, and save "
            "it again with save_model('model.json')"
        )
    if data[1:64].lstrip().startswith(b'"') if binary else data.startswith(b"{L\0"):
        found, suffix = ("JSON", ".json") if binary else ("UBJSON", ".ubj")
        raise InputError(f"this is {found}, and XGBoost goes by the name: let the name of the file end in {suffix}")
    document = ubjson.loads(data) if binary else _json(data)
    if not isinstance(document, dict) or not isinstance(document.get("learner"), dict):
        if isinstance(document, dict) and "tree_info" in document:
            raise UnsupportedModelError("what LightGBM's dump_model gives is for reading: save_model('model.txt')")
        if isinstance(document, list) and any(isinstance(tree, dict) and "nodeid" in tree for tree in document[:1]):
            raise UnsupportedModelError(
                "what XGBoost's dump_model writes lacks the objective and the base score: save_model('model.json')"
            )
        catboost = "" if binary else ", and not CatBoost's: no 'scale_and_bias' or no 'features_info'"
        raise InputError(f"not an XGBoost model: no object 'learner'{catboost}")
    root = DocumentPart(document, "")
    learner = root.section("learner")
    if "generic_param" in learner and "attributes" not in learner:
        raise UnsupportedModelError("what XGBoost's save_config gives has no trees: save_model('model.json')")
    parameters = learner.section("learner_model_param")
    n_features = parameters.integer("num_feature", 1)
    n_outputs = max(parameters.integer("num_class", 0), parameters.integer("num_target", 0, default=1), 1)
    if max(n_features, n_outputs) > MAX_COLUMNS:
        raise UnsupportedModelError(
            f"{parameters.path}num_feature, num_target: {counted(n_features, 'feature')} and "
            f"{counted(n_outputs, 'output')}; more than {MAX_COLUMNS} are not supported"
        )
    booster = learner.section("gradient_booster")
    kind = booster.text("name")
    version = root.indices("version", None, 0, _INT32) if "version" in root else ()
    common: dict[str, Any] = {
        "version": ".".join(map(str, version)) or "unknown",
        "booster": kind,
        "objective": learner.section("objective").text("name"),
        "n_features": n_features,
        "n_outputs": n_outputs,
        "base_score": _base_score(parameters, n_outputs),
        "feature_names": _texts(learner, "feature_names", n_features),
        "feature_types": _texts(learner, "feature_types", n_features),
        "attributes": _attributes(learner),
    }
    if kind == "gblinear":
        return BoosterModel(**common, **_linear(booster.section("model"), n_features, n_outputs))
    if kind not in ("gbtree", "dart"):
        raise UnsupportedModelError(f"gradient_booster.name: '{kind}'; supported: dart, gblinear, gbtree")
    forest = _forest((booster.section("gbtree") if kind == "dart" else booster).section("model"), n_features, n_outputs)
    weight = booster.floats("weight_drop", len(forest["trees"])) if kind == "dart" else None
    return BoosterModel(**common, **forest, tree_weight=weight, linear=None)


def _json(data: bytes) -> Any:
    check_json(data)
    try:
        return json.loads(data, object_hook=_with_arrays)
    except (ValueError, RecursionError) as error:
        raise InputError(f"not a JSON document: {error}") from None


def _with_arrays(entries: dict[str, Any]) -> dict[str, Any]:
    for key, value in entries.items():
        if isinstance(value, list) and len(value) >= _LONG_LIST and isinstance(value[0], int | float):
            entries[key] = _as_floats(value)
    return entries


def _as_floats(values: list[Any]) -> Any:
    """A list of numbers as float64 (which holds every int32 and float32); anything else stays as it is."""
    try:
        result = np.array(array("d", values))
    except (TypeError, OverflowError):
        return values
    # XGBoost reads digits without a point or exponent as int64, which wraps around
    if np.any(np.abs(result) >= 2.0**63) and any(isinstance(value, int) and abs(value) >= 2**63 for value in values):
        return values
    return result


class DocumentPart:
    """An object of the document and the path to it, for typed access with errors that name the field."""

    def __init__(self, entries: Mapping[str, Any], path: str) -> None:
        self.entries = entries
        self.path = path

    def fail(self, name: str, message: str) -> InputError:
        return InputError(f"{self.path}{name}: {message}")

    def __contains__(self, name: str) -> bool:
        return name in self.entries

    def get(self, name: str) -> Any:
        if name not in self.entries:
            raise self.fail(name, "missing")
        return self.entries[name]

    def section(self, name: str) -> DocumentPart:
        entries = self.get(name)
        if not isinstance(entries, dict):
            raise self.fail(name, "not an object")
        return DocumentPart(entries, f"{self.path}{name}.")

    def sections(self, name: str) -> list[DocumentPart]:
        entries = self.get(name)
        if not isinstance(entries, list) or not all(isinstance(one, dict) for one in entries):
            raise self.fail(name, "not a list of objects")
        return [DocumentPart(one, f"{self.path}{name}[{number}].") for number, one in enumerate(entries)]

    def text(self, name: str) -> str:
        value = self.get(name)
        if not isinstance(value, str):
            raise self.fail(name, "not a string")
        return value

    def integer(self, name: str, low: int, default: int | None = None) -> int:
        """An integer parameter, which XGBoost writes as a string."""
        if default is not None and name not in self:
            return default
        value = self.get(name)
        try:
            number = int(value) if isinstance(value, str | int) else None
        except ValueError:
            number = None
        if number is None or not low <= number < _INT32:
            raise self.fail(name, f"{str(value)[:40]!r}, expected an integer from {low}")
        return number

    def numbers(self, name: str, count: int | None = None, *, whole: bool = False) -> FloatArray:
        """A list of numbers as float64; `whole` ones are integers of 32 bits."""
        value = self.get(name)
        values = _as_floats(value) if isinstance(value, list) else value
        if not isinstance(values, np.ndarray):
            raise self.fail(name, "not a list of numbers")
        if count is not None and len(values) != count:
            raise self.fail(name, f"{counted(len(values), 'number')}, expected {count}")
        if whole and not np.all((values == np.trunc(values)) & (np.abs(values) <= _INT32)):
            raise self.fail(name, "a number that is no 32-bit integer")
        return values.astype(np.float64)

    def indices(self, name: str, count: int | None, low: int, high: int) -> IntArray:
        """A list of integers of low .. high-1."""
        values = self.numbers(name, count, whole=True).astype(np.int64)
        bad = np.flatnonzero((values < low) | (values >= high))
        if bad.size:
            raise self.fail(name, f"number {bad[0]} is {values[bad[0]]}, expected {low} .. {high - 1}")
        return values

    def floats(self, name: str, count: int, needed: BoolArray | None = None) -> FloatArray:
        """Numbers rounded to float32; where `needed`, they must be finite."""
        with np.errstate(over="ignore"):
            values = self.numbers(name, count).astype(np.float32).astype(np.float64)
        bad = np.flatnonzero(~np.isfinite(values) & (True if needed is None else needed))
        if bad.size:
            raise self.fail(name, f"number {bad[0]} is {values[bad[0]]}; train the model again")
        return values


def _base_score(parameters: DocumentPart, n_outputs: int) -> FloatArray:
    """Text such as "[5E-1,2E0]", "5E-1" or "(0.5, 2)" -> one float32 number an output."""
    text = parameters.text("base_score").strip()
    try:
        values = json.loads(text.replace("(", "[").replace(")", "]"))
    except (ValueError, RecursionError):
        values = None
    scores = DocumentPart({"base_score": values if isinstance(values, list) else [values]}, parameters.path)
    result = scores.floats("base_score", len(scores.get("base_score")))
    if len(result) not in (1, n_outputs):
        raise parameters.fail("base_score", f"{counted(len(result), 'number')} for {counted(n_outputs, 'output')}")
    return np.broadcast_to(result, n_outputs).copy()


def _texts(section: DocumentPart, name: str, count: int) -> tuple[str, ...] | None:
    """A list of `count` strings; None where it is missing or empty."""
    texts = section.get(name) if name in section else []
    if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
        raise section.fail(name, "not a list of strings")
    if texts and len(texts) != count:
        raise section.fail(name, f"{counted(len(texts), 'entry', 'entries')} for {counted(count, 'feature')}")
    return tuple(texts) or None


def _attributes(learner: DocumentPart) -> dict[str, str]:
    attributes = learner.section("attributes")
    return {name: attributes.text(name) for name in attributes.entries}


def _linear(model: DocumentPart, n_features: int, n_outputs: int) -> dict[str, Any]:
    return {
        "categories": (),
        "linear": model.floats("weights", (n_features + 1) * n_outputs).reshape(n_features + 1, n_outputs),
        "trees": (),
        "tree_output": np.zeros(0, np.int32),
        "round_starts": np.zeros(1, np.int64),
        "tree_weight": None,
    }


def _forest(model: DocumentPart, n_features: int, n_outputs: int) -> dict[str, Any]:
    """Trees in the order of their ids, with the outputs and rounds they belong to."""
    parameters = model.section("gbtree_model_param")
    sections = model.sections("trees")
    n_trees = parameters.integer("num_trees", 0)
    if n_trees != len(sections):
        raise model.fail("trees", f"{counted(len(sections), 'tree')}, num_trees says {n_trees}")
    if not sections:
        raise model.fail("trees", "the model has no trees")
    ids = [section.integer("id", 0) for section in sections]
    if sorted(ids) != list(range(n_trees)):
        raise model.fail("trees", "their ids are not 0, 1, 2, ..")
    ordered = [section for _, section in sorted(zip(ids, sections, strict=True), key=lambda pair: pair[0])]
    outputs = model.indices("tree_info", n_trees, 0, n_outputs)
    return {
        "trees": tuple(_tree(section, n_features, n_outputs) for section in ordered),
        "tree_output": outputs.astype(np.int32),
        "round_starts": _round_starts(model, parameters, n_trees, outputs),
        "categories": _category_names(model.section("cats")) if "cats" in model else (),
    }


def _category_names(cats: DocumentPart) -> tuple[tuple[object, ...], ...]:
    """Names by code for each feature (`CatContainer::Save`): numbers, or strings cut from UTF-8 bytes at offsets."""
    names: list[tuple[object, ...]] = []
    for encoding in cats.sections("enc"):
        values = encoding.numbers("values")
        if "offsets" in encoding:
            raw = (values.astype(np.int64) & 0xFF).astype(np.uint8).tobytes()
            ends = encoding.indices("offsets", None, 0, len(raw) + 1)
            # XGBoost 3.2 counts characters where it means bytes: names beyond ASCII are cut at wrong places
            pairs = itertools.pairwise(ends) if raw.isascii() else ()
            names.append(tuple(raw[start:end].decode() for start, end in pairs))
        else:
            names.append(tuple(f"{value:.17g}" for value in values))
    return tuple(names)


def _round_starts(model: DocumentPart, parameters: DocumentPart, n_trees: int, outputs: IntArray) -> IntArray:
    """`iteration_indptr`; older files have rounds of `num_parallel_tree` trees an output (`MakeIndptr`)."""
    if "iteration_indptr" in model:
        starts = model.indices("iteration_indptr", None, 0, n_trees + 1)
        if len(starts) < 2 or starts[0] != 0 or starts[-1] != n_trees or np.any(np.diff(starts) < 0):
            raise model.fail("iteration_indptr", f"not a rising list from 0 to {n_trees}")
        return starts
    size = max(parameters.integer("num_parallel_tree", 0, default=1), 1) * (int(outputs.max()) + 1)
    if n_trees % size:
        raise model.fail("trees", f"rounds of {size} do not divide {counted(n_trees, 'tree')}")
    return np.arange(0, n_trees + 1, size)


def _tree(section: DocumentPart, n_features: int, n_outputs: int) -> ParsedTree:
    """One tree; nodes that pruning deleted stay and are never reached."""
    parameters = section.section("tree_param")
    nodes = parameters.integer("num_nodes", 1)
    width = max(parameters.integer("size_leaf_vector", 0, default=1), 1)
    if width not in (1, n_outputs):
        raise parameters.fail("size_leaf_vector", f"{width}, the model has {counted(n_outputs, 'output')}")
    left = section.indices("left_children", nodes, -1, nodes)
    split = left >= 0
    right = section.indices("right_children", nodes, -1, _INT32)
    # the library goes to `left + 1`, whatever the file calls the right child (src/predictor/predict_fn.h)
    if np.any(split & (right != left + 1)):
        raise section.fail("right_children", "a right child that is not next to the left one; the file is damaged")
    if np.any(split & ((left < 1) | (right >= nodes))):
        raise section.fail("left_children", "a child outside the tree; the file is damaged")
    feature = section.indices("split_indices", nodes, -1, _INT32)
    if np.any(split & ((feature < 0) | (feature >= n_features))):
        raise section.fail("split_indices", f"a split on a feature that is not one of {n_features}")
    _check_unread_fields(section, nodes, width)
    categorical = np.zeros(nodes, np.bool_)
    if "split_type" in section:
        categorical = (section.indices("split_type", nodes, 0, 2) == 1) & split
    condition = section.floats("split_conditions", nodes, split & ~categorical if width > 1 else ~categorical)
    leaf_number = np.flatnonzero(~split)
    leaf = np.full(nodes, -1, np.int64)
    leaf[leaf_number] = np.arange(len(leaf_number))
    return ParsedTree(
        feature=np.where(split, feature, 0),
        reading=np.where(categorical, READ_CATEGORY, READ_NUMBER),
        threshold=np.where(split & ~categorical, condition, 0.0),
        left=left,
        right=np.where(split, right, -1),
        missing_left=section.indices("default_left", nodes, 0, 2) > 0,
        leaf=leaf,
        leaf_value=condition[leaf_number][:, None]
        if width == 1
        else _vector_leaves(section, right[leaf_number], width),
        categories=_category_sets(section, categorical),
    )


def _check_unread_fields(section: DocumentPart, nodes: int, width: int) -> None:
    """What the library reads besides: it does not survive a file without these, or with parents out of range."""
    if width > 1 and "leaf_weights" not in section:
        raise UnsupportedModelError(
            f"{section.path}leaf_weights: missing; trees with vector leaves from before XGBoost 3.2 cannot be read by "
            "XGBoost 3.2 either: train the model again"
        )
    for name in ("loss_changes", "sum_hessian"):
        section.numbers(name, nodes)
    section.numbers("base_weights")
    parents = section.numbers("parents", nodes, whole=True)
    if np.any((parents[1:] < 0) | (parents[1:] >= nodes)):
        raise section.fail("parents", "a parent outside the tree; the file is damaged")


def _vector_leaves(section: DocumentPart, rows: IntArray, width: int) -> FloatArray:
    """Leaves of a multi_output_tree (leaves, outputs); the right child of a leaf is its row of `leaf_weights`."""
    if np.any((rows < 0) | (rows >= len(rows))):
        raise section.fail("right_children", "a leaf without a row of leaf_weights")
    return section.floats("leaf_weights", len(rows) * width).reshape(len(rows), width)[rows]


def _category_sets(section: DocumentPart, categorical: BoolArray) -> CategorySets | None:
    """The categories that go right at each category split (`RegTree::LoadCategoricalSplit`)."""
    wanted = np.flatnonzero(categorical)
    if not len(wanted) and "categories_nodes" not in section:
        return None
    # the library follows these lists where no node splits by categories, too
    nodes = section.indices("categories_nodes", None, 0, len(categorical))
    if np.any(np.diff(nodes) <= 0) or not np.all(np.isin(wanted, nodes)):
        raise section.fail("categories_nodes", "not the rising list of the category splits")
    codes = section.indices("categories", None, 0, _MAX_CATEGORY)
    begin = section.indices("categories_segments", len(nodes), 0, len(codes) + 1)
    size = section.indices("categories_sizes", len(nodes), 1, len(codes) + 1)
    if np.any(begin + size > len(codes)):
        raise section.fail(
            "categories_sizes", f"a set that ends behind the {counted(len(codes), 'category', 'categories')}"
        )
    if not len(wanted):
        return None
    used = np.searchsorted(nodes, wanted)
    sets: Sequence[IntArray] = [codes[begin[one] : begin[one] + size[one]] for one in used]
    return CategorySets(nodes=wanted, counts=size[used], codes=np.concatenate(sets))
