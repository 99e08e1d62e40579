"""Expressions and calls in the code for a single lane.

Sums, differences and products of LREAL values are written as one Python expression. Whatever goes wrong inside shows
in its value, which is an infinity or a NaN then, so one test of the result is enough; where it fails, the expression
is evaluated again operation by operation, by the leaves that are still there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from st_codegen.st import tree as t
from st_codegen.st.check import arithmetic as a
from st_codegen.st.check.arithmetic import Fault
from st_codegen.st.check.constants import convert
from st_codegen.st.errors import Position
from st_codegen.st.run.emit import literal
from st_codegen.st.run.lane_places import is_elementary, refusal
from st_codegen.st.run.scalar_places import ScalarPlaces
from st_codegen.st.tree import PouKind
from st_codegen.st.types import BOOL, LREAL, REAL, Elementary, Kind, PointerType, storage_type

_SYMBOLS = {"ADD": "+", "SUB": "-", "MUL": "*", "DIV": "/", "AND": "&", "OR": "|", "XOR": "^"}
_COMPARISONS = {"EQ": "==", "NE": "!=", "LT": "<", "LE": "<=", "GT": ">", "GE": ">="}
_REAL = {"ADD": a.real_add, "SUB": a.real_sub, "MUL": a.real_mul, "DIV": a.real_div}
_SHIFTS = {"SHL": a.shift_left, "SHR": a.shift_right, "ROL": a.rotate_left, "ROR": a.rotate_right}
# Python's parser nests deeper, but not without limit
_LONGEST = 40

Node = tuple[Any, ...]


def retrace(node: Node, leaves: tuple[float, ...]) -> float:
    """Evaluate an expression operation by operation. Raises `Fault` with the position of the operation."""
    pending: list[Node] = []
    while len(node) == 4:
        pending.append(node)
        node = node[2]
    value = leaves[node[1]] if node[0] == "leaf" else -retrace(node[1], leaves)
    for operator, position, _, right in reversed(pending):
        operand = retrace(right, leaves)
        try:
            value = _REAL[operator](value, operand)
        except Fault as fault:
            fault.position = position
            raise
    return value


class ScalarExpressions(ScalarPlaces):
    """Writes expressions."""

    def expression(self, expression: t.Expression) -> str:  # noqa: PLR0911 - one return a case
        """Code for the value of an elementary expression."""
        match expression:
            case t.Constant():
                return literal(expression.value)
            case t.VariableRef() | t.InstanceVariable() | t.FieldRef() | t.ElementRef() | t.PointerTarget():
                return self.read(expression)
            case t.Binary() | t.Unary():
                return self._operator(expression)
            case t.Comparison():
                return self._comparison(expression)
            case t.ShortCircuit():
                return self._short_circuit(expression)
            case t.Conversion():
                return self._conversion(expression)
            case t.StandardCall():
                return self._standard(expression)
            case t.Call():
                return self.call(expression)
            case t.AddressOf():
                return self.temporary(self.reference(expression.target), expression.position)
            case _:
                raise refusal(expression)

    def _call_helper(self, function: Callable[..., Any], position: Position, *codes: str) -> str:
        """A temporary for a call of a Python function that may raise a `Fault` here."""
        name = self.source.register("f_", function, lambda: function)
        return self.temporary(f"{name}({', '.join(codes)})", position)

    # --- operators ---

    def _operator(self, expression: t.Binary | t.Unary) -> str:
        type_ = storage_type(expression.type)
        if type_ is LREAL:
            return self._real_tree(expression)
        if isinstance(expression, t.Unary):
            return self._unary(expression, type_)
        pending: list[t.Binary] = []
        current: t.Expression = expression
        while isinstance(current, t.Binary) and storage_type(current.type) is type_:
            pending.append(current)
            current = current.left
        code = self.expression(current)
        for node in reversed(pending):
            code = self._binary(node, type_, code)
        return code

    def _binary(self, node: t.Binary, type_: Elementary, left: str) -> str:
        where = node.position
        if type_ is REAL:
            function = self.compiler.cached_operation(("single", node.operator), lambda: a.single(_REAL[node.operator]))
            return self._call_helper(function, where, left, self.expression(node.right))
        if node.operator in ("AND", "OR", "XOR"):
            right = self.expression(node.right)
            return self.temporary(f"{left} {_SYMBOLS[node.operator]} {right}", where)
        if node.operator in ("DIV", "MOD"):
            return self._division(node, type_, left)
        right = self.expression(node.right)
        result = self.temporary(f"{left} {_SYMBOLS[node.operator]} {right}", where)
        self._fit(result, self.exact_range(node), type_, node.overflow, where, f"{left}, {right}")
        return result

    def _fit(
        self,
        result: str,
        bounds: tuple[int, int],
        type_: Elementary,
        overflow: t.Overflow,
        where: Position,
        operands: str,
    ) -> None:
        """Bring an integer back into its type, where it may have left it."""
        tests = []
        if bounds[0] < type_.lower:
            tests.append(f"{result} < {type_.lower}")
        if bounds[1] > type_.upper:
            tests.append(f"{result} > {type_.upper}")
        if not tests:
            return
        if overflow is t.Overflow.ERROR:
            action = f"overflow_fault({self.place_id(where)}, {operands})"
        else:
            lower, mask = type_.lower, type_.upper - type_.lower
            action = f"{result} = (({result} - {lower}) & {mask}) + {lower}" if lower else f"{result} &= {mask}"
        self.line(f"if {' or '.join(tests)}: {action}", where)

    def _division(self, node: t.Binary, type_: Elementary, left: str) -> str:
        single = a.integer_div if node.operator == "DIV" else a.integer_mod
        lower, upper = type_.lower, type_.upper

        def divide(x: int, y: int) -> int:
            if y < lower:
                raise Fault(a.INTEGER_OVERFLOW, (x, y))
            return single(x, y, upper)

        function = self.compiler.cached_operation(("divide", node.operator, type_), lambda: divide)
        return self._call_helper(function, node.position, left, self.expression(node.right))

    def _unary(self, expression: t.Unary, type_: Elementary) -> str:
        where = expression.position
        operand = self.expression(expression.operand)
        if type_ is BOOL:
            return self.temporary(f"not {operand}", where)
        if type_.is_real:
            return self.temporary(f"-{operand}", where)
        if expression.operator == "NOT":
            return self.temporary(f"~{operand}" if type_.is_signed else f"{operand} ^ {type_.upper}", where)
        low, high = self.range_of(expression.operand)
        result = self.temporary(f"-{operand}", where)
        self._fit(result, (-high, -low), type_, expression.overflow, where, f"0, {operand}")
        return result

    # --- LREAL ---

    def _real_tree(self, expression: t.Expression) -> str:
        leaves: list[str] = []
        code, node = self._raw(expression, leaves)
        result = self.temporary(code, expression.position)
        if _has_operation(node):
            name = self.source.register("r_", object(), lambda: lambda *values: retrace(node, values))
            self.line(f"if {result} - {result}: {result} = {name}({', '.join(leaves)})", expression.position)
        return result

    def _raw(self, expression: t.Expression, leaves: list[str]) -> tuple[str, Node]:
        """Unchecked code for a tree of operators, and the tree over its leaves."""
        if isinstance(expression, t.Unary):
            code, node = self._raw(expression.operand, leaves)
            return f"-({code})", ("NEG", node)
        if not isinstance(expression, t.Binary):
            leaves.append(self.expression(expression))
            return leaves[-1], ("leaf", len(leaves) - 1)
        pending: list[t.Binary] = []
        current: t.Expression = expression
        while isinstance(current, t.Binary):
            pending.append(current)
            current = current.left
        code, node = self._raw(current, leaves)
        is_sum = False
        for count, item in enumerate(reversed(pending), start=1):
            if item.operator == "DIV":
                code, node = self._quotient(item, code, node, leaves)
                is_sum = False
                continue
            right, right_node = self._raw(item.right, leaves)
            is_sum, was_sum = item.operator in ("ADD", "SUB"), is_sum
            left = f"({code})" if was_sum and not is_sum else code
            code = f"{left} {_SYMBOLS[item.operator]} {f'({right})' if ' ' in right else right}"
            node = (item.operator, item.position, node, right_node)
            if count % _LONGEST == 0:
                code, is_sum = self.temporary(code, item.position), False
        return code, node

    def _quotient(self, item: t.Binary, code: str, node: Node, leaves: list[str]) -> tuple[str, Node]:
        """A division: an infinite divisor would hide what went wrong in it, so its value is checked by itself."""
        divisor = self.atom(item.right)
        leaves.append(divisor)
        quotient: Node = ("DIV", item.position, node, ("leaf", len(leaves) - 1))
        is_safe = isinstance(item.right, t.Constant) and item.right.value != 0.0
        if is_safe:
            return f"({code}) / {divisor}", quotient
        dividend = self.temporary(code, item.position)
        return f"({dividend} / {divisor} if {divisor} else {dividend} * NAN)", quotient

    # --- comparisons ---

    def _comparison(self, expression: t.Comparison) -> str:
        where, symbol = expression.position, _COMPARISONS[expression.operator]
        left_type = expression.left.type
        is_real = isinstance(left_type, Elementary) and left_type.is_real and not expression.is_self_test
        if isinstance(left_type, PointerType):
            raise refusal(expression.left)
        if not is_real:
            left, right = self.expression(expression.left), self.expression(expression.right)
            return f"({left} {symbol} {right})"
        left, right = self.atom(expression.left), self.atom(expression.right)
        unordered = [f"{x} != {x}" for x in dict.fromkeys((left, right)) if x.isidentifier()]
        if not unordered:
            return f"({left} {symbol} {right})"
        # A comparison that holds has no NaN in it, except <>, which holds for them
        test = f"({' or '.join(unordered)}) and nan_fault({self.place_id(where)}, {left}, {right})"
        code = f"{left} != {right} and not ({test})" if symbol == "!=" else f"{left} {symbol} {right} or {test}"
        return self.temporary(code, where)

    def _short_circuit(self, expression: t.ShortCircuit) -> str:
        result = self.temporary(self.expression(expression.left), expression.position)
        header = f"if {result}:" if expression.operator == "AND_THEN" else f"if not {result}:"
        with self.branch(), self.indented(header):
            self.line(f"{result} = {self.expression(expression.right)}", expression.right.position)
        return result

    # --- conversions and standard functions ---

    def _conversion(self, expression: t.Conversion) -> str:  # noqa: PLR0911 - one return a case
        source, target = storage_type(expression.operand.type), storage_type(expression.type)
        where = expression.position
        code = self.expression(expression.operand)
        if source == target or (source is REAL and target is LREAL):
            return code
        if target.kind is Kind.STRING:
            return code if source.bits <= target.bits else self.temporary(f"{code}[:{target.bits}]", where)
        if target is BOOL and not source.is_real:
            return f"({code} != 0)"
        if source is BOOL:
            return self.temporary(f"{'float' if target.is_real else 'int'}({code})", where)
        if source.is_integral and target is LREAL:
            return self.temporary(f"float({code})", where)
        if source.is_integral and target.is_integral:
            low, high = self.range_of(expression.operand)
            if target.lower <= low and high <= target.upper:
                return code
            result = self.temporary(code, where)
            self._fit(result, (low, high), target, t.Overflow.WRAP, where, code)
            return result
        if (source, target) == (LREAL, REAL):
            return self._call_helper(a.to_single, where, code)
        function = self.compiler.cached_operation((source, target), lambda: lambda x: convert(x, source, target))
        return self._call_helper(function, where, code)

    def _standard(self, expression: t.StandardCall) -> str:  # noqa: PLR0911 - one return a case
        name, where, type_ = expression.function, expression.position, storage_type(expression.type)
        codes = [self.atom(argument) for argument in expression.arguments]
        if name in a.FUNCTIONS or name in ("EXPT", "ATAN2"):
            function: Callable[..., Any] = a.FUNCTIONS.get(name) or {"EXPT": a.expt, "ATAN2": a.atan2}[name]
            if type_ is REAL:
                plain = function
                function = self.compiler.cached_operation(("single", name), lambda: a.single(plain))
            return self._call_helper(function, where, *codes)
        match name:
            case "ABS":
                if not type_.is_real and type_.is_signed and self.range_of(expression.arguments[0])[0] == type_.lower:
                    self.line(
                        f"if {codes[0]} == {type_.lower}: overflow_fault({self.place_id(where)}, {codes[0]})", where
                    )
                return self.temporary(f"abs({codes[0]})", where)
            case "TRUNC":
                return self._call_helper(a.truncate, where, codes[0], str(type_.lower), str(type_.upper))
            case "SEL":
                return self.temporary(f"{codes[2]} if {codes[0]} else {codes[1]}", where)
            case "MUX":
                return self._call_helper(_mux, where, *codes)
            case "MIN" | "MAX":
                result = codes[0]
                for other in codes[1:]:
                    result = self._extreme(name, type_, result, other, where)
                return result
            case "LIMIT":
                raised = self._extreme("MAX", type_, codes[1], codes[0], where)
                return self._extreme("MIN", type_, raised, codes[2], where)
            case _:
                return self._shift(expression, type_, codes)

    def _extreme(self, name: str, type_: Elementary, first: str, second: str, where: Position) -> str:
        symbol, other = ("<", "<=") if name == "MIN" else (">", ">=")
        if not type_.is_real:
            return self.temporary(f"{second} if {second} {symbol} {first} else {first}", where)
        fault = f"nan_fault({self.place_id(where)}, {first}, {second})"
        return self.temporary(
            f"{second} if {second} {symbol} {first} else {first} if {first} {other} {second} else {fault}", where
        )

    def _shift(self, expression: t.StandardCall, type_: Elementary, codes: list[str]) -> str:
        single, bits = _SHIFTS[expression.function], type_.bits
        mask, is_arithmetic = (1 << bits) - 1, expression.function == "SHR" and type_.is_signed

        def shift(x: int, n: int) -> int:
            return a.wrap(single(x if is_arithmetic else x & mask, n, bits, mask), type_.lower, type_.upper)

        function = self.compiler.cached_operation((expression.function, type_), lambda: shift)
        return self._call_helper(function, expression.position, *codes)

    # --- calls ---

    @property
    def is_instance_unit(self) -> bool:
        """Whether the unit is a body of a block or program."""
        return self.pou.kind in (PouKind.FUNCTION_BLOCK, PouKind.PROGRAM)

    def flush(self) -> None:
        """Give the instance what is held in local variables."""
        raise NotImplementedError

    def reload(self) -> None:
        """Take it back from there."""
        raise NotImplementedError

    def call(self, call: t.Call) -> str:
        """Write a call and return code for its result."""
        callee = self.compiler.project.pous[call.callee]
        receiver = "None" if call.receiver is None else self.object(call.receiver)
        if callee.kind in (PouKind.FUNCTION_BLOCK, PouKind.PROGRAM):
            self._call_instance(call, callee, receiver)
            return "None"
        given = {item.parameter: item for item in call.arguments}
        codes = [self._argument(p, given.get(p)) for p in callee.section(t.Section.INPUT, t.Section.IN_OUT)]
        outputs = callee.section(t.Section.OUTPUT)
        result = self.fresh()
        names = ([result] if callee.result is not None else []) + [self.fresh() for _ in outputs]
        self._invoke(call, callee, receiver, codes, f"{', '.join(names)} = " if names else "")
        for parameter, name in zip(outputs, names[len(names) - len(outputs) :], strict=True):
            if parameter in given:
                self._take(given[parameter], name)
        return result

    def _invoke(self, call: t.Call, callee: t.Pou, receiver: str, codes: list[str], target: str) -> None:
        is_own = isinstance(call.receiver, t.ThisRef)
        if is_own:
            self.flush()
        if callee.is_native:
            code = f"rt.call_native({callee.key!r}, {receiver}, ({''.join(f'{x}, ' for x in codes)}))"
        elif call.is_virtual and self.compiler.has_overrides(call.callee):
            name = callee.name.upper() if callee.block is not None else ""
            code = f"{receiver}.units[{name!r}]({', '.join(['rt', receiver, *codes])})"
        else:
            code = f"{self.compiler.function_name(call.callee)}({', '.join(['rt', receiver, *codes])})"
        self.line(target + code, call.position)
        if is_own:
            self.reload()

    def _call_instance(self, call: t.Call, callee: t.Pou, receiver: str) -> None:
        instance = self.temporary(receiver, call.position)
        for item in call.arguments:
            slot = f"{instance}.v_{item.parameter.key}"
            if item.passing is t.Passing.IN_OUT:
                self.line(f"{slot} = {self.reference(item.value)}", item.value.position)
            elif item.passing is t.Passing.INPUT and is_elementary(item.parameter.type):
                self.line(f"{slot} = {self.expression(item.value)}", item.value.position)
            elif item.passing is t.Passing.INPUT:
                self.line(f"assign({slot}, {self.object(item.value)})", item.value.position)
        self._invoke(call, callee, instance, [], "")
        for item in call.arguments:
            if item.passing is t.Passing.OUTPUT:
                self._take(item, f"{instance}.v_{item.parameter.key}")

    def _argument(self, parameter: t.Variable, item: t.Argument | None) -> str:
        if item is None:
            if is_elementary(parameter.type):
                return literal(cast(Any, parameter.initial))
            name = self.source.register("V_", parameter, lambda: parameter)
            return f"rt.make({name}.type, {name}.initial)"
        if item.passing is t.Passing.IN_OUT:
            return self.reference(item.value)
        if not is_elementary(parameter.type):
            return self.object(item.value)
        return self.expression(item.value)

    def _take(self, item: t.Argument, code: str) -> None:
        if is_elementary(item.value.type):
            self.store(item.value, code)
        else:
            self.line(f"assign({self.object(item.value)}, {code})", item.value.position)


def _has_operation(node: Node) -> bool:
    while node[0] == "NEG":
        node = node[1]
    return bool(node[0] != "leaf")


def _mux(k: int, *choices: Any) -> Any:
    if not 0 <= k < len(choices):
        raise Fault(a.INDEX, (k,), f"MUX has no input {k}")
    return choices[k]
