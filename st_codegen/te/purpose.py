"""The compensation of transmission error as the purpose of a bundle: what it adds to each stage of the compiler."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from st_codegen.emit.blocks.application import Application
from st_codegen.emit.blocks.comparison import CalledBlock
from st_codegen.emit.blocks.tests import ReferenceVectors
from st_codegen.errors import InputError
from st_codegen.ir import ModelIR
from st_codegen.passes.choose import Options, simple_cost
from st_codegen.passes.pipeline import Compiled, Location
from st_codegen.project.bundle import Bundle
from st_codegen.project.purpose import BlockCheck, DifferenceBound, RunsBlocks
from st_codegen.te.check import check_transmission_error, checked_blocks, prediction_vectors
from st_codegen.te.compensation import compensation
from st_codegen.te.compensation.recorder import with_recorder
from st_codegen.te.harmonics import HarmonicOutput, TransmissionError
from st_codegen.walkers.base import LoadedModel


@dataclass(frozen=True)
class Compensation:
    """FB_TEPredict and FB_Compensator around the models of a bundle (see `project.purpose.Purpose`)."""

    te: TransmissionError

    def settled(self, compiled: Compiled, options: Options) -> Compensation:
        """The harmonics read from the printed models, shared out among several calls where the options ask for it."""
        te = _moved(self.te, compiled.locations)
        if options.outputs_per_cycle is not None:
            te = dataclasses.replace(te, cycles=_cycles(te, compiled.models, options.outputs_per_cycle))
        return Compensation(te)

    def application(self, *, recorded: bool = False) -> Application:
        """Blocks, programs, types, signals and tasks. Raises InputError for names that clash."""
        application = compensation(self.te)
        return with_recorder(application) if recorded else application

    def uses(self) -> dict[str, str]:
        """The quantities that each model predicts, such as `amplitude` or `cosine_sine`."""
        quantities: dict[str, set[str]] = {}
        for output in self.te.outputs:
            quantities.setdefault(output.model, set()).add(output.quantity.value)
        return {model: "_".join(sorted(found)) for model, found in quantities.items()}

    def facts(self) -> dict[str, Any]:
        """Name, ratio, orders, directions, added terms, corrections of an axis, calls that models are spread over."""
        te = self.te
        terms = [f"order {o.order} {o.direction} {o.quantity}: {o.model}" for o in te.outputs if o.added]
        return {
            "name": te.name,
            "reduction_ratio": te.reduction_ratio,
            "orders": list(te.orders),
            "directions": [str(direction) for direction in te.directions],
            **({"calls": len(te.cycles)} if te.cycles else {}),
            **({"terms": terms} if terms else {}),
            **(
                {"corrections": [f"order {c.order} {c.direction}: {c}" for c in te.corrections]}
                if te.corrections
                else {}
            ),
            **({"play_deg": te.play.angle_deg} if te.play else {}),
        }

    def remarks(self) -> tuple[str, ...]:
        """How old the outputs are where the models are spread over several calls."""
        calls = len(self.te.cycles)
        if not calls:
            return ()
        return (
            f"The models are spread over {calls} calls of FB_TEPredict: its outputs belong to the operating point of "
            f"{calls - 1} to {2 * calls - 2} calls before.",
        )

    def served(self, models: Sequence[ModelIR]) -> tuple[str, ...]:
        """For each direction the files and outputs of all its orders, as they are read."""
        named = {model.name: model for model in models}

        def text(output: HarmonicOutput) -> str:
            model = named[output.model]
            place = f" output {output.output}" if len(model.outputs) > 1 else ""
            return f"{'+ ' if output.added else ''}{output.quantity} {model.source.file or model.name}{place}"

        lines = []
        for direction in self.te.directions:
            orders = []
            for order in self.te.orders:
                own = [o for o in self.te.outputs if (o.direction, o.order) == (direction, order)]
                orders.append(f"order {order} {', '.join(map(text, own))}")
            lines.append(f"{direction}: {'; '.join(orders)}")
        return tuple(lines)

    def vectors(self, models: Sequence[LoadedModel]) -> tuple[ReferenceVectors, ...]:
        """A test suite for FB_TEPredict."""
        return (prediction_vectors(self.te, models),)

    def called_blocks(self) -> tuple[CalledBlock, ...]:
        """FB_TEPredict and FB_Compensator."""
        return checked_blocks(self.te)

    def checks(
        self,
        models: Sequence[ModelIR],
        code: RunsBlocks,
        seed: int,
        bound: DifferenceBound,
        names: Collection[str] = (),
    ) -> Sequence[BlockCheck]:
        """FB_TEPredict and FB_Compensator against the models that they are made of."""
        return check_transmission_error(models, self.te, code, seed, bound, names)


def transmission_error(bundle: Bundle) -> TransmissionError:
    """What the models of a bundle are for. Raises InputError for models with another purpose, or none."""
    if not isinstance(bundle.purpose, Compensation):
        raise InputError(
            "the models have no bundle.toml, so they do not say which harmonics they predict: there is nothing to "
            "simulate"
        )
    return bundle.purpose.te


def _moved(te: TransmissionError, locations: Mapping[str, Location]) -> TransmissionError:
    """The harmonics read from where their models went."""
    outputs = tuple(
        dataclasses.replace(o, model=locations[o.model].model, output=locations[o.model].outputs[o.output])
        for o in te.outputs
    )
    return dataclasses.replace(te, outputs=outputs)


def _cycles(te: TransmissionError, models: Sequence[ModelIR], mean: int) -> tuple[tuple[str, ...], ...]:
    """The models shared out among successive calls, of so many outputs in the mean; empty where one call does.

    The costliest call is the one that a cycle must bear: models go, the costliest first, into the call that costs least
    so far. Costs count as the next power of the root of 2, so that a model that was trained again rarely moves.
    """
    used = {output.model for output in te.outputs}
    steps = {m.name: round(2 * math.log2(simple_cost(m).nanoseconds)) for m in models if m.name in used}
    outputs = sum(len(model.outputs) for model in models if model.name in used)
    number = min(-(-outputs // mean), len(steps))
    names: list[list[str]] = [[] for _ in range(number)]
    spent = [0.0] * number
    for name in sorted(steps, key=lambda name: (-steps[name], name)):
        cheapest = spent.index(min(spent))
        names[cheapest].append(name)
        spent[cheapest] += 2.0 ** (steps[name] / 2)
    # the last call has the most to do beside its models: it makes harmonics of the answers
    order = sorted(range(number), key=lambda cycle: -spent[cycle])
    return tuple(tuple(sorted(names[cycle])) for cycle in order) if number > 1 else ()
