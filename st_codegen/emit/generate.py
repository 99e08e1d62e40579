"""The compiler: a bundle and a target -> a folder of reviewed-to-be text."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from st_codegen.emit import output
from st_codegen.emit.blocks.model import Limits, block_name
from st_codegen.emit.render import print_plans
from st_codegen.emit.targets import TARGETS, FilePlan, Target, target_named
from st_codegen.errors import TargetError
from st_codegen.ir import KernelSum, ModelIR, TransmissionError, TreeEnsemble
from st_codegen.passes.choose import CostFunction, Options, simple_cost
from st_codegen.passes.pipeline import Compiled, compile_project, unchanged
from st_codegen.proof.probes import trained_range
from st_codegen.proof.vectors import reference_vectors
from st_codegen.te.bundle import Bundle

#: Blocks that an error names
_NAMED = 5


@dataclass(frozen=True)
class Generated:
    """What one run wrote: the folder of the target, its files with their sizes in bytes, and why it looks as it does.

    `facts` is what the manifest says of models and blocks.
    """

    target: str
    folder: Path
    files: dict[str, int]
    compiled: Compiled
    facts: dict[str, Any]


def generate(
    bundle: Bundle,
    target: Target | str,
    out: Path | str,
    *,
    max_array: int | None = None,
    options: Options | None = None,
    with_tests: bool = False,
    cost: CostFunction = simple_cost,
) -> Generated:
    """Write the files of a bundle for one target (or its name) to `out/<target>`, on demand with test suites.

    Layouts are chosen by `cost`.

    Raises InputError or TargetError, with nothing written, for what the target cannot express. Files in the folder that
    were not generated stay; generated files of an earlier run that are no longer needed are removed.
    """
    target = target_named(target) if isinstance(target, str) else target
    out = Path(out)
    folder = out / target.name
    work = _prepared(bundle, target, max_array, options, with_tests, cost)
    with output.staged(out, print_plans(target, work.plans), work.facts) as stage:
        files = {
            path.relative_to(stage).as_posix(): path.stat().st_size
            for path in sorted(stage.rglob("*"))
            if path.is_file() and path.name != output.MANIFEST
        }
        output.install(stage, folder)
    return Generated(target.name, folder, files, work.compiled, work.facts)


def check(
    bundle: Bundle,
    target: Target,
    out: Path,
    *,
    max_array: int | None = None,
    options: Options | None = None,
    with_tests: bool = False,
    cost: CostFunction = simple_cost,
) -> Iterator[str]:
    """The unified diff, line by line, between the files on disk and what would be generated; empty when equal.

    Line ends do not count: version control may change them.
    """
    folder = out / target.name
    work = _prepared(bundle, target, max_array, options, with_tests, cost)
    with output.staged(out, print_plans(target, work.plans), work.facts) as stage:
        wanted = {path.relative_to(stage).as_posix() for path in stage.rglob("*") if path.is_file()}
        for name in sorted(wanted | {name for name in output.generated_names(folder) if (folder / name).exists()}):
            yield from difflib.unified_diff(
                _lines(folder / name),
                _lines(stage / name),
                f"{folder / name} (on disk)",
                f"{folder / name} (generated)",
            )


@dataclass(frozen=True)
class _Prepared:
    """A bundle compiled for a target, ready for printing."""

    compiled: Compiled
    plans: tuple[FilePlan, ...]
    facts: dict[str, Any]


def _prepared(
    bundle: Bundle,
    target: Target,
    max_array: int | None,
    options: Options | None,
    with_tests: bool,
    cost: CostFunction,
) -> _Prepared:
    if with_tests and not target.has_tests:
        able = ", ".join(name for name, other in TARGETS.items() if other.has_tests)
        raise TargetError(f"the target {target.name} has no test suites; --with-tests goes with {able}")
    limits = limits_for(target, max_array)
    options = options or Options()
    if target.compiles:
        options = dataclasses.replace(options, max_array=limits.max_array)
        compiled = compile_project(bundle.project, options, cost)
    else:
        compiled = unchanged(bundle.project)
    vectors = reference_vectors(bundle, compiled) if with_tests else ()
    plans = tuple(target.plan(compiled.project, limits, vectors))
    _check_size(target, plans, limits.data_bytes if options.data_bytes is None else options.data_bytes)
    return _Prepared(compiled, plans, facts(bundle, compiled, plans))


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines(keepends=True) if path.is_file() else []


def limits_for(target: Target, max_array: int | None) -> Limits:
    """The target's limits, with the user's own bound on the length of an array."""
    return target.limits if max_array is None else dataclasses.replace(target.limits, max_array=max_array)


def _check_size(target: Target, plans: Sequence[FilePlan], limit: int) -> None:
    """Raises TargetError that names the largest blocks where all tables together are larger than the limit."""
    blocks = {block.name: block.table_bytes for plan in plans for block in plan.blocks}
    total = sum(blocks.values())
    if total <= limit:
        return
    largest = sorted(blocks.items(), key=lambda item: -item[1])[:_NAMED]
    names = ", ".join(f"{name} {size:,}" for name, size in largest)
    others = len(blocks) - len(largest)
    raise TargetError(
        f"the tables take {total:,} bytes, the limit of the target {target.name} is {limit:,}; the largest: "
        f"{names}{f' and {others} smaller ones' if others else ''}. Train smaller models, or raise the limit with "
        "--max-bytes if your controller has the memory"
    )


def facts(bundle: Bundle, compiled: Compiled, plans: Sequence[FilePlan]) -> dict[str, Any]:
    """What a reviewer asks first, for the manifest: models with their sizes and ranges, and what they are for."""
    return {
        "models": {model.ir.name: _model_facts(model.ir, compiled) for model in bundle.models},
        "blocks": {block.name: {"data_bytes": block.table_bytes} for plan in plans for block in plan.blocks},
        "transmission_error": _te_facts(compiled.project.transmission_error),
    }


def _model_facts(model: ModelIR, compiled: Compiled) -> dict[str, Any]:
    place = compiled.places[model.name]
    layouts = {decision.model: decision.chosen for decision in compiled.decisions}
    trees = [op for op in model.ops if isinstance(op, TreeEnsemble)]
    kernels = [op for op in model.ops if isinstance(op, KernelSum)]
    lower, upper = trained_range(model)
    return {
        "block": block_name(place.model),
        "block_outputs": list(place.outputs),
        "shared": place.model != model.name,
        "layout": layouts.get(model.name, "model"),
        "library": f"{model.source.library} {model.source.version}",
        "class": model.source.model_class,
        "sha256": model.source.sha256,
        "exact": model.exact,
        "accepts_nan": model.accepts_nan,
        "features": [
            {"name": f.name, "unit": f.unit, "limited": f.lower is not None, "range": [float(low), float(high)]}
            for f, low, high in zip(model.features, lower, upper, strict=True)
        ],
        "outputs": list(model.outputs),
        "trees": sum(op.n_trees for op in trees),
        "nodes": sum(op.n_nodes for op in trees),
        "support_vectors": sum(len(op.support_vectors) for op in kernels),
    }


def _te_facts(te: TransmissionError | None) -> dict[str, Any]:
    if te is None:
        return {}
    terms = [f"order {o.order} {o.direction} {o.quantity}: {o.model}" for o in te.outputs if o.added]
    return {
        "name": te.name,
        "reduction_ratio": te.reduction_ratio,
        "orders": list(te.orders),
        "directions": [str(direction) for direction in te.directions],
        **({"calls": len(te.cycles)} if te.cycles else {}),
        **({"terms": terms} if terms else {}),
    }
