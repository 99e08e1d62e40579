"""Reads model files into trees with the rules of their library as data; shares no code with st_codegen.

LightGBM text, XGBoost JSON and UBJSON, scikit-learn trees in skops files, ONNX TreeEnsembleRegressor.
"""

import json
import re
import struct
import zipfile
from io import BytesIO

import numpy as np


class Reject(Exception):
    """Something is not as the certificate says, or is outside of what this checker knows."""


def need(condition, reason):
    if not condition:
        raise Reject(reason)


# --- float64 numbers in their order: key k + 1 is the next number after key k, -0.0 comes right before 0.0 ------------
SIGN = np.int64(-(2**63))
F32_LIMIT = 3.4028235677973366e38  # from this magnitude on float32 overflows


def keys(x):
    bits = np.ascontiguousarray(x, np.float64).view(np.int64)
    return np.where(bits < 0, ~(bits ^ SIGN), bits)


def numbers(k):
    k = np.asarray(k, np.int64)
    return np.where(k < 0, ~k ^ SIGN, k).view(np.float64)


LOW, HIGH = (int(keys([x])[0]) for x in (-np.inf, np.inf))


def single(x):
    with np.errstate(over="ignore"):
        return np.asarray(x, np.float64).astype(np.float32).astype(np.float64)


def bits(x):
    x = np.ascontiguousarray(x)
    return x.view(np.int64) if x.dtype == np.float64 else x.astype(np.int64)


# --- models: trees, with the rules of their library as data -----------------------------------------------------------
#: `<` for `<=`; inputs and sums rounded to float32; the divisor of the sum; the base added last; whether NaN is taken,
#: and the magnitude from which inputs are refused; whether the answer is a class: the number of
#: the largest sum, or 1 where the only sum is above zero.
RULES = {"less": False, "single_in": False, "single_sum": False, "divisor": 1.0, "base_last": False, "nan": True}
RULES |= {"limit": np.inf, "label": False}


class Model:
    """`trees`: (feature, threshold, left, right, nan_left, values, outputs); children < 0 are leaves -child - 1."""

    def __init__(self, features, trees, base, names, **rules):
        self.features, self.trees, self.base, self.names = features, trees, [float(b) for b in base], names
        self.__dict__ |= {**RULES, **rules}
        self.lower, self.upper = np.full(features, -np.inf), np.full(features, np.inf)
        need(np.all(np.isfinite(self.base)) and len(names or range(features)) == features, "a base or names")
        for feature, threshold, left, right, _, values, outputs in trees:
            nodes, parts = len(feature), (threshold, left, right, _)
            need(all(len(part) == nodes for part in parts) and len(values) == nodes + 1, "arrays of other lengths")
            children = np.sort(np.concatenate([left, right]))
            once = np.append(np.arange(-nodes - 1, 0), np.arange(1, nodes)) if nodes else []
            need(np.array_equal(children, once), "nodes that are no tree")
            need(np.all((feature >= 0) & (feature < features)), "an input that is none")
            need(not np.any(np.isnan(threshold)) and np.all(np.isfinite(values)), "NaN or infinity in a tree")
            need(set(outputs) <= set(range(len(self.base))) and values.shape[1] == len(outputs), "another output")

    def order(self, names, wanted):
        """Number the features as the block's inputs are."""
        place = np.array([wanted.index(name) for name in names])
        self.trees = [(place[t[0]] if len(t[0]) else t[0], *t[1:]) for t in self.trees]

    def left(self, x, feature, threshold):
        """Whether numbers go left: after the limits of the bundle and the library's rounding."""
        x = np.clip(x, self.lower[feature], self.upper[feature])
        x = single(x) if self.single_in else x
        return (x < threshold) if self.less else (x <= threshold) | (threshold == np.inf)

    def prepare(self):
        """For each split the key of the last number that goes left, found by halving, for `left` is monotone."""
        self.last = []
        for feature, threshold, *_ in self.trees:
            low, high = np.full(len(feature), LOW), np.full(len(feature), HIGH)
            ends = [self.left(numbers(k), feature, threshold) for k in (low, high)]
            while np.any(high - 1 > low):
                middle = (low & high) + ((low ^ high) >> 1)
                goes = self.left(numbers(middle), feature, threshold)
                low, high = np.where(goes, middle, low), np.where(goes, high, middle)
            self.last.append(np.where(ends[1], HIGH, np.where(ends[0], low, LOW - 1)))
        edge = keys([np.nextafter(-self.limit, 0), np.nextafter(self.limit, 0)]) if self.refuses else [LOW, HIGH]
        self.first_key = np.where(self.lower > -self.limit, LOW, edge[0])
        self.last_key = np.where(self.upper < self.limit, HIGH, edge[1])

    @property
    def refuses(self):
        return self.limit < np.inf

    def evaluate(self, x, output):
        """One output for rows of inputs, every addition in the library's order and precision."""
        round_ = single if self.single_sum else np.asarray
        total = np.float64(0.0 if self.base_last else self.base[output])
        for feature, threshold, left, right, nan_left, value, outputs in self.trees:
            node = np.full(len(x), 0 if len(feature) else -1)
            while np.any(node >= 0):
                at = np.flatnonzero(node >= 0)
                here, given = node[at], x[at, feature[node[at]]]
                goes = np.where(np.isnan(given), nan_left[here], self.left(given, feature[here], threshold[here]))
                node[at] = np.where(goes, left[here], right[here])
            if output in outputs:
                total = round_(total + value[-node - 1, outputs.index(output)])
        total = round_(total / self.divisor) if self.divisor != 1.0 else total
        return round_(total + self.base[output]) if self.base_last else total

    def boxes(self, t):
        """Low and high keys of the inputs that reach each leaf of a tree, whether it is NaN, and the leaf.

        An input that no split on the way reads is not limited (low > high and not NaN).
        """
        feature, _, left, right, nan_left, *_ = self.trees[t]
        n = self.features
        todo = [
            (np.array([0 if len(feature) else -1]), np.full((1, n), HIGH), np.full((1, n), LOW), np.zeros((1, n), bool))
        ]
        done = []
        while todo:
            node, low, high, nan = todo.pop()
            leaf = node < 0
            done.append((low[leaf], high[leaf], nan[leaf], -node[leaf] - 1))
            if np.all(leaf):
                continue
            node, low, high, nan = (a[~leaf] for a in (node, low, high, nan))
            row, f, last = np.arange(len(node)), feature[node], self.last[t][node]
            fresh = (low[row, f] > high[row, f]) & ~nan[row, f]
            first = np.where(fresh, self.first_key[f], low[row, f])
            end = np.where(fresh, self.last_key[f], high[row, f])
            missing = (fresh & self.nan) | nan[row, f]
            parts = []
            for child, lo, hi, there in (
                (left, first, np.minimum(end, last), ~nan[row, f]),
                (right, np.maximum(first, last + 1), end, ~nan[row, f]),
                (np.where(nan_left, left, right), HIGH, LOW, missing),
            ):
                keep = there & ((lo <= hi) | (child is not left) & (child is not right))
                new = [low.copy(), high.copy(), nan.copy()]
                new[0][row, f], new[1][row, f] = lo, hi
                new[2][row, f] = (child is not left) & (child is not right)
                parts.append((child[node][keep], *(a[keep] for a in new)))
            todo.append(tuple(np.concatenate(p) for p in zip(*parts)))
        return tuple(np.concatenate(p) for p in zip(*done))


def flat(columns, value, leaf, outputs):
    """A tree whose leaves are nodes of their own, numbered anew so that children < 0 are leaves.

    `columns`: feature, threshold, left, right, nan_left of each node.
    """
    leaf = np.asarray(leaf, bool)
    name = np.where(leaf, -np.cumsum(leaf), np.cumsum(~leaf) - 1)
    kinds = zip(columns, (int, float, int, int, bool))
    f, threshold, left, right, nan_left = (np.asarray(a)[~leaf].astype(kind) for a, kind in kinds)
    value = np.asarray(value, np.float64)[leaf]
    return f, threshold, name[left], name[right], nan_left, value.reshape(len(value), -1), list(outputs)


def read_lightgbm(data):
    text = data.decode()
    need(not re.search(r"[^\n -\x7e\x80-\uffff]|[\x85\u2028\u2029]", text), "other ends of lines")
    text, end, rest = text.partition("\nend of trees\n")
    head, *parts = re.split(r"(?<=\n)Tree=", text + "\n")
    need(end and "Tree=" not in rest, "trees behind the end")

    def fields(part):
        found = [line.split("=", 1) for line in part.rstrip("\n").split("\n")]
        need(len({key.strip() for key, _ in found}) == len(found), "a name twice")
        return dict(found)

    def row(f, name, kind):
        form = r"-?\d+" if kind is int else r"-?\d+(\.\d*)?(e[-+]?\d+)?"
        words = f.get(name, "").split(" ") if f.get(name) else []
        need(all(re.fullmatch(form, word, re.A) for word in words), f"{name}: a number of another form")
        return np.array(words, float).astype(kind)

    average = "\naverage_output\n" in head
    need(head.startswith("tree\n") and head.count("average_output") == average, "another first line, or average")
    top = fields(head.removeprefix("tree\n").replace("\naverage_output\n", "\n"))
    known = top["num_class"] == top["num_tree_per_iteration"] == "1" and top["version"] == "v4"
    need(known and top["objective"] == "regression", "only LightGBM regression is known")
    need(row(top, "tree_sizes", int).tolist() == [len(f"Tree={p}".encode()) for p in parts], "other sizes of trees")
    trees = []
    for number, part in enumerate(parts):
        f = fields(f"Tree={part}")
        need(f["num_cat"] == "0" and f.get("is_linear", "0") == "0", "categories and linear leaves are not known")
        index = [row(f, k, int) for k in ("split_feature", "left_child", "right_child", "decision_type")]
        threshold, values, kind = row(f, "threshold", float), row(f, "leaf_value", float), index.pop()
        need(f["Tree"] == str(number) and f["num_leaves"] == str(len(values)), "another number of trees or leaves")
        missing = kind >> 2 & 3
        need(np.all(kind & ~14 == 0) and not np.any(missing == 1), "missing_type Zero is not known")
        nan_left = np.where(missing == 2, (kind & 2) > 0, threshold >= 0)  # no missing type: NaN is read as 0.0
        trees.append((index[0], threshold, *index[1:], nan_left, values[:, None], [0]))
    rules = {"divisor": float(len(trees))} if average else {}
    return Model(int(top["max_feature_idx"]) + 1, trees, [0.0], top["feature_names"].split(), **rules)


def read_ubjson(data):
    """UBJSON as XGBoost writes it."""
    sizes = {"i": "b", "U": "B", "I": ">h", "l": ">i", "L": ">q", "d": ">f", "D": ">d"}
    at = 0

    def take(n):
        nonlocal at
        at += n
        return data[at - n : at]

    def number(kind):
        return struct.unpack(sizes[kind], take(struct.calcsize(sizes[kind])))[0]

    def value(kind):
        if kind in sizes:
            return number(kind)
        if kind in "TFZ":
            return {"T": True, "F": False, "Z": None}[kind]
        if kind == "S":
            return take(number(chr(take(1)[0]))).decode()
        need(kind in "[{", f"UBJSON marker {kind}")
        element = count = None
        if data[at : at + 1] == b"$":
            take(1)
            element = chr(take(1)[0])
        if data[at : at + 1] == b"#":
            take(1)
            count = number(chr(take(1)[0]))
        out = [] if kind == "[" else {}
        while (count is None and data[at : at + 1] not in (b"]", b"}")) or (count is not None and len(out) < count):
            if kind == "[":
                out.append(value(element or chr(take(1)[0])))
            else:
                name = take(number(chr(take(1)[0]))).decode()
                need(name not in out, "a name twice")
                out[name] = value(element or chr(take(1)[0]))
        if count is None:
            take(1)
        return out

    document = value(chr(take(1)[0]))
    need(at == len(data), "bytes behind the document")
    return document


def read_json(data):
    """JSON whose names are all different, and whose numbers become the same float32 number in every reader."""

    def named(pairs):
        need(len(dict(pairs)) == len(pairs), "a name twice")
        return dict(pairs)

    def short(digits):
        need(len(re.sub(r"^[-0.]+|E.*|\W", "", digits.upper())) < 10, f"{digits}: more digits than float32 has")
        return float(digits)

    need(b"\\u" not in data, "letters that are escaped")
    return json.loads(data, object_pairs_hook=named, parse_float=short)


def read_xgboost(document):
    learner = document["learner"]
    need(learner["objective"]["name"] == "reg:squarederror", "only reg:squarederror is known")
    booster = learner["gradient_booster"]
    weight = np.array(booster.get("weight_drop", []), np.float32)
    need(document["version"][0] == 3, "another version of XGBoost")
    model = booster["gbtree"]["model"] if booster["name"] == "dart" else booster["model"]
    need(booster["name"] in ("gbtree", "dart"), f"booster {booster['name']} is not known")
    # saved by XGBRegressor, whose predict takes infinities and stops at the best iteration; a Booster does neither
    told = learner.get("attributes", {})
    by_class = "scikit_learn" in told
    need(not by_class or booster["name"] == "gbtree", "dart as XGBRegressor predicts is not known")
    best = int(told["best_iteration"]) if by_class and "best_iteration" in told else None
    need(best is None or best >= 0, "a best iteration below 0")
    last = None if best is None else model["iteration_indptr"][best + 1]
    param, count, starts = learner["learner_model_param"], len(model["trees"]), model["iteration_indptr"]
    base = np.array(read_json(param["base_score"].encode()), np.float32).reshape(-1)
    outputs = max(int(param["num_target"]), 1)
    need(re.fullmatch(r"[-+.\dE,[\]]+", param["base_score"], re.A), "another form of base")
    need(param["num_class"] == "0" and len(base) in (1, outputs), "classes, or another base")
    need(len(weight) == (count if booster["name"] == "dart" else 0), "other weights of trees")
    need(len(model["tree_info"]) == count == int(model["gbtree_model_param"]["num_trees"]), "another number of trees")
    need([tree["id"] for tree in model["trees"]] == list(range(count)), "trees out of order")
    need([*starts[:1], *starts[-1:]] == [0, count] and starts == sorted(starts), "other iterations")
    need(last is None or 0 < last <= count, "another best iteration")
    if last is not None:  # XGBoost up to 1.5 counts the trees of the best rounds, or those of a round, by itself
        parallel = re.search(r'"num_parallel_tree": *(\d{1,9})\b', told["scikit_learn"])
        trees = told.get("best_ntree_limit", str((best + 1) * int(parallel[1]) if parallel else 0))
        need(trees.isdecimal() and int(trees[:10]) * outputs <= last, "more trees than those up to the best iteration")
    base = np.broadcast_to(base, outputs) if len(base) == 1 else base
    trees = []
    for number, (t, group) in enumerate(zip(model["trees"][:last], model["tree_info"])):
        need(not any(t["split_type"]), "categories are not known")
        width = max(int(t["tree_param"]["size_leaf_vector"]), 1)
        need(width == 1, "leaves with several numbers are not known")
        left, wide = np.array(t["left_children"]), np.array(t["split_conditions"], float)
        condition = single(wide).astype(np.float32)
        names = ("right_children", "split_indices", "split_conditions", "default_left", "split_type")
        nodes = [int(t["tree_param"]["num_nodes"]), *(len(t[name]) for name in names)]
        need(all(isinstance(number, float) for number in t["split_conditions"]), "whole numbers as conditions")
        plain = t["tree_param"]["num_deleted"] == "0" and set(t["default_left"]) <= {0, 1}
        need(plain and set(nodes) == {len(left)} and np.all(left >= -1), "nodes of other kinds or lengths")
        value = condition * weight[number] if len(weight) else condition
        columns = t["split_indices"], condition, left, t["right_children"], t["default_left"]
        trees.append(flat(columns, value, left < 0, [group]))
    features, names = int(learner["learner_model_param"]["num_feature"]), learner["feature_names"] or None
    limit = np.inf if by_class else F32_LIMIT
    return Model(features, trees, base, names, less=True, single_in=True, single_sum=True, limit=limit)


OUTSIDE = "link or categories"
#: Criteria of trees that take NaN.
CRITERIA = {"squared_error", "friedman_mse", "poisson", "gini", "entropy", "log_loss"}


def read_skops(data):
    archive = zipfile.ZipFile(BytesIO(data))

    def build(node):
        if not isinstance(node, dict):
            return node
        content, loader = node.get("content"), node["__loader__"]
        if loader == "JsonNode":
            return json.loads(content)
        if loader == "NdArrayNode" and node["type"] == "numpy":
            return np.load(BytesIO(archive.read(node["file"])), allow_pickle=False)
        if loader == "ListNode" or (loader == "NdArrayNode" and isinstance(content, list)):
            return [build(item) for item in content]
        if loader == "NdArrayNode":
            return build(content)
        if loader == "DictNode":
            return {key: build(item) for key, item in content.items() if isinstance(item, dict)}
        if loader in ("ObjectNode", "TreeNode") and content:
            state = build(content) if "__loader__" in content else {k: build(v) for k, v in content.items()}
            need(node["__module__"].startswith(("sklearn.", "numpy")), f"a class of {node['__module__']}")
            return {**(state if isinstance(state, dict) else {}), "class": node["__class__"]}
        return {"class": node["__class__"]}

    e = build(json.loads(archive.read("schema.json")))
    kind, features = e["class"], e.get("n_features_in_")
    names = None if e.get("feature_names_in_") is None else [str(n) for n in np.ravel(e["feature_names_in_"])]
    label, name = kind.endswith("Classifier"), re.sub("(Classifier|Regressor)$", "", kind)
    if name == "HistGradientBoosting":
        losses = ("HalfBinomialLoss", "HalfMultinomialLoss") if label else ("HalfSquaredError", "AbsoluteError")
        known = e["_loss"]["class"] in losses and (label or e["_loss"]["link"]["class"] == "IdentityLink")
        need(known and e["is_categorical_"] is None and e["_preprocessor"] is None, OUTSIDE)
        trees = []
        for number, predictor in ((c, p) for row in e["_predictors"] for c, p in enumerate(row)):
            n = predictor["nodes"]
            need(not np.any(n["is_categorical"]) and number < len(np.ravel(e["_baseline_prediction"])), OUTSIDE)
            columns = [n[k] for k in ("feature_idx", "num_threshold", "left", "right", "missing_go_to_left")]
            trees.append(flat(columns, n["value"], n["is_leaf"] if len(n) > 1 else [True], [number]))
        return Model(features, trees, np.ravel(e["_baseline_prediction"]), names, label=label)
    forest, boosting = name in ("RandomForest", "ExtraTrees"), kind == "GradientBoostingRegressor"
    need(boosting or forest or name in ("DecisionTree", "ExtraTree"), f"{kind} is not known")
    need(not label or e["n_outputs_"] == 1, "several decisions")
    members = [m for row in e["estimators_"] for m in row] if boosting else e["estimators_"] if forest else [e]
    base, rate, width = [0.0], 1.0, int(e["n_classes_"] if label else e.get("n_outputs_", 1))
    if boosting:
        need(e["init_"]["class"] == "DummyRegressor", "an initial estimator")
        base, rate = np.ravel(e["init_"]["constant_"]), float(e["learning_rate"])
    trees = []
    for member in members:
        n, value = member["tree_"]["nodes"], member["tree_"]["values"]
        need(member["class"] in {f"{tree}Tree{kind[len(name) :]}" for tree in ("Decision", "Extra")}, "other members")
        need(value.shape[1:] == ((1, width) if label else (width, 1)) and np.all(n["left_child"] >= -1), "other leaves")
        takes_nan = member["criterion"] in CRITERIA and member["monotonic_cst"] is None
        need(boosting or takes_nan, "whether NaN is taken is not known")
        go = n["missing_go_to_left"] if "missing_go_to_left" in n.dtype.names else np.zeros(len(n))
        columns = *(n[k] for k in ("feature", "threshold", "left_child", "right_child")), go
        value = rate * (value[:, 0] if label else value[:, :, 0])
        trees.append(flat(columns, value, n["left_child"] < 0, range(width)))
    rules = {"divisor": float(len(trees)) if forest else 1.0, "nan": not boosting, "limit": F32_LIMIT, "label": label}
    return Model(features, trees, base if boosting else [0.0] * width, names, single_in=True, **rules)


def protobuf(data):
    """Fields of a message: number -> raw values (integers, or bytes)."""
    out, at = {}, 0

    def varint():
        nonlocal at
        result = shift = 0
        while True:
            byte = data[at]
            at += 1
            result |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return result

    while at < len(data):
        tag = varint()
        kind = tag & 7
        if kind == 0:
            item = varint()
        else:
            size = varint() if kind == 2 else {1: 8, 5: 4}[kind]
            item, at = data[at : at + size], at + size
        out.setdefault(tag >> 3, []).append(item)
    return out


def one(message, number, otherwise=None):
    """The only value of a field."""
    need(len(message.get(number, [otherwise])) == 1 and (number in message or otherwise is not None), "a field twice")
    return message.get(number, [otherwise])[0]


#: Attributes of a TreeEnsembleRegressor: their types, and the values of those that may have one only.
INTEGERS, FLOATS, TEXTS = 7, 6, 8
ATTRIBUTES = {"aggregate_function": (3, b"SUM"), "post_transform": (3, b"NONE"), "n_targets": (2, 1)}
ATTRIBUTES |= dict.fromkeys(("base_values", "nodes_values", "target_weights", "nodes_hitrates"), (FLOATS, None))
ATTRIBUTES |= {"nodes_modes": (TEXTS, None)}
ATTRIBUTES |= {f"target_{name}": (INTEGERS, None) for name in ("ids", "nodeids", "treeids")}
ATTRIBUTES |= {
    f"nodes_{name}": (INTEGERS, None)
    for name in ("treeids", "nodeids", "featureids", "truenodeids", "falsenodeids", "missing_value_tracks_true")
}


def read_onnx(data):
    file = protobuf(data)
    graph = protobuf(one(file, 7))
    need(25 not in file and not {5, 15} & graph.keys(), "functions or numbers of the graph")
    node = protobuf(one(graph, 1))
    need(one(node, 4) == b"TreeEnsembleRegressor", f"the operator {node[4][0].decode()} is not known")
    ends = [protobuf(one(graph, number)) for number in (11, 12)]
    names = [one(end, 1) for end in ends]
    need(one(node, 7) == b"ai.onnx.ml" and [one(node, 1), one(node, 2)] == names, "another node")
    given = protobuf(one(protobuf(one(ends[0], 2)), 1))
    need(one(given, 1) == 1, "inputs that are not float32")
    a = {}
    for raw in node[5]:
        m = protobuf(raw)
        name = one(m, 1).decode()
        kind, value = ATTRIBUTES.get(name, (None, None))
        place = {3: 4, 2: 3, FLOATS: 7, INTEGERS: 8, TEXTS: 9}.get(kind)
        need(name not in a and place and one(m, 20) == kind and not m.keys() - {1, 13, 20, place}, f"attribute {name}")
        need(value is None or one(m, place) == value, "modes or aggregates")
        if kind == FLOATS:
            a[name] = np.frombuffer(b"".join(m.get(7, [])), "<f4")
        elif kind == INTEGERS:
            lists = [varints(i) if isinstance(i, bytes) else [i] for i in m.get(8, [])]
            a[name] = np.array([n for part in lists for n in part], np.int64)
        else:
            a[name] = [text.decode() for text in m.get(9, [])]
    need(set(a["nodes_modes"]) <= {"BRANCH_LEQ", "LEAF"}, "modes or aggregates")
    ids, nodes = a["nodes_treeids"], a["nodes_nodeids"]
    need(not np.any(a["target_ids"]) and np.all(np.diff(ids) >= 0), "another target, or trees out of order")
    leaves = list(zip(a["target_treeids"].tolist(), a["target_nodeids"].tolist()))
    leaf = np.array(a["nodes_modes"]) == "LEAF"
    owners = sorted(zip(ids[leaf].tolist(), nodes[leaf].tolist()))
    need(sorted(leaves) == owners and len(leaves) == len(a["target_weights"]) == len(a["target_ids"]), "a leaf twice")
    weight, trees = dict(zip(leaves, a["target_weights"].tolist())), []
    for t in np.unique(ids).tolist():
        at = np.flatnonzero(ids == t)
        need(np.array_equal(nodes[at], np.arange(len(at))), "nodes out of order")
        names = ("nodes_featureids", "nodes_values", "nodes_truenodeids", "nodes_falsenodeids")
        missing = a.get("nodes_missing_value_tracks_true", np.zeros(len(ids)))
        need(all(len(a[k]) == len(ids) for k in (*names, "nodes_modes")) and len(missing) == len(ids), "lengths")
        value = [weight.get((t, number), 0.0) for number in range(len(at))]
        trees.append(flat((*(a[k][at] for k in names), missing[at]), value, leaf[at], [0]))
    shape = protobuf(one(given, 2))[1]
    need(len(shape) == 2, "inputs of another shape")
    base = a.get("base_values", np.zeros(0))
    need(len(base) < 2, "another base")
    rules = {"single_in": True, "single_sum": True, "base_last": True}
    return Model(one(protobuf(shape[1]), 1), trees, base if len(base) else [0.0], None, **rules)


def varints(data):
    out, shift = [0], 0
    for byte in data:
        out[-1] |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            out, shift = [*out, 0], 0
    return out[:-1]


def read_model(path):
    data = path.read_bytes()
    if path.suffix == ".txt":
        return read_lightgbm(data)
    if path.suffix in (".json", ".ubj"):
        return read_xgboost(read_json(data) if path.suffix == ".json" else read_ubjson(data))
    need(path.suffix in (".skops", ".onnx"), f"{path.name}: a kind of file that is not known")
    return read_skops(data) if path.suffix == ".skops" else read_onnx(data)
