"""XGBoost files that are damaged, foreign or unsupported: a clear error, never another exception."""

from __future__ import annotations

import copy
import json
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import reference
from st_codegen.walkers.xgboost import model as walker
from tests.examples import examples

DATA = Path(__file__).parent / "data"

FUZZ = examples(suppress_health_check=list(HealthCheck))

FILES = sorted(DATA.glob("xgboost-*"))

#: What a field of a document is exchanged with.
NASTY = [None, True, -1, 0, 1, 7, 2**31, 2**70, 1.5, float("nan"), float("inf"), 1e400, "", "x", "-1", "1e9", [], {}]
NASTY += [[[]], [None], [1, "x"], [[1, 2], [3]], [2**70] * 20, ["x"] * 20, [0.5] * 20, {"enc": 1}, "[1,2", "[" * 5000]


def tree(**changes: Any) -> dict[str, Any]:
    """A stump on feature 0, with fields exchanged."""
    fields = {
        "tree_param": {"num_nodes": "3", "size_leaf_vector": "1", "num_feature": "2", "num_deleted": "0"},
        "id": 0,
        "left_children": [1, -1, -1],
        "right_children": [2, -1, -1],
        "parents": [2147483647, 0, 0],
        "split_indices": [0, 0, 0],
        "split_conditions": [0.5, -1.0, 2.0],
        "split_type": [0, 0, 0],
        "default_left": [1, 0, 0],
        "categories": [],
        "categories_nodes": [],
        "categories_segments": [],
        "categories_sizes": [],
        "base_weights": [0.0, 0.0, 0.0],
        "loss_changes": [1.0, 0.0, 0.0],
        "sum_hessian": [2.0, 1.0, 1.0],
    }
    return fields | changes


CATEGORY = {
    "split_type": [1, 0, 0],
    "categories": [1, 3],
    "categories_nodes": [0],
    "categories_segments": [0],
    "categories_sizes": [2],
}
VECTOR = {
    "tree_param": {"num_nodes": "3", "size_leaf_vector": "2", "num_feature": "2", "num_deleted": "0"},
    "right_children": [2, 0, 1],
    "parents": [-1, 0, 0],
    "base_weights": [0.0] * 6,
    "leaf_weights": [1.0, 2.0, 3.0, 4.0],
}


def document(one: dict[str, Any] | None = None, **changes: Any) -> dict[str, Any]:
    """A model of one tree; `changes` replace entries by their path, parts joined by two underscores (DROP: removed)."""
    model = {
        "gbtree_model_param": {"num_trees": "1", "num_parallel_tree": "1"},
        "trees": [tree() if one is None else one],
        "tree_info": [0],
        "iteration_indptr": [0, 1],
        "cats": {"enc": [], "feature_segments": [], "sorted_idx": []},
    }
    result: dict[str, Any] = {
        "version": [3, 2, 0],
        "learner": {
            "attributes": {},
            "feature_names": [],
            "feature_types": [],
            "gradient_booster": {"name": "gbtree", "model": model},
            "learner_model_param": {"base_score": "[5E-1]", "num_class": "0", "num_feature": "2", "num_target": "1"},
            "objective": {"name": "reg:squarederror", "reg_loss_param": {"scale_pos_weight": "1"}},
        },
    }
    for path, value in changes.items():
        parts = path.split("__")
        place = result
        for part in parts[:-1]:
            place = place[part]
        if value == "DROP":
            del place[parts[-1]]
        else:
            place[parts[-1]] = value
    return result


PARAM = "learner__learner_model_param__"
BOOSTER = "learner__gradient_booster__"
MODEL = BOOSTER + "model__"
TWO = {PARAM + "num_target": "2", PARAM + "base_score": "[0,1E0]"}


@pytest.fixture
def load(tmp_path: Path) -> Callable[..., Any]:
    def read(content: bytes | dict[str, Any], suffix: str = "json") -> Any:
        path = tmp_path / f"bad.{suffix}"
        path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
        return walker.load_file(path, "model")

    return read


@pytest.mark.parametrize(
    "content",
    [
        document(),
        document(tree(**CATEGORY)),
        document(tree(**VECTOR), **TWO),
        document(tree(**VECTOR | {"right_children": [2, 1, 0]}), **TWO),
        document(tree(default_left=[True, False, False])),
        document(**{MODEL + "iteration_indptr": "DROP"}),
        document(**{PARAM + "base_score": "5E-1"}),
        document(**{PARAM + "base_score": "(0.5)"}),
        document(**{PARAM + "num_target": "DROP"}),
        document(**{BOOSTER + "name": "gblinear", BOOSTER + "model": {"weights": [1.5, -2.0, 0.25]}}),
    ],
    ids=[
        "stump",
        "category",
        "vector",
        "vector-rows",
        "booleans",
        "no-rounds",
        "scalar-base",
        "tuple-base",
        "no-targets",
        "linear",
    ],
)
def test_hand_made_models_equal_the_library(content: dict[str, Any], load: Any, assert_same: Any) -> None:
    pytest.importorskip("xgboost")
    assert_same(load(content))


def test_one_base_score_serves_all_outputs_of_older_files(load: Any, assert_same: Any) -> None:
    pytest.importorskip("xgboost")
    model = load(document(tree(**VECTOR), **TWO | {PARAM + "base_score": "5E-1"}))
    assert_same(model)
    assert model.ir.ops[0].base.tolist() == [0.5, 0.5]


@examples(40, suppress_health_check=list(HealthCheck))
@given(
    numbers=st.lists(st.floats(width=32, allow_nan=False, allow_infinity=False), min_size=3, max_size=3),
    style=st.sampled_from(["%.9g", "%.8E", "%.17e", "%.30e"]),
)
def test_numbers_are_read_as_the_library_reads_them(numbers: list[float], style: str, load: Any) -> None:
    pytest.importorskip("xgboost")
    text = json.dumps(document(tree(split_conditions=[1, 2, 3]), **{PARAM + "base_score": "0E0"}))
    digits = [style % number for number in numbers]
    model = load(
        text.replace("[1, 2, 3]", f"[{', '.join(d if '.' in d or 'e' in d else d + '.0' for d in digits)}]").encode()
    )
    threshold = float(np.float32(numbers[0]))
    rows = np.array([[threshold, 0.0], [np.nextafter(np.float32(threshold), np.float32(-np.inf)), 0.0]])
    assert np.array_equal(reference.evaluate(model.ir, rows), model.predict(rows))


def test_trees_are_ordered_by_their_ids(load: Any, assert_same: Any) -> None:
    pytest.importorskip("xgboost")
    trees = [tree(id=1, split_conditions=[0.25, 1e-8, 1e8]), tree()]
    content = document(**{MODEL + "trees": trees, MODEL + "tree_info": [0, 0], MODEL + "iteration_indptr": [0, 1, 2]})
    content["learner"]["gradient_booster"]["model"]["gbtree_model_param"]["num_trees"] = "2"
    model = load(content)
    assert model.ir.ops[0].leaf_value[:, 0].tolist() == [-1.0, 2.0, float(np.float32(1e-8)), 1e8]
    assert_same(model)


PLACE = "learner.gradient_booster.model."


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"left_children": [1, -1]}, "trees[0].left_children: 2 numbers, expected 3"),
        ({"left_children": [3, -1, -1]}, "trees[0].left_children: number 0 is 3, expected -1 .. 2"),
        ({"left_children": [1.5, -1, -1]}, "trees[0].left_children: a number that is no 32-bit integer"),
        ({"left_children": [0, -1, -1], "right_children": [1, -1, -1]}, "trees[0].left_children: a child outside"),
        ({"left_children": [2, -1, -1], "right_children": [3, -1, -1]}, "trees[0].left_children: a child outside"),
        ({"right_children": [1, -1, -1]}, "trees[0].right_children: a right child that is not next to the left one"),
        ({"left_children": [1, 1, -1], "right_children": [2, 2, -1]}, "two parents or a cycle"),
        ({"left_children": "x"}, "trees[0].left_children: not a list of numbers"),
        ({"left_children": [[1], [-1], [-1]]}, "trees[0].left_children: not a list of numbers"),
        ({"split_indices": [2, 0, 0]}, "trees[0].split_indices: a split on a feature that is not one of 2"),
        ({"split_indices": [-1, 0, 0]}, "trees[0].split_indices: a split on a feature that is not one of 2"),
        ({"split_conditions": [float("nan"), 1, 2]}, "trees[0].split_conditions: number 0 is nan; train the model"),
        ({"split_conditions": [1e39, 1, 2]}, "trees[0].split_conditions: number 0 is inf"),
        ({"split_conditions": [0.5, 1, float("inf")]}, "trees[0].split_conditions: number 2 is inf"),
        ({"default_left": [2, 0, 0]}, "trees[0].default_left: number 0 is 2, expected 0 .. 1"),
        ({"parents": [-1, 5, 0]}, "trees[0].parents: a parent outside the tree"),
        ({"loss_changes": []}, "trees[0].loss_changes: 0 numbers, expected 3"),
        ({"sum_hessian": None}, "trees[0].sum_hessian: not a list of numbers"),
        ({"tree_param": {"num_nodes": "0"}}, "trees[0].tree_param.num_nodes: '0', expected an integer from 1"),
        ({"tree_param": {"num_nodes": "2000000000"}}, "left_children: 3 numbers, expected 2000000000"),
        ({"tree_param": {"num_nodes": "3", "size_leaf_vector": "3"}}, "size_leaf_vector: 3, the model has 1 output"),
        ({"tree_param": []}, "trees[0].tree_param: not an object"),
        ({"id": 1}, "trees: their ids are not 0, 1, 2, .."),
        (CATEGORY | {"split_type": [2, 0, 0]}, "trees[0].split_type: number 0 is 2, expected 0 .. 1"),
        (CATEGORY | {"categories_nodes": [1]}, "trees[0].categories_nodes: not the rising list of the category splits"),
        (CATEGORY | {"categories_nodes": []}, "trees[0].categories_nodes: not the rising list of the category splits"),
        (CATEGORY | {"categories": [1, -3]}, "trees[0].categories: number 1 is -3, expected 0 .. 16777215"),
        ({"categories_nodes": [1]}, "trees[0].categories_segments: 0 numbers, expected 1"),
        (CATEGORY | {"split_type": [0, 0, 0], "categories": []}, "trees[0].categories_sizes: number 0 is 2, expected"),
        (CATEGORY | {"categories_sizes": [3]}, "trees[0].categories_sizes: number 0 is 3, expected 1 .. 2"),
        (CATEGORY | {"categories_segments": [1]}, "trees[0].categories_sizes: a set that ends behind the 2 categories"),
    ],
)
def test_damaged_trees_are_refused(changes: dict[str, Any], message: str, load: Any) -> None:
    with pytest.raises(InputError, match=r"^bad\.json: .*" + re.escape(message)):
        load(document(tree(**changes)))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"right_children": [2, 0, 2]}, "trees[0].right_children: a leaf without a row of leaf_weights"),
        ({"leaf_weights": [1.0, 2.0]}, "trees[0].leaf_weights: 2 numbers, expected 4"),
        ({"leaf_weights": [1.0, 2.0, 3.0, float("nan")]}, "trees[0].leaf_weights: number 3 is nan"),
    ],
)
def test_damaged_vector_leaves_are_refused(changes: dict[str, Any], message: str, load: Any) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        load(document(tree(**VECTOR | changes), **TWO))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"learner": "DROP"}, "not an XGBoost model: no object 'learner'"),
        ({"learner": [1]}, "not an XGBoost model: no object 'learner'"),
        ({"version": "3.2"}, "version: not a list of numbers"),
        ({PARAM + "num_feature": "0"}, "learner_model_param.num_feature: '0', expected an integer from 1"),
        ({PARAM + "num_feature": "x" * 99}, "learner_model_param.num_feature: '" + "x" * 40 + "', expected"),
        ({PARAM + "num_feature": "DROP"}, "learner.learner_model_param.num_feature: missing"),
        ({PARAM + "num_target": "99999999999"}, "learner_model_param.num_target: '99999999999', expected"),
        ({PARAM + "base_score": "[]"}, "learner_model_param.base_score: 0 numbers for 1 output"),
        ({PARAM + "base_score": "[1,2]"}, "learner_model_param.base_score: 2 numbers for 1 output"),
        ({PARAM + "base_score": "[nan]"}, "learner_model_param.base_score: not a list of numbers"),
        ({PARAM + "base_score": str(2**63)}, "learner_model_param.base_score: not a list of numbers"),
        ({PARAM + "base_score": "1e39"}, "learner_model_param.base_score: number 0 is inf"),
        ({PARAM + "base_score": 0.5}, "learner_model_param.base_score: not a string"),
        ({"learner__objective__name": 1}, "learner.objective.name: not a string"),
        ({"learner__feature_names": ["a"]}, "learner.feature_names: 1 entry for 2 features"),
        ({"learner__feature_types": ["q", "q", "c"]}, "learner.feature_types: 3 entries for 2 features"),
        ({"learner__feature_names": [1, 2]}, "learner.feature_names: not a list of strings"),
        ({"learner__attributes": {"best_iteration": 1}}, "learner.attributes.best_iteration: not a string"),
        ({BOOSTER + "name": "forest"}, "gradient_booster.name: 'forest'; supported: dart, gblinear, gbtree"),
        ({BOOSTER + "name": "dart"}, "learner.gradient_booster.gbtree: missing"),
        ({BOOSTER + "name": "gblinear"}, PLACE + "weights: missing"),
        ({BOOSTER + "name": "gblinear", BOOSTER + "model": {"weights": [1]}}, "weights: 1 number, expected 3"),
        ({MODEL + "trees": {}}, PLACE + "trees: not a list of objects"),
        ({MODEL + "trees": [[]]}, PLACE + "trees: not a list of objects"),
        ({MODEL + "gbtree_model_param": {"num_trees": "2"}}, PLACE + "trees: 1 tree, num_trees says 2"),
        ({MODEL + "gbtree_model_param": {"num_trees": "0"}, MODEL + "trees": []}, "trees: the model has no trees"),
        ({MODEL + "tree_info": [1]}, PLACE + "tree_info: number 0 is 1, expected 0 .. 0"),
        ({MODEL + "iteration_indptr": [0, 2]}, PLACE + "iteration_indptr: number 1 is 2, expected 0 .. 1"),
        ({MODEL + "iteration_indptr": [1, 1]}, PLACE + "iteration_indptr: not a rising list from 0 to 1"),
        ({MODEL + "cats": {"enc": [{"values": "x"}]}}, PLACE + "cats.enc[0].values: not a list of numbers"),
    ],
)
def test_damaged_documents_are_refused(changes: dict[str, Any], message: str, load: Any) -> None:
    with pytest.raises(InputError, match=r"^bad\.json: .*" + re.escape(message)):
        load(document(**changes))


def test_rounds_of_older_files_must_be_whole(load: Any) -> None:
    parameters = {"num_trees": "1", "num_parallel_tree": "2"}
    with pytest.raises(InputError, match="trees: rounds of 2 do not divide 1 tree"):
        load(document(**{MODEL + "iteration_indptr": "DROP", MODEL + "gbtree_model_param": parameters}))


@pytest.mark.parametrize("value", ["1", "-1", "x", "9" * 30])
def test_best_iteration_outside_the_rounds_is_refused(value: str, load: Any) -> None:
    attributes = {"scikit_learn": "{}", "best_iteration": value}
    with pytest.raises(InputError, match=rf"attributes\.best_iteration: '{value}' in a model of 1 round"):
        load(document(learner__attributes=attributes))


def test_best_iteration_means_nothing_to_gblinear(load: Any, assert_same: Any) -> None:
    pytest.importorskip("xgboost")
    weights = {BOOSTER + "name": "gblinear", BOOSTER + "model": {"weights": [1.5, -2.0, 0.25]}}
    assert_same(load(document(learner__attributes={"scikit_learn": "{}", "best_iteration": "7"}, **weights)))


def test_default_child_of_a_leaf_is_dropped(load: Any) -> None:
    assert load(document(tree(default_left=[1, 1, 1]))).ir.ops[0].missing_left.tolist() == [True, False, False]


def test_best_iteration_without_trees_is_refused(load: Any) -> None:
    attributes = {"scikit_learn": "{}", "best_iteration": "0"}
    with pytest.raises(InputError, match="no tree belongs to the rounds up to the best iteration"):
        load(document(learner__attributes=attributes, **{MODEL + "iteration_indptr": [0, 0, 1]}))


@pytest.mark.parametrize("objective", ["reg:expectileerror", "new:one"])
def test_objectives_that_are_not_supported_are_refused(objective: str, load: Any) -> None:
    with pytest.raises(UnsupportedModelError, match=rf"^bad\.json: objective '{objective}' is not supported"):
        load(document(learner__objective__name=objective))


@pytest.mark.parametrize(
    ("objective", "score", "needed"),
    [
        ("reg:gamma", "0", "a number above 0"),
        ("count:poisson", "-1", "a number above 0"),
        ("reg:logistic", "2", "0 .. 1"),
    ],
)
def test_base_scores_outside_the_link_are_refused(objective: str, score: str, needed: str, load: Any) -> None:
    with pytest.raises(InputError, match=re.escape(f"the objective needs {needed}")):
        load(document(learner__objective__name=objective, **{PARAM + "base_score": score}))


@pytest.mark.parametrize("field", ["num_feature", "num_target"])
def test_absurd_numbers_of_columns_are_refused(field: str, load: Any) -> None:
    with pytest.raises(UnsupportedModelError, match=r"num_feature, num_target: .* more than 100000 are not supported"):
        load(document(**{PARAM + field: "2000000000"}))


@pytest.mark.parametrize("sklearn", [False, True])
def test_dart_weights_that_overflow_float32_are_refused(sklearn: bool, load: Any) -> None:
    content = document(tree(split_conditions=[0.5, 1e30, 2.0]), **{PARAM + "base_score": "1E30"})
    booster = content["learner"]["gradient_booster"]
    content["learner"]["gradient_booster"] = {"name": "dart", "gbtree": booster, "weight_drop": [1e30]}
    content["learner"]["attributes"] = {"scikit_learn": "{}"} if sklearn else {}
    with warnings.catch_warnings(), pytest.raises(InputError, match=r"^bad\.json: .*leaf_value.*not finite"):
        warnings.simplefilter("error")
        load(content)


def test_dart_with_vector_leaves_is_refused(load: Any) -> None:
    content = document(tree(**VECTOR), **TWO)
    booster = content["learner"]["gradient_booster"]
    content["learner"]["gradient_booster"] = {"name": "dart", "gbtree": booster, "weight_drop": [1.0]}
    with pytest.raises(UnsupportedModelError, match="dart with vector leaves"):
        load(content)


def test_mixed_leaves_are_refused(load: Any) -> None:
    trees = [tree(**VECTOR), tree(id=1)]
    content = document(
        **TWO, **{MODEL + "trees": trees, MODEL + "tree_info": [0, 0], MODEL + "iteration_indptr": [0, 2]}
    )
    content["learner"]["gradient_booster"]["model"]["gbtree_model_param"]["num_trees"] = "2"
    with pytest.raises(UnsupportedModelError, match="trees with vector leaves beside trees with single ones"):
        load(content)


@pytest.mark.parametrize(
    ("content", "suffix", "message"),
    [
        (b"", "json", "not a JSON document"),
        (
            b"\0\0\0\x3f\3\0\0\0\0\x0fbinary:logistic\6gbtree",
            "json",
            "XGBoost's binary format, which new versions do not read either",
        ),
        (b"binf\0\0\0\x3f\3\0\0\0\0\x0fbinary:logistic\6gbtree", "ubj", "XGBoost's binary format"),
        (b"{", "json", "not a JSON document"),
        (b"\xff\xfe", "json", "not a JSON document"),
        (b"[" * 100_000, "json", "not a JSON document"),
        (b"1" * 5000, "json", "not a JSON document"),
        (b"[1, 2]", "json", "not an XGBoost model"),
        (b'[{"nodeid": 0, "leaf": 1.5}]', "json", "save_model('model.json')"),
        (b'{"name": "tree", "tree_info": []}', "json", "save_model('model.txt')"),
        (b'{"name": "a package"}', "json", "not an XGBoost model"),
        (b"", "ubj", "UBJSON, byte 0: 1 byte declared, 0 left"),
        (
            b'{"learner": {}}',
            "ubj",
            "this is JSON, and XGBoost goes by the name: let the name of the file end in .json",
        ),
        (b"{L\0\0\0\0\0\0\0\x07learner{}}", "json", "this is UBJSON, and XGBoost goes by the name"),
        (b"{x", "ubj", "UBJSON, byte 2: marker b'x' where a length is expected"),
        (
            b"{L\x7f\xff\xff\xff\xff\xff\xff\xff",
            "ubj",
            "UBJSON, byte 10: a length of 9223372036854775807, 0 bytes left",
        ),
        (b"{i\xff", "ubj", "UBJSON, byte 3: a length of -1, 0 bytes left"),
        (b"[$d#l\x00\x00\x00\x02    ", "ubj", "UBJSON, byte 9: 8 bytes declared, 4 left"),
        (b"[$S#i\x01   ", "ubj", "an array of type b'S'"),
        (b"[$d]", "ubj", "a typed container without a count"),
        (b"{$i#i\x00", "ubj", "an object of type b'i'"),
        (b"[" * 100, "ubj", "nested more than 64 deep"),
        (b"{i\x01aZi\x01aZ}", "ubj", "the key 'a' twice"),
        (b"{i\x01\xffZ}", "ubj", "a string that is not UTF-8"),
        (b"?", "ubj", "unknown marker b'?'"),
        (b"[#i\x02NTNC\xe9", "ubj", "not an XGBoost model"),
        (b"[TFZ[]{}Hi\x011I\x00\x01]", "ubj", "not an XGBoost model"),
    ],
)
def test_files_that_are_no_model_are_refused(content: bytes, suffix: str, message: str, load: Any) -> None:
    with pytest.raises(InputError, match=rf"^bad\.{suffix}: .*" + re.escape(message)):
        load(content, suffix)


def test_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^none\.ubj: cannot be read: No such file"):
        walker.load_file(tmp_path / "none.ubj", "model")


def test_library_errors_name_the_file(load: Any) -> None:
    pytest.importorskip("xgboost")
    model = load(document(learner__objective__reg_loss_param={"scale_pos_weight": "x"}))
    with pytest.raises(InputError, match=r"^bad\.json: XGBoost cannot load it: "):
        model.predict(np.zeros((1, 2)))


def loads_or_is_refused(path: Path) -> None:
    try:
        model = walker.load_file(path, "model")
    except InputError as error:
        assert str(error).startswith(f"{path.name}: ")
    else:
        with np.errstate(all="ignore"):
            reference.evaluate(model.ir, np.zeros((2, len(model.ir.features))))


@pytest.mark.thorough
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name.removeprefix("xgboost-"))
@FUZZ
@given(data=st.data())
def test_damaged_bytes_load_or_are_refused(path: Path, data: Any, mutated: Any, tmp_path: Path) -> None:
    damaged = tmp_path / f"damaged{path.suffix}"
    damaged.write_bytes(mutated(data, path.read_bytes()))
    loads_or_is_refused(damaged)


@pytest.mark.thorough
@pytest.mark.parametrize("path", [path for path in FILES if path.suffix == ".json"], ids=lambda path: path.stem[8:])
@FUZZ
@given(data=st.data())
def test_exchanged_fields_load_or_are_refused(path: Path, data: Any, tmp_path: Path) -> None:
    place: Any = copy.deepcopy(json.loads(path.read_text()))
    content = place
    while True:
        keys = list(place) if isinstance(place, dict) else list(range(len(place)))
        key = data.draw(st.sampled_from(keys))
        inner = place[key]
        if isinstance(inner, dict | list) and inner and data.draw(st.integers(0, 4)):
            place = inner
            continue
        if isinstance(place, dict) and data.draw(st.booleans()):
            del place[key]
        else:
            place[key] = data.draw(st.sampled_from(NASTY))
        break
    damaged = tmp_path / "damaged.json"
    damaged.write_text(json.dumps(content))
    loads_or_is_refused(damaged)
