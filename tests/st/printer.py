"""Prints syntax trees as text again, to check that the parser loses nothing."""

from __future__ import annotations

from functools import singledispatch

from st_codegen.st.syntax import nodes as n


@singledispatch
def show(node: object) -> str:
    raise TypeError(type(node))


def lines(items: tuple[n.Node, ...]) -> str:
    return "".join(f"{show(item)}\n" for item in items)


@show.register
def _(node: n.Literal) -> str:
    prefix = f"{node.type_name}#" if node.type_name else ""
    kind = node.kind
    if kind is n.LiteralKind.TIME:
        return f"T#{'-' if node.value < 0 else ''}{abs(node.value)}ns"
    if kind is n.LiteralKind.LTIME:
        return f"LTIME#{'-' if node.value < 0 else ''}{abs(node.value)}ns"
    if kind is n.LiteralKind.BOOL:
        return prefix + str(node.value).upper()
    if kind in (n.LiteralKind.STRING, n.LiteralKind.WSTRING):
        quote, width = ("'", 2) if kind is n.LiteralKind.STRING else ('"', 4)
        return prefix + quote + "".join(f"${ord(c):0{width}X}" for c in node.value) + quote
    text = repr(node.value).upper()
    if kind is n.LiteralKind.REAL and "E" in text and "." not in text:
        text = text.replace("E", ".0E")
    return prefix + text


@show.register
def _(node: n.EnumLiteral) -> str:
    return f"{node.type_name}#{node.name}"


@show.register
def _(node: n.Identifier) -> str:
    return node.name


@show.register
def _(node: n.Member) -> str:
    return f"{show(node.base)}.{node.name}"


@show.register
def _(node: n.Subscript) -> str:
    return f"{show(node.base)}[{', '.join(map(show, node.indices))}]"


@show.register
def _(node: n.Dereference) -> str:
    return f"{show(node.base)}^"


@show.register
def _(node: n.This) -> str:
    return "THIS^"


@show.register
def _(node: n.Super) -> str:
    return "SUPER^"


@show.register
def _(node: n.Argument) -> str:
    value = show(node.value) if node.value is not None else ""
    return value if node.name is None else f"{node.name} {'=>' if node.is_output else ':='} {value}"


@show.register
def _(node: n.Call) -> str:
    return f"{show(node.callee)}({', '.join(map(show, node.arguments))})"


@show.register
def _(node: n.Unary) -> str:
    return f"({node.operator} {show(node.operand)})"


@show.register
def _(node: n.Binary) -> str:
    return f"({show(node.left)} {node.operator} {show(node.right)})"


@show.register
def _(node: n.Table) -> str:
    if node.kind is n.TableKind.BOOL:
        return f"[{', '.join(str(bool(value)).upper() for value in node.values)}]"
    cells = [repr(value).upper() for value in node.values.tolist()]
    return f"[{', '.join(cells)}]"


@show.register
def _(node: n.Repeat) -> str:
    return f"{node.count}({show(node.value) if node.value is not None else ''})"


@show.register
def _(node: n.ArrayInitial) -> str:
    return f"[{', '.join(map(show, node.items))}]"


@show.register
def _(node: n.MemberInitial) -> str:
    return f"{node.name} := {show(node.value)}"


@show.register
def _(node: n.StructInitial) -> str:
    return f"({', '.join(map(show, node.members))})"


@show.register
def _(node: n.NamedType) -> str:
    return node.name


@show.register
def _(node: n.StringSpec) -> str:
    length = f"({show(node.length)})" if node.length is not None else ""
    return f"{'WSTRING' if node.wide else 'STRING'}{length}"


@show.register
def _(node: n.Range) -> str:
    return f"{show(node.lower)}..{show(node.upper)}"


@show.register
def _(node: n.ArraySpec) -> str:
    return f"ARRAY[{', '.join(map(show, node.ranges))}] OF {show(node.element)}"


@show.register
def _(node: n.SubrangeSpec) -> str:
    return f"{node.base}({show(node.range)})"


@show.register
def _(node: n.PointerSpec) -> str:
    return f"POINTER TO {show(node.target)}"


@show.register
def _(node: n.ReferenceSpec) -> str:
    return f"REFERENCE TO {show(node.target)}"


@show.register
def _(node: n.Assignment) -> str:
    return f"{show(node.target)} := {show(node.value)};"


@show.register
def _(node: n.CallStatement) -> str:
    return f"{show(node.call)};"


@show.register
def _(node: n.If) -> str:
    text = ""
    for word, branch in zip(["IF"] + ["ELSIF"] * len(node.branches), node.branches, strict=False):
        text += f"{word} {show(branch.condition)} THEN\n{lines(branch.body)}"
    if node.otherwise is not None:
        text += f"ELSE\n{lines(node.otherwise)}"
    return text + "END_IF"


def _label(node: n.Node) -> str:
    if isinstance(node, n.Range):
        return f"{_label(node.lower)}..{_label(node.upper)}"
    return f"-{show(node.operand)}" if isinstance(node, n.Unary) else show(node)


@show.register
def _(node: n.Case) -> str:
    text = f"CASE {show(node.selector)} OF\n"
    for branch in node.branches:
        text += f"{', '.join(map(_label, branch.labels))}:\n{lines(branch.body)}"
    if node.otherwise is not None:
        text += f"ELSE\n{lines(node.otherwise)}"
    return text + "END_CASE"


@show.register
def _(node: n.For) -> str:
    step = f" BY {show(node.step)}" if node.step is not None else ""
    header = f"FOR {show(node.counter)} := {show(node.start)} TO {show(node.stop)}{step} DO"
    return f"{header}\n{lines(node.body)}END_FOR"


@show.register
def _(node: n.While) -> str:
    return f"WHILE {show(node.condition)} DO\n{lines(node.body)}END_WHILE"


@show.register
def _(node: n.RepeatUntil) -> str:
    return f"REPEAT\n{lines(node.body)}UNTIL {show(node.condition)} END_REPEAT"


@show.register(n.Exit)
@show.register(n.Continue)
@show.register(n.Return)
def _(node: n.Node) -> str:
    return f"{type(node).__name__.upper()};"


@show.register
def _(node: n.Empty) -> str:
    return ";"


def _attributes(attributes: tuple[str, ...]) -> str:
    text = ""
    for attribute in attributes:
        name, has_value, value = attribute.partition(":=")
        text += f"{{attribute '{name}'" + (f" := '{value}'" if has_value else "") + "}\n"
    return text


@show.register
def _(node: n.VariableDeclaration) -> str:
    place = f" AT {node.address}" if node.address else ""
    initial = f" := {show(node.initial)}" if node.initial is not None else ""
    return f"{_attributes(node.attributes)}{node.name}{place} : {show(node.type)}{initial};"


@show.register
def _(node: n.VariableBlock) -> str:
    return f"{' '.join([node.section, *sorted(node.qualifiers)])}\n{lines(node.variables)}END_VAR"


@show.register
def _(node: n.StructDeclaration) -> str:
    base = f" EXTENDS {node.base}" if node.base else ""
    word = "UNION" if node.is_union else "STRUCT"
    return f"TYPE {_attributes(node.attributes)}{node.name}{base} : {word}\n{lines(node.fields)}END_{word} END_TYPE"


@show.register
def _(node: n.EnumValue) -> str:
    return node.name + (f" := {show(node.value)}" if node.value is not None else "")


@show.register
def _(node: n.EnumDeclaration) -> str:
    base = f" {node.base}" if node.base else ""
    default = f" := {show(node.default)}" if node.default is not None else ""
    values = ", ".join(map(show, node.values))
    return f"TYPE {_attributes(node.attributes)}{node.name} : ({values}){base}{default}; END_TYPE"


@show.register
def _(node: n.AliasDeclaration) -> str:
    initial = f" := {show(node.initial)}" if node.initial is not None else ""
    return f"TYPE {_attributes(node.attributes)}{node.name} : {show(node.type)}{initial}; END_TYPE"


@show.register
def _(node: n.PouDeclaration) -> str:
    word = node.kind.value
    header = " ".join([word, *sorted(node.modifiers), node.name])
    if node.base:
        header += f" EXTENDS {node.base}"
    if node.return_type is not None:
        header += f" : {show(node.return_type)}"
    body = lines(node.blocks) + lines(node.methods) + lines(node.body)
    # A semicolon behind the head keeps an empty statement of the body from being taken for it
    return f"{_attributes(node.attributes)}{header};\n{body}END_{word}"


@show.register
def _(node: n.GlobalList) -> str:
    return _attributes(node.attributes) + lines(node.blocks)
