"""The portable subset: what strict compilers of other vendors accept, beyond what the checker asks of `iec` text.

Each rule is a function from a `Text` to problems; `violations` runs all of them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

from st_codegen.errors import counted
from st_codegen.st import tree as t
from st_codegen.st import walk
from st_codegen.st.check.constants import NotConstantError, evaluate
from st_codegen.st.errors import Problem
from st_codegen.st.syntax import declarations as d
from st_codegen.st.syntax.scan import CommentKind, Scanned
from st_codegen.st.syntax.source import ParsedFiles
from st_codegen.st.types import LREAL, REAL, ArrayType, Elementary, EnumType, Scalar, StructType, Type

SMALLEST_REAL, LARGEST_REAL = 1e-37, 1e37
#: Functions of REAL that round nothing.
_EXACT_FUNCTIONS = frozenset({"ABS", "MIN", "MAX"})
_FLAGS = re.IGNORECASE | re.ASCII
# What stands between quotes is no code
_CODE = re.compile(r"'(?:[^'$\r\n]|\$.)*+'|\"(?:[^\"$\r\n]|\$.)*+\"")
#: Why a piece of text outside of comments and strings is refused, by its pattern; upper and lower case are alike.
_REFUSED = tuple(
    (re.compile(pattern, _FLAGS), reason)
    for pattern, reason in {
        r"\bEND_(?:IF|CASE|FOR|WHILE|REPEAT)\b(?!\s*;)": "is not followed by a semicolon",
        r"(?<![0-9A-Z_#.])[0-9][0-9_]*E[+-]?[0-9]+": "is a real literal without a dot",
        r"\*\*": "is not portable: multiply, or use EXPT",
        r"\bCONTINUE\b": "is not portable: use IF",
        r"\b(?:AND_THEN|OR_ELSE)\b": "is not portable: nest IF",
        r"\b[A-Z0-9_]*__[A-Z0-9_]*\b": "has two underscores in a row",
        r"\b(?:POINTER|REFERENCE)\s+TO\b": "is not portable",
        r"\b(?:ADR|SIZEOF)\s*\(": "is not portable",
        r"\b(?:THIS|SUPER)\s*\^": "is not portable",
        r"\bEXTENDS\b": "is not portable",
        r"\bUNION\b": "is not portable: test for NaN with x < 1.0 OR x > -1.0",
        r"\b(?:TANH|FLOOR|CEIL|ATAN2)\b": "is no standard function",
        r"%[IQM][XBWDL]?\*": "is not portable: an address needs a number",
    }.items()
)


@dataclass(frozen=True)
class Text:
    """What the rules look at: the source and the checked project it gives."""

    source: ParsedFiles
    project: t.Project

    @cached_property
    def nodes(self) -> list[t.Node]:
        """All nodes of the declarations as they are written."""
        found: list[t.Node] = []
        stack: list[object] = list(self.source.declarations)
        while stack:
            item = stack.pop()
            if isinstance(item, tuple):
                stack.extend(item)
            elif isinstance(item, t.Node):
                found.append(item)
                if not isinstance(item, d.NumberTable):
                    stack.extend(vars(item).values())
        return found

    @cached_property
    def expressions(self) -> list[t.Expression]:
        """All expressions of the checked project."""
        return [part for pou in self.project.pous.values() for part in walk.all_expressions(pou.body)]

    @cached_property
    def array_types(self) -> set[str]:
        """The upper-case names of types that say what a plain array says."""
        aliases = (item for item in self.source.declarations if isinstance(item, d.AliasDeclaration))
        return {item.name.upper() for item in aliases if isinstance(item.type, d.ArraySpec)}

    @cached_property
    def declared(self) -> dict[t.Variable, d.VariableDeclaration]:
        """The declaration that made each variable."""
        by_position = {item.position: item for item in self.nodes if isinstance(item, d.VariableDeclaration)}
        variables = (variable for pou in self.project.pous.values() for variable in pou.variables)
        return {variable: by_position[variable.position] for variable in variables}

    @cached_property
    def passed_arrays(self) -> list[tuple[t.Variable, t.Node]]:
        """Variables of array types that are parameters or arguments, and where."""
        found: list[tuple[t.Variable, t.Node]] = []
        sections = (t.Section.INPUT, t.Section.OUTPUT, t.Section.IN_OUT)
        for pou in self.project.pous.values():
            found += [
                (item, self.declared[item]) for item in pou.section(*sections) if isinstance(item.type, ArrayType)
            ]
        for call in self.expressions:
            for argument in call.arguments if isinstance(call, t.Call) else ():
                value = argument.value
                if (
                    isinstance(value, t.VariableRef)
                    and isinstance(value.type, ArrayType)
                    and value.variable in self.declared
                ):
                    found.append((value.variable, t.Identifier(value.variable.name, position=value.position)))
        return found


def violations_in(source: ParsedFiles, project: t.Project) -> tuple[Problem, ...]:
    """What in a source is not portable that the checker has accepted as `project`, in the order of the text."""
    text = Text(source, project)
    return tuple(sorted({problem for rule in RULES for problem in rule(text)}))


def _problem(node: t.Node, message: str) -> Problem:
    return Problem(node.position, message)


def pieces_of_text(text: Text) -> Iterator[Problem]:
    """Refuses comments, pragmas and pieces of text that the table refuses."""
    for scanned in text.source.scans:
        for comment in scanned.comments:
            if comment.kind is not CommentKind.BLOCK:
                yield _at(scanned, comment.start, f"a comment of the form {comment.kind.value}: use (* *), not nested")
        for pragma in scanned.pragmas:
            yield _at(scanned, pragma.start, "pragmas and attributes are not portable")
        code = scanned.segment.text
        if "'" in code or '"' in code:
            code = _CODE.sub(lambda match: "'" + " " * (len(match[0]) - 2) + "'", code)
        for pattern, reason in _REFUSED:
            for match in (match for span in scanned.segment.spans for match in pattern.finditer(code, *span)):
                yield _at(scanned, match.start(), f"'{match[0]}' {reason}")


def _at(scanned: Scanned, offset: int, message: str) -> Problem:
    return Problem(scanned.segment.position(offset), message)


def literals(text: Text) -> Iterator[Problem]:
    """Refuses scalar literals that some compilers read as REAL first."""
    for node in text.nodes:
        if isinstance(node, t.Literal) and node.kind is t.LiteralKind.REAL and isinstance(node.value, float):
            size = abs(node.value)
            if size and not SMALLEST_REAL <= size <= LARGEST_REAL:
                yield _problem(node, f"the literal {node.value} is outside of {SMALLEST_REAL}..{LARGEST_REAL}")


def initial_values(text: Text) -> Iterator[Problem]:
    """Refuses repeat counts, and structures whose fields are not all given."""
    for node in text.nodes:
        if isinstance(node, d.Repeated):
            yield _problem(node, f"the initialiser {node.count}(..) is not portable: write all values")
    for variable, declaration in text.declared.items():
        if isinstance(variable.type, StructType) and isinstance(declaration.initial, d.StructInitial):
            missing = len(variable.type.fields) - len(declaration.initial.members)
            if missing:
                yield _problem(declaration, f"'{variable.name}': no initial value for {counted(missing, 'field')}")


def arrays(text: Text) -> Iterator[Problem]:
    """Refuses bounds that are no numbers, arrays of arrays, arrays of structures with initial values."""
    for node in text.nodes:
        if isinstance(node, d.ArraySpec):
            for bounds in node.ranges:
                if not (_is_number(bounds.lower) and _is_number(bounds.upper)):
                    yield _problem(bounds, "the bounds of an array are numbers, not names or expressions")
            if isinstance(node.element, d.ArraySpec) or _names(node.element) & text.array_types:
                yield _problem(node, "arrays of arrays are not portable: use several dimensions")
        if isinstance(node, d.VariableDeclaration | d.AliasDeclaration) and node.initial is not None:
            element = node.type.element if isinstance(node.type, d.ArraySpec) else None
            if element is not None and any(
                isinstance(text.project.types.get(name), StructType) for name in _names(element)
            ):
                yield _problem(node, f"'{node.name}': arrays of structures with initial values are not portable")


def _names(spec: d.TypeSpec) -> set[str]:
    return {spec.name.upper()} if isinstance(spec, d.NamedType) else set()


def _is_number(node: t.Expression) -> bool:
    inner = node.operand if isinstance(node, t.Unary) and node.operator == "NEG" else node
    return isinstance(inner, t.Literal) and inner.kind is t.LiteralKind.INTEGER and inner.type_name is None


def array_types(text: Text) -> Iterator[Problem]:
    """Refuses arrays that are passed without a named type, and named types that no array needs."""
    needed: set[str] = set()
    for variable, where in text.passed_arrays:
        spec = text.declared[variable].type
        needed |= _names(spec)
        if isinstance(spec, d.ArraySpec):
            yield _problem(where, f"'{variable.name}' is passed: its array type needs a name of its own")
    for pou in text.nodes:
        if isinstance(pou, d.PouDeclaration) and pou.return_type is not None:
            needed |= _names(pou.return_type)
            if isinstance(pou.return_type, d.ArraySpec):
                yield _problem(pou, f"the result of '{pou.name}' is an array: its type needs a name of its own")
    for node in text.nodes:
        if isinstance(node, d.AliasDeclaration) and node.name.upper() in text.array_types - needed:
            yield _problem(node, f"the type '{node.name}' says only what a plain array says, and is not passed")


def tables(text: Text) -> Iterator[Problem]:
    """Refuses globals, and tables outside of the VAR CONSTANT of a block."""
    for node in text.source.declarations:
        if isinstance(node, d.GlobalDeclarations):
            yield _problem(node, "VAR_GLOBAL outside of a CONFIGURATION")
    for variable, declaration in text.declared.items():
        in_block = variable.storage is t.Storage.INSTANCE
        if isinstance(variable.type, ArrayType) and declaration.initial is not None:
            if not in_block:
                yield _problem(declaration, f"the table '{variable.name}' belongs into the VAR CONSTANT of a block")
            elif not variable.is_constant and not _is_uniform(declaration.initial):
                yield _problem(declaration, f"the table '{variable.name}' is not CONSTANT")


def _is_uniform(initial: d.Initial) -> bool:
    """Whether an initialiser only presets an array with one value."""
    return isinstance(initial, d.NumberTable) and bool((initial.values == initial.values[0]).all())


def methods(text: Text) -> Iterator[Problem]:
    """Refuses methods."""
    for node in text.nodes:
        if isinstance(node, d.PouDeclaration) and node.kind is t.PouKind.METHOD:
            yield _problem(node, f"the method '{node.name}' is not portable")


def arithmetic(text: Text) -> Iterator[Problem]:
    """Refuses integers narrower than DINT in arithmetic, and REAL where a compiler may compute with more digits.

    One operation of REAL numbers that is stored at once gives the same in whatever precision between: LREAL has more
    than twice the digits, so that rounding twice is rounding once. A sign, ABS, MIN and MAX round nothing. Text for
    controllers without LREAL, in which nothing is one, has no other way to compute.
    """
    has_lreal = any(
        LREAL in (variable.type, getattr(variable.type, "element", None))
        for pou in text.project.pous.values()
        for variable in pou.variables
    )
    stored = {id(expression) for expression in _stored_operations(text)}
    for expression in text.expressions:
        if isinstance(expression, t.Unary | t.Binary) and expression.operator not in ("NOT", "AND", "OR", "XOR"):
            exact = expression.type == REAL and (
                not has_lreal or isinstance(expression, t.Unary) or id(expression) in stored
            )
            problem = None if exact else _narrow(expression.type)
            if problem:
                yield Problem(expression.position, problem)
        if (
            isinstance(expression, t.StandardCall)
            and expression.type == REAL
            and has_lreal
            and expression.function not in _EXACT_FUNCTIONS
        ):
            yield Problem(expression.position, f"{expression.function} of REAL: compute in LREAL and convert")
    for pou in text.project.pous.values():
        for statement in walk.statements(pou.body):
            if isinstance(statement, t.For) and _narrow(statement.counter.type):
                yield Problem(statement.position, f"a FOR loop counts with {statement.counter.type}: use DINT")


def _stored_operations(text: Text) -> Iterator[t.Binary]:
    """Operations of REAL numbers that are all of what is assigned to a REAL."""
    for pou in text.project.pous.values():
        for statement in walk.statements(pou.body):
            if isinstance(statement, t.Assign) and statement.target.type == REAL:
                value = statement.value
                if isinstance(value, t.Binary) and not any(
                    isinstance(inner, t.Binary) and inner.type == REAL
                    for operand in (value.left, value.right)
                    for inner in walk.expressions(operand)
                ):
                    yield value


def _narrow(type_: Type) -> str | None:
    if isinstance(type_, EnumType) or not isinstance(type_, Elementary):
        return None
    if type_.is_integer and type_.bits < 32:
        return f"arithmetic of {type_} differs between compilers: use DINT"
    if type_ == REAL:
        return "arithmetic of REAL differs between targets: compute in LREAL and convert"
    return None


def self_comparisons(text: Text) -> Iterator[Problem]:
    """Refuses comparisons of a number with itself: a compiler may take them for constants."""
    for expression in text.expressions:
        if isinstance(expression, t.Compare) and expression.left == expression.right:
            message = "a number is compared with itself: test for NaN with x < 1.0 OR x > -1.0"
            yield Problem(expression.position, message)


def rounding(text: Text) -> Iterator[Problem]:
    """Refuses conversions from real numbers to integers that round."""
    for expression in text.expressions:
        if isinstance(expression, t.Conversion):
            source, target = expression.operand.type, expression.type
            if (
                isinstance(source, Elementary)
                and isinstance(target, Elementary)
                and source.is_real
                and target.is_integral
            ):
                yield Problem(expression.position, f"{source}_TO_{target} depends on how .5 rounds: use TRUNC")


Rule = Callable[[Text], Iterator[Problem]]
RULES: tuple[Rule, ...] = (
    pieces_of_text,
    literals,
    initial_values,
    arrays,
    array_types,
    tables,
    methods,
    arithmetic,
    self_comparisons,
    rounding,
)


# --- what no generated text has, in whatever dialect: constructs that compilers in use get wrong ---


def single_rounds(project: t.Project) -> tuple[Problem, ...]:
    """Loops from a constant to the same constant, whose body a compiler in use never runs, in the order of the text."""
    return tuple(sorted(_single_rounds(project)))


def _single_rounds(project: t.Project) -> Iterator[Problem]:
    for pou in project.pous.values():
        for statement in walk.statements(pou.body):
            if isinstance(statement, t.For):
                start, stop = _constant(statement.start), _constant(statement.stop)
                if start is not None and start == stop:
                    yield Problem(statement.position, f"a loop from {start} to {stop}: write its body once")


def _constant(expression: t.Expression) -> Scalar | None:
    try:
        return evaluate(expression)
    except NotConstantError:
        return None
