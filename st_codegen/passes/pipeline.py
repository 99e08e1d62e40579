"""Models as the user gave them -> the models that are printed: exact to the bit, but for kernels.

A lone model keeps its block. Models that are called together and whose tables fit together become one block, and one
search serves them all.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from st_codegen.errors import at_most, counted
from st_codegen.ir import FactoredKernel, ModelIR, Rank, Source
from st_codegen.passes import tables
from st_codegen.passes.branches import as_branches
from st_codegen.passes.choose import (
    MAY_GROW,
    Choices,
    CostFunction,
    Layout,
    Options,
    PricedLayout,
    cheapest,
    preferred,
    priced,
    simple_cost,
)
from st_codegen.passes.kernels import factored
from st_codegen.passes.prune import pruned
from st_codegen.passes.ranks import ranked
from st_codegen.passes.slabs import cut_into_cells
from st_codegen.processes import has_many_nodes, shared_out

#: Layouts of forests, of which the second is the first cut into cells.
RANKS, CELLS = "ranked trees", "cut trees"
BRANCHES = "nested IFs"
#: No table of several models is larger.
_MERGED_BYTES = 1024 * 1024


@dataclass(frozen=True)
class Location:
    """Where a model of the user's is computed: the printed model, and which of its outputs are the model's own."""

    model: str
    outputs: tuple[int, ...]


@dataclass(frozen=True)
class LayoutDecision:
    """The layout that was taken for a model, in front of the others that were possible, cheapest first.

    `earlier` is what an earlier run had chosen.
    """

    model: str
    chosen: str
    candidates: tuple[PricedLayout, ...]
    earlier: str | None = None

    @property
    def change(self) -> str:
        """A sentence on why the model does not keep its earlier layout; empty where it does, or had none."""
        if self.earlier in (None, self.chosen):
            return ""
        before = next((c.cost.nanoseconds for c in self.candidates if c.layout == self.earlier), None)
        why = "which these options and limits do not allow"
        if before is not None and math.isfinite(before):
            share = self.candidates[0].cost.nanoseconds / before
            why = f"whose time in the worst case falls to {at_most(100.0 * share, 3)} % by the prices of that choice"
            if share > 1:
                why = "with which all tables together would be larger than the limit"
        return f"{self.model}: new layout '{self.chosen}' for '{self.earlier}', {why}"


@dataclass(frozen=True)
class Compiled:
    """The printed models, in the order of their names, where each model of the user's went, and why.

    `shared`: for each printed model of tables, the models of the user's that stand side by side in each of them.
    """

    models: tuple[ModelIR, ...]
    locations: Mapping[str, Location]
    decisions: tuple[LayoutDecision, ...]
    shared: Mapping[str, Sequence[Sequence[str]]] = field(default_factory=dict)

    @property
    def choices(self) -> Choices:
        """What a later run may keep."""
        return Choices({decision.model: decision.chosen for decision in self.decisions}, self.shared)

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
    earlier: Choices | None = None,
) -> Compiled:
    """Rewrite every model to its cheapest layout; of models called `together`, merge what one search can serve.

    What was chosen `earlier` is kept unless another choice saves much or it is no longer possible.
    """
    options, earlier = options or Options(), earlier or Choices()
    decide = partial(_decide, options=options, cost=cost, earlier=earlier.layouts, together=together)
    found = shared_out(decide, models, is_large=has_many_nodes(model.n_nodes for model in models))
    decisions = {decision.model: decision for decision, _ in found}
    grids = {decision.model: cells for decision, cells in found}
    if options.data_bytes is not None:
        _keep_within(decisions, options.data_bytes)
    chosen = {name: decision.candidates[0].model for name, decision in decisions.items()}
    locations = _own_locations(models)
    printed = list(chosen.values())
    shared: dict[str, list[list[str]]] = {}
    if together:
        cells = {name: found for name, found in grids.items() if found and decisions[name].chosen == "table"}
        together_of = _shared(models, cells, earlier)
        printed, locations = _merged(together_of, chosen, cells, locations)
        shared = {name: [[model.name for model in group] for group in groups] for name, groups in together_of.items()}
    return Compiled(tuple(printed), locations, tuple(decisions.values()), shared)


def _cells(model: ModelIR, options: Options, earlier: str | None) -> tables.Cells | None:
    """The table of a model where it stays below the limits; equal slices may make a large grid small."""
    limit = int(options.table_bytes // 8 * len(model.outputs) * (MAY_GROW if earlier == "table" else 1))
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


def _decide(
    model: ModelIR, options: Options, cost: CostFunction, earlier: Mapping[str, str], *, together: bool
) -> tuple[LayoutDecision, tables.Cells | None]:
    """The layout of a model, and its table where it may have one, which takes longest to compute.

    `earlier` has the layouts of an earlier run, by the names of models.
    """
    before = earlier.get(model.name)
    candidates = [priced("as trained", model, cost)]
    on_grid = None if model.is_real else factored(model)
    if on_grid is not None and _fits(on_grid, options):
        candidates.append(priced("factored kernel", on_grid, cost))
    layout = Layout.TREES if model.is_real else options.layouts.get(model.name, options.layout)
    on_ranks = None if layout is Layout.TREES else _on_ranks(model, options)
    if on_ranks is not None:
        ranked_trees = priced(RANKS, on_ranks, cost)
        candidates = [ranked_trees] if layout in (Layout.RANKED, Layout.CUT) else [*candidates, ranked_trees]
    found = _cells(model, options, before) if layout in (Layout.AUTO, Layout.TABLE) else None
    if found is not None:
        table = priced("table", tables.as_model(model, found), cost)
        candidates = [table] if layout is Layout.TABLE else [*candidates, table]
    elif on_ranks is not None and layout in (Layout.AUTO, Layout.CUT):  # no grid is as fast as a table
        cut = cut_into_cells(on_ranks, options.max_array)
        if cut is not None:
            cut_trees = priced(CELLS, cut, cost)
            candidates = [cut_trees] if layout is Layout.CUT else [*candidates, cut_trees]
    in_place = before
    nested = None if together and found is not None else _nested(on_ranks, layout, cost, before)
    if nested is not None:
        in_place = before or cheapest(candidates).layout  # a text that grows with its tree must save much, too
        candidates = [nested] if layout is Layout.IFS else [*candidates, nested]
    # one that cannot be printed is none where another one can
    candidates = [c for c in candidates if math.isfinite(c.cost.nanoseconds)] or candidates
    best = preferred(candidates, in_place)
    others = sorted((c for c in candidates if c is not best), key=lambda c: c.cost.nanoseconds)
    return LayoutDecision(model.name, best.layout, (best, *others), before), found


def _nested(on_ranks: ModelIR | None, layout: Layout, cost: CostFunction, earlier: str | None) -> PricedLayout | None:
    """A tree as nested IFs, where they are asked for, were there before, or nothing was there before."""
    wanted = layout is Layout.IFS or (layout is Layout.AUTO and earlier in (None, BRANCHES))
    branched = as_branches(on_ranks, MAY_GROW if earlier == BRANCHES else 1.0) if on_ranks and wanted else None
    return None if branched is None else priced(BRANCHES, branched, cost)


def _keep_within(decisions: dict[str, LayoutDecision], limit: int) -> None:
    """Take the cells from the forests that grow most by them, until all tables are within a limit."""
    total = sum(decision.candidates[0].cost.table_bytes for decision in decisions.values())
    growth = {
        name: decision.candidates[0].cost.table_bytes - whole.cost.table_bytes
        for name, decision in decisions.items()
        for whole in decision.candidates[1:]
        if (decision.chosen, whole.layout) == (CELLS, RANKS)
    }
    for name in sorted(growth, key=lambda name: (-growth[name], name)):
        if total <= limit:
            return
        first, *others = decisions[name].candidates
        (whole,) = (candidate for candidate in others if candidate.layout == RANKS)
        rest = (whole, first, *(candidate for candidate in others if candidate is not whole))
        decisions[name] = replace(decisions[name], chosen=RANKS, candidates=rest)
        total -= growth[name]


def _shared(
    models: Sequence[ModelIR], cells: dict[str, tables.Cells], earlier: Choices
) -> dict[str, list[list[ModelIR]]]:
    """The blocks of shared tables by their names, each as groups of models whose numbers stand side by side.

    Tables that refuse the same inputs share one block; a block keeps the name of the earlier one that has most of it.
    """
    alike: dict[tuple[object, ...], list[ModelIR]] = {}
    for model in models:
        if model.name in cells:
            alike.setdefault(_refuses(model), []).append(model)
    together = [members for members in alike.values() if len(members) > 1]
    names = _new_names(len(together), models)
    found = {}
    for members in together:
        here = {model.name for model in members}
        common = {
            name: sum(len(here & set(group)) for group in groups)
            for name, groups in earlier.shared.items()
            if name not in found and name not in {model.name for model in models}
        }
        kept = max((name for name in common if common[name]), key=common.__getitem__, default="")
        name = kept or next(name for name in names if name not in found and name not in earlier.shared)
        found[name] = _groups(members, cells, earlier.shared.get(name, ()))
    return found


def _merged(
    shared: Mapping[str, list[list[ModelIR]]],
    chosen: dict[str, ModelIR],
    cells: dict[str, tables.Cells],
    locations: dict[str, Location],
) -> tuple[list[ModelIR], dict[str, Location]]:
    """The printed models, and where each of the user's went."""
    locations, printed = dict(locations), dict(chosen)
    for name, groups in shared.items():
        members = [member for group in groups for member in group]
        outputs: list[str] = []
        for model in members:
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
            source=_joint_source(members),
            accepts_nan=first.accepts_nan,
            must_be_present=first.must_be_present,
            magnitude_limits=first.refused_from,
            accepted=first.accepted,
            open_zeros=not all(member.signs_zeros for member in members),
        )
    return [printed[name] for name in sorted(printed)], locations


def _groups(
    models: Sequence[ModelIR], cells: dict[str, tables.Cells], earlier: Sequence[Sequence[str]]
) -> list[list[ModelIR]]:
    """Models whose numbers stand side by side in one table, since their axes are (nearly) the same.

    A table of its own costs a model a cache line or two; a joint table may be a fifth larger than its parts. Groups of
    an `earlier` run stay, in their order, while they are a quarter larger still.
    """
    by_name = {model.name: model for model in models}

    def fits(parts: Sequence[ModelIR], more: float = 1.0) -> float | None:
        """How much larger than its parts a joint table is, or None where it is too large."""
        tabled = [cells[model.name] for model in parts]
        size = 8 * sum(part.values.shape[-1] for part in tabled) * math.prod(tables.union_shape(tabled))
        growth = size / (tables.united(tabled[:-1]).n_bytes + tabled[-1].n_bytes)
        return growth if growth <= 1.2 * more and size <= _MERGED_BYTES * more else None

    groups: list[list[ModelIR]] = []
    for names in earlier:
        group: list[ModelIR] = []
        for name in names:
            if name in by_name and (not group or fits([*group, by_name[name]], MAY_GROW) is not None):
                group.append(by_name.pop(name))
        groups += [group] if group else []
    kept = [list(group) for group in groups]
    for model in sorted(by_name.values(), key=lambda model: (-cells[model.name].n_bytes, model.name)):
        growth = [(found, group) for group in groups if (found := fits([*group, model])) is not None]
        if growth:
            min(growth, key=lambda entry: entry[0])[1].append(model)
        else:
            groups.append([model])
    return [_in_order(group, kept) for group in groups]


def _in_order(group: list[ModelIR], kept: list[list[ModelIR]]) -> list[ModelIR]:
    """A group by the names of its models; those that an earlier run had come first, in their old order."""
    old = next((before for before in kept if before[0] is group[0]), [])
    return [*old, *sorted(group[len(old) :], key=lambda model: model.name)]


def _refuses(model: ModelIR) -> tuple[object, ...]:
    """What decides which inputs a model refuses."""
    return model.features, model.accepts_nan, model.must_be_present, model.refused_from, model.accepted


def _joint_source(models: Sequence[ModelIR]) -> Source:
    """Provenance of a merged block: one note an output."""
    libraries = sorted({f"{model.source.library} {model.source.version}".strip() for model in models})
    notes = []
    for model in models:
        parts = [model.name, model.source.model_class, model.source.file]
        parts += [f"digest {model.source.digest}"] if model.source.digest else []
        notes.append(", ".join(part for part in parts if part))
        notes += model.source.notes
    return Source(
        ", ".join(libraries), "", f"tables of {counted(len(models), 'model')}", notes=tuple(dict.fromkeys(notes))
    )


def _new_names(count: int, models: Sequence[ModelIR]) -> Iterator[str]:
    """Names for blocks of shared tables: `tables`, or, where there are several, `tables1`, `tables2`, .."""
    taken = {model.name.lower() for model in models}
    for number in itertools.count(1):
        name = "tables" if count == 1 and number == 1 else f"tables{number}"
        while name in taken:
            name += "_"
        yield name
