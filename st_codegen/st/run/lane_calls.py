"""Calls in the code for lanes."""

from __future__ import annotations

from typing import Any, cast

from st_codegen.st import tree as t
from st_codegen.st.run.emit import literal
from st_codegen.st.run.lane_places import Places, Resolved, is_elementary
from st_codegen.st.tree import PouKind


class Calls(Places):
    """Writes calls of functions, methods, programs and instances of blocks."""

    @property
    def is_instance_unit(self) -> bool:
        """Whether the unit is a body of a block or program."""
        return self.pou.kind in (PouKind.FUNCTION_BLOCK, PouKind.PROGRAM)

    def is_parameter(self, variable: t.Variable) -> bool:
        """Whether the unit's function takes a variable as an argument."""
        return not self.is_instance_unit and variable.section in (t.Section.INPUT, t.Section.IN_OUT)

    def call(self, call: t.Call) -> str:
        """Write a call and return the atom of its result (`None` without one)."""
        self.position = call.position
        places = [item.value for item in call.arguments if item.passing is t.Passing.IN_OUT]
        if call.receiver is not None:
            places.append(call.receiver)
        result = self.fresh("z")
        if any(self.list_elements(place) for place in places):
            self.line(f"{result} = None")
        with self.resolved(places) as path:
            callee = self.compiler.project.pous[call.callee]
            if callee.kind in (PouKind.FUNCTION_BLOCK, PouKind.PROGRAM):
                self._call_instance(call, callee, path)
            elif path.positions is None:
                result = self._call_function(call, callee, path)
            else:
                value = self._call_function(call, callee, path)
                if call.has_result and is_elementary(call.type):
                    dtype = self.dtype(call.type)
                    gathered = f"gather({result}, {path.positions}, {value}, {path.before}, rt.lanes, {dtype})"
                    self.line(f"{result} = {gathered}")
        self.forget(None)
        return result

    def _call_instance(self, call: t.Call, callee: t.Pou, path: Resolved) -> None:
        """Inputs go into the instance, the body runs, outputs come out of it."""
        receiver = self.object(cast(t.Expression, call.receiver), path.indices)
        instance = self.fresh("o")
        self.line(f"{instance} = {receiver}")
        for item in call.arguments:
            slot = f"{instance}.v_{item.parameter.key}"
            if item.passing is t.Passing.IN_OUT:
                self.line(f"{slot} = {self.reference(item.value, path.indices)}", item.value.position)
            elif item.passing is t.Passing.INPUT:
                self._pass_input(item, slot)
        if callee.is_native:
            self.line(f"rt.call_native({callee.key!r}, {instance}, m, ())", call.position)
        else:
            self.line(f"{self._function(call, instance)}(rt, {instance}, m)", call.position)
        self.forget(None)
        for item in call.arguments:
            if item.passing is t.Passing.OUTPUT:
                self._take_output(item, f"{instance}.v_{item.parameter.key}", is_slot=True)

    def _pass_input(self, item: t.Argument, slot: str) -> None:
        if is_elementary(item.parameter.type):
            atom = self.expression(item.value)
            self.store_slot(slot, item.parameter.type, self.owned(atom), item.value.position)
        else:
            with self.resolved([item.value]) as path:
                self.line(f"assign({slot}, {self.object(item.value, path.indices)}, m, rt.lanes)", item.value.position)

    def _take_output(self, item: t.Argument, source: str, is_slot: bool) -> None:
        if is_elementary(item.value.type):
            atom = self.temporary(f"ld({source}, m)" if is_slot else source, item.value.position)
            self.aliases.add(atom)
            self.store(item.value, atom)
        else:
            with self.resolved([item.value]) as path:
                self.line(
                    f"assign({self.object(item.value, path.indices)}, {source}, m, rt.lanes)", item.value.position
                )
            self.forget(None)

    def _function(self, call: t.Call, instance: str) -> str:
        """The Python function of a callee, looked up in the instance where it may be another one."""
        from st_codegen.st.run.lane_code import function_name

        callee = self.compiler.project.pous[call.callee]
        if not call.is_virtual or not self.compiler.has_overrides(call.callee):
            return function_name(call.callee)
        return f"{instance}.units[{callee.name.upper() if callee.block is not None else ''!r}]"

    def _call_function(self, call: t.Call, callee: t.Pou, path: Resolved) -> str:
        """A function or method: values and references go in, a result and outputs come back."""
        receiver = "None" if call.receiver is None else self.object(call.receiver, path.indices)
        given = {item.parameter: item for item in call.arguments}
        parameters = callee.section(t.Section.INPUT, t.Section.IN_OUT)
        atoms = [self._argument(parameter, given.get(parameter), path) for parameter in parameters]
        outputs = callee.section(t.Section.OUTPUT)
        result = self.fresh("z")
        names = ([result] if callee.result is not None else []) + [self.fresh("z") for _ in outputs]
        target = f"{', '.join(names)} = " if names else ""
        if callee.is_native:
            self.line(f"{target}rt.call_native({callee.key!r}, {receiver}, m, ({''.join(f'{x}, ' for x in atoms)}))")
        else:
            self.line(
                f"{target}{self._function(call, receiver)}({', '.join(['rt', receiver, 'm', *atoms])})", call.position
            )
        self.forget(None)
        for parameter, name in zip(outputs, names[len(names) - len(outputs) :], strict=True):
            if parameter in given:
                self._take_output(given[parameter], name, is_slot=False)
        return result

    def _argument(self, parameter: t.Variable, item: t.Argument | None, path: Resolved) -> str:
        if item is None:
            if is_elementary(parameter.type):
                return literal(cast(Any, parameter.initial))
            name = self.source.register("V_", parameter, lambda: parameter)
            return f"rt.make({name}.type, {name}.initial)"
        if item.passing is t.Passing.IN_OUT:
            return self.reference(item.value, path.indices)
        if is_elementary(parameter.type):
            return self.expression(item.value)
        return self.object(item.value, path.indices)

    def address(self, expression: t.Expression) -> str:
        """ADR: what a native block gets instead of an address."""
        from st_codegen.st.run.lane_places import refusal

        if not isinstance(expression, t.AddressOf):
            raise refusal(expression)
        with self.resolved([expression.target]) as path:
            return self.temporary(self.reference(expression.target, path.indices), expression.position)
