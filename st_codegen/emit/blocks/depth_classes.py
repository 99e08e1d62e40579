"""Trees of about the same depth go down together, so that shallow ones do not wait for the deepest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from st_codegen.ir import Int32Array, IntArray


@dataclass(frozen=True)
class Prices:
    """What classes cost, counted in visited nodes.

    `loop`: the code of one more loop, some 28 cache lines that a cold call fetches (100 ns each on an Atom E3845) over
    some 6 ns a node there. `order`: keeping the order of one tree, its number and the leaf that it reached, 4 bytes
    each.
    """

    loop: int = 450
    order: int = 2


@dataclass(frozen=True)
class DepthClasses:
    """`order`: trees as they are visited, shallow ones first; `runs`: (first, stop, depth) along that order."""

    order: Int32Array
    runs: tuple[tuple[int, int, int], ...]

    @property
    def is_sorted(self) -> bool:
        """Whether trees are visited in another order than that of their sum."""
        return len(self.runs) > 1

    @property
    def visits(self) -> int:
        """Nodes visited in a call."""
        return sum((stop - first) * depth for first, stop, depth in self.runs)


def depth_classes(depths: IntArray, abreast: int, prices: Prices) -> DepthClasses:
    """The cheapest classes for trees of these depths; classes but the last have a multiple of `abreast` trees."""
    trees = len(depths)
    whole = DepthClasses(np.arange(trees, dtype=np.int32), ((0, trees, int(depths.max(initial=0))),))
    order = np.argsort(depths, kind="stable").astype(np.int32)
    deepest = depths[order]
    # a class may end behind the last group of a depth
    last = range(abreast, trees, abreast)
    ends = [at for at in last if deepest[at - 1] < deepest[min(at + abreast, trees) - 1]] + [trees]
    best: list[tuple[float, tuple[tuple[int, int, int], ...]]] = []
    for number, stop in enumerate(ends):
        depth = int(deepest[stop - 1])
        ways: list[tuple[float, tuple[tuple[int, int, int], ...]]] = [(float(stop * depth), ((0, stop, depth),))]
        for before in range(number):
            cost, runs = best[before]
            ways.append((cost + prices.loop + (stop - ends[before]) * depth, (*runs, (ends[before], stop, depth))))
        best.append(min(ways, key=lambda way: way[0]))
    cost, runs = best[-1]
    return DepthClasses(order, runs) if cost + prices.order * trees < whole.visits else whole
