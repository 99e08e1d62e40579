"""Ways through a checked tree, for passes that look for something everywhere."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from st_codegen.st import tree as t


def parts(expression: t.Expression) -> tuple[t.Expression, ...]:  # noqa: PLR0911 - one return a case
    """The expressions directly inside of an expression."""
    match expression:
        case t.InstanceVariable(base=base) | t.FieldRef(base=base):
            return (base,)
        case t.ElementRef(base=base, indices=indices):
            return (base, *indices)
        case t.PointerTarget(pointer=inner) | t.AddressOf(target=inner):
            return (inner,)
        case t.Unary(operand=inner) | t.Conversion(operand=inner):
            return (inner,)
        case t.Binary() | t.ShortCircuit() | t.Compare():
            return (expression.left, expression.right)
        case t.StandardCall(arguments=arguments):
            return arguments
        case t.Call(receiver=receiver, arguments=given):
            values = tuple(argument.value for argument in given)
            return values if receiver is None else (receiver, *values)
        case _:
            return ()


def expressions(root: t.Expression) -> Iterator[t.Expression]:
    """An expression and all inside of it, outer ones first."""
    stack = [root]
    while stack:
        current = stack.pop()
        yield current
        stack.extend(reversed(parts(current)))


def variables(root: t.Expression) -> set[t.Variable]:
    """The variables that an expression reads."""
    named = (part for part in expressions(root) if isinstance(part, t.VariableRef | t.InstanceVariable))
    return {part.variable for part in named}


def own_expressions(statement: t.Statement) -> tuple[t.Expression, ...]:  # noqa: PLR0911 - one return a case
    """The expressions of a statement itself, not of the statements inside of it."""
    match statement:
        case t.Assign():
            return (statement.target, statement.value)
        case t.CallStatement():
            return (statement.call,)
        case t.If():
            return tuple(branch.condition for branch in statement.branches)
        case t.Case():
            return (statement.selector,)
        case t.For():
            return (statement.counter, statement.start, statement.stop, statement.step)
        case t.While() | t.Repeat():
            return (statement.condition,)
        case _:
            return ()


def bodies(statement: t.Statement) -> tuple[tuple[t.Statement, ...], ...]:
    """The statement lists directly inside of a statement."""
    match statement:
        case t.If() | t.Case():
            return (*(branch.body for branch in statement.branches), statement.otherwise)
        case t.For() | t.While() | t.Repeat():
            return (statement.body,)
        case _:
            return ()


def statements(body: Iterable[t.Statement]) -> Iterator[t.Statement]:
    """All statements of a body, inner ones included, in the order of the text."""
    stack = list(body)[::-1]
    while stack:
        current = stack.pop()
        yield current
        for inner in reversed(bodies(current)):
            stack.extend(reversed(inner))


def all_expressions(body: Iterable[t.Statement]) -> Iterator[t.Expression]:
    """All expressions of a body, those of inner statements included."""
    for statement in statements(body):
        for root in own_expressions(statement):
            yield from expressions(root)


def calls(body: Iterable[t.Statement]) -> Iterator[t.Call]:
    """All calls of units in a body; standard functions are none."""
    return (expression for expression in all_expressions(body) if isinstance(expression, t.Call))


def assigned_places(body: Iterable[t.Statement]) -> Iterator[t.Expression]:
    """Everything that a body assigns: targets, counters, outputs and in-outs of calls."""
    for statement in statements(body):
        if isinstance(statement, t.Assign):
            yield statement.target
        elif isinstance(statement, t.For):
            yield statement.counter
    for call in calls(body):
        for argument in call.arguments:
            if argument.passing is not t.Passing.INPUT:
                yield argument.value


def assigned_variables(body: Iterable[t.Statement]) -> set[t.Variable]:
    """The variables a body assigns as a whole or in part; what called units assign is not among them."""
    roots = (t.root_variable(place) for place in assigned_places(body))
    return {variable for variable in roots if variable is not None}
