"""Chains of equality tests in ONNX trees: what exporters write for categories, and what onnxruntime makes of it.

Converters write "category in {1, 3}" as `x == 1` whose false child is `x == 3`, both with one true child. onnxruntime
turns such a chain into one test of membership, and it does so too where the true children are different subtrees that
it takes for equal: it compares features, thresholds and the first weight of leaves, but neither missing directions nor
the other weights (core/providers/cpu/ml/tree_ensemble_common.h, AddNodes and CheckIfSubtreesAreEqual).
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import replace

import numpy as np

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import FloatArray, IntArray
from st_codegen.walkers.onnx.forest import Forest, Mode

_ADVICE = "onnxruntime merges the two tests, which changes the model; export it again, or compile the native model"


def merge_equality_chains(forest: Forest) -> Forest:
    """One MEMBER node for each chain of EQ nodes that share their true child; every node then has one parent.

    Raises UnsupportedModelError where splits share a child in another way.
    """
    link = _links(forest)
    if np.any(link >= 0):
        forest = _merged(forest, link)
    parents = _parent_count(forest)
    shared = np.flatnonzero(parents > 1)
    if shared.size:
        raise UnsupportedModelError(
            f"{forest.where(shared[0])}: {parents[shared[0]]} splits or trees lead to this node; only BRANCH_EQ nodes "
            "in a row on one feature may share their true child; export the model again as plain trees"
        )
    return forest


def _parent_count(forest: Forest) -> IntArray:
    children = np.concatenate([forest.true, forest.false])
    return np.bincount(np.concatenate([children[children >= 0], forest.roots]), minlength=len(forest.mode))


def _links(forest: Forest) -> IntArray:
    """For each node the next one of its chain, -1 where there is none."""
    equal = forest.mode == Mode.EQ
    after = np.where(equal, forest.false, -1)
    found = (
        (after >= 0)
        & equal[after]
        & (forest.feature[after] == forest.feature)
        & (forest.true[after] == forest.true)
        & (_parent_count(forest)[after] == 1)
    )
    return np.where(found, after, -1)


def _merged(forest: Forest, link: IntArray) -> Forest:
    heads = np.setdiff1d(np.flatnonzero(link >= 0), link)
    absorbed = np.zeros(len(link), np.bool_)
    values: list[FloatArray] = [np.zeros(0)]
    count = np.zeros(len(link), np.int64)
    mode, false = forest.mode.copy(), forest.false.copy()
    for head in heads.tolist():
        chain = [head]
        while link[chain[-1]] >= 0:
            chain.append(int(link[chain[-1]]))
            if forest.missing_true[chain[-1]] and not forest.missing_true[chain[-2]]:
                raise UnsupportedModelError(
                    f"{forest.where(head)}: equality tests in a row track missing values differently; {_ADVICE}"
                )
        absorbed[chain[1:]] = True
        values.append(forest.value[chain])
        count[head] = len(chain)
        mode[head] = Mode.MEMBER
        false[head] = forest.false[chain[-1]]
    keep = np.flatnonzero(~absorbed)
    number = np.full(len(link) + 1, -1)  # the last entry keeps -1, "no child", as it is
    number[keep] = np.arange(len(keep))
    return replace(
        forest,
        roots=number[forest.roots],
        tree_id=forest.tree_id[keep],
        node_id=forest.node_id[keep],
        mode=mode[keep],
        feature=forest.feature[keep],
        value=forest.value[keep],
        true=number[forest.true[keep]],
        false=number[false[keep]],
        missing_true=forest.missing_true[keep],
        leaf=forest.leaf[keep],
        member_start=np.concatenate([[0], np.cumsum(count[keep])]),
        member=np.concatenate(values),
    )


def check_merges(forest: Forest, order: IntArray) -> None:
    """Refuse trees that onnxruntime changes when it merges equality tests; `order` lists parents before children.

    Raises UnsupportedModelError that names the two tests.
    """
    unrolled = np.isin(forest.mode, (Mode.EQ, Mode.MEMBER))
    first = np.flatnonzero(unrolled & (forest.false >= 0) & unrolled[forest.false])
    second = forest.false[first]
    same = forest.feature[first] == forest.feature[second]
    if not np.any(same):
        return
    seen, exact = _fingerprints(forest, order)
    for one, two in zip(first[same], second[same], strict=True):
        hits = int(forest.true[one]), int(forest.true[two])
        differs = exact[hits[0]] != exact[hits[1]] or (forest.missing_true[two] and not forest.missing_true[one])
        if seen[hits[0]] == seen[hits[1]] and differs:
            raise UnsupportedModelError(f"{forest.where(one)} and {forest.where(two)} test one feature: {_ADVICE}")


def _fingerprints(forest: Forest, order: IntArray) -> tuple[list[int], list[int]]:
    """Two numbers a node, equal for subtrees that onnxruntime takes for equal, and for those that are equal."""
    known: dict[Hashable, int] = {}
    seen = [-1] * len(order)
    exact = [-1] * len(order)
    start = np.searchsorted(forest.weight_leaf, np.arange(forest.n_leaves + 1)).tolist()
    targets, weights = forest.weight_target.tolist(), forest.weight.tolist()
    mode, feature, missing = forest.mode.tolist(), forest.feature.tolist(), forest.missing_true.tolist()
    value, true, false, leaf = (array.tolist() for array in (forest.value, forest.true, forest.false, forest.leaf))

    def number(*key: Hashable) -> int:
        return known.setdefault(key, len(known))

    for node in order[::-1].tolist():
        if mode[node] == Mode.LEAF:
            row = slice(start[leaf[node]], start[leaf[node] + 1])
            seen[node] = number(weights[row.start])
            exact[node] = number(*targets[row], *weights[row])
        elif mode[node] == Mode.MEMBER_INTEGER:
            seen[node] = exact[node] = number("set", node)
        else:
            member = mode[node] == Mode.MEMBER
            test = int(Mode.EQ) if member else mode[node]
            seen[node], exact[node] = seen[false[node]], exact[false[node]]
            for number_in_set in forest.members(node)[::-1].tolist() if member else (value[node],):
                common = (test, feature[node], number_in_set)
                seen[node] = number(*common, seen[true[node]], seen[node])
                exact[node] = number(*common, missing[node], exact[true[node]], exact[node])
    return seen, exact
