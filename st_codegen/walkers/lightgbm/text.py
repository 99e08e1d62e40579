"""LightGBM's text model files: text -> checked arrays, without the lightgbm package.

Format: `GBDT::SaveModelToString` (src/boosting/gbdt_model_text.cpp) and `Tree::ToString` (src/io/tree.cpp) of LightGBM
4.7; files of versions 2.2 to 4 differ only in fields that do not take part in prediction.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from st_codegen.errors import InputError, counted, errors_name
from st_codegen.ir import FloatArray, IntArray
from st_codegen.walkers.forest import CategorySets, LeafModels, ParsedTree
from st_codegen.walkers.limits import MAX_COLUMNS, Things, check_count, check_json

#: How a split reads its column: the missing types of the format, and category sets.
READ_PLAIN, READ_ZERO_MISSING, READ_NAN_MISSING, READ_CATEGORY = range(4)

_CATEGORICAL_BIT, _DEFAULT_LEFT_BIT, _MISSING_SHIFT = 1, 2, 2
_MAX_DECISION_TYPE = (READ_NAN_MISSING << _MISSING_SHIFT) + _DEFAULT_LEFT_BIT + _CATEGORICAL_BIT

_ENDS_OF_TREES = (b"end of trees", b"feature_importances:", b"feature importances:")

_PARAMETER = re.compile(rb"\[(\w+): (.*)\]")

#: What its fast parser stops at: words, which must be nan or inf, and a second sign; all else may be in any order.
_NOT_FAST = re.compile(rb"[-+][-+]|[^-+.eE0-9 ]")

#: Lines of a tree that `Tree::Tree` reads at most.
_MAX_FIELDS = 22

#: The fields of a tree that prediction reads.
_TREE_FIELDS = frozenset(
    b"num_leaves num_cat split_feature threshold decision_type left_child right_child leaf_value cat_boundaries "
    b"cat_threshold is_linear leaf_const num_features leaf_features leaf_coeff leaf_weight".split()
)

#: Fields that LightGBM parses for other ends; on anything but numbers it stops the process.
_NUMERIC_FIELDS = frozenset(b"split_gain leaf_count internal_value internal_weight internal_count shrinkage".split())

#: Bytes of a list that become objects at the same time.
_PIECE = 2**16

_CHARACTERS_OF_NUMBERS = b"0123456789+-.eE naifNAIF"


@dataclass(frozen=True)
class TextModel:
    """A LightGBM text model.

    `objective` is the line of the file in words, empty for a custom objective; `categories` are the lists at the end of
    the file that map codes of pandas category columns, in the order of those columns.
    """

    version: str
    boosting: str
    objective: tuple[str, ...]
    average_output: bool
    n_outputs: int
    feature_names: tuple[str, ...]
    feature_infos: tuple[str, ...]
    categories: tuple[tuple[object, ...], ...]
    trees: tuple[ParsedTree, ...]

    @property
    def n_features(self) -> int:
        return len(self.feature_names)


def parse(stream: BinaryIO) -> TextModel:
    """Read a model line by line; memory is bounded by the arrays of the model and its longest line.

    Raises InputError that names the field and tree where the text is no LightGBM model, cut or inconsistent.
    """
    if stream.readline(64) not in (b"tree", b"tree\n", b"tree\r\n"):
        raise InputError(
            "not a LightGBM text model: the first line is not 'tree'; if it is no model, name it in leave_out of "
            "st-codegen.toml"
        )
    lines = _whole_lines(stream)
    header, line = _read_header(lines)
    n_features = _integer(header, "max_feature_idx", "the header") + 1
    names = _words(header, "feature_names", n_features)
    sizes = _integers(header["tree_sizes"], "tree_sizes") if "tree_sizes" in header else None
    trees: list[ParsedTree] = []
    while line.startswith(b"Tree="):
        check_count(len(trees) + 1, Things.TREES)
        line, fields = _read_tree(lines, line, len(trees), sizes)
        trees.append(_tree(fields, n_features, f"tree {len(trees)}"))
    if sizes is not None and len(trees) != len(sizes):
        raise InputError(f"the file ends after {len(trees)} of {counted(len(sizes), 'tree')}")
    if not trees:
        raise InputError("the model has no trees")
    boosting, categories = _read_tail(lines)
    average = "average_output" in header
    objective = tuple(filter(None, _text(header, "objective").split(" "))) if "objective" in header else ()
    if "objective" in header and not objective:  # the library takes the first word without asking for one
        raise InputError("objective: empty; a model with an objective of your own has no such line")
    return TextModel(
        version=_text(header, "version") if "version" in header else "unknown",
        boosting=boosting or ("rf" if average else "gbdt"),
        objective=objective,
        average_output=average,
        n_outputs=_count_outputs(header, len(trees)),
        feature_names=names,
        feature_infos=_words(header, "feature_infos", n_features),
        categories=categories,
        trees=tuple(trees),
    )


def _whole_lines(stream: BinaryIO) -> Iterator[bytes]:
    """Lines that LightGBM, which ends them at CR and strings at NUL, reads as the same lines."""
    for line in stream:
        if b"\0" in line or b"\r" in _text_of(line):
            raise InputError("a control character inside a line; the file is damaged")
        yield line


def _text_of(line: bytes) -> bytes:
    """A line without its end, and with all else: to LightGBM a line of blanks is not empty, and a tab is no blank."""
    return line.removesuffix(b"\n").removesuffix(b"\r")


def _read_header(lines: Iterator[bytes]) -> tuple[dict[str, bytes], bytes]:
    """The lines in front of the first tree, and the line that ended them."""
    header: dict[str, bytes] = {}
    for line in lines:
        if line.startswith((b"Tree=", *_ENDS_OF_TREES)):
            return header, line
        check_count(len(header), Things.TREES, "or other fields in the header")
        key, equals, value = _text_of(line).partition(b"=")
        # LightGBM drops what is empty between two signs: `=average_output` is a field to it
        if not key.isascii() or (equals and not key) or (b"=" in value and key != b"feature_names"):
            raise InputError(f"the header: the line '{line[:40].decode('utf-8', 'replace').strip()}' is no field")
        header[key.decode()] = value
    raise InputError("the file ends before its trees")


def _read_tree(
    lines: Iterator[bytes], heading: bytes, number: int, sizes: IntArray | None
) -> tuple[bytes, dict[str, bytes]]:
    """The wanted fields of a tree, and the line after it; the length is checked as the library relies on it."""
    fields: dict[str, bytes] = {}
    length = used = len(heading)
    ended, n_lines = False, 0
    for line in lines:
        if line.startswith((b"Tree=", *_ENDS_OF_TREES)):
            if not ended or n_lines > _MAX_FIELDS:  # the library would read on, or look for a tree in what is left
                raise InputError(
                    f"tree {number}: {counted(n_lines, 'line')}, expected at most {_MAX_FIELDS} and an empty one"
                )
            if sizes is not None:
                _check_size(number, sizes, used, length)
            return line, fields
        length += len(line)
        text = _text_of(line)
        if not text:
            ended = True
            continue
        if ended:  # the library ends the tree at the first empty line, and does not survive that fields are missing
            raise InputError(f"tree {number}: an empty line inside the tree; the file was edited or is damaged")
        used = length
        n_lines += 1
        key, equals, value = text.partition(b"=")
        if not equals:
            raise InputError(f"tree {number}: the line '{text[:40].decode('utf-8', 'replace')}' is no field")
        if key in _TREE_FIELDS:
            name = key.decode()
            if name in fields:
                raise InputError(f"tree {number}, {name}: given twice")
            fields[name] = value
        elif key in _NUMERIC_FIELDS:
            _check_unused(value, f"tree {number}, {key.decode()}")
    raise InputError(f"the file ends inside tree {number}")


def _check_size(number: int, sizes: IntArray, used: int, length: int) -> None:
    """LightGBM finds trees by `tree_sizes`; after the last tree some versions leave one more empty line."""
    if number >= len(sizes):
        raise InputError(f"tree_sizes: {counted(len(sizes), 'entry', 'entries')}, but there are more trees")
    size = int(sizes[number])
    if not (used <= size <= length if number == len(sizes) - 1 else size == length):
        raise InputError(
            f"tree {number}: {length} bytes long, tree_sizes says {size}; the file was edited, cut, or its line ends "
            "were converted: save the model again"
        )


def _read_tail(lines: Iterator[bytes]) -> tuple[str, tuple[tuple[object, ...], ...]]:
    """Boosting type and category lists from the lines behind the trees."""
    boosting, categories, inside = "", b"null", False
    for line in lines:
        text = _text_of(line)
        if text in (b"parameters:", b"end of parameters"):
            inside = text == b"parameters:"
        elif inside and text:
            # LightGBM does not survive a line of another form
            parameter = _PARAMETER.fullmatch(text)
            if parameter is None:
                raise InputError(f"parameters: the line '{text[:40].decode('utf-8', 'replace')}' is not [name: value]")
            if parameter[1] in (b"boosting", b"boosting_type"):
                boosting = parameter[2].decode("utf-8", "replace")
        elif text.startswith(b"pandas_categorical:"):
            categories = text.partition(b":")[2]
    if inside:
        raise InputError("the file ends inside its parameters")
    with errors_name("pandas_categorical"):
        check_json(categories)
    try:
        lists = json.loads(categories)
    except (ValueError, RecursionError) as error:
        raise InputError(f"pandas_categorical: {error}") from None
    if lists is None:
        return boosting, ()
    if not isinstance(lists, list) or not all(isinstance(one, list) for one in lists):
        raise InputError("pandas_categorical: not a list of lists")
    return boosting, tuple(tuple(one) for one in lists)


def _count_outputs(header: dict[str, bytes], n_trees: int) -> int:
    """Trees of one iteration, which is the number of outputs."""
    n_classes = _integer(header, "num_class", "the header")
    n_outputs = _integer(header, "num_tree_per_iteration", "the header") if "num_tree_per_iteration" in header else 1
    if n_outputs < 1 or n_classes != n_outputs:
        raise InputError(
            f"num_tree_per_iteration: {n_outputs} for num_class {n_classes}; they must be equal, 1 or more"
        )
    if n_trees % n_outputs:
        raise InputError(f"num_tree_per_iteration: {n_outputs} does not divide {counted(n_trees, 'tree')}")
    return n_outputs


def _tree(fields: dict[str, bytes], n_features: int, where: str) -> ParsedTree:
    """Fields of one tree -> arrays over all nodes: splits first, leaves behind them."""
    leaves = _integer(fields, "num_leaves", where)
    if leaves < 1:
        raise InputError(f"{where}, num_leaves: {leaves}, expected 1 or more")
    splits = leaves - 1
    n_sets = _integer(fields, "num_cat", where)
    leaf_value = _floats(fields, "leaf_value", leaves, where)
    linear = _leaf_models(fields, leaves, n_features, where)
    if leaves > 1 or linear is not None:
        # a linear tree of one leaf is asked for its splits too; the weights are not used, but must be as many as leaves
        for name in ("split_feature", "threshold", "left_child", "right_child"):
            _field(fields, name, where)
        if "leaf_weight" in fields:
            _floats(fields, "leaf_weight", leaves, where)
    _require_finite(leaf_value, "leaf_value", where)
    feature = _indices(fields, "split_feature", splits, where, 0, n_features)
    threshold = _floats(fields, "threshold", splits, where)
    if "decision_type" in fields:
        decision = _indices(fields, "decision_type", splits, where, 0, _MAX_DECISION_TYPE + 1)
    else:
        decision = np.zeros(splits, np.int64)
    categorical = (decision & _CATEGORICAL_BIT).astype(np.bool_)
    bad = ~categorical & (np.isnan(threshold) | (threshold == -np.inf))
    if np.any(bad):
        raise InputError(f"{where}, threshold: number {np.flatnonzero(bad)[0]} is {threshold[bad][0]}")
    # a leaf is written as the complement of its number
    left, right = (_indices(fields, f"{side}_child", splits, where, -leaves, splits) for side in ("left", "right"))

    def over_nodes(values: IntArray, at_leaves: int) -> IntArray:
        return np.concatenate([values, np.full(leaves, at_leaves, np.int64)])

    return ParsedTree(
        feature=over_nodes(feature, 0),
        reading=over_nodes(np.where(categorical, READ_CATEGORY, decision >> _MISSING_SHIFT), 0),
        threshold=np.concatenate([np.where(categorical, 0.0, threshold), np.zeros(leaves)]),
        left=over_nodes(np.where(left >= 0, left, splits + ~left), -1),
        right=over_nodes(np.where(right >= 0, right, splits + ~right), -1),
        # NaN goes right at a category split, whatever the default child says
        missing_left=over_nodes(np.where(categorical, 0, decision & _DEFAULT_LEFT_BIT), 0) > 0,
        leaf=np.concatenate([np.full(splits, -1, np.int64), np.arange(leaves)]),
        leaf_value=leaf_value[:, None],
        categories=_category_sets(fields, threshold, np.flatnonzero(categorical), n_sets, where),
        linear=linear,
    )


def _category_sets(
    fields: dict[str, bytes], threshold: FloatArray, nodes: IntArray, n_sets: int, where: str
) -> CategorySets | None:
    """Bit sets of 32-bit words -> codes; the threshold of a category split is the number of its set."""
    if n_sets < 1:
        if len(nodes):
            raise InputError(f"{where}, num_cat: {n_sets}, but {counted(len(nodes), 'split')} on categories")
        return None
    boundaries = _indices(fields, "cat_boundaries", n_sets + 1, where, 0, 2**31)
    if boundaries[0] != 0 or np.any(np.diff(boundaries) < 0):
        raise InputError(f"{where}, cat_boundaries: not a rising list from 0")
    words = _indices(fields, "cat_threshold", int(boundaries[-1]), where, 0, 2**32)
    number = threshold[nodes]
    if not np.all((number >= 0) & (number < n_sets) & (number == np.trunc(number))):
        raise InputError(f"{where}, threshold: a split names a category set that is not one of {n_sets}")
    bits = np.flatnonzero(np.unpackbits(words.astype("<u4").view(np.uint8), bitorder="little"))
    first_bit = np.searchsorted(bits, boundaries * 32)
    if not len(nodes):
        return None
    sets = number.astype(np.int64)
    codes = [bits[first_bit[one] : first_bit[one + 1]] - boundaries[one] * 32 for one in sets]
    return CategorySets(nodes=nodes, counts=first_bit[sets + 1] - first_bit[sets], codes=np.concatenate(codes))


def _leaf_models(fields: dict[str, bytes], leaves: int, n_features: int, where: str) -> LeafModels | None:
    """Linear models of the leaves (linear_tree); None for a plain tree."""
    if "is_linear" not in fields or _integer(fields, "is_linear", where) == 0:
        return None
    constant = _floats(fields, "leaf_const", leaves, where, _stod)
    counts = _indices(fields, "num_features", leaves, where, 0, n_features + 1)
    total = int(counts.sum())
    coefficient = _floats(fields, "leaf_coeff", total, where, _stod)
    _require_finite(constant, "leaf_const", where)
    _require_finite(coefficient, "leaf_coeff", where)
    return LeafModels(
        constant=constant,
        counts=counts,
        column=_indices(fields, "leaf_features", total, where, 0, n_features),
        coefficient=coefficient,
    )


def _require_finite(values: FloatArray, name: str, where: str) -> None:
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise InputError(f"{where}, {name}: number {bad[0]} is {values[bad[0]]}; train the model again")


def _field(fields: dict[str, bytes], name: str, where: str) -> bytes:
    if name not in fields:
        raise InputError(f"{where}: the field '{name}' is missing")
    return fields[name]


def _text(fields: dict[str, bytes], name: str) -> str:
    try:
        return _field(fields, name, "the header").decode("utf-8")
    except UnicodeDecodeError:
        raise InputError(f"{name}: not UTF-8 text") from None


def _words(fields: dict[str, bytes], name: str, count: int) -> tuple[str, ...]:
    text = _text(fields, name)
    if text.count(" ") > MAX_COLUMNS:
        raise InputError(f"{name}: more than {MAX_COLUMNS} features are not supported")
    words = tuple(word for word in text.split(" ") if word)
    if count < 1 or len(words) != count:
        raise InputError(f"{name}: {counted(len(words), 'entry', 'entries')}, max_feature_idx says {count}")
    return words


def _integer(fields: dict[str, bytes], name: str, where: str) -> int:
    values = _integers(_field(fields, name, where), f"{where}, {name}")
    if len(values) != 1:
        raise InputError(f"{where}, {name}: {counted(len(values), 'number')}, expected one")
    if abs(values[0]) >= 2**31:
        raise InputError(f"{where}, {name}: {values[0]} is beyond 32 bits")
    return int(values[0])


def _indices(fields: dict[str, bytes], name: str, count: int, where: str, low: int, high: int) -> IntArray:
    """`count` integers of low .. high-1; a field without entries may be missing."""
    if count == 0:
        return np.zeros(0, np.int64)
    values = _integers(_field(fields, name, where), f"{where}, {name}")
    _check_count(values, count, f"{where}, {name}")
    bad = np.flatnonzero((values < low) | (values >= high))
    if bad.size:
        raise InputError(f"{where}, {name}: number {bad[0]} is {values[bad[0]]}, expected {low} .. {high - 1}")
    return values


def _floats(
    fields: dict[str, bytes], name: str, count: int, where: str, number: Callable[[bytes], float] = float
) -> FloatArray:
    """`count` numbers, each rounded to the nearest float64 as LightGBM's parser rounds them."""
    if count == 0:
        return np.zeros(0)
    values = np.fromiter(_numbers(number, _field(fields, name, where), f"{where}, {name}"), np.float64)
    _check_count(values, count, f"{where}, {name}")
    return values


def _stod(word: bytes) -> float:
    """A number of a linear leaf: LightGBM reads it by `std::stod`, which stops the process at a subnormal one."""
    value = float(word)
    if abs(value) < np.finfo(np.float64).tiny and word.lower().partition(b"e")[0].strip(b"+-0."):
        raise ValueError(f"{word.decode()} is nearer to 0 than LightGBM reads")
    return value


def _integers(text: bytes, where: str) -> IntArray:
    try:
        return np.fromiter(_numbers(int, text, where), np.int64)
    except OverflowError as error:
        raise InputError(f"{where}: {error}") from None


def _numbers(kind: Callable[[bytes], int | float], text: bytes, where: str) -> Iterator[int | float]:
    _check_characters(text, where)
    check_count(text.count(b" ") + 1, Things.NUMBERS, f"in {where}")
    try:
        for piece in _pieces(text):
            yield from map(kind, piece.split())
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None


def _pieces(text: bytes) -> Iterator[bytes]:
    """A long list in pieces that end at blanks: an entry in a list of its own takes many times its bytes."""
    start = 0
    while start < len(text):
        end = text.find(b" ", start + _PIECE)
        end = len(text) if end < 0 else end
        yield text[start:end]
        start = end


def _check_unused(text: bytes, where: str) -> None:
    if _NOT_FAST.search(text):
        for _ in _numbers(float, text, where):
            pass


def _check_characters(text: bytes, where: str) -> None:
    """Numbers are divided by blanks only, and Python would read 1_000 as one."""
    other = text.translate(None, _CHARACTERS_OF_NUMBERS)
    if other:
        raise InputError(f"{where}: {other[:1].decode('latin-1')!r} in a list of numbers")


def _check_count(values: NDArray[np.generic], count: int, where: str) -> None:
    if len(values) != count:
        raise InputError(f"{where}: {counted(len(values), 'number')}, expected {count}")
