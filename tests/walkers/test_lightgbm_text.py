"""LightGBM text files that are damaged, foreign or unsupported: a clear error, never another exception."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import reference
from st_codegen.walkers.forest import MAX_CATEGORY_ANSWERS
from st_codegen.walkers.lightgbm import model as walker
from tests.examples import examples

DATA = Path(__file__).parent / "data"


def text_of(tree: str, *, header: str = "", tail: str = "\nparameters:\nend of parameters\n") -> str:
    """A model of one tree with consistent sizes; `header` lines replace those of the same key."""
    lines = {
        "version": "v4",
        "num_class": "1",
        "num_tree_per_iteration": "1",
        "label_index": "0",
        "max_feature_idx": "1",
        "objective": "regression",
        "feature_names": "a b",
        "feature_infos": "[0:1] 0:1:2",
        "tree_sizes": str(len(f"Tree=0\n{tree}\n\n")),
    }
    for line in header.splitlines():
        key, _, value = line.partition("=")
        lines[key] = value
    joined = "\n".join(key + (f"={value}" if value else "") for key, value in lines.items() if value != "DROP")
    return f"tree\n{joined}\n\nTree=0\n{tree}\n\nend of trees\n{tail}"


STUMP = """num_leaves=3
num_cat=0
split_feature=0 1
threshold=0.5 1.5
decision_type=2 8
left_child=1 -1
right_child=-2 -3
leaf_value=1 2 3
is_linear=0
shrinkage=1
"""
SIZE = len("Tree=0\n" + STUMP + "\n\n")
CATEGORY = (
    STUMP.replace("num_cat=0", "num_cat=1")
    .replace("decision_type=2 8", "decision_type=2 1")
    .replace("threshold=0.5 1.5", "threshold=0.5 0")
    + "cat_boundaries=0 1\ncat_threshold=6\n"
)
LINEAR = (
    STUMP.replace("is_linear=0", "is_linear=1")
    + "leaf_const=1 2 3\nnum_features=0 1 2\nleaf_features=0  0 1\nleaf_coeff=1.5  2 -1\n"
)


@pytest.fixture
def load(tmp_path: Path) -> Callable[[str | bytes], Any]:
    def read(content: str | bytes) -> Any:
        path = tmp_path / "bad.txt"
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return walker.load_file(path, "model")

    return read


STEEP = LINEAR.replace("leaf_const=1 2 3", "leaf_const=0 0 0").replace(
    "leaf_coeff=1.5  2 -1", "leaf_coeff=1e30  1e30 1"
)

ZEROS = LINEAR.replace("leaf_const=1 2 3", "leaf_const=0e-400 -0.0 2.2250738585072014e-308")


@pytest.mark.parametrize(
    "tree",
    [STUMP, CATEGORY, CATEGORY.replace("decision_type=2 1", "decision_type=2 3"), LINEAR, STEEP, ZEROS],
    ids=["stump", "category", "category-default-left", "linear", "linear-that-shows-tiny-inputs", "linear-zeros"],
)
def test_hand_made_models_equal_the_library(tree: str, load: Any, assert_same: Any) -> None:
    pytest.importorskip("lightgbm")
    assert_same(load(text_of(tree)))


@examples(40, suppress_health_check=list(HealthCheck))
@given(
    numbers=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=20, max_size=60),
    style=st.sampled_from(["%r", "%.17g", "%.16e", "%.25e", "%+.19g", "%.40g"]),
)
def test_numbers_are_read_as_the_library_reads_them(numbers: list[float], style: str, load: Any) -> None:
    """Leaf values of a chain of splits at 0, 1, 2, .., one of which each row reaches."""
    pytest.importorskip("lightgbm")
    splits = range(len(numbers) - 1)
    fields = {
        "num_leaves": [len(numbers)],
        "num_cat": [0],
        "split_feature": [0 for _ in splits],
        "threshold": splits,
        "decision_type": [0 for _ in splits],
        "left_child": [~number for number in splits],
        "right_child": [*splits[1:], ~len(splits)],
        "leaf_value": [style % number for number in numbers],
    }
    text = "".join(f"{key}={' '.join(map(str, values))}\n" for key, values in fields.items())
    model = load(text_of(text))
    rows = np.column_stack([np.arange(len(numbers)), np.zeros(len(numbers))])
    assert np.array_equal(reference.evaluate(model.ir, rows), model.predict(rows))


def test_unused_category_sets_do_no_harm(load: Any) -> None:
    model = load(text_of(edited(STUMP, "num_cat", "1") + "cat_boundaries=0 1\ncat_threshold=6\n"))
    assert not model.ir.ops[0].has_categories


def test_leaf_numbers_need_not_follow_the_nodes(load: Any) -> None:
    model = load(text_of(STUMP))
    rows = np.array([[0.5, 1.5], [0.5, 1.6], [0.6, 0.0]])
    assert reference.evaluate(model.ir, rows)[:, 0].tolist() == [1.0, 3.0, 2.0]


def edited(tree: str, key: str, value: str | None) -> str:
    """A tree with one field exchanged, or dropped."""
    pattern = re.compile(rf"^{key}=.*\n", re.MULTILINE)
    assert pattern.search(tree)
    return pattern.sub("" if value is None else f"{key}={value}\n", tree)


@pytest.mark.parametrize(
    ("tree", "key", "value", "message"),
    [
        (STUMP, "num_leaves", "0", "tree 0, num_leaves: 0, expected 1 or more"),
        (STUMP, "num_leaves", "x", "tree 0, num_leaves: 'x' in a list of numbers"),
        (STUMP, "num_leaves", "3 3", "tree 0, num_leaves: 2 numbers, expected one"),
        (STUMP, "num_leaves", "2000000000", "tree 0, leaf_value: 3 numbers, expected 2000000000"),
        (STUMP, "num_leaves", None, "tree 0: the field 'num_leaves' is missing"),
        (STUMP, "leaf_value", "1 2", "tree 0, leaf_value: 2 numbers, expected 3"),
        (STUMP, "leaf_value", "1 nan 3", "tree 0, leaf_value: number 1 is nan"),
        (STUMP, "leaf_value", "1 2 1e400", "tree 0, leaf_value: number 2 is inf"),
        (STUMP, "leaf_value", "1 2 3_0", "tree 0, leaf_value: '_' in a list of numbers"),
        (STUMP, "leaf_value", "1 2 3x", "tree 0, leaf_value: 'x' in a list of numbers"),
        (STUMP, "leaf_value", "1 2 -", "tree 0, leaf_value: could not convert string to float: b'-'"),
        (STUMP, "leaf_value", "1 2\t3", "tree 0, leaf_value: '\\t' in a list of numbers"),
        (STUMP, "num_cat", "1", "tree 0: the field 'cat_boundaries' is missing"),
        (STUMP, "shrinkage", "1i", "tree 0, shrinkage: could not convert string to float: b'1i'"),
        (STUMP, "shrinkage", "x", "tree 0, shrinkage: 'x' in a list of numbers"),
        (STUMP + "leaf_weight=1 2\n", "leaf_weight", "1 2", "tree 0, leaf_weight: 2 numbers, expected 3"),
        (STUMP, "threshold", "0.5", "tree 0, threshold: 1 number, expected 2"),
        (STUMP, "threshold", "0.5 nan", "tree 0, threshold: number 1 is nan"),
        (STUMP, "threshold", "-inf 0.5", "tree 0, threshold: number 0 is -inf"),
        (STUMP, "split_feature", "0 2", "tree 0, split_feature: number 1 is 2, expected 0 .. 1"),
        (STUMP, "split_feature", "0 -1", "tree 0, split_feature: number 1 is -1, expected 0 .. 1"),
        (STUMP, "split_feature", "0 99999999999999999999", "tree 0, split_feature: Python int too large"),
        (STUMP, "decision_type", "2 12", "tree 0, decision_type: number 1 is 12, expected 0 .. 11"),
        (STUMP, "decision_type", "2 1", "tree 0, num_cat: 0, but 1 split on categories"),
        (STUMP, "left_child", "1 -4", "tree 0, left_child: number 1 is -4, expected -3 .. 1"),
        (STUMP, "left_child", "2 -1", "tree 0, left_child: number 0 is 2, expected -3 .. 1"),
        (STUMP, "left_child", "0 -1", "two parents or a cycle"),
        (STUMP, "right_child", "-1 -3", "two parents or a cycle"),
        (STUMP, "right_child", None, "tree 0: the field 'right_child' is missing"),
        (CATEGORY, "num_cat", "-1", "tree 0, num_cat: -1, but 1 split"),
        (CATEGORY, "cat_boundaries", "0", "tree 0, cat_boundaries: 1 number, expected 2"),
        (CATEGORY, "cat_boundaries", "1 0", "tree 0, cat_boundaries: not a rising list from 0"),
        (CATEGORY, "cat_boundaries", "0 1000000000", "tree 0, cat_threshold: 1 number, expected 1000000000"),
        (CATEGORY, "cat_threshold", "4294967296", "tree 0, cat_threshold: number 0 is 4294967296"),
        (CATEGORY, "cat_threshold", None, "tree 0: the field 'cat_threshold' is missing"),
        (CATEGORY, "threshold", "0.5 1", "tree 0, threshold: a split names a category set that is not one of 1"),
        (CATEGORY, "threshold", "0.5 0.5", "tree 0, threshold: a split names a category set"),
        (CATEGORY, "threshold", "0.5 nan", "tree 0, threshold: a split names a category set"),
        (LINEAR, "leaf_const", "1 2 inf", "tree 0, leaf_const: number 2 is inf"),
        (LINEAR, "leaf_const", "1 2 -1e-320", "tree 0, leaf_const: -1e-320 is nearer to 0 than LightGBM reads"),
        (LINEAR, "leaf_coeff", "1 2 0.001E-400", "tree 0, leaf_coeff: 0.001E-400 is nearer to 0 than LightGBM reads"),
        (LINEAR, "leaf_const", None, "tree 0: the field 'leaf_const' is missing"),
        (LINEAR, "num_features", "0 1 3", "tree 0, num_features: number 2 is 3, expected 0 .. 2"),
        (LINEAR, "num_features", "0 1 1", "tree 0, leaf_coeff: 3 numbers, expected 2"),
        (LINEAR, "leaf_features", "0 0 2", "tree 0, leaf_features: number 2 is 2, expected 0 .. 1"),
        (LINEAR, "leaf_coeff", "1 nan 2", "tree 0, leaf_coeff: number 1 is nan"),
    ],
)
def test_damaged_trees_are_refused(tree: str, key: str, value: str | None, message: str, load: Any) -> None:
    with pytest.raises(InputError, match=r"^bad\.txt: .*" + re.escape(message)):
        load(text_of(edited(tree, key, value)))


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("max_feature_idx=-1", "feature_names: 2 entries, max_feature_idx says 0"),
        ("max_feature_idx=2000000000", "feature_names: 2 entries, max_feature_idx says 2000000001"),
        ("max_feature_idx=x", "the header, max_feature_idx: 'x' in a list of numbers"),
        ("max_feature_idx=DROP", "the header: the field 'max_feature_idx' is missing"),
        ("feature_names=a b c", "feature_names: 3 entries, max_feature_idx says 2"),
        ("feature_infos=[0:1]", "feature_infos: 1 entry, max_feature_idx says 2"),
        ("feature_infos=DROP", "the header: the field 'feature_infos' is missing"),
        ("num_class=2", "num_tree_per_iteration: 1 for num_class 2"),
        ("num_class=DROP", "the header: the field 'num_class' is missing"),
        ("num_class=2\nnum_tree_per_iteration=2", "num_tree_per_iteration: 2 does not divide 1 tree"),
        ("num_class=0\nnum_tree_per_iteration=0", "num_tree_per_iteration: 0"),
        ("tree_sizes=12", f"tree 0: {SIZE} bytes long, tree_sizes says 12; the file was edited"),
        (f"tree_sizes={SIZE} {SIZE}", "the file ends after 1 of 2 trees"),
        ("tree_sizes=", "tree_sizes: 0 entries, but there are more trees"),
        ("tree_sizes=1e3", "tree_sizes: invalid literal"),
    ],
)
def test_damaged_headers_are_refused(header: str, message: str, load: Any) -> None:
    with pytest.raises(InputError, match=r"^bad\.txt: .*" + re.escape(message)):
        load(text_of(STUMP, header=header))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a LightGBM text model: the first line is not 'tree'"),
        (b"speed,torque\n1,2\n", "not a LightGBM text model"),
        (b"tree", "the file ends before its trees"),
        (b"\xef\xbb\xbftree\n", "not a LightGBM text model"),
        (b"tree\nend of trees\n", "the header: the field 'max_feature_idx' is missing"),
        (text_of(STUMP).encode().replace(b"feature_names=a b", b"feature_names=a \xff"), "feature_names: not UTF-8"),
        (text_of(STUMP).encode().replace(b"\n", b"\r\n"), "its line ends were converted"),
        (text_of(STUMP).encode().partition(b"leaf_value")[0], "the file ends inside tree 0"),
        (text_of(STUMP).encode().partition(b"end of trees")[0], "the file ends inside tree 0"),
        (text_of(STUMP + "num_cat=0\n").encode(), "tree 0, num_cat: given twice"),
        (text_of(STUMP + "half a line\n").encode(), "tree 0: the line 'half a line' is no field"),
        (text_of(STUMP).encode().replace(b"1 2 3", b"1 2 3\r4"), "a control character inside a line"),
        (text_of(STUMP).encode().replace(b"1 2 3", b"1 2 3\0"), "a control character inside a line"),
        (text_of(STUMP, header="label_index=0=1").encode(), "the header: the line 'label_index=0=1' is no field"),
        (text_of(STUMP, header="läbel=0").encode(), "the header: the line 'läbel=0' is no field"),
        (text_of(STUMP, tail="parameters:\n[boosting: gbdt]\n").encode(), "the file ends inside its parameters"),
        (text_of(STUMP, tail="parameters:\n[boosti").encode(), "parameters: the line '[boosti' is not [name: value]"),
        (text_of(STUMP, tail="pandas_categorical:[1]\n").encode(), "pandas_categorical: not a list of lists"),
        (text_of(STUMP, tail="pandas_categorical:[[\n").encode(), "pandas_categorical: Expecting value"),
        (text_of(STUMP, tail="pandas_categorical:" + "[" * 100_000).encode(), "pandas_categorical: "),
    ],
)
def test_files_that_are_no_whole_model_are_refused(content: bytes, message: str, load: Any) -> None:
    with pytest.raises(InputError, match=r"^bad\.txt: .*" + re.escape(message)):
        load(content)


def test_trees_in_the_wrong_places_are_refused(load: Any) -> None:
    """The library would look for the second tree a byte too late."""
    text = text_of(STUMP, header=f"tree_sizes={SIZE + 1} {SIZE - 1}")
    with pytest.raises(InputError, match=rf"tree 0: {SIZE} bytes long, tree_sizes says {SIZE + 1}"):
        load(text.replace("end of trees", f"Tree=1\n{STUMP}\n\nend of trees"))


def test_model_without_trees_is_refused(load: Any) -> None:
    text = text_of(STUMP, header="tree_sizes=DROP")
    with pytest.raises(InputError, match="the model has no trees"):
        load(text.partition("Tree=0")[0] + "end of trees\n")


def test_missing_file_and_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^none\.txt: cannot be read: No such file"):
        walker.load_file(tmp_path / "none.txt", "model")
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        walker.load_file(tmp_path, "model")


@pytest.mark.parametrize(
    ("objective", "reason"),
    [
        ("new_one", "is not known; supported: binary,"),
        ("multiclass num_class:3", "with 1 tree an iteration for 2 classes"),
        ("multiclassova", "with 1 tree an iteration for 2 classes"),
    ],
)
def test_objectives_that_are_not_known_or_do_not_fit_are_refused(objective: str, reason: str, load: Any) -> None:
    with pytest.raises(UnsupportedModelError, match=rf"^bad\.txt: objective '{objective}' {reason}"):
        load(text_of(STUMP, header=f"objective={objective}"))


@pytest.mark.parametrize("sigmoid", ["0", "-1", "nan", "1e9", "x", ""])
def test_a_sigmoid_that_cannot_be_is_refused(sigmoid: str, load: Any) -> None:
    with pytest.raises(InputError, match=r"expected a sigmoid of 1e-6 \.\. 1e6"):
        load(text_of(STUMP, header=f"objective=binary sigmoid:{sigmoid}"))


def test_several_trees_an_iteration_need_a_custom_objective(load: Any) -> None:
    text = text_of(STUMP, header="num_class=2\nnum_tree_per_iteration=2\ntree_sizes=DROP")
    both = text.replace("end of trees", f"Tree=1\n{STUMP}\n\nend of trees")
    with pytest.raises(UnsupportedModelError, match="objective 'regression' with 2 trees an iteration"):
        load(both)
    assert load(both.replace("objective=regression", "objective=custom")).ir.outputs == ("out1", "out2")


def test_category_codes_that_need_absurd_tables_are_refused(load: Any) -> None:
    words = MAX_CATEGORY_ANSWERS // 32 + 1
    tree = edited(edited(CATEGORY, "cat_boundaries", f"0 {words}"), "cat_threshold", "0 " * (words - 1) + "2147483648")
    with pytest.raises(UnsupportedModelError, match=r"category codes up to \d+ in 1 split .* number the categories"):
        load(text_of(tree))


def test_files_without_tree_sizes_are_read(load: Any, assert_same: Any) -> None:
    pytest.importorskip("lightgbm")
    assert_same(load(text_of(STUMP, header="tree_sizes=DROP")))


def test_library_errors_name_the_file(load: Any) -> None:
    pytest.importorskip("lightgbm")
    model = load(text_of(STUMP, header="label_index=DROP"))
    with pytest.raises(InputError, match=r"^bad\.txt: LightGBM cannot load it: .*label index"):
        model.predict(np.zeros((1, 2)))


@pytest.mark.parametrize("path", sorted(DATA.glob("lightgbm-*.txt")), ids=lambda path: path.stem)
@examples(suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_damaged_files_load_or_are_refused(path: Path, data: Any, mutated: Any, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.txt"
    damaged.write_bytes(mutated(data, path.read_bytes()))
    try:
        model = walker.load_file(damaged, "model")
    except InputError as error:
        assert str(error).startswith("damaged.txt: ")
    else:
        reference.evaluate(model.ir, np.zeros((2, len(model.ir.features))))


def test_text_that_the_library_does_not_survive_is_refused(load: Any) -> None:
    with pytest.raises(InputError, match="objective: empty"):
        load(text_of(STUMP).replace("objective=regression", "objective="))
    tree = STUMP.replace("threshold=", "\nthreshold=")
    with pytest.raises(InputError, match="tree 0: an empty line inside the tree"):
        load(text_of(tree))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("blank_before_a_field", "tree 0: the field 'num_cat' is missing"),
        ("blank_in_the_line_that_ends_a_tree", "tree 0: the line '\t' is no field"),
        ("fields_behind_the_last_that_is_read", "tree 0: 26 lines, expected at most 22 and an empty one"),
        ("last_tree_without_the_line_that_ends_it", "tree 1: 10 lines, expected at most 22 and an empty one"),
        ("leaves_beyond_32_bits", "tree 0, num_cat: -4294967295 is beyond 32 bits"),
        ("line_of_a_blank_in_the_parameters", "parameters: the line ' ' is not [name: value]"),
        ("linear_leaf_without_splits", "tree 0: the field 'split_feature' is missing"),
        ("sign_before_a_field_of_the_header", "the header: the line '=average_output' is no field"),
        ("tab_before_numbers", "tree 0, split_feature: '\\t' in a list of numbers"),
        ("tab_in_the_line_that_ends_a_tree", "tree 2: the line '\t' is no field"),
        ("tree_without_the_line_that_ends_it", "tree 0: 10 lines, expected at most 22 and an empty one"),
        ("two_returns_in_a_tree", "a control character inside a line"),
        ("two_signs_before_a_number", "tree 0, internal_value: could not convert string to float: b'--5'"),
    ],
)
def test_text_that_the_library_cuts_elsewhere_is_refused(name: str, message: str, load: Any) -> None:
    corpus = Path(__file__).parents[1] / "fuzz" / "corpus" / "lightgbm.txt"
    with pytest.raises(InputError, match=r"^bad\.txt: " + re.escape(message)):
        load((corpus / name).read_bytes())
