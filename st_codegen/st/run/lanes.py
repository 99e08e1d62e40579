"""Runs a checked project for many lanes at once: every variable may have another value in each lane.

project = load_project(["out/iec"], dialect="iec")
machine = LaneMachine(project, lanes=10_000)
block = machine.instance("FB_Forest")
block(fSpeed_rpm=speeds, fTorque_Nm=torques)      # arrays of length lanes, or single values
block["fOut1"]                                    # array of length lanes
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from st_codegen.st import tree as t
from st_codegen.st.check.arithmetic import INVALID, Fault
from st_codegen.st.errors import StUsageError
from st_codegen.st.run.emit import Compiled
from st_codegen.st.run.lane_code import compile_lanes
from st_codegen.st.run.lane_memory import LaneRuntime
from st_codegen.st.run.machine import LOOP_LIMIT, Machine, checked_numbers
from st_codegen.st.run.natives import Library, as_lanes
from st_codegen.st.run.paths import Step
from st_codegen.st.run.runtime import Slot
from st_codegen.st.run.storage import LaneArray, LaneUnion, SlotReference
from st_codegen.st.run.vector import TRAPS
from st_codegen.st.types import ArrayType, Elementary, EnumType, StructType, Type, storage_type

_COMPILED: WeakKeyDictionary[t.Project, Compiled] = WeakKeyDictionary()


class LaneMachine(Machine):
    """A project in `lanes` independent copies; variables are read as arrays whose first axis is the lanes.

    `loop_limit` is the number of rounds after which a single run of a loop is an error. `libraries` are those the
    project was checked with. Raises `StCheckError` for pointers outside of native calls.
    """

    def __init__(
        self, project: t.Project, lanes: int = 1, *, loop_limit: int = LOOP_LIMIT, libraries: Iterable[Library] = ()
    ) -> None:
        if lanes < 1:
            raise StUsageError(f"a machine has at least one lane, not {lanes}")
        code = _COMPILED.get(project) or _COMPILED.setdefault(project, compile_lanes(project))
        self.lanes = lanes
        self.rt: LaneRuntime = LaneRuntime(project, code.functions, libraries, lanes, loop_limit)
        self.rt.k = tuple(self.rt.make_constant(variable) for variable in code.constants)
        super().__init__(project, self.rt, code.source)

    def run(self, code: Callable[..., Any], receiver: Any, *atoms: Any) -> Any:
        """Run a unit in all lanes. Raises `StRuntimeError` for what would stop a controller in one of them."""
        try:
            with np.errstate(**TRAPS):
                return code(self.rt, receiver, None, *atoms)
        except Fault as fault:
            raise self.source.explain(fault, fault.__traceback__) from None
        except FloatingPointError as error:
            raise self.source.explain(Fault(INVALID, (), str(error)), error.__traceback__) from None

    def show(self, value: Any, type_: Type) -> Any:
        """A variable for the user: arrays with the lanes first, dictionaries for structures."""
        if isinstance(type_, Elementary | EnumType):
            return as_lanes(value, self.lanes, storage_type(type_).dtype)
        if isinstance(value, LaneArray) and isinstance(type_, ArrayType):
            table = np.tile(value.data, (self.lanes, 1)) if value.data.ndim == 1 else value.data.T.copy()
            return table.reshape((self.lanes, *type_.shape))
        if isinstance(type_, ArrayType):
            return [self.show(item, type_.element) for item in value]
        if isinstance(type_, StructType):
            steps = [Step(entry.type, name=key, number=i) for i, (key, entry) in enumerate(type_.by_key.items())]
            parts = [self.element(value, s) if type_.is_union else getattr(value, f"v_{s.name}") for s in steps]
            return {e.name: self.show(part, e.type) for e, part in zip(type_.fields, parts, strict=True)}
        raise StUsageError(f"{type_} has no value of its own: name a variable in it")

    def element(self, holder: Any, step: Step) -> Any:
        """An element of an array or a field of a union."""
        if isinstance(holder, LaneArray):
            return holder.get(step.index, None)
        if not isinstance(holder, LaneUnion):
            return holder.get(None)
        number = step.number or 0
        if not isinstance(step.type, ArrayType):
            return holder.get(number, 0, None)
        dtype = storage_type(step.type.element).dtype
        parts = [as_lanes(holder.get(number, k, None), self.lanes, dtype) for k in range(step.type.size)]
        return LaneArray(np.stack(parts), self.lanes)

    def set_element(self, holder: Any, step: Step, value: Any) -> None:
        """Assign an element of an array or a field of a union."""
        if isinstance(holder, LaneArray):
            holder.set(step.index, value, None)
        elif isinstance(holder, LaneUnion):
            holder.set(step.number or 0, 0, value, None)
        else:
            holder.set(value, None)

    def single(self, value: Any, type_: Elementary) -> Any:
        """A single value or an array of length lanes."""
        numbers = checked_numbers(value, type_)
        if numbers.ndim == 0:
            return numbers.item()
        if numbers.shape != (self.lanes,):
            raise ValueError(f"shape {numbers.shape}, expected () or ({self.lanes},)")
        return numbers

    def array(self, value: Any, type_: ArrayType) -> LaneArray:
        """An array of the type's shape, or one with the lanes in front."""
        numbers = checked_numbers(value, storage_type(type_.element))
        if numbers.shape == type_.shape:
            return LaneArray(numbers.reshape(-1), self.lanes)
        if numbers.shape != (self.lanes, *type_.shape):
            raise ValueError(f"shape {numbers.shape}, expected {type_.shape} or {(self.lanes, *type_.shape)}")
        return LaneArray(np.ascontiguousarray(numbers.reshape(self.lanes, -1).T), self.lanes)

    def reference(self, slot: Slot, type_: Elementary) -> SlotReference:
        """What a VAR_IN_OUT of an elementary type holds."""
        return SlotReference(slot, "v", self.lanes, type_.dtype)


def evaluate_rows(
    project: t.Project, block: str, columns: Mapping[str, NDArray[Any]], *, chunk: int = 8192, **options: Any
) -> dict[str, NDArray[Any]]:
    """Call a fresh instance of a block once for each row, in chunks that fit the processor's cache.

    `columns` gives for each input one value a row, shape (rows,); the result has for each output (rows, ..).
    `options` are those of `LaneMachine`.
    """
    rows = len(next(iter(columns.values())))
    results: dict[str, list[NDArray[Any]]] = {}
    for start in range(0, rows, chunk):
        count = min(chunk, rows - start)
        instance = LaneMachine(project, count, **options).instance(block)
        instance(**{name: values[start : start + count] for name, values in columns.items()})
        for port in instance.outputs:
            results.setdefault(port.name, []).append(instance[port.name])
    return {name: np.concatenate(parts) for name, parts in results.items()}
