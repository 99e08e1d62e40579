"""Emitted Structured Text -> C, to race it against code that others generate. Part of the benchmarks, never shipped.

It translates what st-codegen emits and refuses the rest. A block becomes a structure and a function, tables become
`static const` arrays; nothing is optimised here that gcc is not told, too. `race.py` checks the result against the
engine before it takes a single time.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from st_codegen.st import tree as t
from st_codegen.st import walk
from st_codegen.st.tree import PouKind
from st_codegen.st.types import LREAL, ArrayType, BlockType, Elementary, EnumType, Kind, StructType, Type

_C_TYPES = {
    "BOOL": "uint8_t",
    "REAL": "float",
    "LREAL": "double",
    "BYTE": "uint8_t",
    "WORD": "uint16_t",
    "DWORD": "uint32_t",
    "LWORD": "uint64_t",
    "SINT": "int8_t",
    "INT": "int16_t",
    "DINT": "int32_t",
    "LINT": "int64_t",
    "USINT": "uint8_t",
    "UINT": "uint16_t",
    "UDINT": "uint32_t",
    "ULINT": "uint64_t",
}
_OPERATORS = {"ADD": "+", "SUB": "-", "MUL": "*", "DIV": "/", "MOD": "%", "AND": "&", "OR": "|", "XOR": "^"}
_COMPARISONS = {"EQ": "==", "NE": "!=", "LT": "<", "LE": "<=", "GT": ">", "GE": ">="}
_FUNCTIONS = {
    "SQRT": "sqrt",
    "EXP": "exp",
    "LN": "log",
    "LOG": "log10",
    "SIN": "sin",
    "COS": "cos",
    "TAN": "tan",
    "ATAN": "atan",
    "ASIN": "asin",
    "ACOS": "acos",
    "ATAN2": "atan2",
}
_HEAD = """#include <math.h>
#include <stdint.h>
#include <string.h>

"""


class UntranslatableError(Exception):
    """Something that st-codegen does not emit today."""


def translate(project: t.Project, block: str, symbol: str) -> str:
    """C with `void SYMBOL(const double *x, double *y)`: inputs of a block in order, and all its outputs in a row.

    Raises UntranslatableError.
    """
    return _HEAD + "\n".join(_Unit(project).whole(project.pous[block.upper()], symbol)) + "\n"


def ports(project: t.Project, block: str) -> tuple[int, int]:
    """How many numbers a block takes and gives; arrays count their elements."""
    pou = project.pous[block.upper()]
    return _width(pou, t.Section.INPUT), _width(pou, t.Section.OUTPUT)


def _width(pou: t.Pou, section: t.Section) -> int:
    return sum(v.type.size if isinstance(v.type, ArrayType) else 1 for v in pou.section(section))


def _name(key: str) -> str:
    return key.replace(".", "__")


def _number(value: Any, type_: Type) -> str:
    if isinstance(type_, EnumType):
        type_ = type_.base
    assert isinstance(type_, Elementary)
    if type_.kind is Kind.BOOL:
        return "1" if value else "0"
    if type_.is_real:
        number = float(value)
        return f"{number.hex()}{'f' if type_.bits == 32 else ''}" if number >= 0 else f"({number.hex()})"
    if type_.bits == 64:
        return f"UINT64_C({int(value)})" if int(value) >= 2**63 else f"INT64_C({int(value)})"
    return str(int(value)) if int(value) >= 0 else f"({int(value)})"


def _parts_first(type_: StructType) -> Iterator[StructType]:
    for field in type_.fields:
        element = field.type.element if isinstance(field.type, ArrayType) else field.type
        if isinstance(element, StructType):
            yield from _parts_first(element)
    yield type_


def _assigned(type_: Type, target: str, value: str) -> str:
    if isinstance(type_, ArrayType):
        return f"memcpy({target}, {value}, sizeof {target});"
    return f"{target} = {value};"


class _Unit:
    def __init__(self, project: t.Project) -> None:
        self.project = project
        self.pou: t.Pou
        self.temporaries = 0

    # --- declarations ---

    def whole(self, main: t.Pou, symbol: str) -> Iterator[str]:
        order = list(dict.fromkeys(self._callees_first(main.key)))
        structs = [type_ for type_ in self.project.types.values() if isinstance(type_, StructType)]
        for part in dict.fromkeys(part for struct in structs for part in _parts_first(struct)):
            yield self._struct(part)
        used = self._used_variables(order)
        for owner, variables in self.project.globals.items():
            for variable in variables:
                if variable in used:
                    yield self._table(variable, f"g_{owner}_{variable.key}", is_const=variable.is_constant)
        for key in order:
            self.pou = self.project.pous[key]
            if self.pou.is_native or self.pou.kind is PouKind.METHOD:
                raise UntranslatableError(f"{key}: only functions and blocks")
            for variable in self.pou.variables:
                if variable.is_constant and isinstance(variable.type, ArrayType):
                    yield self._table(variable, self._constant(variable), is_const=True)
            yield from self._code()
        yield from self._entry(main, symbol)

    def _callees_first(self, key: str) -> Iterator[str]:
        for call in walk.calls(self.project.pous[key].body):
            yield from self._callees_first(call.callee)
        for variable in self.project.pous[key].variables:
            if isinstance(variable.type, BlockType):
                yield from self._callees_first(variable.type.name.upper())
        yield key

    def _used_variables(self, units: list[str]) -> set[t.Variable]:
        bodies = (self.project.pous[key].body for key in units)
        found = (node for body in bodies for node in walk.all_expressions(body))
        return {node.variable for node in found if isinstance(node, t.VariableRef)}

    def _type(self, type_: Type) -> str:
        if isinstance(type_, EnumType):
            return self._type(type_.base)
        if isinstance(type_, Elementary) and type_.name in _C_TYPES:
            return _C_TYPES[type_.name]
        if isinstance(type_, StructType):
            return f"struct s_{type_.name.upper()}"
        if isinstance(type_, BlockType):
            return f"struct {type_.name.upper()}"
        raise UntranslatableError(f"type {type_}")

    def _declare(self, type_: Type, name: str) -> str:
        if isinstance(type_, ArrayType):
            return f"{self._type(type_.element)} {name}[{type_.size}]"
        return f"{self._type(type_)} {name}"

    def _struct(self, type_: StructType) -> str:
        fields = "\n".join(f"    {self._declare(field.type, field.name.upper())};" for field in type_.fields)
        if type_.is_union:
            fields = f"    union {{\n{fields}\n    }};"
        return f"struct s_{type_.name.upper()} {{\n{fields}\n}};"

    def _table(self, variable: t.Variable, name: str, *, is_const: bool) -> str:
        type_ = variable.type
        element = type_.element if isinstance(type_, ArrayType) else type_
        values: Any = variable.initial if isinstance(type_, ArrayType) else [variable.initial]
        if not isinstance(element, Elementary | EnumType):
            raise UntranslatableError(f"table of {element}")
        numbers = (_number(value, element) for value in np.asarray(values).tolist())
        head = f"static {'const ' if is_const else ''}{self._declare(type_, name)}"
        return f"{head} = {{{','.join(numbers)}}};" if isinstance(type_, ArrayType) else f"{head} = {next(numbers)};"

    def _constant(self, variable: t.Variable) -> str:
        return f"t_{_name(variable.owner)}_{variable.key}"

    def _code(self) -> Iterator[str]:
        pou, name = self.pou, _name(self.pou.key)
        body = self._body(pou.body, 1)
        if pou.kind is PouKind.FUNCTION:
            assert pou.result is not None
            inputs = [self._declare(v.type, f"l_{v.key}") for v in pou.section(t.Section.INPUT)]
            yield f"static {self._type(pou.result.type)} {name}({', '.join(inputs) or 'void'})\n{{"
            for variable in pou.variables:
                if variable.section is not t.Section.INPUT and not variable.is_constant:
                    yield f"    {self._declare(variable.type, f'l_{variable.key}')};"
                    yield from self._set(variable.type, f"l_{variable.key}", variable.initial)
            if pou.result not in pou.variables:
                yield f"    {self._declare(pou.result.type, f'l_{pou.result.key}')};"
            yield from body
            yield f"    return l_{pou.result.key};\n}}"
            return
        fields = [v for v in pou.variables if not v.is_constant]
        yield f"struct {name} {{"
        for variable in fields:
            yield f"    {self._declare(variable.type, variable.key)};"
        yield f"}};\nstatic void {name}__init(struct {name} *self)\n{{\n    memset(self, 0, sizeof *self);"
        for variable in fields:
            if isinstance(variable.type, BlockType):
                yield f"    {variable.type.name.upper()}__init(&self->{variable.key});"
            else:
                yield from self._set(variable.type, f"self->{variable.key}", variable.initial)
        yield f"}}\nstatic void {name}(struct {name} *self)\n{{"
        yield from body
        yield "}"

    def _set(self, type_: Type, place: str, value: Any) -> Iterator[str]:
        """Initial values other than zero."""
        if isinstance(type_, ArrayType):
            for number, entry in enumerate(np.asarray(value).tolist()):
                if entry:
                    yield f"    {place}[{number}] = {_number(entry, type_.element)};"
        elif isinstance(type_, StructType):
            yield f"    memset(&{place}, 0, sizeof {place});"
        elif not isinstance(type_, BlockType):
            yield f"    {place} = {_number(value, type_)};"

    def _entry(self, main: t.Pou, symbol: str) -> Iterator[str]:
        name = _name(main.key)
        yield f"static struct {name} instance;\nstatic int is_ready;"
        yield f"void {symbol}(const double *x, double *y)\n{{"
        yield f"    if (!is_ready) {{ {name}__init(&instance); is_ready = 1; }}"
        for at, variable in enumerate(main.section(t.Section.INPUT)):
            if isinstance(variable.type, ArrayType):
                raise UntranslatableError("an array as an input")
            yield f"    instance.{variable.key} = x[{at}];"
        yield f"    {name}(&instance);"
        at = 0
        for variable in main.section(t.Section.OUTPUT):
            if isinstance(variable.type, ArrayType):
                size = variable.type.size
                yield f"    for (int i = 0; i < {size}; i++) y[{at} + i] = instance.{variable.key}[i];"
                at += size
            else:
                yield f"    y[{at}] = instance.{variable.key};"
                at += 1
        yield "}"

    # --- statements ---

    def _body(self, body: tuple[t.Statement, ...], depth: int) -> list[str]:
        return [line for statement in body for line in self._statement(statement, depth)]

    def _statement(self, statement: t.Statement, depth: int) -> list[str]:  # noqa: PLR0911 - one return a case
        pad = "    " * depth
        match statement:
            case t.Assign(target=target, value=value):
                return [pad + _assigned(target.type, self._value(target), self._value(value))]
            case t.CallStatement(call=call):
                return [pad + line for line in self._call_statement(call)]
            case t.If():
                return self._if(statement, depth)
            case t.Case():
                return self._case(statement, depth)
            case t.For():
                return self._for(statement, depth)
            case t.While(condition=condition, body=body):
                return [f"{pad}while ({self._value(condition)}) {{", *self._body(body, depth + 1), pad + "}"]
            case t.Repeat(condition=condition, body=body):
                return [f"{pad}do {{", *self._body(body, depth + 1), f"{pad}}} while (!({self._value(condition)}));"]
            case t.Exit():
                return [pad + "break;"]
            case t.Continue():
                return [pad + "continue;"]
            case t.Return():
                result = self.pou.result
                return [f"{pad}return;" if result is None else f"{pad}return l_{result.key};"]

    def _if(self, statement: t.If, depth: int) -> list[str]:
        pad, lines, word = "    " * depth, [], "if"
        for branch in statement.branches:
            lines += [f"{pad}{word} ({self._value(branch.condition)}) {{", *self._body(branch.body, depth + 1)]
            word = "} else if"
        if statement.otherwise:
            lines += [pad + "} else {", *self._body(statement.otherwise, depth + 1)]
        return [*lines, pad + "}"]

    def _case(self, statement: t.Case, depth: int) -> list[str]:
        """As a chain of IFs: BREAK must leave the loop around it."""
        pad, lines, word = "    " * depth, [], "if"
        self.temporaries += 1
        name = f"chosen{self.temporaries}"
        lines.append(f"{pad}int64_t {name} = {self._value(statement.selector)};")
        for branch in statement.branches:
            tests = [
                f"{name} == {low}" if low == high else f"({name} >= {low} && {name} <= {high})"
                for low, high in branch.labels
            ]
            lines += [f"{pad}{word} ({' || '.join(tests)}) {{", *self._body(branch.body, depth + 1)]
            word = "} else if"
        if statement.otherwise:
            lines += [pad + "} else {", *self._body(statement.otherwise, depth + 1)]
        return [*lines, pad + "}"]

    def _for(self, statement: t.For, depth: int) -> list[str]:
        pad = "    " * depth
        if not isinstance(statement.step, t.Constant) or not isinstance(statement.step.value, int):
            raise UntranslatableError("FOR with a step that is no constant")
        lines, stop = [], self._value(statement.stop)
        if not isinstance(statement.stop, t.Constant):
            self.temporaries += 1
            lines.append(f"{pad}int64_t stop{self.temporaries} = {stop};")
            stop = f"stop{self.temporaries}"
        counter, step = self._value(statement.counter), statement.step.value
        test = "<=" if step > 0 else ">="
        head = f"{counter} = {self._value(statement.start)}; {counter} {test} {stop}; {counter} += {step}"
        lines.append(f"{pad}for ({head}) {{")
        return [*lines, *self._body(statement.body, depth + 1), pad + "}"]

    def _call_statement(self, call: t.Call) -> list[str]:
        if call.receiver is None or not isinstance(call.receiver.type, BlockType):
            return [f"{self._value(call)};"]
        if self.project.pous[call.callee].kind is PouKind.METHOD:
            raise UntranslatableError("a method")
        instance = self._value(call.receiver)
        lines, after = [], []
        for argument in call.arguments:
            field = f"{instance}.{argument.parameter.key}"
            if argument.passing is t.Passing.INPUT:
                lines.append(_assigned(argument.parameter.type, field, self._value(argument.value)))
            elif argument.passing is t.Passing.OUTPUT:
                after.append(_assigned(argument.parameter.type, self._value(argument.value), field))
            else:
                raise UntranslatableError("VAR_IN_OUT")
        return [*lines, f"{_name(call.callee)}(&{instance});", *after]

    # --- expressions ---

    def _variable(self, variable: t.Variable) -> str:
        if variable.is_constant and isinstance(variable.type, Elementary | EnumType):
            return _number(variable.initial, variable.type)
        if variable.storage is t.Storage.GLOBAL:
            return f"g_{variable.owner}_{variable.key}"
        if variable.is_constant:
            return self._constant(variable)
        return f"self->{variable.key}" if variable.storage is t.Storage.INSTANCE else f"l_{variable.key}"

    def _value(self, node: t.Expression) -> str:  # noqa: PLR0911, PLR0912 - one return a case
        match node:
            case t.Constant(value=value):
                return _number(value, node.type)
            case t.VariableRef(variable=variable):
                return self._variable(variable)
            case t.InstanceVariable(base=base, variable=variable):
                return f"{self._value(base)}.{variable.key}"
            case t.FieldRef(base=base, name=name):
                return f"{self._value(base)}.{name}"
            case t.ElementRef():
                return self._element(node)
            case t.Unary(operator=operator, operand=operand):
                is_bool = isinstance(node.type, Elementary) and node.type.kind is Kind.BOOL
                sign = "-" if operator == "NEG" else ("!" if is_bool else "~")
                return f"({self._type(node.type)})({sign}{self._value(operand)})"
            case t.Binary(operator=operator, left=left, right=right):
                code = f"({self._value(left)} {_OPERATORS[operator]} {self._value(right)})"
                return code if node.type == LREAL else f"({self._type(node.type)}){code}"
            case t.ShortCircuit(operator=operator, left=left, right=right):
                return f"({self._value(left)} {'&&' if operator == 'AND_THEN' else '||'} {self._value(right)})"
            case t.Compare(operator=operator, left=left, right=right):
                return f"({self._value(left)} {_COMPARISONS[operator]} {self._value(right)})"
            case t.Conversion(operand=operand):
                return self._conversion(node, operand)
            case t.StandardCall():
                return self._standard(node)
            case t.Call() if node.receiver is None:
                given = {argument.parameter.key: argument.value for argument in node.arguments}
                inputs = self.project.pous[node.callee].section(t.Section.INPUT)
                values = [self._value(given[v.key]) if v.key in given else _number(v.initial, v.type) for v in inputs]
                return f"{_name(node.callee)}({', '.join(values)})"
            case _:
                raise UntranslatableError(type(node).__name__)

    def _element(self, node: t.ElementRef) -> str:
        type_ = node.base.type
        assert isinstance(type_, ArrayType)
        code = ""
        for index, (low, _), length in zip(node.indices, type_.bounds, type_.shape, strict=True):
            one = self._value(index) if low == 0 else f"({self._value(index)} - ({low}))"
            code = one if not code else f"({code}) * {length} + {one}"
        return f"{self._value(node.base)}[{code}]"

    def _conversion(self, node: t.Conversion, operand: t.Expression) -> str:
        source, target = operand.type, node.type
        value = self._value(operand)
        if isinstance(target, Elementary) and target.kind is Kind.BOOL:
            return f"({value} != 0)"
        is_real = isinstance(source, Elementary) and source.is_real
        if is_real and isinstance(target, Elementary) and not target.is_real:
            return f"({self._type(target)})llrint({value})"
        return f"({self._type(target)})({value})"

    def _standard(self, node: t.StandardCall) -> str:  # noqa: PLR0911 - one return a case
        values = [self._value(argument) for argument in node.arguments]
        name, c_type = node.function, self._type(node.type)
        is_real = isinstance(node.type, Elementary) and node.type.is_real
        if name in _FUNCTIONS:
            return f"({c_type}){_FUNCTIONS[name]}({', '.join(values)})"
        if name == "ABS" and is_real:
            return f"({c_type})fabs({values[0]})"
        if name == "ABS":
            return f"({values[0]} < 0 ? -{values[0]} : {values[0]})"
        if name in ("MIN", "MAX"):
            result = values[0]
            for value in values[1:]:  # the first one where they are equal
                result = f"({value} {'<' if name == 'MIN' else '>'} {result} ? {value} : {result})"
            return result
        if name == "SEL":
            return f"({values[0]} ? {values[2]} : {values[1]})"
        if name == "LIMIT":
            low, value, high = values
            raised = f"({value} > {low} ? {value} : {low})"
            return f"({high} < {raised} ? {high} : {raised})"
        if name == "TRUNC":
            return f"(int32_t)({values[0]})"
        if name in ("SHL", "SHR"):
            return f"({c_type})({values[0]} {'<<' if name == 'SHL' else '>>'} {values[1]})"
        raise UntranslatableError(f"function {name}")
