"""From vibration to a block that knows the state of a bearing; see README.md.

python examples/condition_monitoring/run.py --out build/monitoring
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper
from signals import RATE_HZ, STATES, FloatArray, vibration, windows
from sklearn.linear_model import LogisticRegression

import st_codegen
from st_codegen.emit.targets import TARGETS
from st_codegen.proof.runner import GeneratedCode

#: Samples of a window: 8 ms, which is longer than the time between two impacts.
WINDOW = 32
#: Bands of the filters, and the taps of each.
BANDS_HZ = (200.0, 600.0, 1200.0, 1700.0)
TAPS = 16
CONFIGURATION = f"""[project]
name = "Monitoring"

[[model]]
file = "state.onnx"
window = {WINDOW}
samples = ["fVibration"]

[[model]]
file = "strange.onnx"
window = {WINDOW}
samples = ["fVibration"]
outputs = [{{name = "fDistance"}}]
"""


def features() -> tuple[list[onnx.NodeProto], list[onnx.TensorProto]]:
    """Nodes from a window to eight numbers: the logarithms of mean and largest magnitude in each band."""
    t = (np.arange(TAPS) - (TAPS - 1) / 2) / RATE_HZ
    filters = [np.hanning(TAPS + 2)[1:-1] * np.cos(2 * math.pi * band * t) for band in BANDS_HZ]
    kernel = np.array([taps / np.sum(np.abs(taps)) for taps in filters], np.float32)[:, None, :]
    nodes = [
        helper.make_node("Conv", ["window", "kernel"], ["bands"]),
        helper.make_node("Abs", ["bands"], ["magnitudes"]),
        helper.make_node("GlobalAveragePool", ["magnitudes"], ["means"]),
        helper.make_node("GlobalMaxPool", ["magnitudes"], ["peaks"]),
        helper.make_node("Concat", ["means", "peaks"], ["both"], axis=1),
        helper.make_node("Flatten", ["both"], ["sizes"]),
        helper.make_node("Add", ["sizes", "small"], ["positive"]),
        helper.make_node("Log", ["positive"], ["features"]),
    ]
    return nodes, [tensor("kernel", kernel), tensor("small", 1e-3)]


def tensor(name: str, array: object) -> onnx.TensorProto:
    """A constant of a graph."""
    return numpy_helper.from_array(np.asarray(array, np.float32), name)


def model(nodes: list[onnx.NodeProto], constants: list[onnx.TensorProto], outputs: dict[str, int]) -> onnx.ModelProto:
    """A graph behind the features; `outputs` has the type of each output."""
    first, known = features()
    graph = helper.make_graph(
        [*first, *nodes],
        "monitoring",
        [helper.make_tensor_value_info("window", TensorProto.FLOAT, ("rows", 1, WINDOW))],
        [helper.make_tensor_value_info(name, kind, None) for name, kind in outputs.items()],
        [*known, *constants],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)


def classifier(x: FloatArray, states: FloatArray) -> onnx.ModelProto:
    """A logistic regression on standardized features, which become part of its weights."""
    mean, scale = x.mean(axis=0), x.std(axis=0)
    fitted = LogisticRegression(max_iter=2000).fit((x - mean) / scale, states)
    weights = fitted.coef_ / scale
    nodes = [
        helper.make_node("Gemm", ["features", "weights", "bias"], ["scores"], transB=1),
        helper.make_node("ArgMax", ["scores"], ["number"], axis=1, keepdims=0),
        helper.make_node("Gather", ["names", "number"], ["state"]),
        helper.make_node("Softmax", ["scores"], ["chances"], axis=1),
    ]
    names = helper.make_tensor("names", TensorProto.STRING, [len(STATES)], [state.encode() for state in STATES])
    constants = [names, tensor("weights", weights), tensor("bias", fitted.intercept_ - weights @ mean)]
    return model(nodes, constants, {"state": TensorProto.STRING, "chances": TensorProto.FLOAT})


def detector(x: FloatArray) -> onnx.ModelProto:
    """The Mahalanobis distance from healthy windows: 1 is as far as the farthest of a hundred of them."""
    mean, covariance = x.mean(axis=0), np.cov(x.T)
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    limit = np.quantile(np.linalg.norm((x - mean) @ whiten.T, axis=1), 0.99)
    nodes = [
        helper.make_node("Gemm", ["features", "whiten", "offset"], ["whitened"], transB=1),
        helper.make_node("ReduceL2", ["whitened", "axes"], ["distance"], keepdims=0),
    ]
    constants = [
        tensor("whiten", whiten / limit),
        tensor("offset", -whiten @ mean / limit),
        numpy_helper.from_array(np.array([1], np.int64), "axes"),
    ]
    return model(nodes, constants, {"distance": TensorProto.FLOAT})


def computed(graph: onnx.ModelProto, x: FloatArray) -> list[FloatArray]:
    """All outputs of a graph for windows."""
    session = onnxruntime.InferenceSession(graph.SerializeToString(), providers=["CPUExecutionProvider"])
    return [np.asarray(found) for found in session.run(None, {"window": x[:, None, :].astype(np.float32)})]


def records(first_seed: int, count: int) -> tuple[FloatArray, FloatArray]:
    """Windows of so many records of each state, and the numbers of their states."""
    found = [
        windows(vibration(state, 20 * WINDOW, seed), WINDOW)
        for state in STATES
        for seed in range(first_seed, first_seed + count)
    ]
    return np.vstack(found), np.repeat(np.arange(len(STATES)), 20 * count)


def train(folder: Path, count: int) -> None:
    """Write the models, and print how they do on records that they have not seen."""
    x, states = records(0, count)
    features_of = model([], [], {"features": TensorProto.FLOAT})
    learned = computed(features_of, x)[0].astype(np.float64)
    made = {"state": classifier(learned, states), "strange": detector(learned[states == 0])}
    folder.mkdir(parents=True, exist_ok=True)
    for name, graph in made.items():
        (folder / f"{name}.onnx").write_bytes(graph.SerializeToString())
    (folder / "st-codegen.toml").write_text(CONFIGURATION, encoding="utf-8")
    x, states = records(1000, count)
    found, distance = computed(made["state"], x)[0], computed(made["strange"], x)[0]
    for number, state in enumerate(STATES):
        own = states == number
        print(
            f"{state:>8}: {np.mean(found[own] == state):.0%} of {np.sum(own)} new windows recognized, "
            f"{np.mean(distance[own] > 1):.0%} strange"
        )


def replay(folder: Path, samples: int) -> None:
    """A bearing that wears out, sample by sample through the generated blocks."""
    signal = np.concatenate([vibration("healthy", samples, 5000), vibration("worn", samples, 5001)])
    code = GeneratedCode(folder / "iec", TARGETS["iec"].dialect)
    taken = np.ones(len(signal), np.bool_)
    inputs = {"fVibration": signal, "bShift": taken, "bReset": ~taken}
    state, strange = (code.sequence(f"FB_{name}Window", inputs) for name in ("State", "Strange"))
    valid = np.flatnonzero(state["bValid"])
    worn = np.flatnonzero(
        (state["nClass"] == STATES.index("worn")) & state["bValid"] & (np.arange(len(signal)) >= samples)
    )
    odd = np.flatnonzero((strange["fDistance"] > 1.0) & strange["bValid"] & (np.arange(len(signal)) >= samples))
    false = np.sum(state["nClass"][valid[valid < samples]] != 0)
    print(f"first answer with sample {valid[0] + 1}; wrong on {false} of {np.sum(valid < samples)} healthy windows")
    for what, found in (("worn", worn), ("strange", odd)):
        when = f"{found[0] - samples + 1} samples after the fault begins" if len(found) else "never"
        print(f"{what} for the first time: {when}")


def main() -> int:
    """Train, generate, verify and replay."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("build/monitoring"))
    parser.add_argument("--records", type=int, default=40, help="records of each state to learn from, and to try")
    parser.add_argument("--samples", type=int, default=400, help="samples of each half of the replay")
    parser.add_argument("--rows", type=int, default=2000, help="rows that verify tries")
    given = parser.parse_args()
    train(given.out / "models", given.records)
    bundle = st_codegen.load(given.out / "models")
    for target in ("iec", "twincat"):
        st_codegen.generate(bundle, target, given.out / "plc")
    report = st_codegen.verify(bundle, given.out / "plc", rows=given.rows)
    for result in report.models:
        print(
            f"{result.name}: {'verified' if result.passed else 'DIFFERS'}, {result.n} rows, {', '.join(result.targets)}"
        )
    replay(given.out / "plc", given.samples)
    return 0 if report.passed else 1


if __name__ == "__main__":
    raise SystemExit(main())
