"""Model files that were changed so that a reader may take them for another model than the library does.

Each row is a file of `golden/lone/models` and a change of its bytes or of its parsed content. The checker's reader must
refuse it, or read the very numbers that the library gives.
"""

import json
import re
import zipfile
from io import BytesIO

import numpy as np
import pytest

from tests.checker.test_check_certificate import GOLDEN, mutants

model_files = mutants.check_certificate.sys.modules["model_files"]
ROWS = np.random.default_rng(3).uniform([100.0, -200.0, 20.0], [1900.0, 1900.0, 40.0], (400, 3))
ROWS[::5, 0], ROWS[1::7, 1], ROWS[2::11, 2], ROWS[3::13] = 0.0, np.nan, np.inf, -0.0


def lightgbm(path, rows):
    library = pytest.importorskip("lightgbm")
    return library.Booster(model_file=path).predict(rows)


def xgboost(path, rows):
    library = pytest.importorskip("xgboost")
    if b"scikit_learn" in path.read_bytes():
        model = library.XGBRegressor()
        model.load_model(path)
        return model.predict(rows)
    return library.Booster(model_file=path).predict(library.DMatrix(rows))


def skops(path, rows):
    library = pytest.importorskip("skops.io")
    model = library.load(path, trusted=library.get_untrusted_types(file=path))
    return model.predict(rows)


def onnx(path, rows):
    library = pytest.importorskip("onnxruntime")
    session = library.InferenceSession(path, providers=["CPUExecutionProvider"])
    (given,) = session.get_inputs()
    kind = np.float64 if "double" in given.type else np.float32
    width = given.shape[1]
    return np.concatenate([session.run(None, {given.name: row[None, :width].astype(kind)})[0].ravel() for row in rows])


LIBRARIES = {".txt": lightgbm, ".json": xgboost, ".ubj": xgboost, ".skops": skops, ".onnx": onnx}


def text(pattern, change, count=1):
    """The text with some matches of a pattern replaced."""

    def edit(data):
        found, number = re.subn(pattern, change, data.decode(), count=count)
        assert number
        return found.encode()

    return edit


def lines(pattern, change):
    """The text of a LightGBM file with a match replaced, and the sizes of its trees as they are then."""

    def edit(data):
        found = text(pattern, change)(data).decode()
        trees = found.partition("end of trees")[0].split("Tree=")[1:]
        sizes = " ".join(str(len(f"Tree={tree}".encode())) for tree in trees)
        return re.sub("tree_sizes=.*", f"tree_sizes={sizes}", found).encode()

    return edit


def document(change):
    """The JSON document after a change of its content."""

    def edit(data):
        content = json.loads(data)
        learner = content["learner"]
        change(learner)
        return json.dumps(content).encode()

    return edit


def model_of(learner):
    booster = learner["gradient_booster"]
    return booster["gbtree"]["model"] if "gbtree" in booster else booster["model"]


def at(place, value):
    """The change of one entry of the trees of an XGBoost file; `place` names it from the model on."""

    def change(learner):
        *way, last = place
        here = model_of(learner)
        for step in way:
            here = here[step]
        here[last] = value

    return document(change)


GBDT, ZERO = "lightgbm_gbdt.txt", "lightgbm_missing.txt"
LIGHTGBM = {
    "a key twice in a tree": (GBDT, lines(r"(leaf_value=\S+)(.*)\n", r"\g<0>leaf_value=9.0\2\n")),
    "a key twice in a tree, first": (GBDT, lines(r"leaf_value=(\S+)(.*)\n", r"leaf_value=9.0\2\n\g<0>")),
    "a key far behind": (
        GBDT,
        lines(r"shrinkage=1\n", "shrinkage=1\n" + "unknown=1\n" * 9 + "leaf_value=1 2 3 4 5 6\n"),
    ),
    "a key with a blank": (GBDT, lines(r"(leaf_value)=(\S+)(.*)\n", r"\g<0>\1 =9.0\3\n")),
    "a header key twice": (GBDT, lines(r"objective=regression\n", "objective=regression\nobjective=poisson\n")),
    "a header key twice, first": (GBDT, lines(r"objective=regression\n", "objective=poisson\nobjective=regression\n")),
    "another objective behind": (GBDT, lines(r"objective=regression\n", "objective=regression sqrt\n")),
    "fewer leaves": (GBDT, lines("num_leaves=6", "num_leaves=1")),
    "three leaves": (GBDT, lines("num_leaves=6", "num_leaves=3")),
    "a category without categories": (GBDT, lines("decision_type=2 2", "decision_type=2 3")),
    "a category in front": (GBDT, lines("decision_type=2", "decision_type=1")),
    "sizes of fewer trees": (GBDT, text(r"(tree_sizes=\S+ \S+ \S+) \S+", r"\1")),
    "sizes that begin elsewhere": (GBDT, text(r"tree_sizes=(\S+) (\S+) (\S+) (\S+)", r"tree_sizes=\1 \2 \3 1")),
    "no sizes": (GBDT, text(r"tree_sizes=.*\n", "")),
    "a tree behind the end": (
        GBDT,
        lambda data: data + b"\nTree=4\n" + data.split(b"Tree=3\n")[1].split(b"\n\n\n")[0] + b"\n\n\n",
    ),
    "a tree that is hidden by a blank line": (GBDT, lines(r"\nleaf_weight", "\n\nleaf_weight")),
    "leaves behind a blank line": (GBDT, lines(r"\nleaf_value", "\n\nleaf_value")),
    "underscores in a number": (GBDT, lines(r"threshold=900\.", "threshold=9_00.")),
    "digits of another script": (GBDT, lines(r"threshold=900\.", "threshold=\u0669\u0660\u0660.")),
    "a hexadecimal number": (GBDT, lines(r"threshold=\S+", "threshold=0x384")),
    "a threshold of NaN": (GBDT, lines(r"threshold=\S+", "threshold=nan")),
    "a threshold of infinity": (GBDT, lines(r"threshold=\S+", "threshold=inf")),
    "a threshold that overflows": (GBDT, lines(r"threshold=\S+", "threshold=1e999")),
    "a leaf of NaN": (GBDT, lines(r"leaf_value=\S+", "leaf_value=nan")),
    "a leaf of infinity": (GBDT, lines(r"leaf_value=\S+", "leaf_value=inf")),
    "a leaf with a comma": (GBDT, lines(r"leaf_value=(\S+)\.", r"leaf_value=\1,")),
    "a leaf of many digits": (
        GBDT,
        lines(r"leaf_value=\S+", "leaf_value=0.1000000000000000055511151231257827021181583404541015625000001"),
    ),
    "a leaf that is tiny": (GBDT, lines(r"leaf_value=\S+", "leaf_value=4.9406564584124654e-324")),
    "a child in front": (GBDT, lines(r"left_child=2 3", "left_child=0 3")),
    "a child twice": (GBDT, lines(r"left_child=2 3 4 -2 -1", "left_child=2 3 4 -2 -2")),
    "an input below zero": (GBDT, lines(r"split_feature=0 1", "split_feature=-1 1")),
    "an input of 3": (GBDT, lines(r"split_feature=0 1", "split_feature=3 1")),
    "a fraction of an input": (GBDT, lines(r"split_feature=0 1", "split_feature=0.9 1")),
    "a fraction of a decision": (GBDT, lines("decision_type=2 2", "decision_type=2 2.9")),
    "zero is missing": (GBDT, lines("decision_type=2 2 2 2 2", "decision_type=6 6 4 4 4")),
    "no kind of missing values": (GBDT, lines("decision_type=2 2 2 2 2", "decision_type=14 12 14 12 14")),
    "a decision beyond a byte": (GBDT, lines("decision_type=2 2 2 2 2", "decision_type=266 264 2 2 2")),
    "two trees an iteration": (GBDT, lines("num_tree_per_iteration=1", "num_tree_per_iteration=2")),
    "an average": (GBDT, lines(r"\nobjective=", "\naverage_output\nobjective=")),
    "an average with a value": (GBDT, lines(r"\nobjective=", "\naverage_output=1\nobjective=")),
    "an average behind the trees": (GBDT, lines("end of trees", "average_output\nend of trees")),
    "lines of Windows": (GBDT, lambda data: data.replace(b"\n", b"\r\n")),
    "lines of old machines": (GBDT, lines(r"(leaf_value=.*)\n", "\\1\rleaf_value=1 2 3 4 5 6\n")),
    "a form feed": (GBDT, lines(r"(leaf_value=.*)\n", "\\1\x0cleaf_value=1 2 3 4 5 6\n")),
    "linear leaves": (GBDT, lines("is_linear=0", "is_linear=1")),
    "linear leaves, by a word": (GBDT, lines("is_linear=0", "is_linear=00")),
    "no leaves": (GBDT, lines(r"leaf_value=.*\n", "")),
    "fewer thresholds": (GBDT, lines(r"threshold=\S+ ", "threshold=")),
    "more leaf values": (GBDT, lines(r"leaf_value=", "leaf_value=7.0 ")),
    "another number of a tree": (GBDT, lines("Tree=1", "Tree=7")),
    "a shrinkage": (GBDT, lines("shrinkage=1", "shrinkage=0.5")),
    "another version": (GBDT, lines("version=v4", "version=v2")),
    "another header": (GBDT, lines("tree\nversion", "tree2\nversion")),
}
GBTREE, DART = "xgboost_gbtree.json", "xgboost_dart.json"
TREES = ("trees", 0)
XGBOOST = {
    "trees twice": (GBTREE, text(r'"tree_info":', '"tree_info":[0,0,0,0],"trees":[],"tree_info":')),
    "a tree's key twice": (GBTREE, text(r'("split_conditions":\[)([^,]*)', r'\1 7.0\2,"x":["split_conditions"],\g<0>')),
    "conditions twice": (
        GBTREE,
        text(r'"split_conditions":\[([^,]*)', r'"split_conditions":[1,1,1,1,1,1,1,1,1,1,1,1,1,1,1],\g<0>'),
    ),
    "conditions twice, first": (
        GBTREE,
        text(r'("split_conditions":\[[^]]*\])', r'\1,"split_conditions":[1,1,1,1,1,1,1,1,1,1,1,1,1,1,1]'),
    ),
    "an escaped key": (
        GBTREE,
        text(r'("split_conditions":\[[^]]*\])', r'\1,"split_\\u0063onditions":[1,1,1,1,1,1,1,1,1,1,1,1,1,1,1]'),
    ),
    "a base twice": (GBTREE, text(r'"base_score":"[^"]*"', r'"base_score":"[5E-1]",\g<0>')),
    "a base twice, first": (GBTREE, text(r'"base_score":"[^"]*"', r'\g<0>,"base_score":"[5E-1]"')),
    "a plain base": (GBTREE, text(r'"base_score":"[^"]*"', '"base_score":"2.5E-1"')),
    "a base of two": (GBTREE, text(r'"base_score":"[^"]*"', '"base_score":"[2.5E-1,1E0]"')),
    "a base of NaN": (GBTREE, text(r'"base_score":"[^"]*"', '"base_score":"[NaN]"')),
    "a base that rounds twice": (GBTREE, text(r'"base_score":"[^"]*"', '"base_score":"[1.000000059604644775390626]"')),
    "a base of true": (GBTREE, text(r'"base_score":"[^"]*"', '"base_score":"true"')),
    "a base with blanks": (GBTREE, text(r'"base_score":"[^"]*"', '"base_score":" [ 2.5E-1 ] "')),
    "a number that rounds twice": (GBTREE, text(r'("split_conditions":\[)', r"\1 1.000000059604644775390626, 0,"[:-4])),
    "a leaf that rounds twice": (GBTREE, text(r"-0?\.?4\.1994883E-4|-4\.1994883E-4", "1.000000059604644775390626")),
    "weights of a dart in a gbtree": (
        GBTREE,
        document(lambda d: d["gradient_booster"].update(weight_drop=[0.5, 0.5, 0.5, 0.5])),
    ),
    "fewer weights": (DART, document(lambda d: d["gradient_booster"]["weight_drop"].pop())),
    "no weights": (DART, document(lambda d: d["gradient_booster"].pop("weight_drop"))),
    "a tree of another group": (GBTREE, at(("tree_info", 1), 1)),
    "a tree of a group below": (GBTREE, at(("tree_info", 1), -1)),
    "fewer groups": (GBTREE, at(("tree_info",), [0, 0])),
    "fewer iterations": (GBTREE, at(("iteration_indptr",), [0, 1, 2])),
    "an iteration of two trees": (GBTREE, at(("iteration_indptr",), [0, 2, 4])),
    "an iteration that begins late": (GBTREE, at(("iteration_indptr",), [2, 3, 4])),
    "no iterations": (GBTREE, document(lambda d: model_of(d).pop("iteration_indptr"))),
    "parallel trees": (GBTREE, at(("gbtree_model_param", "num_parallel_tree"), "2")),
    "fewer trees": (GBTREE, at(("gbtree_model_param", "num_trees"), "2")),
    "fewer nodes": (GBTREE, at((*TREES, "tree_param", "num_nodes"), "3")),
    "a deleted node": (GBTREE, at((*TREES, "tree_param", "num_deleted"), "1")),
    "a child below": (GBTREE, at((*TREES, "left_children", 1), 0)),
    "a child twice": (GBTREE, at((*TREES, "left_children", 0), 2)),
    "one child only": (GBTREE, at((*TREES, "right_children", 1), -1)),
    "a leaf with a right child": (GBTREE, at((*TREES, "left_children", 1), -1)),
    "an input of 3": (GBTREE, at((*TREES, "split_indices", 0), 3)),
    "an input below zero": (GBTREE, at((*TREES, "split_indices", 0), -1)),
    "a default of 2": (GBTREE, at((*TREES, "default_left", 0), 2)),
    "a default of true": (GBTREE, at((*TREES, "default_left", 0), True)),
    "a category": (GBTREE, at((*TREES, "split_type", 0), 1)),
    "a split of another kind": (GBTREE, at((*TREES, "split_type", 0), 2)),
    "no kinds of splits": (GBTREE, at((*TREES, "split_type"), [])),
    "an infinite condition": (GBTREE, text(r'("split_conditions":\[)[^,]*', r"\g<1>Infinity")),
    "a condition that overflows": (GBTREE, text(r'("split_conditions":\[)[^,]*', r"\g<1>1E39")),
    "a condition of NaN": (GBTREE, text(r'("split_conditions":\[)[^,]*', r"\g<1>NaN")),
    "a whole condition": (GBTREE, text(r'("split_conditions":\[)[^,]*', r"\g<1>16777217")),
    "a large whole condition": (GBTREE, text(r'("split_conditions":\[)[^,]*', r"\g<1>9223372036854775809")),
    "leaves as vectors": (GBTREE, at((*TREES, "tree_param", "size_leaf_vector"), "2")),
    "two targets": (GBTREE, document(lambda d: d["learner_model_param"].update(num_target="2"))),
    "three classes": (GBTREE, document(lambda d: d["learner_model_param"].update(num_class="3"))),
    "a best iteration of a Booster": (GBTREE, document(lambda d: d["attributes"].update(best_iteration="1"))),
    "a best iteration": (
        GBTREE,
        document(lambda d: d["attributes"].update(best_iteration="1", scikit_learn='{"_estimator_type": "regressor"}')),
    ),
    "a best iteration below zero": (
        GBTREE,
        document(
            lambda d: d["attributes"].update(best_iteration="-2", scikit_learn='{"_estimator_type": "regressor"}')
        ),
    ),
    "a best iteration beyond": (
        GBTREE,
        document(lambda d: d["attributes"].update(best_iteration="9", scikit_learn='{"_estimator_type": "regressor"}')),
    ),
    "more trees than those up to the best iteration": (
        GBTREE,
        document(
            lambda d: d["attributes"].update(best_iteration="0", best_ntree_limit="2", scikit_learn='{"type": "XGB"}')
        ),
    ),
    "more trees in a round": (
        GBTREE,
        document(lambda d: d["attributes"].update(best_iteration="0", scikit_learn='{"num_parallel_tree": 2}')),
    ),
    "as many trees as up to the best iteration": (
        GBTREE,
        document(
            lambda d: d["attributes"].update(best_iteration="1", best_ntree_limit="2", scikit_learn='{"type": "XGB"}')
        ),
    ),
    "another objective": (GBTREE, document(lambda d: d["objective"].update(name="reg:logistic"))),
    "an objective and another": (GBTREE, text(r'"objective":', '"objective":{"name":"reg:logistic"},"objective":')),
    "an old version": (GBTREE, text(r'"version":\[3,2,0\]', '"version":[0,90,0]')),
    "a version of one": (GBTREE, text(r'"version":\[3,2,0\]', '"version":[1,7,6]')),
    "text behind": (GBTREE, lambda data: data + b"{}"),
    "fewer inputs": (GBTREE, document(lambda d: d["learner_model_param"].update(num_feature="2"))),
    "another order of trees": (GBTREE, document(lambda d: model_of(d)["trees"].reverse())),
}


def read(path):
    """The reader's model, prepared; None where it refuses the file."""
    try:
        model = model_files.read_model(path)
        model.prepare()
    except mutants.check_certificate.REJECTIONS:
        return None
    return model


def differs(path):
    """What is read otherwise than by the library; None where the reader refuses, or both agree."""
    model = read(path)
    if model is None:
        return None
    rows = ROWS[:, : model.features]
    taken = (np.abs(rows) < model.limit) | ~np.isfinite(rows) & (model.limit == np.inf) | (np.isnan(rows) & model.nan)
    rows = rows[np.all(taken, axis=1)]
    wanted = np.asarray(LIBRARIES[path.suffix](path, rows), np.float64)
    got = model.evaluate(rows, 0)
    if len(model.base) > 1 and not model.label:
        got = np.stack(np.broadcast_arrays(*(model.evaluate(rows, n) for n in range(len(model.base)))), axis=1)
    if model.label:
        scores = np.array([model.evaluate(rows, number) for number in range(len(model.base))])
        got = np.argmax(scores, axis=0) if len(scores) > 1 else (scores[0] > 0) * 1.0
    if wanted.shape != got.shape:
        return f"{wanted.shape} answers"
    other = np.flatnonzero(got != wanted)
    return f"{len(other)} rows: {got[other[0]]} for {wanted[other[0]]} at {rows[other[0]]}" if len(other) else None


SQUARES = "hist_gradient_boosting.skops"
FOREST = "random_forest.skops"


def entries(data, change):
    """A skops file in which `change` (name, content) gives the content of each entry."""
    source, out = zipfile.ZipFile(BytesIO(data)), BytesIO()
    with zipfile.ZipFile(out, "w") as target:
        for name in source.namelist():
            target.writestr(name, change(name, source.read(name)))
    return out.getvalue()


def schema(*changes):
    """The description in a skops file with some patterns replaced."""

    def changed(name, content):
        for pattern, change in changes if name == "schema.json" else ():
            content, count = re.subn(pattern.encode(), change.encode(), content, count=1)
            assert count
        return content

    return lambda data: entries(data, changed)


def arrays(pattern, change):
    """The arrays of nodes in a skops file after a change."""

    def edit(data):
        done = []

        def changed(name, content):
            array = np.load(BytesIO(content)) if name.endswith(".npy") and not done else np.empty(0)
            if pattern not in (array.dtype.names or ()):
                return content
            done.append(name)
            array = array.copy()
            change(array)
            out = BytesIO()
            np.save(out, array)
            return out.getvalue()

        made = entries(data, changed)
        assert done
        return made

    return edit


def setting(name, index, value):
    def change(array):
        array[name][index] = value

    return change


LOSS = r'"__class__": "HalfSquaredError"'
SKOPS = {
    "a loss with a logarithm": (
        SQUARES,
        schema((LOSS, '"__class__": "HalfPoissonLoss"'), ("CyHalfSquaredError", "CyHalfPoissonLoss")),
    ),
    "a link with a logarithm": (SQUARES, schema(('"__class__": "IdentityLink"', '"__class__": "LogLink"'))),
    "a node of a category": (SQUARES, arrays("is_categorical", setting("is_categorical", 0, 1))),
    "a leaf that is a split": (SQUARES, arrays("is_categorical", setting("is_leaf", 0, 1))),
    "a threshold of infinity": (SQUARES, arrays("num_threshold", setting("num_threshold", 0, np.inf))),
    "missing values to the other side": (SQUARES, arrays("num_threshold", setting("missing_go_to_left", 0, 1))),
    "an input of 3": (SQUARES, arrays("num_threshold", setting("feature_idx", 0, 3))),
    "a child twice": (SQUARES, arrays("num_threshold", setting("left", 0, 2))),
    "members that refuse NaN": (
        FOREST,
        schema(*[(r'"content": "\\"squared_error\\""', r'"content": "\\\\"absolute_error\\\\""')] * 4),
    ),
    "a rate of another kind": (
        "gradient_boosting.skops",
        schema((r'("learning_rate": [^}]*"content": ")[^"]*', r"\g<1>1.0")),
    ),
    "an initial answer of another kind": ("gradient_boosting.skops", schema(("DummyRegressor", "DummyClassifier"))),
    "more outputs": (FOREST, schema((r'("n_outputs_": [^}]*"content": ")1', r"\g<1>2"))),
    "another class of members": (FOREST, schema(("DecisionTreeRegressor", "DecisionTreeClassifier"))),
    "a leaf by another mark": (FOREST, arrays("left_child", setting("left_child", 0, -2))),
    "a threshold of NaN in a tree": (FOREST, arrays("left_child", setting("threshold", 0, np.nan))),
    "another class": (FOREST, schema(("RandomForestRegressor", "ExtraTreesRegressor"))),
    "a module of another package": (FOREST, schema(("sklearn.ensemble._forest", "elsewhere._forest"))),
}


def proto(change, raw=None):
    """The ONNX file, with splits that the checker knows, after a change of its message and of its bytes."""

    def edit(data):
        library = pytest.importorskip("onnx")
        file = library.load_from_string(data)
        attributes = {attribute.name: attribute for attribute in file.graph.node[0].attribute}
        modes = attributes["nodes_modes"].strings
        modes[:] = [b"LEAF" if mode == b"LEAF" else b"BRANCH_LEQ" for mode in modes]
        change(file, attributes)
        data = file.SerializeToString()
        return data if raw is None else raw(data, file)

    return edit


def nothing(file, attributes):
    pass


def numbers(name, place, value):
    def change(file, attributes):
        field = attributes[name]
        (field.floats if len(field.floats) else field.ints)[place] = value

    return change


def leaf_twice(file, attributes):
    for name, value in (("target_ids", 0), ("target_nodeids", 1), ("target_treeids", 0)):
        attributes[name].ints.append(value)
    attributes["target_weights"].floats.append(5.0)


def attribute_twice(file, attributes):
    other = file.graph.node[0].attribute.add()
    other.CopyFrom(attributes["target_weights"])
    other.floats[0] = 5.0


def tensor(file, attributes):
    onnx = pytest.importorskip("onnx")
    values = [float(number) + 0.1 for number in attributes["nodes_values"].floats]
    made = onnx.helper.make_tensor("x", onnx.TensorProto.DOUBLE, [len(values)], values)
    file.graph.node[0].attribute.append(onnx.helper.make_attribute("nodes_values_as_tensor", made))


def doubles(file, attributes):
    file.graph.input[0].type.tensor_type.elem_type = 11


def as_integers(file, attributes):
    attributes["target_weights"].type = 7


def of_another_domain(file, attributes):
    file.graph.node[0].domain = "com.microsoft"


def function(file, attributes):
    onnx = pytest.importorskip("onnx")
    node = onnx.helper.make_node("Neg", ["x"], ["y"])
    opsets = [onnx.helper.make_opsetid("", 17)]
    names = ("ai.onnx.ml", "TreeEnsembleRegressor", ["x"], ["y"])
    file.functions.append(
        onnx.helper.make_function(*names, [node], opsets, [a.name for a in file.graph.node[0].attribute])
    )


def another_tree_first(file, attributes):
    for name in ("nodes_treeids", "target_treeids"):
        attributes[name].ints[:] = [7 - number for number in attributes[name].ints]


def a_graph_behind(data, file):
    onnx = pytest.importorskip("onnx")
    more = onnx.ModelProto()
    more.graph.node.add().CopyFrom(file.graph.node[0])
    more.graph.node[0].op_type = "Identity"
    return data + more.SerializeToString()


def an_operator_behind(data, file):
    """The last of two names of the operator is the one that counts."""
    node = file.graph.node[0].SerializeToString()
    other = node + b"\x22\x03Neg"
    graph = file.graph.SerializeToString()

    def size(number):
        return bytes([number & 127 | 128, number >> 7]) if number > 127 else bytes([number])

    before = b"\x0a" + size(len(node)) + node
    assert graph.startswith(before)
    changed = b"\x0a" + size(len(other)) + other + graph[len(before) :]
    whole = b"\x3a" + size(len(graph)) + graph
    assert data.count(whole) == 1
    return data.replace(whole, b"\x3a" + size(len(changed)) + changed)


ENSEMBLE = "onnx_trees.onnx"
ONNX = {
    "the file itself": (ENSEMBLE, proto(nothing)),
    "a leaf with two weights": (ENSEMBLE, proto(leaf_twice)),
    "an attribute twice": (ENSEMBLE, proto(attribute_twice)),
    "values as a tensor": (ENSEMBLE, proto(tensor)),
    "inputs in double precision": (ENSEMBLE, proto(doubles)),
    "an attribute of another type": (ENSEMBLE, proto(as_integers)),
    "an operator of another domain": (ENSEMBLE, proto(of_another_domain)),
    "a function of the same name": (ENSEMBLE, proto(function)),
    "trees by other numbers": (ENSEMBLE, proto(another_tree_first)),
    "a second graph": (ENSEMBLE, proto(nothing, a_graph_behind)),
    "a second operator": (ENSEMBLE, proto(nothing, an_operator_behind)),
    "a weight of an inner node": (ENSEMBLE, proto(numbers("target_nodeids", 0, 0))),
    "a weight of another target": (ENSEMBLE, proto(numbers("target_ids", 0, 1))),
    "a weight of no tree": (ENSEMBLE, proto(numbers("target_treeids", 0, 9))),
    "a threshold of NaN": (ENSEMBLE, proto(numbers("nodes_values", 0, np.nan))),
    "a threshold of infinity": (ENSEMBLE, proto(numbers("nodes_values", 0, np.inf))),
    "an input below zero": (ENSEMBLE, proto(numbers("nodes_featureids", 0, -1))),
    "a child twice": (ENSEMBLE, proto(numbers("nodes_truenodeids", 0, 2))),
    "a missing value that goes by 2": (ENSEMBLE, proto(numbers("nodes_missing_value_tracks_true", 0, 2))),
}

TABLES = {"lightgbm": LIGHTGBM, "xgboost": XGBOOST, "skops": SKOPS, "onnx": ONNX}
#: Files that are read, although they were changed: the library reads the same.
READ = {
    "lightgbm": {"a threshold that overflows", "a leaf of many digits", "a leaf that is tiny"}
    | {"no kind of missing values", "an average", "a shrinkage"},
    "xgboost": {"a plain base", "an infinite condition", "a condition that overflows"}
    | {"an iteration of two trees", "parallel trees", "a default of true", "two targets", "fewer inputs"}
    | {"a best iteration of a Booster", "a best iteration", "as many trees as up to the best iteration"},
    "skops": {"a threshold of infinity", "missing values to the other side", "a rate of another kind"}
    | {"another class of members", "another class"},
    "onnx": {"the file itself", "a threshold of infinity", "a missing value that goes by 2"},
}


@pytest.mark.parametrize(("kind", "row"), [(kind, row) for kind, table in TABLES.items() for row in table])
def test_a_changed_file_is_refused_or_read_as_the_library_does(kind, row, tmp_path):
    name, edit = TABLES[kind][row]
    path = tmp_path / name
    path.write_bytes(edit((GOLDEN / "models" / name).read_bytes()))
    assert (read(path) is not None) == (row in READ[kind])
    assert differs(path) is None


def test_rows_that_are_read_are_rows():
    assert all(READ[kind] <= table.keys() for kind, table in TABLES.items())
