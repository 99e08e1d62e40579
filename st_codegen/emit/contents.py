"""What is printed together: models, and what surrounds their blocks."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial

from st_codegen.emit.blocks.application import Application
from st_codegen.emit.blocks.classes import class_type
from st_codegen.emit.blocks.listing import Block
from st_codegen.emit.blocks.model import PLAIN, Extras, input_variables
from st_codegen.emit.blocks.self_test import SELF_TEST, self_test_block
from st_codegen.emit.blocks.window import Window, window_block
from st_codegen.errors import InputError, Problems
from st_codegen.ir import ModelIR
from st_codegen.processes import has_many_nodes, shared_out

#: Models that have nothing to do with each other: nothing surrounds their blocks.
LONE = Application("Models", connected=False)


@dataclass(frozen=True)
class Contents:
    """The models of a project, in the order in which their blocks are declared, and the application around them.

    `around` has the project's name and all that the purpose of the models adds: types, signals, blocks that call the
    models' blocks, programs and tasks. `uses` says in a word what a model predicts, for the models that have a use.
    `extras` has what models' blocks have beside the model, by the model's name; `windows` has the models, by name,
    whose features are the newest samples of a signal. `extended` adds to the whole application what needs to know all
    its blocks.
    """

    models: tuple[ModelIR, ...]
    around: Application = LONE
    uses: Mapping[str, str] = field(default_factory=dict)
    extras: Mapping[str, Extras] = field(default_factory=dict)
    windows: Mapping[str, Window] = field(default_factory=dict)
    extended: Callable[[Application], Application] = lambda application: application

    def application(self, block_of: Callable[[ModelIR, Extras], Block]) -> Application:
        """The whole application; `block_of` makes the block of a model. FB_SelfTest comes first where there is LREAL,
        of which it tests the arithmetic.

        Raises InputError for names that Structured Text cannot have, or that FB_SelfTest has; TargetError for tables
        that are too long.
        """
        given = [(model, self.extras.get(model.name, PLAIN)) for model in self.models]
        is_large = has_many_nodes(model.n_nodes for model in self.models)
        made = shared_out(partial(_made, block_of), given, is_large=is_large)
        problems = Problems()
        found = {}
        for (model, extras), block in zip(given, made, strict=True):
            with problems.collect():
                found[model.name] = block or block_of(model, extras)
                if found[model.name].name.lower() == SELF_TEST.lower():
                    raise InputError(
                        f"model '{model.name}': {SELF_TEST} is the name of the block that tests the "
                        "controller: rename the model"
                    )
        problems.raise_if_any()
        for model in self.models if self.around.connected else ():
            _check_callable(model, found[model.name])
        kept = (window_block(found[name], window) for name, window in self.windows.items())
        blocks = (*found.values(), *kept, *self.around.blocks)
        types = tuple(named for model in self.models if (named := class_type(model)) is not None)
        if not any(model.is_real for model in self.models):
            blocks = (self_test_block(), *blocks)
        return self.extended(dataclasses.replace(self.around, types=(*types, *self.around.types), blocks=blocks))


def _made(block_of: Callable[[ModelIR, Extras], Block], given: tuple[ModelIR, Extras]) -> Block | None:
    """The block of a model, or nothing where it cannot be made."""
    with suppress(InputError):
        return block_of(*given)
    return None


def _check_callable(model: ModelIR, block: Block) -> None:
    """Raise InputError where an input does not have the name by which other blocks call it."""
    for feature, wanted, found in zip(model.features, input_variables(model.features), block.inputs, strict=True):
        if wanted.name != found.name:
            raise InputError(
                f"feature '{feature.name}': {block.name} has a variable {wanted.name} of its own: rename the feature"
            )
