"""Times and peak memory of generation and verification; `make bench`.

Each row is a process of its own, so that its peak memory is its own. The row of the real bundle needs the measured
tables beside the checkout (see tests/families.py) and trains for some minutes first.
"""

from __future__ import annotations

import contextlib
import io
import multiprocessing
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.passes.choose import Options

ROOT = Path(__file__).resolve().parent.parent
#: These models are larger than what a controller holds
UNLIMITED = Options(data_bytes=2**40)


def forest(trees: int, nodes: int) -> Any:
    """A forest of complete random trees on eight features that knows missing values."""
    from st_codegen.ir import Comparison, Feature, ModelIR, Precision, Source, TreeColumn, TreeEnsemble
    from st_codegen.ir.preorder import preorder
    from st_codegen.project.bundle import Bundle
    from st_codegen.walkers.base import LoadedModel

    random = np.random.default_rng(0)
    number = np.arange(nodes)
    left = np.where(2 * number + 2 < nodes, 2 * number + 1, -1)
    shift = np.repeat(np.arange(trees) * nodes, nodes)
    every = np.tile(left, trees)
    layout = preorder(
        np.arange(trees) * nodes, np.where(every < 0, -1, every + shift), np.where(every < 0, -1, every + shift + 1)
    )
    inner = layout.left >= 0
    total = trees * nodes
    op = TreeEnsemble(
        inputs=(0,),
        columns=tuple(TreeColumn(column) for column in range(8)),
        roots=layout.roots,
        split=np.where(inner, random.integers(0, 8, total), -1),
        threshold=np.where(inner, random.normal(size=total), 0.0),
        left=layout.left,
        right=layout.right,
        missing_left=inner & (random.random(total) < 0.5),
        leaf=np.where(inner, -1, np.cumsum(~inner) - 1),
        leaf_value=random.normal(size=(int((~inner).sum()), 1)),
        tree_output=np.zeros(trees, np.int32),
        base=np.zeros(1),
        comparison=Comparison.LESS_OR_EQUAL,
        input_precision=Precision.FLOAT32,
        divisor=float(trees),
    )
    features = tuple(Feature(f"f{column}") for column in range(8))
    model = ModelIR("forest", features, (op,), ("out1",), Source("made", "1", "random forest"), accepts_nan=True)

    def no_library(x: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    return Bundle((LoadedModel(model, no_library),), None)


def generate_forest(trees: int, nodes: int) -> str:
    """Generate a forest; the time does not count making it."""
    from st_codegen.driver import generate
    from st_codegen.emit.targets import TARGETS

    bundle = forest(trees, nodes)
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        generated = generate(bundle, TARGETS["twincat"], Path(folder), options=UNLIMITED)
        seconds = time.perf_counter() - start
    return f"{seconds:6.1f} s, {sum(generated.files.values()) / 1e6:.0f} MB of text"


def run_forest(trees: int, nodes: int, rows: int) -> str:
    """Rows a second of the engine on a generated forest."""
    from st_codegen.driver import generate
    from st_codegen.emit.targets import TARGETS
    from st_codegen.proof.runner import GeneratedCode

    bundle = forest(trees, nodes)
    x = np.random.default_rng(1).normal(size=(rows, 8))
    with tempfile.TemporaryDirectory() as folder:
        code = GeneratedCode(generate(bundle, TARGETS["twincat"], Path(folder), options=UNLIMITED).folder, "twincat")
        code.run_model("FB_Forest", x[:100], 1)
        start = time.perf_counter()
        code.run_model("FB_Forest", x, 1)
        seconds = time.perf_counter() - start
    return f"{seconds:6.1f} s, {rows / seconds:,.0f} rows a second"


def bundle_times(models: Path, rows: int) -> str:
    """Load and generate, then verify a bundle."""
    from st_codegen.driver import generate
    from st_codegen.emit.targets import TARGETS
    from st_codegen.project.bundle import load
    from st_codegen.proof.verify import verify

    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        bundle = load(models, trust_pickle=True)
        generate(bundle, TARGETS["twincat"], Path(folder), options=UNLIMITED)
        generated = time.perf_counter()
        report = verify(bundle, Path(folder), rows=rows)
        verified = time.perf_counter()
    total = sum(model.n for model in report.models)
    return (
        f"{generated - start:6.1f} s to generate {len(bundle.models)} models, {verified - generated:.1f} s to verify "
        f"on {total:,} rows, {'passed' if report.passed else 'FAILED'}"
    )


def real_bundle(rows: int) -> str:
    """The 38 models of the paper, trained on the table measured on the real rig."""
    from tests.families import SHARED, write_bundle

    if not SHARED.is_dir():
        return "the measured tables are not beside this checkout"
    with tempfile.TemporaryDirectory() as folder:
        with contextlib.redirect_stderr(io.StringIO()):
            write_bundle(Path(folder))
        return bundle_times(Path(folder), rows)


def measured(label: str, work: Callable[..., str], *arguments: Any) -> None:
    """Run in a process of its own and print its result and peak memory."""
    context = multiprocessing.get_context("spawn")
    receive, send = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(send, work, arguments))
    process.start()
    text, megabytes = receive.recv()
    process.join()
    print(f"{label:34} {text}; peak memory {megabytes:,.0f} MB", flush=True)


def _child(send: Any, work: Callable[..., str], arguments: tuple[Any, ...]) -> None:
    text = work(*arguments)
    send.send((text, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024))


def main() -> None:
    """Print the table."""
    measured("example bundle, 10,000 rows", bundle_times, ROOT / "examples" / "rv160n" / "models", 10_000)
    for trees in (125, 250, 500, 1000):
        measured(f"generate {trees:,} trees x 2,001 nodes", generate_forest, trees, 2_001)
    measured("generate 2,000 trees x 5,001 nodes", generate_forest, 2_000, 5_001)  # ten million nodes
    measured("interpret 100 trees x 255 nodes", run_forest, 100, 255, 100_000)
    measured("interpret 500 trees x 2,001 nodes", run_forest, 500, 2_001, 20_000)
    measured("real bundle, 10,000 rows", real_bundle, 10_000)


if __name__ == "__main__":
    main()
