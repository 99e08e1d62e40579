"""What native code of scikit-learn and SciPy follows without a look, wherever it stands in an estimator.

A wrong number there ends the process, or makes it read or write what lies beside. Walkers check what they read; but the
library also follows what no walker reads: `SelectFromModel` asks the trees of its own estimator how important each
feature is.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from st_codegen.walkers.fitted import Fitted

#: Arrays of nodes; scikit-learn checks their types and lengths when it loads them, and none of their numbers.
TREE = "sklearn.tree._tree.Tree"
#: The number of a child that means a leaf (`tree/_tree.pyx: _TREE_LEAF`); any other one is followed.
_LEAF = -1


def is_tree(part: Any) -> bool:
    """Whether an object holds the nodes of a tree of `sklearn.tree`."""
    return f"{type(part).__module__}.{type(part).__name__}" == TREE


def check_native(estimator: Any) -> None:
    """Check every tree and every sparse matrix inside an estimator.

    Raises InputError for a tree, ValueError for a matrix, that the library would follow beyond its end.
    """
    for part in objects_in(estimator):
        if is_tree(part):
            _check_tree(part)
        elif type(part).__module__.startswith("scipy.sparse") and hasattr(part, "check_format"):
            part.check_format(full_check=True)


def objects_in(estimator: Any) -> Iterator[Any]:
    """An estimator and everything that it holds, lists and dictionaries included, each once."""
    seen: set[int] = set()
    waiting = [estimator]
    while waiting:
        part = waiting.pop()
        if id(part) in seen:
            continue
        seen.add(id(part))
        if isinstance(part, dict):
            waiting += part.values()
        elif isinstance(part, list | tuple):
            waiting += part
        elif isinstance(part, np.ndarray):
            waiting += part.ravel().tolist() if part.dtype == object else []
        elif hasattr(part, "__dict__") and not isinstance(part, type):
            waiting += vars(part).values()
        yield part


def _check_tree(tree: Any) -> None:
    """All nodes, those too that no path reaches: some methods visit them one after another."""
    fitted, count = Fitted(tree), tree.node_count
    if count < 1:
        raise fitted.fail("nodes", "no nodes")
    inner = tree.children_left != _LEAF
    for name in ("children_left", "children_right"):
        children = getattr(tree, name)
        if np.any((children[inner] < 0) | (children[inner] >= count)) or np.any(children[~inner] != _LEAF):
            raise fitted.fail(name, "a child number outside the tree")
    if np.any((tree.feature[inner] < 0) | (tree.feature[inner] >= tree.n_features)):
        raise fitted.fail("feature", "a split of a feature that does not exist")
