"""Runs a checked project for a single lane, as fast as plain Python can: for simulations of many cycles."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any
from weakref import WeakKeyDictionary

from st_codegen.st import tree as t
from st_codegen.st.check.arithmetic import Fault
from st_codegen.st.errors import StUsageError
from st_codegen.st.run.emit import Compiled
from st_codegen.st.run.machine import LOOP_LIMIT, Machine, checked_numbers
from st_codegen.st.run.natives import Library
from st_codegen.st.run.paths import Step
from st_codegen.st.run.runtime import Slot
from st_codegen.st.run.scalar_code import ScalarCode, compile_scalar
from st_codegen.st.run.scalar_memory import ScalarRuntime, ScalarUnion, SlotReference
from st_codegen.st.types import ArrayType, Elementary, EnumType, StructType, Type, storage_type

_COMPILED: WeakKeyDictionary[t.Project, Compiled] = WeakKeyDictionary()

#: Instead of a block's body: called with the compiled body, the runtime, and the memory of the instance.
Replacement = Callable[[Callable[..., Any], Any, Any], Any]


def replace_bodies(code: Compiled, replaced: Mapping[str, Replacement]) -> Compiled:
    """The same code with other bodies of some blocks. Raises `StUsageError` for a block that is not there."""
    functions = dict(code.functions)
    for block, replacement in replaced.items():
        if block.upper() not in functions:
            raise StUsageError(f"the project has no block '{block}'")
        original = functions[block.upper()]

        def body(rt: Any, memory: Any, original: Any = original, replacement: Replacement = replacement) -> Any:
            return replacement(original, rt, memory)

        functions[block.upper()] = body
        # units call each other by these names
        code.source.namespace[ScalarCode.function_name(block.upper())] = body
    return Compiled(functions, code.source, code.constants)


class ScalarMachine(Machine):
    """A project in one copy; variables are read as plain Python values, arrays as (nested) NumPy arrays.

    `loop_limit` is the number of rounds after which a single run of a loop is an error. `libraries` are those the
    project was checked with. `replaced` gives the bodies of some blocks another function: it is given the compiled
    body, which it may call, the machine's runtime and the instance's memory (`v_NAME` for each variable). Raises
    `StCheckError` for pointers outside of native calls.
    """

    def __init__(
        self,
        project: t.Project,
        *,
        loop_limit: int = LOOP_LIMIT,
        libraries: Iterable[Library] = (),
        replaced: Mapping[str, Replacement] | None = None,
    ) -> None:
        if replaced:
            code = replace_bodies(compile_scalar(project), replaced)
        else:
            code = _COMPILED.get(project) or _COMPILED.setdefault(project, compile_scalar(project))
        super().__init__(project, ScalarRuntime(project, code.functions, libraries, 1, loop_limit), code.source)

    def run(self, code: Callable[..., Any], receiver: Any, *atoms: Any) -> Any:
        """Run a unit. Raises `StRuntimeError` for what would stop a controller."""
        try:
            return code(self.rt, receiver, *atoms)
        except Fault as fault:
            raise self.source.explain(fault, fault.__traceback__) from None

    def show(self, value: Any, type_: Type) -> Any:
        """A variable for the user: single values as they are, arrays as NumPy arrays, dictionaries for structures."""
        if isinstance(type_, Elementary | EnumType):
            return value
        if isinstance(type_, ArrayType):
            if isinstance(type_.element, Elementary | EnumType):
                return checked_numbers(list(value), storage_type(type_.element)).reshape(type_.shape)
            return [self.show(item, type_.element) for item in value]
        if isinstance(type_, StructType):
            steps = [Step(entry.type, name=key, number=i) for i, (key, entry) in enumerate(type_.by_key.items())]
            parts = [self.element(value, s) if type_.is_union else getattr(value, f"v_{s.name}") for s in steps]
            return {e.name: self.show(part, e.type) for e, part in zip(type_.fields, parts, strict=True)}
        raise StUsageError(f"{type_} has no value of its own: name a variable in it")

    def element(self, holder: Any, step: Step) -> Any:
        """An element of an array or a field of a union."""
        if not isinstance(holder, ScalarUnion):
            return holder.get()
        number = step.number or 0
        if isinstance(step.type, ArrayType):
            return [holder.get(number, k) for k in range(step.type.size)]
        return holder.get(number, 0)

    def set_element(self, holder: Any, step: Step, value: Any) -> None:
        """Assign an element of an array or a field of a union."""
        if isinstance(holder, list):
            holder[step.index] = value
        elif isinstance(holder, ScalarUnion):
            holder.set(step.number or 0, 0, value)
        else:
            holder.set(value)

    def single(self, value: Any, type_: Elementary) -> Any:
        """A single value."""
        if type(value) is float and type_.is_real and type_.bits == 64:
            return value
        numbers = checked_numbers(value, type_)
        if numbers.size != 1:
            raise ValueError(f"shape {numbers.shape}, a single value is expected")
        return numbers.reshape(()).item()

    def array(self, value: Any, type_: ArrayType) -> Any:
        """An array of the type's shape."""
        numbers = checked_numbers(value, storage_type(type_.element))
        if numbers.shape not in (type_.shape, (1, *type_.shape)):
            raise ValueError(f"shape {numbers.shape}, expected {type_.shape}")
        return numbers.reshape(-1).tolist()

    def reference(self, slot: Slot, type_: Elementary) -> SlotReference:
        """What a VAR_IN_OUT of an elementary type holds."""
        del type_
        return SlotReference(slot, "v")
