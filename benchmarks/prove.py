"""What `prove` proves, and what it takes.

python benchmarks/prove.py                 all golden projects, the example bundle and classifiers, as a table
python benchmarks/prove.py TREES LEAVES    time and memory for one model of random trees of that size
"""

import dataclasses
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import lightgbm
import numpy as np

from st_codegen.driver import generate
from st_codegen.ir import TreeEnsemble
from st_codegen.passes.choose import Layout, Options
from st_codegen.passes.domain import limit_inputs
from st_codegen.project.bundle import Bundle, load
from st_codegen.proof.prove.certificate import certificate
from st_codegen.proof.prove.prove import ProveReport, Verdict, prove
from st_codegen.walkers.base import LoadedModel
from st_codegen.walkers.objects import from_estimator

ROOT = Path(__file__).resolve().parents[1]
CHECKER = ROOT / "checker" / "check_certificate.py"


def row(name: str, report: ProveReport, seconds: float, checked: str) -> None:
    """Print what was found of a project, and then why something is not proved."""
    verdicts = Counter(result.verdict for result in report.results)
    methods = Counter(result.method for result in report.results if result.verdict is Verdict.PROVED)
    how = ", ".join(f"{count} by {method}" for method, count in sorted(methods.items()))
    rest = len(report.results) - verdicts[Verdict.PROVED]
    print(f"| {name} | {verdicts[Verdict.PROVED]} | {how} | {rest} | {checked} | {seconds:.1f} |", flush=True)
    for result in report.results:
        if result.verdict is not Verdict.PROVED:
            print(f"{result.model}: {result.verdict.value}: {result.reason}", file=sys.stderr)


def checked(models: Path, generated: Path, bundle: Bundle, report: ProveReport) -> str:
    """How many entries of its certificate the checker confirms."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "certificate.json"
        path.write_text(json.dumps(certificate(bundle, models, generated, report)))
        command = [sys.executable, CHECKER, path, models, generated]
        said = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
    if said.returncode not in (0, 3):
        raise SystemExit(said.stdout)
    return str(said.stdout.count(": confirmed"))


def projects() -> None:
    """Prove the golden projects, the example bundle and the classifiers of the tests; print a table."""
    from tests.proof.prove import test_prove_classes as classifiers

    print("| project | with a proof | how | without | confirmed by the checker | s |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as out:
        example = ROOT / "examples" / "rv160n" / "models"
        for target in ("twincat", "iec"):
            generate(load(example), target, Path(out))
        folders = [
            (ROOT / "golden" / name / "models", ROOT / "golden" / name / "generated") for name in ("lone", "bundle")
        ]
        for models, generated in [*folders, (example, Path(out))]:
            bundle = load(models)
            for target in ("twincat", "iec"):
                start = time.process_time()
                report = prove(bundle, generated / target)
                seconds = time.process_time() - start
                confirmed = checked(models, generated / target, bundle, report)
                row(f"`{models.parent.relative_to(ROOT)}`, {target}", report, seconds, confirmed)
    results, start = [], time.process_time()
    kinds = {**classifiers.EXPRESSIONS, **{name: (kind, y, x) for name, (kind, x, y) in classifiers.TREES.items()}}
    fitted = [(name, classifiers.fitted(*given)) for name, given in kinds.items()]
    fitted += [(name, classifiers.booster(name)) for name in classifiers.BOOSTERS]
    for _, model in fitted:
        with tempfile.TemporaryDirectory() as out:
            results.append(classifiers.proved(model, Path(out)))
    row(
        f"{len(fitted)} classifiers, anomaly models and links, iec",
        ProveReport(tuple(results)),
        time.process_time() - start,
        "-",
    )


def grown(op: TreeEnsemble, trees: int, leaves: int) -> TreeEnsemble:
    """An ensemble of random trees: each split cuts the box of its node in two, and divides its leaves at random."""
    random = np.random.default_rng(0)
    nodes = 2 * leaves - 1
    split, left, right, leaf = (np.full(trees * nodes, -1, np.int32) for _ in range(4))
    threshold = np.zeros(trees * nodes)
    for tree in range(trees):
        waiting, node, found = [(leaves, ((-3.0, 3.0),) * len(op.columns))], tree * nodes, tree * leaves
        while waiting:
            count, box = waiting.pop()
            if count == 1:
                leaf[node], found = found, found + 1
            else:
                column, first = int(random.integers(len(box))), int(random.integers(1, count))
                low, high = box[column]
                split[node], threshold[node] = column, random.uniform(low, high)
                left[node], right[node] = node + 1, node + 2 * first
                for size, side in ((count - first, (threshold[node], high)), (first, (low, threshold[node]))):
                    waiting.append((size, (*box[:column], side, *box[column + 1 :])))
            node += 1
    roots = np.arange(0, trees * nodes, nodes)
    return dataclasses.replace(
        op,
        roots=roots,
        split=split,
        threshold=threshold,
        left=left,
        right=right,
        missing_left=random.random(len(split)) < 0.5,
        leaf=leaf,
        leaf_value=random.normal(size=(trees * leaves, 1)),
        tree_output=np.zeros(trees),
    )


def main(trees: int, leaves: int) -> None:
    """Grow random trees, generate and prove; print what it took."""
    random = np.random.default_rng(0)
    x = random.normal(size=(1000, 6))
    y = np.sin(3 * x[:, 0]) + x[:, 1:].sum(axis=1)
    loaded = from_estimator(lightgbm.LGBMRegressor(n_estimators=20, verbose=-1, n_jobs=1).fit(x, y), "m")
    (op,) = loaded.ir.ops
    assert isinstance(op, TreeEnsemble) and len(op.columns) == x.shape[1]
    model = LoadedModel(dataclasses.replace(loaded.ir, ops=(grown(op, trees, leaves),)), loaded.predict)
    bundle = Bundle((LoadedModel(limit_inputs(model.ir), model.predict),))
    nodes = sum(getattr(op, "n_nodes", 0) for op in model.ir.ops)
    with tempfile.TemporaryDirectory() as folder:
        generate(bundle, "iec", Path(folder), options=Options(layout=Layout.TREES, data_bytes=10**9))
        wall, processor = time.perf_counter(), time.process_time()
        (result,) = prove(bundle, folder).results
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{trees} trees, {nodes:,} nodes: {result.verdict.value}; {wall:.1f} s, of the processor {processor:.1f} s")
    print(f"{processor / trees:.1e} s a tree, {processor / nodes:.1e} s a node; {memory:.0f} MB with the generation")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:])) if len(sys.argv) > 1 else projects()
