"""Compiles the typed tree to Python functions that run many lanes at once.

A function has the signature `u_KEY(rt, s, m, ..)`: the machine, the instance (None for functions), the active lanes,
then inputs and references. Its code keeps `m` up to date: a branch runs with the lanes that take it, EXIT, CONTINUE
and RETURN take lanes out, and code that may be left without lanes stands behind `if m is not EMPTY`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, cast

from st_codegen.st import tree as t
from st_codegen.st import walk
from st_codegen.st.check.flow import overriding
from st_codegen.st.run import lane_runtime, storage, vector, vector_functions
from st_codegen.st.run.emit import Compiled, Source, boxed_variables, has_calls, is_inlined, leaves, literal
from st_codegen.st.run.lane_calls import Calls
from st_codegen.st.run.lane_places import is_elementary, refusal, stable_root
from st_codegen.st.types import ArrayType, Elementary, EnumType, PointerType, storage_type


def compile_lanes(project: t.Project) -> Compiled:
    """Compile all units of a project; the functions serve machines of any number of lanes.

    A machine has the composite constants of functions and methods in `rt.k`. Raises `StCheckError` for pointers.
    """
    code = LaneCode(project)
    keys = [key for key, pou in project.pous.items() if not pou.is_native]
    for key in keys:
        UnitCode(code, project.pous[key]).write(function_name(key))
    code.source.run()
    functions = {key: code.source.namespace[function_name(key)] for key in keys}
    return Compiled(functions, code.source, tuple(code.constants))


class LaneCode:
    """What the units of a project share while they are compiled."""

    def __init__(self, project: t.Project) -> None:
        self.project = project
        self.source = Source("lanes")
        self.source.namespace.update(_fixed_names())
        self.constants: list[t.Variable] = []

    def has_overrides(self, key: str) -> bool:
        """Whether a virtual call may reach more than one unit."""
        return overriding(self.project, key) != {key}

    def constant_object(self, variable: t.Variable) -> str:
        """Where a machine has a composite constant of a function or method."""
        if variable not in self.constants:
            self.constants.append(variable)
        return f"rt.k[{self.constants.index(variable)}]"

    def constant_table(self, place: t.Expression) -> str | None:
        """The name of the array of numbers that a constant is, if it is one."""
        if not isinstance(place, t.VariableRef) or not place.variable.is_constant:
            return None
        variable = place.variable
        if not isinstance(variable.type, ArrayType) or not isinstance(variable.type.element, Elementary | EnumType):
            return None
        return self.source.register("C_", variable, lambda: variable.initial)


def function_name(key: str) -> str:
    """The Python name of a unit."""
    return f"u_{key.replace('.', '__')}"


def _fixed_names() -> dict[str, Any]:
    """What generated code refers to by fixed names."""
    return {name: getattr(module, name) for module in (storage, lane_runtime) for name in module.__all__}


class UnitCode(Calls):
    """Writes the function of one unit."""

    def __init__(self, compiler: LaneCode, pou: t.Pou) -> None:
        super().__init__(compiler, pou, boxed_variables(pou))
        self._loops: list[tuple[t.Statement, str, str]] = []

    # --- the unit ---

    def write(self, name: str) -> None:
        """Write the function."""
        pou = self.pou
        parameters = [f"a_{variable.key}" for variable in pou.variables if self.is_parameter(variable)]
        self.source.lines.append(f"def {name}({', '.join(['rt', 's', 'm', *parameters])}):")
        self.source.positions.append(pou.position)
        self.position = pou.position
        self.line("m0 = m")
        for variable in (*pou.variables, *([pou.result] if pou.result is not None else [])):
            if variable.storage is t.Storage.LOCAL:
                self._declare(variable)
        self.block(pou.body)
        results = [] if pou.result is None else [pou.result]
        if pou.block is not None or not self.is_instance_unit:
            results += list(pou.section(t.Section.OUTPUT))
        atoms = []
        for variable in results:
            slot = self.variable_slot(variable)
            atoms.append(f"ld({slot}, m0)" if is_elementary(variable.type) else slot)
        self.line(f"return {atoms[0]}" if len(atoms) == 1 else f"return ({', '.join(atoms)})")

    def _declare(self, variable: t.Variable) -> None:
        if is_inlined(variable) or (variable.is_constant and not is_elementary(variable.type)):
            return
        slot = f"v_{variable.key}"
        if variable.section is t.Section.IN_OUT:
            self.line(f"{slot} = a_{variable.key}", variable.position)
            return
        if not is_elementary(variable.type):
            source = f"a_{variable.key}" if self.is_parameter(variable) else None
            name = self.source.register("V_", variable, lambda: variable)
            self.line(f"{slot} = rt.make({name}.type, {name}.initial)", variable.position)
            if source is not None:
                self.line(f"assign({slot}, {source}, m, rt.lanes)", variable.position)
            return
        value = literal(cast(Any, variable.initial))
        if self.is_parameter(variable):
            value = f"spread(own(a_{variable.key}), m, rt.lanes, {self.dtype(variable.type)})"
        self.line(f"{slot} = {f'Slot({value})' if variable in self.boxed else value}", variable.position)

    # --- statements ---

    def block(self, statements: Iterable[t.Statement]) -> None:
        """Write statements; what follows one that may take all lanes out is guarded."""
        pending: list[t.Statement] = []
        is_guarded = False
        for statement in statements:
            pending.append(statement)
            if leaves(statement):
                self._segment(pending, is_guarded)
                pending, is_guarded = [], True
        self._segment(pending, is_guarded)

    def _segment(self, statements: list[t.Statement], is_guarded: bool) -> None:
        if not statements:
            return
        if not is_guarded:
            for statement in statements:
                self.statement(statement)
            return
        self.memo = {}
        with self.indented("if m is not EMPTY:"):
            for statement in statements:
                self.statement(statement)

    def statement(self, statement: t.Statement) -> None:
        """Write one statement."""
        self.position = statement.position
        match statement:
            case t.Assign():
                self._assign(statement)
            case t.CallStatement():
                self.call(statement.call)
            case t.If():
                self._if(statement)
            case t.Case():
                self._case(statement)
            case t.For():
                self._for(statement)
            case t.While() | t.Repeat():
                self._while(statement)
            case t.Exit():
                self._leave_loop("x")
            case t.Continue():
                self._leave_loop("n")
            case t.Return():
                for loop, number, _ in self._loops:
                    if isinstance(loop, t.For):
                        self._keep_counter(loop, number, "m")
                self.line("m = EMPTY")

    def _assign(self, statement: t.Assign) -> None:
        self.is_unstable = has_calls(statement.value) or has_calls(statement.target)
        if is_elementary(statement.target.type):
            self.store(statement.target, self.expression(statement.value))
        else:
            with self.resolved([statement.target, statement.value]) as path:
                source = self.object(statement.value, path.indices)
                target = self.object(statement.target, path.indices)
                self.line(f"assign({target}, {source}, m, rt.lanes)", statement.position)
            self.forget(None)
        self.is_unstable = False

    def _value(self, expression: t.Expression) -> str:
        """The atom of a condition or bound, read before what follows can change it."""
        self.is_unstable = has_calls(expression)
        atom = self.expression(expression)
        self.is_unstable = False
        return atom

    def _restore(self, saved: dict[tuple[object, ...], str], done: tuple[t.Statement, ...]) -> None:
        """Back at the lanes that `saved` was computed for: only loads of what was assigned meanwhile are stale."""
        self.memo = saved
        if next(walk.calls(done), None) is not None:
            self.forget(None)
        for place in walk.assigned_places(done):
            self.forget(stable_root(place))

    def _if(self, statement: t.If) -> None:
        before, after = self.fresh("m"), self.fresh("w")
        has_left = bool(leaves(statement))
        self.line(f"{before} = m")
        if has_left:
            self.line(f"{after} = []")
        first, *others = statement.branches
        condition = self._value(first.condition)
        saved = dict(self.memo)
        is_last = not others and not statement.otherwise and not has_left
        self._branch(condition, first.body, after if has_left else None, is_last)
        for branch in others:
            # Conditions further down are evaluated by the lanes that get there
            with self.indented("if m is not EMPTY:"):
                self.position = branch.condition.position
                condition = self._value(branch.condition)
                self._branch(condition, branch.body, after if has_left else None, is_last=False)
        self._otherwise(statement, before, after if has_left else None, saved)

    def _branch(self, condition: str, body: tuple[t.Statement, ...], after: str | None, is_last: bool) -> None:
        """A branch with the lanes for which its condition holds; `m` is then what is left over."""
        rest = self.fresh("r")
        self.line(f"m = only(m, {condition})" if is_last else f"m, {rest} = split(m, {condition})")
        self.memo = {}
        with self.indented("if m is not EMPTY:"):
            self.block(body)
            if after is not None:
                self.line(f"{after}.append(m)")
        self.memo = {}
        if not is_last:
            self.line(f"m = {rest}")

    def _otherwise(
        self, statement: t.If | t.Case, before: str, after: str | None, saved: dict[tuple[object, ...], str]
    ) -> None:
        """The ELSE, and the lanes behind all branches."""
        self.memo = {}
        if statement.otherwise or after is not None:
            with self.indented("if m is not EMPTY:"):
                self.block(statement.otherwise)
                if after is not None:
                    self.line(f"{after}.append(m)")
        if after is None:
            self.line(f"m = {before}")
            self._restore(saved, (statement,))
        else:
            self.line(f"m = join_all({after}, rt.lanes)")
            self.memo = {}

    def _case(self, statement: t.Case) -> None:
        selector = self._value(statement.selector)
        kept, before, after = self.fresh("c"), self.fresh("m"), self.fresh("w")
        has_left = bool(leaves(statement))
        saved = dict(self.memo)
        self.line(f"{before} = m")
        self.line(f"{kept} = spread(own({selector}), m, rt.lanes, {self.dtype(statement.selector.type)})")
        if has_left:
            self.line(f"{after} = []")
        for branch in statement.branches:
            tests = [f"labelled(ld({kept}, m), {low}, {high})" for low, high in branch.labels]
            with self.indented("if m is not EMPTY:"):
                self._branch(" | ".join(tests), branch.body, after if has_left else None, is_last=False)
        self._otherwise(statement, before, after if has_left else None, saved)

    # --- loops ---

    def _open_loop(self, statement: t.For | t.While | t.Repeat) -> tuple[str, str, dict[tuple[object, ...], str]]:
        number = self.fresh("")
        self.line(f"m{number} = m")
        self.line(f"l{number} = 0")
        returns = any(t.Return in leaves(item) for item in statement.body)
        if returns:
            self.line(f"w{number} = []")
        self._loops.append((statement, number, "w" if returns else ""))
        saved = dict(self.memo)
        self.memo = {}
        return number, "w" if returns else "", saved

    def _close_loop(
        self, statement: t.For | t.While | t.Repeat, number: str, after: str, saved: dict[tuple[object, ...], str]
    ) -> None:
        self._loops.pop()
        if after:
            self.line(f"m = join_all(w{number}, rt.lanes)")
            self.memo = {}
        else:
            self.line(f"m = m{number}")
            self._restore(saved, (statement,))

    def _round(self, statement: t.For | t.While | t.Repeat, number: str) -> None:
        """The body of a loop, with the lanes of CONTINUE back at its end."""
        self.line(f"l{number} += 1", statement.position)
        self.line(f"if l{number} > rt.limit: loop_fault(rt.limit)", statement.position)
        continues = any(t.Continue in leaves(item) for item in statement.body)
        if continues:
            self.line(f"n{number} = []")
        self.block(statement.body)
        if continues:
            self.line(f"m = join(m, join_all(n{number}, rt.lanes), rt.lanes)")
        if any(leaves(item) for item in statement.body):
            self.line("if m is EMPTY: break")
        self.memo = {}

    def _for(self, statement: t.For) -> None:
        counter, type_ = statement.variable, cast(Elementary, statement.counter.type)
        parts = [self._value(part) for part in (statement.start, statement.stop, statement.step)]
        number, after, saved = self._open_loop(statement)
        dtype = self.dtype(type_)
        for prefix, atom in zip("iep", parts, strict=True):
            self.line(
                f"{prefix}{number} = spread({f'own({atom})' if not atom.isdecimal() else atom}, m, rt.lanes, {dtype})"
            )
        calls_out = next(walk.calls(statement.body), None) is not None
        with self.indented("while True:"):
            self.line(f"c{number} = for_test(i{number}, e{number}, p{number}, m)", statement.position)
            with self.indented(f"if c{number} is not True:"):
                self.line(f"m, d{number} = split(m, c{number})")
                with self.indented(f"if d{number} is not EMPTY:"):
                    self._keep_counter(statement, number, f"d{number}")
                    if after:
                        self.line(f"w{number}.append(d{number})")
                self.line("if m is EMPTY: break")
            if calls_out:
                self._keep_counter(statement, number, "m")
            self.counters[counter] = f"i{number}"
            self._round(statement, number)
            del self.counters[counter]
            bounds = f"{type_.lower}, {type_.upper}"
            self.line(f"i{number} = advance(i{number}, p{number}, m, rt.lanes, {bounds})", statement.position)
        self._close_loop(statement, number, after, saved)

    def _keep_counter(self, loop: t.For, number: str, lanes: str) -> None:
        """Give the counter's variable its value in some lanes: inside of the loop it is `i`."""
        slot, dtype = self.variable_slot(loop.variable), self.dtype(loop.counter.type)
        self.line(f"{slot} = put({slot}, own(ld(i{number}, {lanes})), {lanes}, rt.lanes, {dtype})")

    def _while(self, statement: t.While | t.Repeat) -> None:
        number, after, saved = self._open_loop(statement)
        with self.indented("while True:"):
            if isinstance(statement, t.Repeat):
                self._round(statement, number)
            self.position = statement.condition.position
            condition = self._value(statement.condition)
            order = f"d{number}, m" if isinstance(statement, t.Repeat) else f"m, d{number}"
            self.line(f"{order} = split(m, {condition})")
            if after:
                self.line(f"w{number}.append(d{number})")
            self.line("if m is EMPTY: break")
            self.memo = {}
            if isinstance(statement, t.While):
                self._round(statement, number)
        self._close_loop(statement, number, after, saved)

    def _leave_loop(self, kind: str) -> None:
        loop, number, after = self._loops[-1]
        if kind == "n":
            self.line(f"n{number}.append(m)")
        else:
            if isinstance(loop, t.For):
                self._keep_counter(loop, number, "m")
            if after:
                self.line(f"w{number}.append(m)")
        self.line("m = EMPTY")

    # --- expressions ---

    def expression(self, expression: t.Expression) -> str:  # noqa: PLR0911 - one return a case
        """The atom of an elementary expression."""
        match expression:
            case t.Constant():
                return literal(expression.value)
            case t.VariableRef() | t.InstanceVariable() | t.FieldRef() | t.ElementRef() | t.PointerTarget():
                return self.read(expression)
            case t.Binary():
                return self._chain(expression)
            case t.ShortCircuit():
                return self._short_circuit(expression)
            case t.Call():
                return self.call(expression)
            case t.Unary(operand=inner) | t.Conversion(operand=inner):
                return self._operation(expression, [self.expression(inner)])
            case t.Comparison() if isinstance(expression.left.type, PointerType):
                raise refusal(expression.left)
            case t.Comparison():
                return self._operation(
                    expression, [self.expression(expression.left), self.expression(expression.right)]
                )
            case t.StandardCall(arguments=arguments):
                atom = self._operation(expression, [self.expression(argument) for argument in arguments])
                if expression.function in ("SEL", "MUX", "MIN", "MAX", "LIMIT"):
                    self.aliases.add(atom)
                return atom
            case _:
                return self.address(expression)

    def _chain(self, expression: t.Binary) -> str:
        pending: list[t.Binary] = []
        current: t.Expression = expression
        while isinstance(current, t.Binary):
            pending.append(current)
            current = current.left
        atom = self.expression(current)
        for node in reversed(pending):
            atom = self._operation(node, [atom, self.expression(node.right)])
        return atom

    def _operation(self, expression: t.Expression, atoms: list[str]) -> str:
        key = operation_key(self.compiler, expression)
        name = self.source.register("o_", key, lambda: make_operation(key))
        return self.temporary(f"{name}({', '.join(atoms)})", expression.position, (name, *atoms))

    def _short_circuit(self, expression: t.ShortCircuit) -> str:
        left = self.expression(expression.left)
        before, result = self.fresh("m"), self.fresh("z")
        is_and = expression.operator == "AND_THEN"
        self.line(f"{before} = m")
        self.line(f"{result} = None")
        self.line(f"m = only(m, {left})" if is_and else f"m = split(m, {left})[1]")
        saved, self.memo = self.memo, {}
        with self.indented("if m is not EMPTY:"):
            right = self.expression(expression.right)
            self.line(f"{result} = {self.owned(right)}")
        self.line(f"m = {before}")
        self.memo = saved
        if has_calls(expression.right):
            self.forget(None)
        return self.temporary(f"{'and_then' if is_and else 'or_else'}({left}, {result})", expression.position)


Key = tuple[Any, ...]


def operation_key(compiler: LaneCode, expression: t.Expression) -> Key:
    """What distinguishes the operation of one node from that of another."""
    type_ = storage_type(expression.type) if not isinstance(expression.type, PointerType) else expression.type
    match expression:
        case t.Unary():
            return ("unary", expression.operator, type_, expression.overflow)
        case t.Binary():
            return ("binary", expression.operator, type_, expression.overflow)
        case t.Comparison(left=left, right=right):
            flags = tuple(not expression.is_self_test and _may_be_nan(compiler, side) for side in (left, right))
            return ("compare", expression.operator, *flags)
        case t.Conversion(operand=operand):
            return ("convert", storage_type(operand.type), type_)
        case _:
            call = cast(t.StandardCall, expression)
            return ("standard", call.function, type_, len(call.arguments))


def make_operation(key: Key) -> Any:  # noqa: PLR0911 - one return a case
    """The operation of a key."""
    match key:
        case ("unary", "NOT", type_, _):
            return vector.inversion(type_)
        case ("unary", _, type_, overflow):
            return vector.negation(type_, overflow)
        case ("binary", operator, type_, _) if operator in vector.BITWISE:
            return vector.BITWISE[operator]
        case ("binary", operator, type_, _) if type_.is_real:
            return vector.real_operation(operator, type_)
        case ("binary", "DIV" | "MOD" as operator, type_, _):
            return vector.integer_division(operator, type_)
        case ("binary", operator, type_, overflow):
            return vector.ring_operation(operator, type_, overflow)
        case ("compare", operator, left, right):
            return vector.comparison(operator, left, right)
        case ("convert", source, target):
            return vector.conversion(source, target)
        case (_, function, type_, arity):
            return vector_functions.standard_function(function, type_, arity)


def _may_be_nan(compiler: LaneCode, expression: t.Expression) -> bool:
    """False where a real number cannot be a NaN: literals, constants and tables of them."""
    if not isinstance(expression.type, Elementary) or not expression.type.is_real:
        return False
    if isinstance(expression, t.Constant) or (
        isinstance(expression, t.VariableRef) and is_inlined(expression.variable)
    ):
        return False
    return not (isinstance(expression, t.ElementRef) and compiler.constant_table(expression.base) is not None)
