"""Compiles the typed tree to plain Python functions for a single lane.

A function has the signature `u_KEY(rt, s, ..)`: the machine, the instance (None for functions), inputs and references.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn, cast

from st_codegen.st import tree as t
from st_codegen.st import walk
from st_codegen.st.check import arithmetic as a
from st_codegen.st.check.arithmetic import Fault
from st_codegen.st.check.flow import overriding
from st_codegen.st.errors import Position
from st_codegen.st.run import runtime, scalar_memory
from st_codegen.st.run.emit import Compiled, Source, boxed_variables, has_calls, is_inlined, literal
from st_codegen.st.run.lane_places import is_elementary
from st_codegen.st.run.scalar_expressions import ScalarExpressions
from st_codegen.st.types import ArrayType, Elementary


def compile_scalar(project: t.Project) -> Compiled:
    """Compile all units of a project. Raises `StCheckError` for pointers."""
    code = ScalarCode(project)
    keys = [key for key, pou in project.pous.items() if not pou.is_native]
    for key in keys:
        ScalarUnit(code, project.pous[key]).write(code.function_name(key))
    code.source.run()
    return Compiled({key: code.source.namespace[code.function_name(key)] for key in keys}, code.source)


class ScalarCode:
    """What the units of a project share while they are compiled."""

    def __init__(self, project: t.Project) -> None:
        self.project = project
        self.source = Source("scalar")
        self.positions: list[Position] = []
        self._operations: dict[Any, Callable[..., Any]] = {}
        self.shared = shared_variables(project)
        names = self.source.namespace
        names.update({name: getattr(scalar_memory, name) for name in ("SlotReference", "ElementReference")})
        names.update(UnionReference=scalar_memory.UnionReference, assign=scalar_memory.assign, Slot=runtime.Slot)
        names.update(NAN=math.nan, loop_range=loop_range, after=after, **self._faults())

    @staticmethod
    def function_name(key: str) -> str:
        """The Python name of a unit."""
        return f"u_{key.replace('.', '__')}"

    def has_overrides(self, key: str) -> bool:
        """Whether a virtual call may reach more than one unit."""
        return overriding(self.project, key) != {key}

    def constant(self, variable: t.Variable) -> str:
        """The name of a composite constant that the code holds itself."""
        is_array = isinstance(variable.type, ArrayType) and is_elementary(variable.type.element)
        if is_array:
            return self.source.register("C_", variable, lambda: scalar_memory.packed(cast(Any, variable.initial)))
        return f"rt.constant({self.source.register('V_', variable, lambda: variable)})"

    def cached_operation(self, key: Any, make: Callable[[], Callable[..., Any]]) -> Callable[..., Any]:
        """An operation that is made once."""
        if key not in self._operations:
            self._operations[key] = make()
        return self._operations[key]

    def _faults(self) -> dict[str, Callable[..., NoReturn]]:
        positions = self.positions

        def nan_fault(where: int, *operands: float) -> NoReturn:
            raise Fault(a.NAN_COMPARED, operands, position=positions[where])

        def overflow_fault(where: int, *operands: int) -> NoReturn:
            raise Fault(a.INTEGER_OVERFLOW, operands, position=positions[where])

        def index_fault(where: int, index: int, low: int, high: int) -> NoReturn:
            raise Fault(a.INDEX, (index,), f"{index} is outside of {low}..{high}", position=positions[where])

        def loop_fault(where: int, limit: int) -> NoReturn:
            raise Fault(a.LOOP, (limit,), f"more than {limit} rounds", position=positions[where])

        faults = (nan_fault, overflow_fault, index_fault, loop_fault)
        return {fault.__name__: fault for fault in faults}


def shared_variables(project: t.Project) -> set[t.Variable]:
    """Variables that others may use while their instance runs: of programs, and those passed by reference."""
    found: set[t.Variable] = set()
    for pou in project.pous.values():
        for expression in walk.all_expressions(pou.body):
            if isinstance(expression, t.InstanceVariable) and isinstance(expression.base, t.ProgramRef):
                found.add(expression.variable)
            places = [expression.target] if isinstance(expression, t.AddressOf) else []
            if isinstance(expression, t.Call):
                places = [item.value for item in expression.arguments if item.passing is t.Passing.IN_OUT]
            found |= {place.variable for place in places if isinstance(place, t.VariableRef | t.InstanceVariable)}
    return found


def loop_range(start: int, stop: int, step: int, bounds: tuple[int, int], limit: int) -> Iterable[int]:
    """The values of a counter. Raises `Fault` for a step of zero, and in the round after the last allowed one."""
    if step == 0:
        raise Fault(a.STEP, (0,))
    counter = range(start, stop + (1 if step > 0 else -1), step)
    if len(counter) <= limit and (not counter or bounds[0] <= counter[-1] + step <= bounds[1]):
        return counter
    return _wrapping(start, stop, step, bounds, limit)


def _wrapping(start: int, stop: int, step: int, bounds: tuple[int, int], limit: int) -> Iterator[int]:
    i = start
    for _ in range(limit):
        if (i > stop) if step > 0 else (i < stop):
            return
        yield i
        i = a.wrap(i + step, *bounds)
    raise Fault(a.LOOP, (limit,), f"more than {limit} rounds")


def after(start: int, stop: int, step: int) -> int:
    """The counter behind a loop that ended by itself."""
    counter = range(start, stop + (1 if step > 0 else -1), step)
    return counter[-1] + step if counter else start


class ScalarUnit(ScalarExpressions):
    """Writes the function of one unit."""

    def __init__(self, compiler: ScalarCode, pou: t.Pou) -> None:
        used = {item.variable for item in walk.all_expressions(pou.body) if isinstance(item, t.VariableRef)}
        self._held = [
            variable
            for variable in sorted(used - compiler.shared, key=lambda item: item.key)
            if variable.storage is t.Storage.INSTANCE
            and not variable.is_constant
            and (variable.section is not t.Section.IN_OUT or not is_elementary(variable.type))
        ]
        self._assigned = walk.assigned_variables(pou.body)
        super().__init__(compiler, pou, boxed_variables(pou), set(self._held))

    def write(self, name: str) -> None:
        """Write the function."""
        pou = self.pou
        parameters = [] if self.is_instance_unit else pou.section(t.Section.INPUT, t.Section.IN_OUT)
        self.source.lines.append(f"def {name}({', '.join(['rt', 's', *(f'a_{p.key}' for p in parameters)])}):")
        self.source.positions.append(pou.position)
        self.position = pou.position
        for variable in (*pou.variables, *([pou.result] if pou.result is not None else [])):
            if variable.storage is t.Storage.LOCAL:
                self._declare(variable, variable in parameters)
        self.reload()
        self.block(pou.body)
        self._return()

    def _declare(self, variable: t.Variable, is_parameter: bool) -> None:
        if is_inlined(variable) or (variable.is_constant and not is_elementary(variable.type)):
            return
        slot, where = f"v_{variable.key}", variable.position
        if variable.section is t.Section.IN_OUT:
            self.line(f"{slot} = a_{variable.key}", where)
        elif not is_elementary(variable.type):
            name = self.source.register("V_", variable, lambda: variable)
            self.line(f"{slot} = rt.make({name}.type, {name}.initial)", where)
            if is_parameter:
                self.line(f"assign({slot}, a_{variable.key})", where)
        else:
            value = f"a_{variable.key}" if is_parameter else literal(cast(Any, variable.initial))
            self.line(f"{slot} = {f'Slot({value})' if variable in self.boxed else value}", where)

    def flush(self) -> None:
        """Give the instance what is held in local variables."""
        for variable in self._held:
            if variable in self._assigned and is_elementary(variable.type):
                self.line(f"s.v_{variable.key} = v_{variable.key}")

    def reload(self) -> None:
        """Take it back from there."""
        self.facts = {}
        for variable in self._held:
            self.line(f"v_{variable.key} = s.v_{variable.key}")

    def _return(self) -> None:
        self.flush()
        pou = self.pou
        results = [] if pou.result is None else [self.slot(pou.result)]
        if not self.is_instance_unit:
            results += [self.slot(variable) for variable in pou.section(t.Section.OUTPUT)]
        self.line(f"return {results[0]}" if len(results) == 1 else f"return ({', '.join(results)})")

    # --- statements ---

    def block(self, statements: Iterable[t.Statement]) -> None:
        """Write statements; what stands behind EXIT, CONTINUE or RETURN never runs."""
        for statement in statements:
            self.statement(statement)
            if isinstance(statement, t.Exit | t.Continue | t.Return):
                return

    def statement(self, statement: t.Statement) -> None:
        """Write one statement."""
        self.position = statement.position
        match statement:
            case t.Assign():
                self._assign(statement)
            case t.CallStatement():
                self.is_unstable = any(has_calls(item.value) for item in statement.call.arguments)
                self.call(statement.call)
                self.is_unstable = False
            case t.If():
                self._if(statement)
            case t.Case():
                self._case(statement)
            case t.For():
                self._for(statement)
            case t.While() | t.Repeat():
                self._while(statement)
            case t.Exit():
                self.line("break")
            case t.Continue():
                self.line("continue")
            case t.Return():
                self._return()

    def _assign(self, statement: t.Assign) -> None:
        self.is_unstable = has_calls(statement.value) or has_calls(statement.target)
        if is_elementary(statement.target.type):
            self.store(statement.target, self.expression(statement.value))
        else:
            source = self.object(statement.value)
            self.line(f"assign({self.object(statement.target)}, {source})", statement.position)
        self.is_unstable = False

    def _value(self, expression: t.Expression) -> str:
        self.is_unstable = has_calls(expression)
        code = self.expression(expression)
        self.is_unstable = False
        return code

    @contextmanager
    def _captured(self) -> Iterator[list[str]]:
        """Lines written inside are taken out again: what an expression needs before it."""
        lines, positions = self.source.lines, self.source.positions
        start, facts = len(lines), dict(self.facts)
        captured: list[str] = []
        yield captured
        self.facts = facts
        captured += lines[start:]
        del lines[start:]
        del positions[start:]

    def _if(self, statement: t.If) -> None:
        """IF and ELSIF in a row where conditions are plain; else each below a test that nothing ran yet."""
        with self._captured() as needed:
            for branch in statement.branches[1:]:
                self._value(branch.condition)
        pending = self.fresh("b") if needed else None
        for number, branch in enumerate(statement.branches):
            self.position = branch.condition.position
            if number and pending is not None:
                with self.branch(), self.indented(f"if {pending}:"):
                    self._branch("if", branch, pending)
            else:
                if pending is not None:
                    self.line(f"{pending} = True")
                self._branch("elif" if number else "if", branch, pending)
        if statement.otherwise:
            with self.branch(), self.indented("else:" if pending is None else f"if {pending}:"):
                self.block(statement.otherwise)

    def _branch(self, word: str, branch: t.Branch, pending: str | None) -> None:
        condition = self._value(branch.condition)
        with self.branch(), self.indented(f"{word} {condition}:", branch.condition.position):
            if pending is not None:
                self.line(f"{pending} = False")
            self.block(branch.body)

    def _case(self, statement: t.Case) -> None:
        selector = self.temporary(self._value(statement.selector), statement.position)
        for number, branch in enumerate(statement.branches):
            tests = [
                f"{selector} == {low}" if low == high else f"{low} <= {selector} <= {high}"
                for low, high in branch.labels
            ]
            with self.branch(), self.indented(f"{'elif' if number else 'if'} {' or '.join(tests)}:"):
                self.block(branch.body)
        if statement.otherwise and statement.branches:
            with self.branch(), self.indented("else:"):
                self.block(statement.otherwise)
        elif statement.otherwise:
            self.block(statement.otherwise)

    # --- loops ---

    def _for(self, statement: t.For) -> None:
        counter, type_ = statement.variable, cast(Elementary, statement.counter.type)
        parts = (statement.start, statement.stop, statement.step)
        start, stop, step = (self.temporary(self._value(part), part.position) for part in parts)
        rounds, slot = self.fresh("i"), self.slot(counter)
        bounds = f"({type_.lower}, {type_.upper})"
        self.line(f"{slot} = {start}")
        known = [part.value for part in parts if isinstance(part, t.Constant)]
        outer = self.counter_ranges.get(counter)
        if len(known) == 3:
            low, high = sorted((cast(int, known[0]), cast(int, known[1])))
            self.counter_ranges[counter] = (low, high)
        header = f"for {rounds} in loop_range({start}, {stop}, {step}, {bounds}, rt.limit):"
        self.facts = {}
        with self.indented(header, statement.position):
            self.line(f"{slot} = {rounds}")
            self.block(statement.body)
        self.facts = {}
        if outer is None:
            self.counter_ranges.pop(counter, None)
        else:
            self.counter_ranges[counter] = outer
        with self.indented("else:"):
            self.line(f"{slot} = after({start}, {stop}, {step})")

    def _while(self, statement: t.While | t.Repeat) -> None:
        """Both test at the top, where CONTINUE gets to; REPEAT not before its first round."""
        rounds, where = self.fresh("l"), statement.position
        self.facts = {}
        self.line(f"{rounds} = 0")
        with self.indented("while True:"):
            self.position = statement.condition.position
            if isinstance(statement, t.Repeat):
                with self.branch(), self.indented(f"if {rounds}:"):
                    self.line(f"if {self._value(statement.condition)}: break")
            else:
                self.line(f"if not {self._value(statement.condition)}: break")
            self.line(f"{rounds} += 1", where)
            self.line(f"if {rounds} > rt.limit: loop_fault({self.place_id(where)}, rt.limit)", where)
            self.block(statement.body)
        self.facts = {}
