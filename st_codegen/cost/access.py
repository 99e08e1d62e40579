"""What expressions cost, and which memory they touch."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

from st_codegen.cost.memory import Region, Touch, Versions, new_version
from st_codegen.cost.operations import CostClass, of_expression, size_of
from st_codegen.cost.paths import Costs, PathCost
from st_codegen.cost.ranges import Interval, Ranges, is_counted
from st_codegen.st import tree as t
from st_codegen.st import walk
from st_codegen.st.types import ArrayType, StructType, Type


@dataclass
class PathState:
    """What is known at a point of a path."""

    versions: Versions = field(default_factory=Versions)
    ranges: Ranges = field(default_factory=Ranges)

    def copy(self) -> PathState:
        """What is known, copied for a branch that then goes its own way."""
        return PathState(self.versions.copy(), self.ranges.copy())

    def assigned(self, target: t.Expression, interval: Interval | None) -> None:
        """Take note of an assignment; `interval` is what its value can be, None when nothing is known."""
        variable = t.root_variable(target)
        if variable is None:
            self.ranges.forget()
            return
        self.versions.change(variable)
        # a callee may assign a global, too
        is_certain = isinstance(target, t.VariableRef) and variable.storage is not t.Storage.GLOBAL
        self.ranges.set(variable, interval if is_certain else None)

    def become_common(self, branches: list[PathState]) -> None:
        """Keep what is known behind all branches; given are those from which the path goes on."""
        if not branches:
            return
        changed = {variable for branch in branches for variable in self.versions.differs(branch.versions)}
        first, *others = branches
        self.ranges = first.ranges.copy()
        self.ranges.keep_common(branch.ranges for branch in others)
        for variable in changed:
            self.versions.change(variable)

    def after_call(self, call: t.Call) -> None:
        """Take note of what a call assigns: its outputs, and anything of this instance where it runs on it."""
        for argument in call.arguments:
            if argument.passing is not t.Passing.INPUT:
                self.assigned(argument.value, None)
        if call.receiver is not None and (receiver := t.root_variable(call.receiver)) is not None:
            self.versions.change(receiver)
        if isinstance(call.receiver, t.ThisRef):
            self.ranges.forget()

    def after_calls(self, body: Iterable[t.Statement]) -> None:
        """Take note of what the calls in a loop assign."""
        for call in walk.calls(body):
            self.after_call(call)


@dataclass(frozen=True)
class _Address:
    """A region, and where in it: bytes for each version, other versions it depends on, a distance, and the text.

    Without a region it is a scalar of the unit itself: those are counted as one region.
    """

    region: Region | None
    affine: dict[int, int] = field(default_factory=dict)
    varies: frozenset[int] = frozenset()
    offset: int = 0
    text: tuple[object, ...] = ()

    def touch(self, size: int) -> PathCost:
        """An access to a value of a size, eight bytes at a time."""
        if self.region is None:
            return PathCost()
        key = (self.region, self.text, tuple(sorted(self.affine.items())), self.varies)
        words = _words(size)
        end = self.offset + 8 * (words - 1)
        touch = Touch(self.region, self.affine, self.varies, executions=words, low=self.offset, high=end)
        return PathCost({}, {key: touch})


#: PathCost of the unit behind a call, given the path to its instance
Follow = Callable[[t.Call, tuple[str, ...], PathState], PathCost]


class Accesses:
    """Finds what the expressions of one unit cost."""

    def __init__(self, project: t.Project, pou: t.Pou, costs: Costs, follow: Follow) -> None:
        self._project = project
        self._pou = pou
        self._costs = costs
        self._follow = follow

    # --- values ---

    def value(self, node: t.Expression, state: PathState) -> PathCost:  # noqa: PLR0911 - one return a case
        """The cost of computing the value of an expression."""
        match node:
            case t.Constant():
                return self._costs.of(CostClass.LOAD) if node.type.is_real else PathCost()
            case t.VariableRef(variable=variable) if variable.is_constant and not isinstance(
                node.type, ArrayType | StructType
            ):
                return self._costs.of(CostClass.LOAD) if node.type.is_real else PathCost()
            case t.VariableRef() | t.InstanceVariable() | t.FieldRef() | t.ElementRef() | t.PointerTarget():
                return self._moved(CostClass.LOAD, node, state)
            case t.ThisRef() | t.ProgramRef():
                return PathCost()
            case t.AddressOf(target=target):
                cost, _ = self._address(target, state)
                return cost.then(self._costs.of(CostClass.INDEX))
            case t.Call():
                return self._call(node, state)
            case _:
                cost = PathCost()
                for part in walk.parts(node):
                    cost = cost.then(self.value(part, state))
                return cost.then(self._costs.of(*of_expression(node)))

    def store(self, target: t.Expression, state: PathState) -> PathCost:
        """The cost of putting a computed value into a variable."""
        return self._moved(CostClass.STORE, target, state)

    def _moved(self, operation: CostClass, node: t.Expression, state: PathState) -> PathCost:
        cost, address = self._address(node, state)
        return cost.then(address.touch(self._size(node.type))).then(self._words(operation, node.type))

    def _words(self, operation: CostClass, type_: Type) -> PathCost:
        """A load or store of a value, eight bytes at a time."""
        return self._costs.of(*[operation] * _words(self._size(type_)))

    def _size(self, type_: Type) -> int:
        return size_of(type_, self._project.pous)

    # --- addresses ---

    def _address(self, node: t.Expression, state: PathState) -> tuple[PathCost, _Address]:
        match node:
            case t.VariableRef(variable=variable):
                return self._variable(variable, ())
            case t.InstanceVariable(base=base, variable=variable):
                cost, path, varies = self._path(base, state)
                more, address = self._variable(variable, path)
                return cost.then(more), replace(address, varies=address.varies | varies)
            case t.FieldRef(base=base, name=name):
                cost, address = self._address(base, state)
                return cost, replace(address, text=(*address.text, name))
            case t.ElementRef():
                return self._element(node, state)
            case t.PointerTarget(pointer=pointer):
                cost = self.value(pointer, state)
                # it may point anywhere, and elsewhere each time: what it points to is as large as the memory
                region = Region((), "pointer", self._pou.key, sys.maxsize, True)
                return cost, _Address(region, varies=frozenset({new_version()}))
            case _:
                return self.value(node, state), _Address(None)

    def _variable(self, variable: t.Variable, path: tuple[str, ...]) -> tuple[PathCost, _Address]:
        size = self._size(variable.type)
        is_shared = variable.is_constant or variable.storage is t.Storage.GLOBAL
        name = variable.key
        cost = self._costs.of(CostClass.LOAD) if variable.section is t.Section.IN_OUT else PathCost()
        if size <= 8 and not is_shared and not path:
            return cost, _Address(None)
        return cost, _Address(Region(() if is_shared else path, name, variable.owner, size, is_shared))

    def _path(self, base: t.Expression | None, state: PathState) -> tuple[PathCost, tuple[str, ...], frozenset[int]]:
        """The way to an instance of a block; an element of an array of instances depends on its index."""
        match base:
            case t.VariableRef(variable=variable):
                return PathCost(), (variable.key,), frozenset()
            case t.InstanceVariable(base=inner, variable=variable):
                cost, path, varies = self._path(inner, state)
                return cost, (*path, variable.key), varies
            case t.FieldRef(base=inner, name=name):
                cost, path, varies = self._path(inner, state)
                return cost, (*path, name), varies
            case t.ElementRef(base=inner, indices=indices):
                cost, path, varies = self._path(inner, state)
                for index in indices:
                    more, moves, others, _ = self._linear(index, state)
                    cost = cost.then(more).then(self._costs.of(CostClass.INDEX))
                    varies |= others | frozenset(moves)
                return cost, (*path, "[]"), varies
            case t.ThisRef() | t.ProgramRef() | None:
                return PathCost(), (), frozenset()
            case _:
                return self.value(base, state), ("^",), frozenset({new_version()})

    def _element(self, node: t.ElementRef, state: PathState) -> tuple[PathCost, _Address]:
        cost, address = self._address(node.base, state)
        type_ = node.base.type
        assert isinstance(type_, ArrayType)
        stride = self._size(type_.element)
        strides = []
        for length in reversed(type_.shape):
            strides.append(stride)
            stride *= length
        affine, varies, offset, unknown = dict(address.affine), address.varies, address.offset, []
        for index, step in zip(node.indices, reversed(strides), strict=True):
            more, moves, others, distance = self._linear(index, state)
            cost = cost.then(more)
            offset += distance * step
            if others:
                unknown.append(index)
            if not isinstance(index, t.Constant):
                cost = cost.then(self._costs.of(CostClass.INDEX))
            for version, factor in moves.items():
                affine[version] = affine.get(version, 0) + factor * step
            varies |= others
        text = (*address.text, *unknown)
        return cost, replace(address, affine=affine, varies=varies, offset=offset, text=text)

    def _linear(self, index: t.Expression, state: PathState) -> tuple[PathCost, dict[int, int], frozenset[int], int]:
        """An index as factors of versions, the versions it depends on in another way, and a constant."""
        cost = self.value(index, state)
        found = _factors(index, state)
        if found is not None:
            return cost, found[0], frozenset(), found[1]
        used = (variable for variable in walk.variables(index) if not variable.is_constant)
        return cost, {}, frozenset(state.versions[variable] for variable in used), 0

    # --- calls ---

    def _call(self, call: t.Call, state: PathState) -> PathCost:
        cost, path, varies = (
            (PathCost(), (), frozenset()) if call.receiver is None else self._path(call.receiver, state)
        )
        after = PathCost()
        for argument in call.arguments:
            if argument.passing is t.Passing.INPUT:
                copied = self._words(CostClass.STORE, argument.parameter.type)
                cost = cost.then(self.value(argument.value, state)).then(copied)
            elif argument.passing is t.Passing.IN_OUT:
                more, _ = self._address(argument.value, state)
                cost = cost.then(more).then(self._costs.of(CostClass.STORE))
            else:
                after = after.then(self._costs.of(CostClass.LOAD)).then(self.store(argument.value, state))
        body = self._follow(call, path, state)
        if varies:
            body = replace(body, touches={k: replace(x, varies=x.varies | varies) for k, x in body.touches.items()})
        result = self._costs.of(CostClass.CALL, CostClass.LOAD) if call.has_result else self._costs.of(CostClass.CALL)
        return cost.then(body).then(result).then(after)


def _words(size: int) -> int:
    """How many accesses of eight bytes a value of a size takes, at least one."""
    return max(-(-size // 8), 1)


def _factors(node: t.Expression, state: PathState) -> tuple[dict[int, int], int] | None:  # noqa: PLR0911 - one return a case
    """A sum of variables times constants, as factors of versions and a constant; None for anything else."""
    interval = state.ranges.of(node)
    if interval is not None and interval.low == interval.high:
        return {}, interval.low
    match node:
        case t.VariableRef(variable=variable) if not variable.is_constant:
            return {state.versions[variable]: 1}, 0
        case t.Conversion(operand=operand) if is_counted(operand.type):
            return _factors(operand, state)
        case t.Unary(operator="NEG", operand=operand):
            inner = _factors(operand, state)
            return None if inner is None else _times(inner, -1)
        case t.Binary(operator="ADD" | "SUB" as operator, left=left, right=right):
            a, b = _factors(left, state), _factors(right, state)
            if a is None or b is None:
                return None
            moves, distance = _times(b, 1 if operator == "ADD" else -1)
            return {v: a[0].get(v, 0) + moves.get(v, 0) for v in {**a[0], **moves}}, a[1] + distance
        case t.Binary(operator="MUL", left=left, right=right):
            for constant, other in ((left, right), (right, left)):
                interval = state.ranges.of(constant)
                inner = _factors(other, state)
                if interval is not None and interval.low == interval.high and inner is not None:
                    return _times(inner, interval.low)
            return None
        case _:
            return None


def _times(terms: tuple[dict[int, int], int], factor: int) -> tuple[dict[int, int], int]:
    moves, distance = terms
    return {version: factor * number for version, number in moves.items()}, factor * distance
