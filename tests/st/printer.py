"""Prints syntax trees as text again, to check that the parser loses nothing."""

from __future__ import annotations

from functools import singledispatch

from st_codegen.st import tree as t
from st_codegen.st.syntax import declarations as d

OPERATORS = {
    "NEG": "-",
    "POS": "+",
    "ADD": "+",
    "SUB": "-",
    "MUL": "*",
    "DIV": "/",
    "EXPT": "**",
    "EQ": "=",
    "NE": "<>",
    "LT": "<",
    "LE": "<=",
    "GT": ">",
    "GE": ">=",
}


@singledispatch
def show(node: object) -> str:
    raise TypeError(type(node))


def lines(items: tuple[t.Node, ...]) -> str:
    return "".join(f"{show(item)}\n" for item in items)


@show.register
def _(node: t.Literal) -> str:
    prefix = f"{node.type_name}#" if node.type_name else ""
    kind = node.kind
    if kind is t.LiteralKind.TIME:
        return f"T#{'-' if node.value < 0 else ''}{abs(node.value)}ns"
    if kind is t.LiteralKind.LTIME:
        return f"LTIME#{'-' if node.value < 0 else ''}{abs(node.value)}ns"
    if kind is t.LiteralKind.BOOL:
        return prefix + str(node.value).upper()
    if kind in (t.LiteralKind.STRING, t.LiteralKind.WSTRING):
        quote, width = ("'", 2) if kind is t.LiteralKind.STRING else ('"', 4)
        return prefix + quote + "".join(f"${ord(c):0{width}X}" for c in node.value) + quote
    text = repr(node.value).upper()
    if kind is t.LiteralKind.REAL and "E" in text and "." not in text:
        text = text.replace("E", ".0E")
    return prefix + text


@show.register
def _(node: t.EnumLiteral) -> str:
    return f"{node.type_name}#{node.name}"


@show.register
def _(node: t.Identifier) -> str:
    return node.name


@show.register
def _(node: t.Member) -> str:
    return f"{show(node.base)}.{node.name}"


@show.register
def _(node: t.ElementRef) -> str:
    return f"{show(node.base)}[{', '.join(map(show, node.indices))}]"


@show.register
def _(node: t.PointerTarget) -> str:
    return f"{show(node.pointer)}^"


@show.register
def _(node: t.ThisRef) -> str:
    return "THIS^"


@show.register
def _(node: t.Super) -> str:
    return "SUPER^"


@show.register
def _(node: t.Argument) -> str:
    value = show(node.value)
    return value if node.name is None else f"{node.name} {'=>' if node.passing is t.Passing.OUTPUT else ':='} {value}"


@show.register
def _(node: t.Omitted) -> str:
    return ""


@show.register
def _(node: t.Call) -> str:
    return f"{show(node.function)}({', '.join(map(show, node.arguments))})"


@show.register
def _(node: t.Unary) -> str:
    return f"({OPERATORS.get(node.operator, node.operator)} {show(node.operand)})"


@show.register
def _(node: t.Infix) -> str:
    return f"({show(node.left)} {OPERATORS.get(node.operator, node.operator)} {show(node.right)})"


@show.register
def _(node: d.NumberTable) -> str:
    if node.kind is d.TableKind.BOOL:
        return f"[{', '.join(str(bool(value)).upper() for value in node.values)}]"
    cells = [repr(value).upper() for value in node.values.tolist()]
    return f"[{', '.join(cells)}]"


@show.register
def _(node: d.Repeated) -> str:
    return f"{node.count}({show(node.value) if node.value is not None else ''})"


@show.register
def _(node: d.ArrayInitial) -> str:
    return f"[{', '.join(map(show, node.items))}]"


@show.register
def _(node: d.MemberInitial) -> str:
    return f"{node.name} := {show(node.value)}"


@show.register
def _(node: d.StructInitial) -> str:
    return f"({', '.join(map(show, node.members))})"


@show.register
def _(node: d.NamedType) -> str:
    return node.name


@show.register
def _(node: d.StringSpec) -> str:
    length = f"({show(node.length)})" if node.length is not None else ""
    return f"{'WSTRING' if node.wide else 'STRING'}{length}"


@show.register
def _(node: t.Range) -> str:
    return f"{show(node.lower)}..{show(node.upper)}"


@show.register
def _(node: d.ArraySpec) -> str:
    return f"ARRAY[{', '.join(map(show, node.ranges))}] OF {show(node.element)}"


@show.register
def _(node: d.SubrangeSpec) -> str:
    return f"{node.base}({show(node.range)})"


@show.register
def _(node: d.PointerSpec) -> str:
    return f"{'REFERENCE' if node.is_reference else 'POINTER'} TO {show(node.target)}"


@show.register
def _(node: t.Assign) -> str:
    return f"{show(node.target)} := {show(node.value)};"


@show.register
def _(node: t.CallStatement) -> str:
    return f"{show(node.call)};"


@show.register
def _(node: t.If) -> str:
    text = ""
    for word, branch in zip(["IF"] + ["ELSIF"] * len(node.branches), node.branches, strict=False):
        text += f"{word} {show(branch.condition)} THEN\n{lines(branch.body)}"
    if node.otherwise:
        text += f"ELSE\n{lines(node.otherwise)}"
    return text + "END_IF"


def _choice(node: t.Range) -> str:
    ends = [f"-{show(end.operand)}" if isinstance(end, t.Unary) else show(end) for end in (node.lower, node.upper)]
    return "..".join(dict.fromkeys(ends))


@show.register
def _(node: t.Case) -> str:
    text = f"CASE {show(node.selector)} OF\n"
    for branch in node.branches:
        text += f"{', '.join(map(_choice, branch.choices))}:\n{lines(branch.body)}"
    if node.otherwise:
        text += f"ELSE\n{lines(node.otherwise)}"
    return text + "END_CASE"


@show.register
def _(node: t.For) -> str:
    header = f"FOR {show(node.counter)} := {show(node.start)} TO {show(node.stop)} BY {show(node.step)} DO"
    return f"{header}\n{lines(node.body)}END_FOR"


@show.register
def _(node: t.While) -> str:
    return f"WHILE {show(node.condition)} DO\n{lines(node.body)}END_WHILE"


@show.register
def _(node: t.Repeat) -> str:
    return f"REPEAT\n{lines(node.body)}UNTIL {show(node.condition)} END_REPEAT"


@show.register(t.Exit)
@show.register(t.Continue)
@show.register(t.Return)
def _(node: t.Node) -> str:
    return f"{type(node).__name__.upper()};"


def _attributes(attributes: tuple[str, ...]) -> str:
    text = ""
    for attribute in attributes:
        name, has_value, value = attribute.partition(":=")
        text += f"{{attribute '{name}'" + (f" := '{value}'" if has_value else "") + "}\n"
    return text


@show.register
def _(node: d.VariableDeclaration) -> str:
    place = f" AT {node.address}" if node.address else ""
    initial = f" := {show(node.initial)}" if node.initial is not None else ""
    return f"{_attributes(node.attributes)}{node.name}{place} : {show(node.type)}{initial};"


@show.register
def _(node: d.VariableBlock) -> str:
    return f"{' '.join([node.section.value, *sorted(node.qualifiers)])}\n{lines(node.variables)}END_VAR"


@show.register
def _(node: d.StructDeclaration) -> str:
    base = f" EXTENDS {node.base}" if node.base else ""
    word = "UNION" if node.is_union else "STRUCT"
    return f"TYPE {_attributes(node.attributes)}{node.name}{base} : {word}\n{lines(node.fields)}END_{word} END_TYPE"


@show.register
def _(node: d.Enumerator) -> str:
    return node.name + (f" := {show(node.value)}" if node.value is not None else "")


@show.register
def _(node: d.EnumDeclaration) -> str:
    base = f" {node.base}" if node.base else ""
    default = f" := {show(node.default)}" if node.default is not None else ""
    values = ", ".join(map(show, node.values))
    return f"TYPE {_attributes(node.attributes)}{node.name} : ({values}){base}{default}; END_TYPE"


@show.register
def _(node: d.AliasDeclaration) -> str:
    initial = f" := {show(node.initial)}" if node.initial is not None else ""
    return f"TYPE {_attributes(node.attributes)}{node.name} : {show(node.type)}{initial}; END_TYPE"


@show.register
def _(node: d.PouDeclaration) -> str:
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
def _(node: d.ConfigurationDeclaration) -> str:
    tasks = "".join(
        f"TASK {task.name}(INTERVAL := {show(task.interval)}, PRIORITY := {show(task.priority)});\n"
        for task in node.tasks
    )
    programs = "".join(f"PROGRAM {run.name} WITH {run.task} : {run.program};\n" for run in node.programs)
    head = f"CONFIGURATION {node.name} RESOURCE {node.resource} ON {node.platform}"
    return f"{head}\n{tasks}{programs}END_RESOURCE END_CONFIGURATION"


@show.register
def _(node: d.GlobalDeclarations) -> str:
    return _attributes(node.attributes) + lines(node.blocks)
