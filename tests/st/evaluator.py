# ruff: noqa: PLR0911, PLR0912 - one case for each kind of expression and statement
"""A second opinion: walks the typed tree and computes with `check.arithmetic`, as slowly and plainly as possible."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

import numpy as np

from st_codegen.st import tree as t
from st_codegen.st.check import arithmetic as a
from st_codegen.st.check import constants
from st_codegen.st.errors import Position
from st_codegen.st.tree import PouKind
from st_codegen.st.types import REAL, ArrayType, BlockType, Elementary, StructType, Type, storage_type
from tests.st import functions


class StoppedError(Exception):
    """What would stop a controller: the kind of fault, its place, its operands."""

    def __init__(self, kind: str, position: Position, operands: tuple[Any, ...]) -> None:
        self.kind, self.position, self.operands = kind, position, operands
        super().__init__(f"{position}: {kind} {operands}")


class LeaveError(Exception):
    """EXIT, CONTINUE or RETURN."""

    def __init__(self, kind: type) -> None:
        self.kind = kind


class Union:
    """Fields in the same bytes."""

    def __init__(self, type_: StructType) -> None:
        self.types = {key: entry.type for key, entry in type_.by_key.items()}
        self.bytes = bytearray(64)

    @staticmethod
    def _dtype(type_: Type) -> np.dtype[Any]:
        return storage_type(type_.element if isinstance(type_, ArrayType) else type_).dtype

    def __getitem__(self, key: str) -> Any:
        type_ = self.types[key]
        count = type_.size if isinstance(type_, ArrayType) else 1
        values = np.frombuffer(bytes(self.bytes), self._dtype(type_), count)
        return UnionArray(self, key) if isinstance(type_, ArrayType) else values[0].item()

    def __setitem__(self, key: str, value: Any) -> None:
        content = np.array(value, self._dtype(self.types[key])).tobytes()
        self.bytes[: len(content)] = content


class UnionArray(list[Any]):
    """An array in a union; what is assigned goes into the bytes."""

    def __init__(self, owner: Union, key: str) -> None:
        dtype = Union._dtype(owner.types[key])
        size = owner.types[key].size  # type: ignore[union-attr]
        super().__init__(np.frombuffer(bytes(owner.bytes), dtype, size).tolist())
        self.owner, self.dtype = owner, dtype

    def __setitem__(self, index: Any, value: Any) -> None:
        super().__setitem__(index, value)
        content = np.array(value, self.dtype).tobytes()
        self.owner.bytes[index * len(content) : (index + 1) * len(content)] = content


class Instance(dict[str, Any]):
    """Variables of a block by upper-case name."""

    block = ""


Ref = tuple[Any, Any]


class Evaluator:
    """Runs one copy of a project."""

    def __init__(self, project: t.Project, loop_limit: int) -> None:
        self.project = project
        self.limit = loop_limit

    # --- variables ---

    def make(self, type_: Type, initial: Any) -> Any:
        if isinstance(type_, ArrayType):
            values = initial.tolist() if isinstance(initial, np.ndarray) else initial
            return [self.make(type_.element, value) for value in values]
        if isinstance(type_, BlockType):
            made = Instance()
            made.block = type_.name.upper()
            for variable in self.project.block_variables(type_.name):
                if variable.section is not t.Section.IN_OUT:
                    made[variable.key] = self.make(variable.type, initial.get(variable.key, variable.initial))
            return made
        if isinstance(type_, StructType):
            holder: Any = Union(type_) if type_.is_union else {}
            for key, entry in type_.by_key.items():
                if not type_.is_union:
                    holder[key] = self.make(entry.type, initial[key])
            if type_.is_union:
                for key, value in initial.items():
                    holder[key] = value
            return holder
        return initial

    def _copy(self, value: Any) -> Any:
        if isinstance(value, Union):
            made = Union.__new__(Union)
            made.types, made.bytes = value.types, bytearray(value.bytes)
            return made
        if isinstance(value, dict):
            copied = type(value)({key: self._copy(item) for key, item in value.items()})
            if isinstance(value, Instance):
                copied.block = value.block  # type: ignore[attr-defined]
            return copied
        return [self._copy(item) for item in value] if isinstance(value, list) else value

    # --- calls ---

    def run(self, instance: Instance) -> None:
        """Call an instance."""
        _Unit(self, self.project.pous[instance.block], instance, {}).run()

    def function(self, pou: t.Pou, this: Any, given: dict[str, Any]) -> dict[str, Any]:
        """Call a function or method; gives its local variables afterwards."""
        variables = (*pou.variables, *([pou.result] if pou.result is not None else []))
        local = {v.key: given.get(v.key, self.make(v.type, v.initial)) for v in variables}
        _Unit(self, pou, this, local).run()
        return local

    def method(self, block: str, callee: t.Pou) -> t.Pou:
        """The method or body that a block has for another's."""
        if callee.block is None:
            return self.project.pous[block]
        name = callee.name.upper()
        return self.project.pous[next(pou.methods[name] for pou in self.project.lineage(block) if name in pou.methods)]


class _Unit:
    def __init__(self, evaluator: Evaluator, pou: t.Pou, this: Any, local: dict[str, Any]) -> None:
        self.e, self.pou, self.this, self.local = evaluator, pou, this, local
        for variable in pou.variables:
            if variable.storage is t.Storage.LOCAL and variable.key not in local:
                local[variable.key] = evaluator.make(variable.type, variable.initial)

    def run(self) -> None:
        try:
            self.block(self.pou.body)
        except LeaveError as leave:
            assert leave.kind is t.Return

    def at(self, position: Position, function: Callable[..., Any], *operands: Any) -> Any:
        try:
            return function(*operands)
        except a.Fault as fault:
            raise StoppedError(fault.kind, position, fault.operands) from None

    # --- places ---

    def place(self, node: t.Expression) -> Ref:
        match node:
            case t.VariableRef(variable=variable):
                if variable.is_constant:
                    return {"": self.e.make(variable.type, variable.initial)}, ""
                holder = self.this if variable.storage is t.Storage.INSTANCE else self.local
                if variable.section is t.Section.IN_OUT:
                    return holder[variable.key]  # type: ignore[no-any-return]
                return holder, variable.key
            case t.InstanceVariable(base=base, variable=variable):
                return self.value(base), variable.key
            case t.FieldRef(base=base, name=name):
                return self.value(base), name
            case t.ElementRef(base=base, indices=indices):
                type_ = base.type
                assert isinstance(type_, ArrayType)
                holder, flat = self.value(base), 0
                for item, (low, high) in zip(indices, type_.bounds, strict=True):
                    index = self.value(item)
                    if not low <= index <= high:
                        raise StoppedError(a.INDEX, item.position, (index,))
                    flat = flat * (high - low + 1) + index - low
                return holder, flat
            case _:
                return {"": self.value(node)}, ""

    # --- expressions ---

    def value(self, node: t.Expression) -> Any:
        at = node.position
        match node:
            case t.Constant():
                return node.value
            case t.ThisRef():
                return self.this
            case t.VariableRef() | t.InstanceVariable() | t.FieldRef() | t.ElementRef():
                holder, key = self.place(node)
                return holder[key]
            case t.Conversion(operand=operand):
                return self.at(at, constants.convert, self.value(operand), operand.type, node.type)
            case t.Unary(operator=operator, operand=operand):
                type_, x = storage_type(node.type), self.value(operand)
                if operator == "NOT":
                    return not x if isinstance(x, bool) else a.wrap(~x, type_.lower, type_.upper)
                if type_.is_real:
                    return -x
                return self.at(at, constants.binary, "SUB", type_, node.overflow, 0, x)
            case t.Binary(operator=operator):
                left, right = self.value(node.left), self.value(node.right)
                if node.type is REAL:
                    return self.at(at, functions.single(a.REAL_OPERATORS[operator]), left, right)
                return self.at(at, constants.binary, operator, storage_type(node.type), node.overflow, left, right)
            case t.ShortCircuit(operator=operator):
                left = self.value(node.left)
                return self.value(node.right) if left is (operator == "AND_THEN") else left
            case t.Compare():
                left, right = self.value(node.left), self.value(node.right)
                if node.is_number_test and math.isnan(left):
                    return False
                return self.at(at, constants.compare, node.operator, left, right)
            case t.StandardCall():
                arguments = [self.value(item) for item in node.arguments]
                return self.at(at, self.standard, node, storage_type(node.type), *arguments)
            case t.Call():
                return self.call(node)
            case _:
                raise AssertionError(node)

    @staticmethod
    def standard(node: t.StandardCall, type_: Elementary, *x: Any) -> Any:
        name = node.function
        if name in a.FUNCTIONS or name in ("EXPT", "ATAN2"):
            function = a.FUNCTIONS.get(name) or {"EXPT": functions.expt, "ATAN2": functions.atan2}[name]
            return (functions.single(function) if type_ is REAL else function)(*x)
        match name:
            case "ABS":
                return abs(x[0]) if type_.is_real else a.exact(abs(x[0]), type_.lower, type_.upper, x[0])
            case "TRUNC":
                return functions.truncate(x[0], type_.lower, type_.upper)
            case "SEL":
                return x[2] if x[0] else x[1]
            case "MUX":
                if not 0 <= x[0] < len(x) - 1:
                    raise a.Fault(a.INDEX, (x[0],))
                return x[x[0] + 1]
            case "MIN" | "MAX" | "LIMIT":
                operator = "LT" if name != "MAX" else "GT"
                result = x[0] if name != "LIMIT" else x[1]
                steps = [(operator, item) for item in x[1:]] if name != "LIMIT" else [("GT", x[0]), ("LT", x[2])]
                for operator, item in steps:
                    result = item if constants.compare(operator, item, result) else result
                return result
        count, mask = x[1], (1 << type_.bits) - 1
        if count < 0 or (name in ("SHL", "SHR") and count >= type_.bits):
            raise a.Fault(a.SHIFT, x)
        if name == "SHR":
            return x[0] >> count
        function = {"SHL": functions.shift_left, "ROL": functions.rotate_left, "ROR": functions.rotate_right}[name]
        return a.wrap(function(x[0] & mask, count, type_.bits, mask), type_.lower, type_.upper)

    def call(self, node: t.Call) -> Any:
        callee = self.e.project.pous[node.callee]
        this = None if node.receiver is None else self.value(node.receiver)
        if callee.kind in (PouKind.FUNCTION_BLOCK, PouKind.PROGRAM):
            for item in node.arguments:
                if item.passing is not t.Passing.OUTPUT:
                    is_input = item.passing is t.Passing.INPUT
                    this[item.parameter.key] = (
                        self.e._copy(self.value(item.value)) if is_input else self.place(item.value)
                    )
            pou = self.e.method(this.block, callee) if node.is_virtual else callee
            _Unit(self.e, pou, this, {}).run()
            results = this
        else:
            given = {}
            for item in node.arguments:
                if item.passing is t.Passing.INPUT:
                    given[item.parameter.key] = self.e._copy(self.value(item.value))
                elif item.passing is t.Passing.IN_OUT:
                    given[item.parameter.key] = self.place(item.value)
            pou = self.e.method(this.block, callee) if node.is_virtual else callee
            results = self.e.function(pou, this, given)
        for item in node.arguments:
            if item.passing is t.Passing.OUTPUT:
                holder, key = self.place(item.value)
                holder[key] = self.e._copy(results[item.parameter.key])
        return None if pou.result is None else results[pou.result.key]

    # --- statements ---

    def block(self, body: tuple[t.Statement, ...]) -> None:
        for statement in body:
            self.statement(statement)

    def statement(self, node: t.Statement) -> None:
        match node:
            case t.Assign():
                value = self.e._copy(self.value(node.value))
                holder, key = self.place(node.target)
                holder[key] = value
            case t.CallStatement():
                self.call(node.call)
            case t.If():
                for branch in node.branches:
                    if self.value(branch.condition):
                        self.block(branch.body)
                        return
                self.block(node.otherwise)
            case t.Case():
                selector = self.value(node.selector)
                for choice in node.branches:
                    if any(low <= selector <= high for low, high in choice.labels):
                        self.block(choice.body)
                        return
                self.block(node.otherwise)
            case t.For():
                self.loop(node)
            case t.While() | t.Repeat():
                self.rounds(node)
            case _:
                raise LeaveError(type(node))

    def round(self, body: tuple[t.Statement, ...]) -> bool:
        """One round of a loop; whether it goes on."""
        try:
            self.block(body)
        except LeaveError as leave:
            if leave.kind is t.Return:
                raise
            return leave.kind is t.Continue
        return True

    def loop(self, node: t.For) -> None:
        i, stop, step = (self.value(part) for part in (node.start, node.stop, node.step))
        type_ = storage_type(node.counter.type)
        if step == 0:
            raise StoppedError(a.STEP, node.position, (0,))
        count = 0
        holder, key = self.place(node.counter)
        while True:
            holder[key] = i
            if (i > stop) if step > 0 else (i < stop):
                return
            count += 1
            if count > self.e.limit:
                raise StoppedError(a.LOOP, node.position, (self.e.limit,))
            if not self.round(node.body):
                return
            i = a.wrap(i + step, type_.lower, type_.upper)

    def rounds(self, node: t.While | t.Repeat) -> None:
        count = 0
        while True:
            if isinstance(node, t.While) and not self.value(node.condition):
                return
            count += 1
            if count > self.e.limit:
                raise StoppedError(a.LOOP, node.position, (self.e.limit,))
            if not self.round(node.body):
                return
            if isinstance(node, t.Repeat) and self.value(node.condition):
                return


def bits(value: Any) -> Any:
    """Something that is equal when all bits are, but for those of NaN."""
    if isinstance(value, Union):
        return {key: bits(list(value[key]) if isinstance(value[key], list) else value[key]) for key in value.types}
    if isinstance(value, dict):
        return {key.upper(): bits(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return [bits(item) for item in value.reshape(-1).tolist()]
    if isinstance(value, list):
        return [bits(item) for item in value]
    if isinstance(value, float):
        return "nan" if math.isnan(value) else struct.pack("<d", value)
    return value
