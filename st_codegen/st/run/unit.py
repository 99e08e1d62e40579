"""Code of one unit: a function, a method, or the body of a block or program.

The code is an LLVM function `i32 unit(ptr c, ptr g, ptr s, ..)`: the context, the global variables,
the instance, then inputs (numbers as values, all else by address), in-outs, the result and outputs by address. It gives
0, or 1 when the context holds a fault.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

from st_codegen.st import tree as t
from st_codegen.st import walk
from st_codegen.st.check import arithmetic as a
from st_codegen.st.check.flow import overriding
from st_codegen.st.errors import Position, Problem, StCheckError
from st_codegen.st.run import operations as op
from st_codegen.st.run.layout import is_inlined, is_scalar
from st_codegen.st.run.module import Module, NativeSite
from st_codegen.st.run.prelude import context_entry
from st_codegen.st.run.writer import Operand, Writer, literal, value_type
from st_codegen.st.tree import PouKind
from st_codegen.st.types import LINT, ArrayType, Kind, PointerType, Scalar, StructType, Type, storage_type

#: Larger local variables are not put on the stack.
_STACK_BYTES = 1024


def is_body(pou: t.Pou) -> bool:
    """Whether a unit's parameters are variables of its instance."""
    return pou.kind in (PouKind.FUNCTION_BLOCK, PouKind.PROGRAM)


def parameters(pou: t.Pou) -> list[t.Variable]:
    """What the function of a unit takes, in order: inputs and in-outs, then result and outputs."""
    if is_body(pou):
        return []
    results = [] if pou.result is None else [pou.result]
    return [*pou.section(t.Section.INPUT, t.Section.IN_OUT), *results, *pou.section(t.Section.OUTPUT)]


def is_by_value(variable: t.Variable) -> bool:
    """Whether a parameter of a function travels as a number."""
    return variable.section is t.Section.INPUT and is_scalar(variable.type)


class Unit:
    """Writes the function of one unit; `called` gives the code of another one by its key."""

    def __init__(self, module: Module, pou: t.Pou, called: Callable[[str], str]) -> None:
        self.module = module
        self.pou = pou
        self._called = called
        self.w = Writer(module.sites, module.functions)
        self._addresses: dict[t.Variable, str] = {}
        self._counters: dict[t.Variable, str] = {}
        self._loops: list[tuple[str, str]] = []  # labels of CONTINUE and EXIT
        self._kept = _referenced(pou)
        self._copied: list[tuple[t.Variable, str]] = []

    def text(self, is_internal: bool) -> str:
        """The whole function; an internal one is called in its module only."""
        pou, w = self.pou, self.w
        names = [f"%a.{number}" for number in range(len(parameters(pou)))]
        kinds = [value_type(item.type) if is_by_value(item) else "ptr" for item in parameters(pou)]
        given = "".join(f", {kind} {name}" for kind, name in zip(kinds, names, strict=True))
        for variable, name in zip(parameters(pou), names, strict=True):
            self._take(variable, name)
        for variable in pou.variables:
            if variable.storage is t.Storage.LOCAL and variable not in self._addresses and not variable.is_constant:
                self._addresses[variable] = self._room(variable)
                self._initialise(variable)
        self._statements(pou.body)
        w.jump("done")
        w.begin("done")
        for variable, target in self._copied:
            w.copy(target, self._addresses[variable], self.module.layout.size_of(variable.type))
        w.line("ret i32 0")
        linkage = "internal " if is_internal else ""
        head = f'define {linkage}i32 @"u.{pou.key}"(ptr %c, ptr %g, ptr %s{given}) {{'
        return "\n".join([head, *w.body(), "}"])

    # --- local variables ---

    def _take(self, variable: t.Variable, name: str) -> None:
        """A parameter: what is given, or where the result is wanted."""
        if variable.section is t.Section.IN_OUT:
            self._addresses[variable] = name
        elif variable.section is t.Section.INPUT:
            self._addresses[variable] = self._room(variable)
            if is_by_value(variable):
                self.w.store(variable.type, name, self._addresses[variable])
            else:
                self.w.copy(self._addresses[variable], name, self.module.layout.size_of(variable.type))
        else:
            self._addresses[variable] = name
            if variable in self._kept:
                self._addresses[variable] = self._room(variable)
                self._copied.append((variable, name))
            self._initialise(variable)

    def _room(self, variable: t.Variable) -> str:
        """Memory for a local variable; a block may keep the address of one that is passed to it."""
        size = self.module.layout.size_of(variable.type)
        if variable in self._kept or size > _STACK_BYTES:
            return self._framed(size)
        is_plain = is_scalar(variable.type) and value_type(variable.type) != "i1"
        return self.w.slot(value_type(variable.type)) if is_plain else self.w.local(size)

    def _framed(self, size: int) -> str:
        """Memory of the row that stays where it is: no unit runs twice at the same time, for there is no recursion."""
        frame = self.w.value(f"load ptr, ptr {self.w.value(context_entry('frame'))}")
        return self.w.offset(frame, self.module.reserve(size))

    def _temporary(self, type_: Type) -> str:
        return self._bytes(self.module.layout.size_of(type_))

    def _bytes(self, size: int) -> str:
        return self._framed(size) if size > _STACK_BYTES else self.w.local(size)

    def _initialise(self, variable: t.Variable) -> None:
        type_, address = variable.type, self._addresses[variable]
        if is_scalar(type_):
            self.w.store(type_, literal(cast(Scalar, variable.initial), type_), address)
        else:
            image = self.module.layout.image(type_, variable.initial)
            self.w.copy(address, self.module.data(image), len(image))

    # --- places ---

    def address(self, place: t.Expression) -> str:  # noqa: PLR0911 - one return a case
        """Where a variable, or a value that is not a number, is."""
        match place:
            case t.VariableRef():
                return self._variable(place)
            case t.ThisRef():
                return "%s"
            case t.ProgramRef():
                self.module.uses_programs = True
                programs = self.w.value(f"load ptr, ptr {self.w.value(context_entry('program'))}")
                return self.w.offset(programs, self.module.layout.programs[str(place.type).upper()])
            case t.InstanceVariable():
                if place.variable.is_constant:
                    return self.module.table(place.variable)
                return self._member(self.address(place.base), place.base.type, place.variable.key)
            case t.FieldRef():
                return self._member(self.address(place.base), place.base.type, place.name)
            case t.ElementRef():
                return self._element(place)
            case t.Constant() if not is_scalar(place.type):
                return self.module.data(self.module.layout.image(place.type, place.value))
            case t.Call() | t.Conversion() | t.StandardCall() if not is_scalar(place.type):
                return self.expression(place)
            case _:
                raise refusal(place)

    def _variable(self, place: t.VariableRef) -> str:
        variable = place.variable
        if variable.is_constant:
            return self.module.table(variable)
        if variable.storage is t.Storage.GLOBAL:
            return self.w.offset("%g", self.module.layout.globals[variable])
        if variable.storage is t.Storage.LOCAL:
            return self._addresses[variable]
        return self._member("%s", self.module.instance_type(self.pou), variable.key)

    def _member(self, base: str, owner: Type, name: str) -> str:
        """A variable of an instance, or a field; a VAR_IN_OUT is read where it is set, in the body, only."""
        member = self.module.layout.record(cast(StructType, owner)).members[name]
        address = self.w.offset(base, member.offset)
        return self.w.value(f"load ptr, ptr {address}") if member.is_reference else address

    def _element(self, place: t.ElementRef) -> str:
        type_ = cast(ArrayType, place.base.type)
        base, flat = self.address(place.base), "0"
        for item, (low, high) in zip(place.indices, type_.bounds, strict=True):
            part = self._index(item, low, high)
            if flat != "0":
                part = self.w.value(f"add i64 {self.w.value(f'mul i64 {flat}, {high - low + 1}')}, {part}")
            flat = part
        stride = self.module.layout.stride(type_)
        return self.w.value(f"getelementptr inbounds [{stride} x i8], ptr {base}, i64 {flat}")

    def _index(self, item: t.Expression, low: int, high: int) -> str:
        """A checked index, counted from zero."""
        if isinstance(item, t.Constant) and low <= cast(int, item.value) <= high:
            return str(cast(int, item.value) - low)
        index = self.operand(item)
        part = self.w.wide(index)
        if low:
            part = self.w.value(f"sub i64 {part}, {low}")
        outside = self.w.value(f"icmp uge i64 {part}, {high - low + 1}")
        self.w.trap(outside, a.INDEX, item.position, (index,), f"{{0}} is outside of {low}..{high}")
        return part

    # --- expressions ---

    def operand(self, expression: t.Expression) -> Operand:
        """The value of an expression with its type."""
        return Operand(self.expression(expression), storage_type(expression.type))

    def expression(self, node: t.Expression) -> str:  # noqa: PLR0911 - one return a case
        """The value of an expression: a number, or the address of what is not one."""
        if isinstance(node.type, PointerType):
            raise refusal(node)
        match node:
            case t.Constant() if is_scalar(node.type):
                return literal(node.value, node.type)
            case t.Unary():
                x, type_ = self.operand(node.operand), storage_type(node.type)
                if node.operator == "NOT":
                    return op.inversion(self.w, type_, x.code)
                return op.negation(self.w, type_, node.overflow, x, node.position)
            case t.Binary() | t.ShortCircuit():
                return self._chain(node)
            case t.Compare():
                return self._comparison(node)
            case t.Conversion():
                return self._conversion(node)
            case t.StandardCall():
                arguments = [self.operand(argument) for argument in node.arguments]
                return op.function(self.w, node.function, storage_type(node.type), arguments, node.position)
            case t.Call():
                return self.call(node)
            case t.PointerTarget() | t.AddressOf():
                raise refusal(node)
            case _:
                return self._read(node)

    def _read(self, place: t.Expression) -> str:
        if isinstance(place, t.VariableRef | t.InstanceVariable):
            if is_inlined(place.variable):
                return literal(cast(Scalar, place.variable.initial), place.type)
            if isinstance(place, t.VariableRef) and place.variable in self._counters:
                return self._counters[place.variable]
        address = self.address(place)
        if not is_scalar(place.type):
            return address
        root = t.root_variable(place)
        return self.w.load(place.type, address, root is not None and root.is_constant)

    def _chain(self, node: t.Binary | t.ShortCircuit) -> str:
        """Operators in a row, of any length, from left to right."""
        pending: list[t.Binary | t.ShortCircuit] = []
        current: t.Expression = node
        while isinstance(current, t.Binary | t.ShortCircuit):
            pending.append(current)
            current = current.left
        result = self.operand(current)
        for step in reversed(pending):
            type_ = storage_type(step.type)
            if isinstance(step, t.ShortCircuit):
                code = self._short_circuit(step, result.code)
            else:
                right = self.operand(step.right)
                code = op.binary(self.w, step.operator, type_, step.overflow, result, right, step.position)
            result = Operand(code, type_)
        return result.code

    def _short_circuit(self, node: t.ShortCircuit, left: str) -> str:
        w, slot, more, done = self.w, self.w.slot("i1"), self.w.label(), self.w.label()
        w.line(f"store i1 {left}, ptr {slot}")
        labels = (more, done) if node.operator == "AND_THEN" else (done, more)
        w.branch(left, *labels)
        w.begin(more)
        w.line(f"store i1 {self.expression(node.right)}, ptr {slot}")
        w.jump(done)
        w.begin(done)
        return w.value(f"load i1, ptr {slot}")

    def _comparison(self, node: t.Compare) -> str:
        left, right = self.operand(node.left), self.operand(node.right)
        if left.type.kind is Kind.STRING:
            raise refusal(node, "strings are moved but not compared")
        return op.comparison(self.w, node.operator, left, right, node.position, node.is_number_test)

    def _conversion(self, node: t.Conversion) -> str:
        value, target = self.operand(node.operand), storage_type(node.type)
        if target.kind is not Kind.STRING:
            return op.conversion(self.w, value, target, node.position)
        layout, made = self.module.layout, self._temporary(target)
        size, given = layout.size_of(target), layout.size_of(value.type)
        self.w.line(f"call void @llvm.memset.p0.i64(ptr {made}, i8 0, i64 {size}, i1 false)")
        self.w.copy(made, value.code, min(size, given))
        return made

    # --- calls ---

    def call(self, node: t.Call) -> str:
        """Call a unit; the value of its result, of no use where there is none."""
        callee = self.module.project.pous[node.callee]
        if (
            node.is_virtual
            and not _is_exact(node.receiver)
            and overriding(self.module.project, callee.key) - {callee.key}
        ):
            raise refusal(
                node, f"'{callee.name}' has more than one meaning here: calls of what is overridden do not run"
            )
        receiver = "null" if node.receiver is None else self.address(node.receiver)
        given = {item.parameter: item.value for item in node.arguments}
        if is_body(callee):
            self._call_body(node, receiver, given)
            return "undef"
        values = {item: self._argument(item, given.get(item)) for item in parameters(callee)}
        self._invoke(node.callee, receiver, values, given)
        for variable in callee.section(t.Section.OUTPUT):
            if variable in given:
                self._assign(given[variable], self._loaded(variable.type, values[variable]))
        return "undef" if callee.result is None else self._loaded(callee.result.type, values[callee.result])

    def _loaded(self, type_: Type, address: str) -> str:
        return self.w.load(type_, address) if is_scalar(type_) else address

    def _argument(self, variable: t.Variable, given: t.Expression | None) -> str:
        """What a function is given for a parameter: a value, or an address."""
        if variable.section not in (t.Section.INPUT, t.Section.IN_OUT):
            return self._temporary(variable.type)
        if isinstance(variable.type, PointerType):
            if isinstance(given, t.AddressOf):
                return self.address(given.target)
            if isinstance(given, t.Constant) or given is None:
                return "null"
            raise refusal(given)
        if given is None:
            if is_scalar(variable.type):
                return literal(cast(Scalar, variable.initial), variable.type)
            return self.module.data(self.module.layout.image(variable.type, variable.initial))
        return self.expression(given) if is_by_value(variable) else self.address(given)

    def _call_body(self, node: t.Call, receiver: str, given: dict[t.Variable, t.Expression]) -> None:
        """Inputs go into the instance, the body runs, outputs come out of it."""
        members = self.module.layout.record(cast(StructType, cast(t.Expression, node.receiver).type)).members
        slots = {variable: self.w.offset(receiver, members[variable.key].offset) for variable in given}
        for variable, value in given.items():
            if variable.section is t.Section.IN_OUT:
                self.w.line(f"store ptr {self.address(value)}, ptr {slots[variable]}")
            elif variable.section is t.Section.INPUT:
                self._put(variable.type, slots[variable], self.expression(value))
        self._invoke(node.callee, receiver, {}, given)
        for variable, value in given.items():
            if variable.section is t.Section.OUTPUT:
                self._assign(value, self._loaded(variable.type, slots[variable]))

    def _invoke(
        self, key: str, receiver: str, values: dict[t.Variable, str], given: dict[t.Variable, t.Expression]
    ) -> None:
        callee = self.module.project.pous[key]
        in_machine_code = self.w.functions.get(f"block.{key}")
        if callee.is_native and in_machine_code is None:
            self._call_native(callee, receiver, list(values.items()), given)
            return
        arguments = "".join(
            f", {value_type(item.type) if is_by_value(item) else 'ptr'} {value}" for item, value in values.items()
        )
        code = in_machine_code or self._called(key)
        status = self.w.value(f"call i32 {code}(ptr %c, ptr %g, ptr {receiver}{arguments})")
        self.w.propagate(status)

    def _call_native(
        self,
        callee: t.Pou,
        receiver: str,
        values: list[tuple[t.Variable, str]],
        given: dict[t.Variable, t.Expression],
    ) -> None:
        """Everything the unit may see is copied into a frame, and back from there."""
        w = self.w
        pointees = {
            item: cast(t.AddressOf, given[item]).target.type
            for item, value in values
            if isinstance(item.type, PointerType) and value != "null"
        }
        site = self.module.native_site(callee, [item for item, _ in values], pointees)
        frame = self._bytes(site.size)
        w.line(f"call void @llvm.memset.p0.i64(ptr {frame}, i8 0, i64 {site.size}, i1 false)")
        w.line(f"store ptr {receiver}, ptr {frame}")
        back: list[tuple[str, str, int]] = []
        for item, value in values:
            if item in pointees or not isinstance(item.type, PointerType):
                self._into_frame(item, value, w.offset(frame, site.offsets[item.key]), site, back)
        if site.block is not None:
            size = self.module.layout.size_of(site.block)
            inside = w.offset(frame, site.block_offset)
            w.copy(inside, receiver, size)
            back.append((receiver, inside, size))
        w.propagate(
            w.value(f"call i32 {w.functions['native']}(ptr %c, i64 {site.number}, ptr {frame}, i64 {site.size})")
        )
        for target, source, size in back:
            w.copy(target, source, size)

    def _into_frame(
        self, item: t.Variable, value: str, place: str, site: NativeSite, back: list[tuple[str, str, int]]
    ) -> None:
        size = self.module.layout.size_of(site.types[item.key])
        if item.section is t.Section.INPUT and not isinstance(item.type, PointerType):
            self._put(item.type, place, value)
            return
        if item.section is not t.Section.INPUT and item.section is not t.Section.IN_OUT:
            image = self.module.layout.image(item.type, item.initial)
            self.w.copy(place, self.module.data(image), size)
        else:
            self.w.copy(place, value, size)
        back.append((value, place, size))

    # --- statements ---

    def _put(self, type_: Type, address: str, value: str) -> None:
        """Assign a value of the same type."""
        if is_scalar(type_):
            self.w.store(type_, value, address)
        else:
            self.w.copy(address, value, self.module.layout.size_of(type_))

    def _assign(self, target: t.Expression, value: str) -> None:
        if isinstance(target.type, PointerType):
            raise refusal(target)
        self._put(target.type, self.address(target), value)

    def _statements(self, body: tuple[t.Statement, ...]) -> None:
        for statement in body:
            self._statement(statement)

    def _statement(self, statement: t.Statement) -> None:
        match statement:
            case t.Assign():
                self._assign(statement.target, self.expression(statement.value))
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
                self.w.leave(self._loops[-1][1])
            case t.Continue():
                self.w.leave(self._loops[-1][0])
            case t.Return():
                self.w.leave("done")

    def _if(self, statement: t.If) -> None:
        w, done = self.w, self.w.label()
        for branch in statement.branches:
            then, otherwise = w.label(), w.label()
            w.branch(self.expression(branch.condition), then, otherwise)
            w.begin(then)
            self._statements(branch.body)
            w.jump(done)
            w.begin(otherwise)
        self._statements(statement.otherwise)
        w.jump(done)
        w.begin(done)

    def _case(self, statement: t.Case) -> None:
        w, done = self.w, self.w.label()
        selector = self.operand(statement.selector)
        kind = value_type(selector.type)
        for branch in statement.branches:
            then, otherwise = w.label(), w.label()
            for low, high in branch.labels:
                distance = w.value(f"sub {kind} {selector.code}, {low}")
                following = w.label()
                w.branch(w.value(f"icmp ule {kind} {distance}, {high - low}"), then, following)
                w.begin(following)
            w.jump(otherwise)
            w.begin(then)
            self._statements(branch.body)
            w.jump(done)
            w.begin(otherwise)
        self._statements(statement.otherwise)
        w.jump(done)
        w.begin(done)

    def _for(self, statement: t.For) -> None:
        """The counter is stored before each test, and known inside, where nothing assigns it."""
        w, counter, type_ = self.w, statement.counter, storage_type(statement.counter.type)
        kind = value_type(type_)
        start, stop, step = (self.expression(part) for part in (statement.start, statement.stop, statement.step))
        if not isinstance(statement.step, t.Constant) or not statement.step.value:
            w.trap(w.value(f"icmp eq {kind} {step}, 0"), a.STEP, statement.position, (Operand("0", type_),))
        slot, address = w.slot(kind), self.address(counter)
        w.line(f"store {kind} {start}, ptr {slot}")
        head, inside, following, done = (w.label() for _ in range(4))
        rounds = None if _has_few_rounds(statement, self.module.loop_limit) else self._count_rounds()
        w.jump(head)
        w.begin(head)
        now = w.value(f"load {kind}, ptr {slot}")
        w.line(f"store {kind} {now}, ptr {address}")
        sign = "s" if type_.is_signed else "u"
        upwards = w.value(f"icmp {sign}le {kind} {now}, {stop}")
        downwards = w.value(f"icmp {sign}ge {kind} {now}, {stop}")
        rising = w.value(f"icmp {sign}gt {kind} {step}, 0")
        w.branch(w.value(f"select i1 {rising}, i1 {upwards}, i1 {downwards}"), inside, done)
        w.begin(inside)
        if rounds is not None:
            self._check_rounds(rounds, statement.position)
        self._counters[statement.variable] = now
        self._loops.append((following, done))
        self._statements(statement.body)
        self._loops.pop()
        self._counters.pop(statement.variable)  # no loop inside has the same one: that would assign it
        w.jump(following)
        w.begin(following)
        w.line(f"store {kind} {w.value(f'add {kind} {now}, {step}')}, ptr {slot}")
        w.jump(head)
        w.begin(done)

    def _while(self, statement: t.While | t.Repeat) -> None:
        """REPEAT enters behind the test; CONTINUE gets to the test of both."""
        w = self.w
        test, inside, done = w.label(), w.label(), w.label()
        rounds = self._count_rounds()
        w.jump(inside if isinstance(statement, t.Repeat) else test)
        w.begin(test)
        condition = self.expression(statement.condition)
        ways = (done, inside) if isinstance(statement, t.Repeat) else (inside, done)
        w.branch(condition, *ways)
        w.begin(inside)
        self._check_rounds(rounds, statement.position)
        self._loops.append((test, done))
        self._statements(statement.body)
        self._loops.pop()
        w.jump(test)
        w.begin(done)

    def _count_rounds(self) -> str:
        slot = self.w.slot("i64")
        self.w.line(f"store i64 0, ptr {slot}")
        return slot

    def _check_rounds(self, slot: str, at: Position) -> None:
        w, limit = self.w, self.module.loop_limit
        done = w.value(f"load i64, ptr {slot}")
        operand = Operand(str(limit), LINT)
        w.trap(w.value(f"icmp uge i64 {done}, {limit}"), a.LOOP, at, (operand,), f"more than {limit} rounds")
        w.line(f"store i64 {w.value(f'add i64 {done}, 1')}, ptr {slot}")


def _has_few_rounds(statement: t.For, limit: int) -> bool:
    """Whether a loop with constant bounds ends by itself within the limit."""
    parts = [part.value for part in (statement.start, statement.stop, statement.step) if isinstance(part, t.Constant)]
    if len(parts) < 3 or not parts[2]:
        return False
    start, stop, step = (int(cast(int, part)) for part in parts)
    counter = range(start, stop + (1 if step > 0 else -1), step)
    return len(counter) <= limit and (not counter or storage_type(statement.counter.type).holds(counter[-1] + step))


def _referenced(pou: t.Pou) -> set[t.Variable]:
    """The local variables of a unit that are passed by reference."""
    found: set[t.Variable] = set()
    for call in walk.calls(pou.body):
        for item in call.arguments:
            root = t.root_variable(item.value) if item.passing is t.Passing.IN_OUT else None
            if root is not None and root.storage is t.Storage.LOCAL and root.section is not t.Section.IN_OUT:
                found.add(root)
    return found


def _is_exact(receiver: t.Expression | None) -> bool:
    """Whether an instance is of the block that is declared: THIS^ and a VAR_IN_OUT may be of one that extends it."""
    if isinstance(receiver, t.VariableRef | t.InstanceVariable):
        return receiver.variable.section is not t.Section.IN_OUT
    return not isinstance(receiver, t.ThisRef)


_POINTERS = "pointers and references are checked but not executed; only native blocks can take them"


def refusal(place: t.Expression, message: str = _POINTERS) -> StCheckError:
    """What the engine says to text that is checked but that it does not run."""
    return StCheckError([Problem(place.position, message)])
