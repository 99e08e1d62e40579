"""Models as the user gave them -> the models that are printed: every rewrite is exact to the bit.

A lone model keeps its block. Models that are called together and whose tables fit together become one block, and one
search serves them all.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from st_codegen.ir import FactoredKernel, Feature, ModelIR, Rank, Source
from st_codegen.passes import tables
from st_codegen.passes.choose import (
    CostFunction,
    Layout,
    Options,
    PricedLayout,
    cheapest,
    priced,
    simple_cost,
)
from st_codegen.passes.kernels import factored
from st_codegen.passes.prune import pruned
from st_codegen.passes.ranks import ranked


@dataclass(frozen=True)
class Location:
    """Where a model of the user's is computed: the printed model, and which of its outputs are the model's own."""

    model: str
    outputs: tuple[int, ...]


@dataclass(frozen=True)
class LayoutDecision:
    """The layouts that were possible for a model, cheapest first, and the one that was taken."""

    model: str
    chosen: str
    candidates: tuple[PricedLayout, ...]


@dataclass(frozen=True)
class Compiled:
    """The printed models, in the order of their names, where each model of the user's went, and why."""

    models: tuple[ModelIR, ...]
    locations: Mapping[str, Location]
    decisions: tuple[LayoutDecision, ...]

    def block_model(self, name: str) -> ModelIR:
        """The printed model that computes the user's model `name`."""
        location = self.locations[name]
        return next(model for model in self.models if model.name == location.model)


def unchanged(models: Sequence[ModelIR]) -> Compiled:
    """The models as they are, for targets that hand the models themselves on."""
    return Compiled(tuple(models), _own_locations(models), ())


def _own_locations(models: Sequence[ModelIR]) -> dict[str, Location]:
    return {model.name: Location(model.name, tuple(range(len(model.outputs)))) for model in models}


def compile_models(
    models: Sequence[ModelIR],
    options: Options | None = None,
    cost: CostFunction = simple_cost,
    *,
    together: bool = False,
) -> Compiled:
    """Rewrite every model to its cheapest layout; of models called `together`, merge what one search can serve."""
    options = options or Options()
    decisions = {model.name: _decide(model, options, cost) for model in models}
    chosen = {name: decision.candidates[0].model for name, decision in decisions.items()}
    locations = _own_locations(models)
    printed = list(chosen.values())
    if together:
        cells = {
            model.name: found
            for model in models
            if decisions[model.name].chosen == "table" and (found := _cells(model, options)) is not None
        }
        printed, locations = _merged(models, chosen, cells, options, locations)
    return Compiled(tuple(printed), locations, tuple(decisions.values()))


def _cells(model: ModelIR, options: Options) -> tables.Cells | None:
    """The table of a model where it stays below the limits; equal slices may make a large grid small."""
    limit = options.table_bytes // 8 * len(model.outputs)
    found = tables.cells_of(model, 4 * limit)
    if found is None or found.values.size > limit:
        return None
    if any(len(axis.edges) > options.max_array for axis in found.axes):
        return None
    return found


def _fits(model: ModelIR, options: Options) -> bool:
    """Whether the target holds the coefficients of factored kernels."""
    return all(op.coefficients.size <= options.max_array for op in model.ops if isinstance(op, FactoredKernel))


def _on_ranks(model: ModelIR, options: Options) -> ModelIR | None:
    """The model with its trees on ranks and pruned, where it has such trees and the target holds their thresholds."""
    found = ranked(model)
    if found is None:
        return None
    found = pruned(found)
    longest = max(column.highest for op in found.ops if isinstance(op, Rank) for column in op.columns)
    return found if longest <= options.max_array else None


def _decide(model: ModelIR, options: Options, cost: CostFunction) -> LayoutDecision:
    candidates = [priced("as trained", model, cost)]
    on_grid = factored(model)
    if on_grid is not None and _fits(on_grid, options):
        candidates.append(priced("factored kernel", on_grid, cost))
    on_ranks = _on_ranks(model, options) if options.ranks else None
    if on_ranks is not None:
        candidates.append(priced("ranked trees", on_ranks, cost))
    if options.layout is not Layout.TREES:
        found = _cells(model, options)
        if found is not None:
            table = priced("table", tables.as_model(model, found), cost)
            candidates = [table] if options.layout is Layout.TABLE else [*candidates, table]
    best = cheapest(candidates)
    others = sorted((c for c in candidates if c is not best), key=lambda c: c.cost.nanoseconds)
    return LayoutDecision(model.name, best.layout, (best, *others))


def _merged(
    models: Sequence[ModelIR],
    chosen: dict[str, ModelIR],
    cells: dict[str, tables.Cells],
    options: Options,
    locations: dict[str, Location],
) -> tuple[list[ModelIR], dict[str, Location]]:
    """The printed models, and where each of the user's went: tables that refuse the same inputs share one block."""
    alike: dict[tuple[object, ...], list[ModelIR]] = {}
    for model in models:
        if model.name in cells:
            alike.setdefault(_refuses(model), []).append(model)
    together = [members for members in alike.values() if len(members) > 1]
    locations, printed = dict(locations), dict(chosen)
    for number, members in enumerate(together, 1):
        name = _free_name("tables" if len(together) == 1 else f"tables{number}", models)
        groups = _groups(members, cells, options)
        outputs: list[str] = []
        for model in (member for group in groups for member in group):
            at = len(outputs)
            outputs += [model.name if len(model.outputs) == 1 else f"{model.name} {output}" for output in model.outputs]
            locations[model.name] = Location(name, tuple(range(at, len(outputs))))
            del printed[model.name]
        first = members[0]
        printed[name] = ModelIR(
            name=name,
            features=first.features,
            ops=tables.table_operations([tables.united([cells[model.name] for model in group]) for group in groups]),
            outputs=tuple(outputs),
            source=_joint_source([model for group in groups for model in group]),
            accepts_nan=first.accepts_nan,
            magnitude_limits=_limits(first),
        )
    return [printed[name] for name in sorted(printed)], locations


def _groups(models: Sequence[ModelIR], cells: dict[str, tables.Cells], options: Options) -> list[list[ModelIR]]:
    """Models whose numbers stand side by side in one table, since their axes are (nearly) the same.

    A table of its own costs a model a cache line or two; a joint table may be a fifth larger than its parts.
    """
    groups: list[list[ModelIR]] = []
    for model in sorted(models, key=lambda model: (-cells[model.name].n_bytes, model.name)):
        best: tuple[float, list[ModelIR]] | None = None
        for group in groups:
            parts = [cells[member.name] for member in (*group, model)]
            size = 8 * sum(part.values.shape[-1] for part in parts) * math.prod(tables.union_shape(parts))
            growth = size / (tables.united(parts[:-1]).n_bytes + parts[-1].n_bytes)
            if growth <= 1.2 and size <= options.merged_bytes and (best is None or growth < best[0]):
                best = growth, group
        if best is None:
            groups.append([model])
        else:
            best[1].append(model)
    return [sorted(group, key=lambda model: model.name) for group in groups]


def _refuses(model: ModelIR) -> tuple[object, ...]:
    """What decides which inputs a model refuses."""
    return model.features, model.accepts_nan, _limits(model)


def _limits(model: ModelIR) -> tuple[float | None, ...]:
    """The magnitudes that a model refuses, without those that its declared ranges keep away from."""
    return tuple(
        None if limit is None or _below(feature, limit) else limit
        for feature, limit in zip(model.features, model.magnitude_limits, strict=True)
    )


def _below(feature: Feature, limit: float) -> bool:
    return feature.lower is not None and feature.upper is not None and max(-feature.lower, feature.upper) < limit


def _joint_source(models: Sequence[ModelIR]) -> Source:
    """Provenance of a merged block: one note an output."""
    libraries = sorted({f"{model.source.library} {model.source.version}".strip() for model in models})
    notes = []
    for model in models:
        parts = [model.name, model.source.model_class, model.source.file]
        parts += [f"digest {model.source.digest}"] if model.source.digest else []
        notes.append(", ".join(part for part in parts if part))
        notes += model.source.notes
    return Source(", ".join(libraries), "", f"tables of {len(models)} models", notes=tuple(dict.fromkeys(notes)))


def _free_name(name: str, models: Sequence[ModelIR]) -> str:
    taken = {model.name.lower() for model in models}
    while name.lower() in taken:
        name += "_"
    return name
