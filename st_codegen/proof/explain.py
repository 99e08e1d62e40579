"""Prices of layouts from the text that they would be: what `passes.choose` asks for, answered by the cost model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from st_codegen.cost.profile import Profile
from st_codegen.cost.report import BlockCost, project_cost
from st_codegen.emit.blocks.model import Limits, block_name
from st_codegen.emit.contents import Contents
from st_codegen.emit.render import render
from st_codegen.emit.targets import Target
from st_codegen.errors import InputError
from st_codegen.ir import ModelIR
from st_codegen.passes.choose import CallCost
from st_codegen.passes.pipeline import Compiled
from st_codegen.st import parse_project
from st_codegen.st.syntax.source import SUFFIXES


@dataclass(frozen=True)
class EmittedCost(CallCost):
    """The worst case of a model's block on one controller, in us, and an estimate of its machine code."""

    warm_us: float = 0.0
    cold_us: float = 0.0
    code_bytes: int = 0

    @property
    def nanoseconds(self) -> float:
        return 1000.0 * self.cold_us


@dataclass(frozen=True)
class Pricing:
    """Prices models for a target on a controller: each is printed, read again and counted. A `CostFunction`.

    A layout that cannot be printed has an infinite price.
    """

    target: Target
    limits: Limits
    profile: Profile

    def __call__(self, model: ModelIR) -> EmittedCost:
        try:
            cost = self.block(model)
        except InputError:  # above all an array that the target does not hold: another layout may do
            return EmittedCost(math.inf, math.inf, 0, math.inf, math.inf)
        return EmittedCost(
            instructions=sum(cost.operations.values()),
            lines=sum(part.lines for part in cost.parts),
            table_bytes=sum(part.table_bytes for part in cost.parts),
            warm_us=cost.warm_us,
            cold_us=cost.cold_us,
            code_bytes=sum(part.code_bytes for part in cost.parts),
        )

    def block(self, model: ModelIR) -> BlockCost:
        """The worst case of the block of one model."""
        files = render(Contents((model,)), self.target, self.limits)
        texts = {file.path: "".join(file.pieces) for file in files if file.path.lower().endswith(SUFFIXES)}
        project = parse_project(texts, self.target.dialect)
        name = block_name(model.name)
        return project_cost(project, self.profile, [name]).blocks[name]


@dataclass(frozen=True)
class InputLimit:
    """From which magnitude on a model's block refuses an input; infinity where it refuses infinities only."""

    model: str
    feature: str
    magnitude: float


def input_limits(models: Sequence[ModelIR]) -> list[InputLimit]:
    """The inputs that are refused beyond a magnitude, but for those that are limited to a range below it."""
    return [
        InputLimit(model.name, feature.name, limit)
        for model in models
        for feature, limit in zip(model.features, model.refused_from, strict=True)
        if limit is not None
    ]


@dataclass(frozen=True)
class Price:
    """One layout that a model could have."""

    model: str
    layout: str
    is_chosen: bool
    cost: EmittedCost


def prices(compiled: Compiled, pricing: Pricing) -> list[Price]:
    """Every layout of every model: what was chosen and what else could have been printed."""
    found = []
    for decision in compiled.decisions:
        for number, candidate in enumerate(decision.candidates):
            known = candidate.cost
            cost = known if isinstance(known, EmittedCost) else pricing(candidate.model)
            if math.isfinite(cost.cold_us):
                found.append(Price(decision.model, candidate.layout, number == 0, cost))
    return found
