"""Turns what the LALR parser reduces into nodes, rule by rule, without a tree in between."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextvars import ContextVar
from typing import Any, TypeVar

from lark import Token, Transformer

from st_codegen.st import tree as t
from st_codegen.st.errors import Position, Problem, StSyntaxError
from st_codegen.st.syntax import declarations as d
from st_codegen.st.syntax.literals import parse_characters, parse_duration, parse_integer, parse_real
from st_codegen.st.syntax.scan import Scanned
from st_codegen.st.syntax.tables import parse_table

_T = TypeVar("_T")
_REAL_TYPES = {"REAL", "LREAL"}
_DURATIONS = {
    "T": t.LiteralKind.TIME,
    "TIME": t.LiteralKind.TIME,
    "LT": t.LiteralKind.LTIME,
    "LTIME": t.LiteralKind.LTIME,
}
_BINARY = {"+": "ADD", "-": "SUB", "*": "MUL", "/": "DIV", "**": "EXPT", "&": "AND"}
_COMPARISONS = {"=": "EQ", "<>": "NE", "<": "LT", "<=": "LE", ">": "GT", ">=": "GE"}
#: How strongly operators bind that may follow one another without parentheses; of equal ones the first comes first.
_STRENGTH = {
    operator: strength
    for strength, operators in enumerate(("OR OR_ELSE", "XOR", "AND AND_THEN &", "= <>", "< <= > >=", "+ -", "* / MOD"))
    for operator in operators.split()
}
_UNARY = {"-": "NEG", "+": "POS", "NOT": "NOT"}

# A child is a token, a node, None for an optional part that is absent, or what a helper rule below returns.
Children = Sequence[Any]
MakePou = Callable[..., d.PouDeclaration]
MakeType = Callable[..., d.TypeDeclaration]
Rule = Callable[["Builder", Children], Any]


def _true(text: str) -> bool:
    return text.upper() == "TRUE"


_LITERALS: dict[str, tuple[t.LiteralKind, Callable[[str], Any]]] = {
    "INTEGER": (t.LiteralKind.INTEGER, parse_integer),
    "BASED": (t.LiteralKind.INTEGER, parse_integer),
    "REAL": (t.LiteralKind.REAL, parse_real),
    "TRUE": (t.LiteralKind.BOOL, _true),
    "FALSE": (t.LiteralKind.BOOL, _true),
    "CHARACTERS": (t.LiteralKind.STRING, parse_characters),
    "WIDE_CHARACTERS": (t.LiteralKind.WSTRING, parse_characters),
}


def _node(cls: type[t.Node], skip: int = 0, at: int = 0, **more: Any) -> Rule:
    """A rule whose children, less the first `skip`, are the fields of a node; it stands where the child `at` does."""

    def rule(self: Builder, children: Children) -> t.Node:
        parts = (str(child) if isinstance(child, Token) else child for child in children[skip:])
        return cls(*parts, position=self._at(children[at]), **more)

    return rule


def _pou_head(kind: t.PouKind) -> Rule:
    """A rule that makes a unit, once its variables and its items (statements and methods) are known."""
    is_block = kind is t.PouKind.FUNCTION_BLOCK

    def rule(self: Builder, children: Children) -> MakePou:
        keyword, *rest = children
        extra = rest.pop() if kind is not t.PouKind.PROGRAM else None
        name: Token = rest.pop()

        def make(blocks: Iterable[d.VariableBlock], items: Sequence[Any]) -> d.PouDeclaration:
            return d.PouDeclaration(
                kind=kind,
                name=str(name),
                blocks=tuple(blocks),
                body=tuple(item for item in items if isinstance(item, t.Statement)),
                return_type=None if is_block else extra,
                base=str(extra) if is_block and extra is not None else None,
                modifiers=frozenset(rest),
                methods=tuple(item for item in items if isinstance(item, d.PouDeclaration)),
                attributes=self._attributes(keyword),
                position=self._at(name),
            )

        return make

    return rule


def _structure(is_union: bool) -> Rule:
    """A rule that makes a structure or union, once its name and base are known."""

    def rule(self: Builder, children: Children) -> MakeType:
        def make(name: Token, base: Token | None) -> d.StructDeclaration:
            extended = None if base is None else str(base)
            return d.StructDeclaration(
                str(name), extended, tuple(_flat(children[1:])), is_union, **self._declared(name)
            )

        return make

    return rule


class Builder(Transformer[Token, Any]):
    """One method a grammar rule, named after it.

    One builder serves all parses, since lark binds it to its tables; `parsing` holds the segment of the current one.
    """

    parsing: ContextVar[Scanned] = ContextVar("parsing")

    @property
    def _scanned(self) -> Scanned:
        return self.parsing.get()

    def _at(self, child: Token | t.Node) -> Position:
        return child.position if isinstance(child, t.Node) else self._scanned.segment.position(child.start_pos or 0)

    def _attributes(self, token: Token) -> tuple[str, ...]:
        return self._scanned.attributes.get(token.start_pos or 0, ())

    def _declared(self, name: Token) -> dict[str, Any]:
        return {"attributes": self._attributes(name), "position": self._at(name)}

    def _error(self, token: Token, message: str) -> StSyntaxError:
        return self._scanned.segment.error(token.start_pos or 0, message)

    def _valued(self, token: Token, convert: Callable[[str], _T], text: str | None = None) -> _T:
        try:
            return convert(str(token) if text is None else text)
        except ValueError as error:
            raise self._error(token, str(error)) from None

    # --- program organisation units ---

    def types(self, children: Children) -> list[Any]:
        return list(_flat(children))

    file = types

    def body(self, children: Children) -> tuple[Any, ...]:
        return tuple(children)

    statements = globals = case_labels = body

    def head(self, children: Children) -> d.PouDeclaration:
        make: MakePou = children[0]
        return make(children[1:], ())

    function_head = _pou_head(t.PouKind.FUNCTION)
    block_head = _pou_head(t.PouKind.FUNCTION_BLOCK)
    program_head = _pou_head(t.PouKind.PROGRAM)
    method_head = _pou_head(t.PouKind.METHOD)

    def function(self, children: Children) -> d.PouDeclaration:
        make: MakePou = children[0]
        return make([part for part in children[1:] if isinstance(part, d.VariableBlock)], children[1:])

    function_block = program = method = function

    task = _node(d.TaskDeclaration)
    program_instance = _node(d.ProgramInstance, skip=1)

    def configuration(self, children: Children) -> d.ConfigurationDeclaration:
        name, resource, platform, *parts = children
        tasks = tuple(part for part in parts if isinstance(part, d.TaskDeclaration))
        programs = tuple(part for part in parts if isinstance(part, d.ProgramInstance))
        where = self._at(name)
        return d.ConfigurationDeclaration(str(name), str(resource), str(platform), tasks, programs, position=where)

    def modifier(self, children: Children) -> str:
        return str(children[0]).upper()

    qualifier = modifier

    def global_blocks(self, children: Children) -> d.GlobalDeclarations:
        name = self._scanned.segment.file.rpartition("/")[2].rpartition(".")[0]
        blocks, attributes = zip(*children, strict=True)
        return d.GlobalDeclarations(name, blocks, sum(attributes, ()), position=blocks[0].position)

    def global_block(self, children: Children) -> tuple[d.VariableBlock, tuple[str, ...]]:
        return self.var_block(children), self._attributes(children[0])

    def var_section(self, children: Children) -> Token:
        token: Token = children[0]
        return token

    def var_block(self, children: Children) -> d.VariableBlock:
        keyword, *rest = children
        try:
            section = t.Section(str(keyword).upper())
        except ValueError:
            raise self._error(keyword, f"{keyword} is not supported") from None
        qualifiers = frozenset(part for part in rest if isinstance(part, str))
        variables = tuple(_flat(part for part in rest if not isinstance(part, str)))
        return d.VariableBlock(section, qualifiers, variables, position=self._at(keyword))

    def variable(self, children: Children) -> list[d.VariableDeclaration]:
        names, address, spec, initial = children
        attributes = self._attributes(names[0])
        located = None if address is None else str(address).upper()
        return [
            d.VariableDeclaration(str(name), spec, initial, located, attributes, position=self._at(name))
            for name in names
        ]

    def names(self, children: Children) -> list[Token]:
        return list(children)

    # --- types ---

    type_block = names
    struct = _structure(is_union=False)
    union = _structure(is_union=True)

    def type_declaration(self, children: Children) -> d.TypeDeclaration:
        name, base, _ = children
        make: MakeType = children[2]
        return make(name, base)

    def _without_base(self, cls: Any, *parts: Any) -> MakeType:
        def make(name: Token, base: Token | None) -> d.TypeDeclaration:
            if base is not None:
                raise self._error(base, "only structures and blocks can extend another one")
            made: d.TypeDeclaration = cls(str(name), *parts, **self._declared(name))
            return made

        return make

    def enum(self, children: Children) -> MakeType:
        *values, base, default = children
        return self._without_base(
            d.EnumDeclaration, tuple(values), None if base is None else str(base).upper(), default
        )

    def alias(self, children: Children) -> MakeType:
        return self._without_base(d.AliasDeclaration, *children)

    def enum_default(self, children: Children) -> t.Identifier:
        name = children[0]
        return t.Identifier(str(name).rpartition(".")[2], position=self._at(name))

    def qualified_name(self, children: Children) -> Token:
        first: Token = children[0]
        return first if len(children) == 1 else first.update(value=".".join(children))

    def subrange(self, children: Children) -> d.SubrangeSpec:
        base, limits = children
        return d.SubrangeSpec(str(base).upper(), limits, position=self._at(base))

    def string(self, children: Children) -> d.StringSpec:
        keyword, *lengths = children
        length = next((part for part in lengths if part is not None), None)
        return d.StringSpec(length, str(keyword).upper() == "WSTRING", position=self._at(keyword))

    def array(self, children: Children) -> d.ArraySpec:
        keyword, *ranges, element = children
        return d.ArraySpec(tuple(ranges), element, position=self._at(keyword))

    enum_value = _node(d.Enumerator)
    named_type = _node(d.NamedType)
    pointer = _node(d.PointerSpec, skip=1)
    reference_to = _node(d.PointerSpec, skip=1, is_reference=True)
    range = label_range = _node(t.Range)

    # --- initial values ---

    member_initial = _node(d.MemberInitial)

    def table(self, children: Children) -> d.NumberTable:
        values, kind = self._valued(children[0], parse_table)
        return d.NumberTable(values, kind, position=self._at(children[0]))

    def array_initial(self, children: Children) -> d.ArrayInitial:
        return d.ArrayInitial(tuple(_nodes(children)), position=self._at(children[0]))

    def repeat(self, children: Children) -> d.Repeated:
        count, value = children
        return d.Repeated(self._valued(count, parse_integer), value, position=self._at(count))

    def struct_initial(self, children: Children) -> d.StructInitial:
        return d.StructInitial(tuple(_nodes(children)), position=self._at(children[0]))

    # --- statements ---

    assignment = _node(t.Assign)
    elsif = _node(t.Branch, skip=1)
    while_ = _node(t.While, skip=1)
    repeat_until = _node(t.Repeat, skip=1)
    exit = _node(t.Exit, skip=1)
    continue_ = _node(t.Continue, skip=1)
    return_ = _node(t.Return, skip=1)

    def call_statement(self, children: Children) -> t.CallStatement:
        call = children[0]
        if not isinstance(call, t.Call):
            raise _error(call, "a statement is an assignment or a call; this is neither")
        return t.CallStatement(call, position=call.position)

    def if_(self, children: Children) -> t.If:
        keyword, condition, body, *elsifs, otherwise = children
        first = t.Branch(condition, body, position=self._at(keyword))
        return t.If((first, *elsifs), otherwise or (), position=self._at(keyword))

    def case(self, children: Children) -> t.Case:
        keyword, selector, *items, otherwise = children
        branches: list[tuple[tuple[Any, ...], list[t.Statement]]] = []
        for item in items:
            if isinstance(item, tuple):
                branches.append((item, []))
            elif branches:
                branches[-1][1].append(item)
            else:
                raise _error(item, "a statement between OF and the first label of a CASE")
        made = tuple(t.CaseBranch(choices, tuple(body), position=choices[0].position) for choices, body in branches)
        return t.Case(selector, made, otherwise or (), position=self._at(keyword))

    def case_label(self, children: Children) -> t.Range:
        label = children[0]
        return label if isinstance(label, t.Range) else t.Range(label, label, position=label.position)

    def for_(self, children: Children) -> t.For:
        keyword, counter, start, stop, step, body = children
        where = self._at(keyword)
        step = step or t.Literal(t.LiteralKind.INTEGER, 1, position=where)
        return t.For(counter, start, stop, step, body, position=where)

    # --- expressions ---

    identifier = _node(t.Identifier)
    this = _node(t.ThisRef, skip=1)
    super = _node(t.Super, skip=1)
    member = _node(t.Member, at=1)
    dereference = _node(t.PointerTarget)

    def binary(self, children: Children) -> t.Infix:
        left, operator, right = children
        name, where = str(operator).upper(), self._at(operator)
        if name in _COMPARISONS:
            return t.Compare(_COMPARISONS[name], left, right, position=where)
        cls = t.ShortCircuit if name in ("AND_THEN", "OR_ELSE") else t.Binary
        return cls(_BINARY.get(name, name), left, right, position=where)

    def chain(self, children: Children) -> t.Infix:
        """Operands with operators between them: what binds more strongly than the next operator is made first."""
        first, *rest = children
        values, operators = [first], list[Token]()

        def make(until: int) -> None:
            while operators and _STRENGTH[operators[-1].upper()] >= until:
                right, left = values.pop(), values.pop()
                values.append(self.binary((left, operators.pop(), right)))

        for operator, operand in zip(rest[::2], rest[1::2], strict=True):
            make(_STRENGTH[operator.upper()])
            operators.append(operator)
            values.append(operand)
        make(0)
        made: t.Infix = values[0]
        return made

    def unary(self, children: Children) -> t.Unary:
        sign, operand = children
        return t.Unary(_UNARY[str(sign).upper()], operand, position=self._at(sign))

    negative_label = unary

    def subscript(self, children: Children) -> t.ElementRef:
        base, *indices = children
        return t.ElementRef(base, tuple(indices), position=base.position)

    def call(self, children: Children) -> t.Call:
        function, *arguments = children
        return t.Call(function, tuple(part for part in arguments if part is not None), position=function.position)

    def argument(self, children: Children) -> t.Argument:
        value = children[0]
        return value if isinstance(value, t.Argument) else t.Argument(None, value, position=value.position)

    def input_argument(self, children: Children) -> t.Argument:
        return self._named(children, t.Passing.INPUT)

    def output_argument(self, children: Children) -> t.Argument:
        return self._named(children, t.Passing.OUTPUT)

    def _named(self, children: Children, passing: t.Passing) -> t.Argument:
        name, value = children
        where = self._at(name)
        return t.Argument(str(name), value or t.Omitted(position=where), passing, position=where)

    def literal(self, children: Children) -> t.Literal | t.EnumLiteral:
        token: Token = children[0]
        if token.type not in _LITERALS:
            return self._typed_literal(token)
        kind, convert = _LITERALS[token.type]
        return t.Literal(kind, self._valued(token, convert), position=self._at(token))

    def _typed_literal(self, token: Token) -> t.Literal | t.EnumLiteral:
        prefix, _, text = str(token).partition("#")
        name, where, kind = prefix.upper(), self._at(token), t.LiteralKind
        if name in _DURATIONS:
            return t.Literal(_DURATIONS[name], self._valued(token, parse_duration, text), position=where)
        if text[0] in "'\"":
            wide = kind.WSTRING if text[0] == '"' else kind.STRING
            return t.Literal(wide, self._valued(token, parse_characters, text), name, position=where)
        if text.upper() in {"TRUE", "FALSE"}:
            return t.Literal(kind.BOOL, _true(text), name, position=where)
        if text[0].isalpha() or text[0] == "_":
            return t.EnumLiteral(prefix, text, position=where)
        if name in _REAL_TYPES and "#" not in text:
            return t.Literal(kind.REAL, self._valued(token, parse_real, text), name, position=where)
        return t.Literal(kind.INTEGER, self._valued(token, parse_integer, text), name, position=where)


# Python keywords cannot be method names
for _rule in ("if", "for", "while", "continue", "return"):
    setattr(Builder, _rule, getattr(Builder, f"{_rule}_"))


def _flat(children: Iterable[Any]) -> Iterable[Any]:
    for child in children:
        if isinstance(child, list):
            yield from child
        else:
            yield child


def _nodes(children: Children) -> Iterable[Any]:
    return (child for child in children if not isinstance(child, Token))


def _error(node: t.Node, message: str) -> StSyntaxError:
    return StSyntaxError([Problem(node.position, message)])
