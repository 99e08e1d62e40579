"""Turns what the LALR parser reduces into nodes, rule by rule, without a tree in between."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextvars import ContextVar
from typing import Any, TypeVar

from lark import Token, Transformer

from st_codegen.st.errors import Position, Problem, StSyntaxError
from st_codegen.st.syntax import nodes as n
from st_codegen.st.syntax.literals import parse_characters, parse_duration, parse_integer, parse_real
from st_codegen.st.syntax.scan import Scanned
from st_codegen.st.syntax.tables import parse_table

_T = TypeVar("_T")
_DURATIONS = {
    "T": n.LiteralKind.TIME,
    "TIME": n.LiteralKind.TIME,
    "LT": n.LiteralKind.LTIME,
    "LTIME": n.LiteralKind.LTIME,
}
_REAL_TYPES = {"REAL", "LREAL"}

# A child is a token, a node, None for an optional part that is absent, or what a helper rule below returns.
Children = Sequence[Any]
MakePou = Callable[..., n.PouDeclaration]
MakeType = Callable[..., n.TypeDeclaration]


class Builder(Transformer[Token, Any]):
    """One method a grammar rule, named after it.

    One builder serves all parses, since lark binds it to its tables; `parsing` holds the segment of the current one.
    """

    parsing: ContextVar[Scanned] = ContextVar("parsing")

    @property
    def _scanned(self) -> Scanned:
        return self.parsing.get()

    def _at(self, token: Token) -> Position:
        return self._scanned.segment.position(token.start_pos or 0)

    def _attributes(self, token: Token) -> tuple[str, ...]:
        return self._scanned.attributes.get(token.start_pos or 0, ())

    def _valued(self, token: Token, convert: Callable[[str], _T], text: str | None = None) -> _T:
        try:
            return convert(str(token) if text is None else text)
        except ValueError as error:
            raise self._scanned.segment.error(token.start_pos or 0, str(error)) from None

    # --- program organisation units ---

    def file(self, children: Children) -> list[n.Declaration]:
        return list(_flat(children))

    def types(self, children: Children) -> list[n.TypeDeclaration]:
        return list(_flat(children))

    def globals(self, children: Children) -> tuple[n.VariableBlock, ...]:
        return tuple(children)

    def body(self, children: Children) -> tuple[n.Statement, ...]:
        return tuple(children)

    statements = body

    def head(self, children: Children) -> n.PouDeclaration:
        make: MakePou = children[0]
        return make(children[1:], ())

    def _pou_head(self, kind: n.PouKind, children: Children) -> MakePou:
        keyword, *rest = children
        extra = rest.pop() if kind is not n.PouKind.PROGRAM else None
        name: Token = rest.pop()
        is_block = kind is n.PouKind.FUNCTION_BLOCK

        def make(blocks: Iterable[n.VariableBlock], items: Iterable[Any]) -> n.PouDeclaration:
            parts = list(items)
            return n.PouDeclaration(
                kind=kind,
                name=str(name),
                blocks=tuple(blocks),
                body=tuple(part for part in parts if not isinstance(part, n.PouDeclaration)),
                return_type=None if is_block else extra,
                base=str(extra) if is_block and extra is not None else None,
                modifiers=frozenset(rest),
                methods=tuple(part for part in parts if isinstance(part, n.PouDeclaration)),
                attributes=self._attributes(keyword),
                position=self._at(name),
            )

        return make

    def function_head(self, children: Children) -> MakePou:
        return self._pou_head(n.PouKind.FUNCTION, children)

    def block_head(self, children: Children) -> MakePou:
        return self._pou_head(n.PouKind.FUNCTION_BLOCK, children)

    def program_head(self, children: Children) -> MakePou:
        return self._pou_head(n.PouKind.PROGRAM, children)

    def method_head(self, children: Children) -> MakePou:
        return self._pou_head(n.PouKind.METHOD, children)

    def function(self, children: Children) -> n.PouDeclaration:
        make: MakePou = children[0]
        blocks = [part for part in children[1:] if isinstance(part, n.VariableBlock)]
        return make(blocks, [part for part in children[1:] if not isinstance(part, n.VariableBlock)])

    function_block = program = method = function

    def modifier(self, children: Children) -> str:
        return str(children[0]).upper()

    qualifier = modifier

    def global_blocks(self, children: Children) -> n.GlobalList:
        name = self._scanned.segment.file.rpartition("/")[2].rpartition(".")[0]
        blocks, attributes = zip(*children, strict=True)
        return n.GlobalList(name, blocks, sum(attributes, ()), position=blocks[0].position)

    def global_block(self, children: Children) -> tuple[n.VariableBlock, tuple[str, ...]]:
        return self._variables("VAR_GLOBAL", children), self._attributes(children[0])

    def var_section(self, children: Children) -> Token:
        token: Token = children[0]
        return token

    def var_block(self, children: Children) -> n.VariableBlock:
        return self._variables(str(children[0]).upper(), children)

    def _variables(self, section: str, children: Children) -> n.VariableBlock:
        keyword, *rest = children
        qualifiers = frozenset(part for part in rest if isinstance(part, str))
        variables = tuple(_flat(part for part in rest if not isinstance(part, str)))
        return n.VariableBlock(section, qualifiers, variables, position=self._at(keyword))

    def variable(self, children: Children) -> list[n.VariableDeclaration]:
        names, address, spec, initial = children
        attributes = self._attributes(names[0])
        place = None if address is None else str(address).upper()
        return [
            n.VariableDeclaration(str(name), spec, initial, place, attributes, position=self._at(name))
            for name in names
        ]

    def names(self, children: Children) -> list[Token]:
        return list(children)

    # --- types ---

    def type_block(self, children: Children) -> list[n.TypeDeclaration]:
        return list(children)

    def type_declaration(self, children: Children) -> n.TypeDeclaration:
        name, base, _ = children
        make: MakeType = children[2]
        return make(name, base)

    def _define(self, cls: Any, *parts: Any) -> MakeType:
        def make(name: Token, base: Token | None) -> n.TypeDeclaration:
            where: dict[str, Any] = {"attributes": self._attributes(name), "position": self._at(name)}
            if cls is n.StructDeclaration:
                fields, is_union = parts
                return n.StructDeclaration(str(name), None if base is None else str(base), fields, is_union, **where)
            if base is not None:
                raise self._scanned.segment.error(
                    base.start_pos or 0, "only structures and blocks can extend another one"
                )
            made: n.TypeDeclaration = cls(str(name), *parts, **where)
            return made

        return make

    def struct(self, children: Children) -> MakeType:
        return self._define(n.StructDeclaration, tuple(_flat(children[1:])), False)

    def union(self, children: Children) -> MakeType:
        return self._define(n.StructDeclaration, tuple(_flat(children[1:])), True)

    def enum(self, children: Children) -> MakeType:
        *values, base, default = children
        return self._define(n.EnumDeclaration, tuple(values), None if base is None else str(base).upper(), default)

    def enum_default(self, children: Children) -> n.Identifier:
        name = children[0]
        return n.Identifier(str(name).rpartition(".")[2], position=self._at(name))

    def enum_value(self, children: Children) -> n.EnumValue:
        name, value = children
        return n.EnumValue(str(name), value, position=self._at(name))

    def alias(self, children: Children) -> MakeType:
        return self._define(n.AliasDeclaration, *children)

    def qualified_name(self, children: Children) -> Token:
        first: Token = children[0]
        return first if len(children) == 1 else first.update(value=".".join(children))

    def named_type(self, children: Children) -> n.NamedType:
        return n.NamedType(str(children[0]), position=self._at(children[0]))

    def subrange(self, children: Children) -> n.SubrangeSpec:
        base, limits = children
        return n.SubrangeSpec(str(base).upper(), limits, position=self._at(base))

    def string(self, children: Children) -> n.StringSpec:
        keyword, *lengths = children
        length = next((part for part in lengths if part is not None), None)
        return n.StringSpec(length, str(keyword).upper() == "WSTRING", position=self._at(keyword))

    def array(self, children: Children) -> n.ArraySpec:
        keyword, *ranges, element = children
        return n.ArraySpec(tuple(ranges), element, position=self._at(keyword))

    def pointer(self, children: Children) -> n.PointerSpec:
        return n.PointerSpec(children[1], position=self._at(children[0]))

    def reference_to(self, children: Children) -> n.ReferenceSpec:
        return n.ReferenceSpec(children[1], position=self._at(children[0]))

    def range(self, children: Children) -> n.Range:
        return n.Range(*children, position=children[0].position)

    label_range = range

    # --- initial values ---

    def table(self, children: Children) -> n.Table:
        values, kind = self._valued(children[0], parse_table)
        return n.Table(values, kind, position=self._at(children[0]))

    def array_initial(self, children: Children) -> n.ArrayInitial:
        return n.ArrayInitial(tuple(_nodes(children)), position=self._at(children[0]))

    def repeat(self, children: Children) -> n.Repeat:
        count, value = children
        return n.Repeat(self._valued(count, parse_integer), value, position=self._at(count))

    def struct_initial(self, children: Children) -> n.StructInitial:
        return n.StructInitial(tuple(_nodes(children)), position=self._at(children[0]))

    def member_initial(self, children: Children) -> n.MemberInitial:
        return n.MemberInitial(str(children[0]), children[1], position=self._at(children[0]))

    # --- statements ---

    def assignment(self, children: Children) -> n.Assignment:
        return n.Assignment(*children, position=children[0].position)

    def call_statement(self, children: Children) -> n.CallStatement:
        call = children[0]
        if not isinstance(call, n.Call):
            raise _error(call, "a statement is an assignment or a call; this is neither")
        return n.CallStatement(call, position=call.position)

    def if_(self, children: Children) -> n.If:
        keyword, condition, body, *elsifs, otherwise = children
        first = n.Branch(condition, body, position=self._at(keyword))
        return n.If((first, *elsifs), otherwise, position=self._at(keyword))

    def elsif(self, children: Children) -> n.Branch:
        keyword, condition, body = children
        return n.Branch(condition, body, position=self._at(keyword))

    def case(self, children: Children) -> n.Case:
        keyword, selector, *items, otherwise = children
        branches: list[tuple[tuple[Any, ...], list[n.Statement]]] = []
        for item in items:
            if isinstance(item, tuple):
                branches.append((item, []))
            elif branches:
                branches[-1][1].append(item)
            else:
                raise _error(item, "a statement between OF and the first label of a CASE")
        made = tuple(n.CaseBranch(labels, tuple(body), position=labels[0].position) for labels, body in branches)
        return n.Case(selector, made, otherwise, position=self._at(keyword))

    def case_labels(self, children: Children) -> tuple[Any, ...]:
        return tuple(children)

    def negative_label(self, children: Children) -> n.Unary:
        return n.Unary("-", children[1], position=self._at(children[0]))

    def for_(self, children: Children) -> n.For:
        keyword, *parts = children
        return n.For(*parts, position=self._at(keyword))

    def while_(self, children: Children) -> n.While:
        keyword, *parts = children
        return n.While(*parts, position=self._at(keyword))

    def repeat_until(self, children: Children) -> n.RepeatUntil:
        keyword, *parts = children
        return n.RepeatUntil(*parts, position=self._at(keyword))

    def exit(self, children: Children) -> n.Exit:
        return n.Exit(position=self._at(children[0]))

    def continue_(self, children: Children) -> n.Continue:
        return n.Continue(position=self._at(children[0]))

    def return_(self, children: Children) -> n.Return:
        return n.Return(position=self._at(children[0]))

    def empty(self, children: Children) -> n.Empty:
        return n.Empty(position=self._at(children[0]))

    # --- expressions ---

    def binary(self, children: Children) -> n.Binary:
        left, operator, right = children
        name = "AND" if operator == "&" else str(operator).upper()
        return n.Binary(name, left, right, position=self._at(operator))

    def unary(self, children: Children) -> n.Unary:
        return n.Unary(str(children[0]).upper(), children[1], position=self._at(children[0]))

    def identifier(self, children: Children) -> n.Identifier:
        return n.Identifier(str(children[0]), position=self._at(children[0]))

    def this(self, children: Children) -> n.This:
        return n.This(position=self._at(children[0]))

    def super(self, children: Children) -> n.Super:
        return n.Super(position=self._at(children[0]))

    def member(self, children: Children) -> n.Member:
        return n.Member(children[0], str(children[1]), position=self._at(children[1]))

    def subscript(self, children: Children) -> n.Subscript:
        base, *indices = children
        return n.Subscript(base, tuple(indices), position=base.position)

    def dereference(self, children: Children) -> n.Dereference:
        return n.Dereference(children[0], position=children[0].position)

    def call(self, children: Children) -> n.Call:
        callee, *arguments = children
        return n.Call(callee, tuple(part for part in arguments if part is not None), position=callee.position)

    def argument(self, children: Children) -> n.Argument:
        value = children[0]
        return value if isinstance(value, n.Argument) else n.Argument(None, value, position=value.position)

    def input_argument(self, children: Children) -> n.Argument:
        return n.Argument(str(children[0]), children[1], position=self._at(children[0]))

    def output_argument(self, children: Children) -> n.Argument:
        return n.Argument(str(children[0]), children[1], is_output=True, position=self._at(children[0]))

    def literal(self, children: Children) -> n.Literal | n.EnumLiteral:
        token: Token = children[0]
        where = self._at(token)
        kind = n.LiteralKind
        match token.type:
            case "INTEGER" | "BASED":
                return n.Literal(kind.INTEGER, self._valued(token, parse_integer), position=where)
            case "REAL":
                return n.Literal(kind.REAL, self._valued(token, parse_real), position=where)
            case "TRUE" | "FALSE":
                return n.Literal(kind.BOOL, token.type == "TRUE", position=where)
            case "CHARACTERS":
                return n.Literal(kind.STRING, self._valued(token, parse_characters), position=where)
            case "WIDE_CHARACTERS":
                return n.Literal(kind.WSTRING, self._valued(token, parse_characters), position=where)
            case _:
                return self._typed_literal(token)

    def _typed_literal(self, token: Token) -> n.Literal | n.EnumLiteral:
        prefix, _, text = str(token).partition("#")
        name, where, kind = prefix.upper(), self._at(token), n.LiteralKind
        if name in _DURATIONS:
            return n.Literal(_DURATIONS[name], self._valued(token, parse_duration, text), position=where)
        if text[0] in "'\"":
            wide = kind.WSTRING if text[0] == '"' else kind.STRING
            return n.Literal(wide, self._valued(token, parse_characters, text), name, position=where)
        if text.upper() in {"TRUE", "FALSE"}:
            return n.Literal(kind.BOOL, text.upper() == "TRUE", name, position=where)
        if text[0].isalpha() or text[0] == "_":
            return n.EnumLiteral(prefix, text, position=where)
        if name in _REAL_TYPES and "#" not in text:
            return n.Literal(kind.REAL, self._valued(token, parse_real, text), name, position=where)
        return n.Literal(kind.INTEGER, self._valued(token, parse_integer, text), name, position=where)


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


def _error(node: n.Node, message: str) -> StSyntaxError:
    return StSyntaxError([Problem(node.position, message)])
