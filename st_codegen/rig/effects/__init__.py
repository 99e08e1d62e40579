"""The catalogue of effects: all classes of this package, of entry points, and of files that the user names."""

from __future__ import annotations

import functools
import importlib
import importlib.metadata
import importlib.util
import inspect
import pkgutil
from collections.abc import Callable, Iterable, Mapping
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any

import numpy as np

from st_codegen.campaign.conditions import Conditions
from st_codegen.errors import InputError, StCodegenError
from st_codegen.rig.effects.base import Constants, Effect, Form, Phasor, Scalar, Stage

__all__ = ["Catalogue", "Conditions", "Constants", "Effect", "Form", "Phasor", "Scalar", "Stage", "catalogue"]

ENTRY_POINTS = "st_codegen.effects"

#: name -> class, in the order of the files
Catalogue = Mapping[str, type[Effect]]


def catalogue(files: Iterable[Path] = ()) -> Catalogue:
    """All effects: built in, from entry points, and from Python files of the user's.

    Raises InputError for a file that cannot be loaded, holds no effect or half of one, or takes a name twice.
    """
    found: dict[str, type[Effect]] = {}
    for module in sorted(pkgutil.iter_modules(__path__), key=lambda info: info.name):
        _add(found, effects_of(importlib.import_module(f"{__name__}.{module.name}")), module.name)
    for entry in sorted(importlib.metadata.entry_points(group=ENTRY_POINTS), key=lambda entry: entry.name):
        loaded: Any = entry.load()
        classes = effects_of(loaded) if inspect.ismodule(loaded) else [loaded]
        _add(found, [_own(one, f"entry point {entry.name}") for one in classes], f"entry point {entry.name}")
    for path in files:
        classes = effects_of(_module(path))
        if not classes:
            raise InputError(f"{path}: no effect in it; an effect is a subclass of st_codegen.rig.effects.Effect")
        _add(found, [_own(one, str(path)) for one in classes], str(path))
    return MappingProxyType(found)


def effects_of(module: ModuleType) -> list[type[Effect]]:
    """The effects that a module defines, in its order: subclasses with a name of their own."""
    return [
        value
        for value in vars(module).values()
        if inspect.isclass(value)
        and issubclass(value, Effect)
        and "name" in vars(value)
        and value.__module__ == module.__name__
    ]


def _add(found: dict[str, type[Effect]], classes: Iterable[type[Effect]], source: str) -> None:
    for effect in classes:
        if effect.name in found:
            raise InputError(f"{source}: the effect '{effect.name}' exists already; give it another name")
        found[effect.name] = effect


def _own(effect: type[Effect], source: str) -> type[Effect]:
    """An effect that others wrote, whose methods say so where they fail. Raises InputError where it lacks some."""
    if not isinstance(effect.name, str) or not effect.name:
        raise InputError(f"{source}: {effect.__name__} has the name {effect.name!r}; a name is a text")
    ways = ("coefficient", "contribution", "passed_on", "transfer", "constant")
    # what acts between reference and input adds to no order, and what measures may pass all of them on
    if effect.stage is not Stage.AXIS and all(getattr(effect, way) is getattr(Effect, way) for way in ways):
        raise InputError(f"{source}: the effect '{effect.name}' has no method `coefficient`, so it would add nothing")
    adds = effect.stage in (Stage.ADDITIVE, Stage.STRUCTURE)
    if adds and effect.orders_key is None and effect.touched_orders is Effect.touched_orders:
        raise InputError(
            f"{source}: the effect '{effect.name}' has neither a method `touched_orders` nor an `orders_key`, so it "
            "would add to no order"
        )
    for method, problem_of in (("touched_orders", _orders_problem), ("contribution", _shape_problem)):
        given = getattr(effect, method)
        if not hasattr(given, "__wrapped__"):
            setattr(effect, method, _said_whose(given, f"{source}: the effect '{effect.name}'", problem_of))
    return effect


def _said_whose(method: Callable[..., Any], whose: str, problem_of: Callable[..., str]) -> Callable[..., Any]:
    @functools.wraps(method)
    def called(self: Effect, *given: Any) -> Any:
        try:
            found = method(self, *given)
            problem = problem_of(found, *given)
        except StCodegenError:
            raise
        except Exception as error:  # it is the user's code
            raise InputError(f"{whose} fails in `{method.__name__}` ({type(error).__name__}: {error})") from error
        if problem:
            raise InputError(f"{whose}: `{method.__name__}` gives {problem}")
        return found

    return called


def _orders_problem(found: Any) -> str:
    if all(isinstance(order, int | np.integer) and order >= 0 for order in found):
        return ""
    return f"{found!r}, where whole numbers of 0 and more are wanted"


def _shape_problem(found: Any, at: Conditions, orders: Any) -> str:
    wanted = (len(at), len(orders))
    return "" if np.shape(found) == wanted else f"an array of {np.shape(found)}, where one of {wanted} is wanted"


class _SourceOnly(SourceFileLoader):
    """Leaves no compiled file beside a user's own."""

    def set_data(self, path: str, data: Any, *, _mode: int = 0o666) -> None:
        """Write nothing."""


def _module(path: Path) -> ModuleType:
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    name = f"effects_of_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path, loader=_SourceOnly(name, str(path)))
    if spec is None or spec.loader is None or path.suffix != ".py":
        raise InputError(f"{path}: not a Python file")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # the file may do anything, leave the program included
        raise InputError(f"{path}: cannot be loaded ({type(error).__name__}: {error})") from error
    return module
