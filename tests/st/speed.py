# ruff: noqa: T201 - a command that reports
"""Measures the interpreters on loads like the generated ones: `python -m tests.st.speed` prints rows a second.

The forest has trees that split a grid of operating points until they run out of points or depth, as trained ones do.
"""

from __future__ import annotations

import cProfile
import pstats
import sys
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from st_codegen.st import Machine, parse_project

FEATURES = ("fSpeed_rpm", "fTorque_Nm", "fTemperature_C")


@dataclass
class Forest:
    """Trees in the layout of the generated code: the left child follows its parent, `right` is an offset."""

    size: list[int]
    split: list[int]
    threshold: list[float]
    right: list[int]


def random_forest(rng: np.random.Generator, points: NDArray[np.float64], trees: int, depth: int) -> Forest:
    forest = Forest([], [], [], [])
    for _ in range(trees):
        start = len(forest.split)
        sample = points[rng.integers(0, len(points), len(points))]
        _grow(rng, forest, sample, depth)
        forest.size.append(len(forest.split) - start)
    return forest


def _grow(rng: np.random.Generator, forest: Forest, points: NDArray[np.float64], depth: int) -> None:
    node = len(forest.split)
    feature = int(rng.integers(0, points.shape[1])) if len(points) else 0
    values = np.unique(points[:, feature])
    forest.right.append(0)
    if depth == 0 or len(values) < 2:
        forest.split.append(-1)
        forest.threshold.append(float(rng.normal()))
        return
    cut = int(rng.integers(1, len(values)))
    threshold = float(values[cut - 1] + values[cut]) / 2
    forest.split.append(feature)
    forest.threshold.append(threshold)
    is_left = points[:, feature] <= threshold
    _grow(rng, forest, points[is_left], depth - 1)
    forest.right[node] = len(forest.split) - node
    _grow(rng, forest, points[~is_left], depth - 1)


def _table(name: str, kind: str, values: list[int] | list[float]) -> str:
    cells = [repr(value).upper() for value in values]
    rows = ",\n        ".join(", ".join(cells[i : i + 8]) for i in range(0, len(cells), 8))
    return f"    {name} : ARRAY[0..{len(cells) - 1}] OF {kind} := [\n        {rows}];\n"


def forest_block(name: str, forest: Forest, depth: int) -> str:
    inputs = "".join(f"    {feature} : LREAL;\n" for feature in FEATURES)
    loads = "".join(f"aX[{i}] := {feature};\n" for i, feature in enumerate(FEATURES))
    return (
        f"FUNCTION_BLOCK {name}\nVAR_INPUT\n{inputs}END_VAR\nVAR_OUTPUT\n    fOut1 : LREAL;\nEND_VAR\nVAR\n"
        "    aX : ARRAY[0..2] OF LREAL;\n    nTree : DINT; nNode : DINT; nRoot : DINT; nLevel : DINT;\n"
        "    fSum : LREAL;\nEND_VAR\nVAR CONSTANT\n"
        + _table("SIZE", "DINT", forest.size)
        + _table("SPLIT", "DINT", forest.split)
        + _table("THRESHOLD", "LREAL", forest.threshold)
        + _table("SKIP", "DINT", forest.right)
        + f"END_VAR\n{loads}nRoot := 0;\nfSum := 0.0;\nFOR nTree := 0 TO {len(forest.size) - 1} DO\n"
        f"    nNode := nRoot;\n    FOR nLevel := 1 TO {depth} DO\n"
        "        IF SPLIT[nNode] < 0 THEN\n            EXIT;\n        END_IF;\n"
        "        IF aX[SPLIT[nNode]] <= THRESHOLD[nNode] THEN\n            nNode := nNode + 1;\n"
        "        ELSE\n            nNode := nNode + SKIP[nNode];\n        END_IF;\n    END_FOR;\n"
        "    fSum := fSum + THRESHOLD[nNode];\n    nRoot := nRoot + SIZE[nTree];\nEND_FOR;\n"
        f"fOut1 := fSum / {float(len(forest.size))!r};\nEND_FUNCTION_BLOCK\n"
    )


def kernel_block(rng: np.random.Generator, vectors: int) -> str:
    inputs = "".join(f"    {feature} : LREAL;\n" for feature in FEATURES)
    loads = "".join(f"aX[{i}] := {feature};\n" for i, feature in enumerate(FEATURES))
    return (
        f"FUNCTION_BLOCK FB_Kernel\nVAR_INPUT\n{inputs}END_VAR\nVAR_OUTPUT\n    fOut1 : LREAL;\nEND_VAR\nVAR\n"
        "    aX : ARRAY[0..2] OF LREAL;\n    nVector : DINT; nColumn : DINT; fSquares : LREAL; fDelta : LREAL;\n"
        "END_VAR\nVAR CONSTANT\n"
        + _table("VECTORS", "LREAL", rng.normal(size=vectors * 3).tolist())
        + _table("WEIGHTS", "LREAL", rng.normal(size=vectors).tolist())
        + f"END_VAR\n{loads}fOut1 := 0.5;\nFOR nVector := 0 TO {vectors - 1} DO\n    fSquares := 0.0;\n"
        "    FOR nColumn := 0 TO 2 DO\n        fDelta := aX[nColumn] - VECTORS[nVector * 3 + nColumn];\n"
        "        fSquares := fSquares + fDelta * fDelta;\n    END_FOR;\n"
        "    fOut1 := fOut1 + WEIGHTS[nVector] * EXP(-0.3 * fSquares);\nEND_FOR;\nEND_FUNCTION_BLOCK\n"
    )


def measure_forest(models: int, trees: int, depth: int, rows: int, profile: bool) -> None:
    rng = np.random.default_rng(1)
    grid = np.stack(np.meshgrid(np.arange(17.0), np.arange(19.0), np.arange(3.0)), -1).reshape(-1, 3)
    texts = {}
    nodes = 0
    for number in range(models):
        forest = random_forest(rng, grid, trees, depth)
        nodes += len(forest.split)
        texts[f"m{number}.st"] = forest_block(f"FB_Model{number}", forest, depth)
    started = time.perf_counter()
    project = parse_project(texts, dialect="iec")
    parsed = time.perf_counter()
    machine = Machine(project, rows)
    compiled = time.perf_counter()
    inputs = {name: rng.uniform(-1, 18, rows) for name in FEATURES}
    if profile:
        profiler = cProfile.Profile()
        profiler.enable()
    for number in range(models):
        machine.instance(f"FB_Model{number}")(**inputs)
    if profile:
        profiler.disable()
        pstats.Stats(profiler).sort_stats("tottime").print_stats(18)
    done = time.perf_counter()
    print(
        f"forest: {models} models x {trees} trees x depth {depth}, {nodes} nodes, {rows} lanes: "
        f"parse {parsed - started:.2f} s, compile {compiled - parsed:.2f} s, "
        f"run {done - compiled:.2f} s = {rows / (done - compiled):.0f} rows/s"
    )
    scalar = Machine(project)
    blocks = [scalar.instance(f"FB_Model{number}") for number in range(models)]
    started = time.perf_counter()
    for row in range(5):
        for block in blocks:
            block(**{name: float(values[row]) for name, values in inputs.items()})
    print(f"forest, one row at a time: {5 / (time.perf_counter() - started):.1f} rows/s")


def measure_kernel(vectors: int, rows: int) -> None:
    rng = np.random.default_rng(2)
    project = parse_project({"kernel.st": kernel_block(rng, vectors)}, dialect="iec")
    block = Machine(project, rows).instance("FB_Kernel")
    inputs = {name: rng.normal(size=rows) for name in FEATURES}
    started = time.perf_counter()
    block(**inputs)
    print(f"kernel: {vectors} vectors, {rows} lanes: {rows / (time.perf_counter() - started):.0f} rows/s")
    single = Machine(project).instance("FB_Kernel")
    started = time.perf_counter()
    for row in range(20):
        single(**{name: float(values[row]) for name, values in inputs.items()})
    print(f"kernel, one row at a time: {20 / (time.perf_counter() - started):.0f} rows/s")


if __name__ == "__main__":
    measure_forest(38, 60, 14, 10_000, "--profile" in sys.argv)
    measure_kernel(930, 10_000)
