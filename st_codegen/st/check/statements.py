"""The check of statements."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import cast

from st_codegen.st import tree as t
from st_codegen.st import walk
from st_codegen.st.check.calls import check_assignable
from st_codegen.st.check.declare import Declarations
from st_codegen.st.check.symbols import DeclaredUnit, failure, noted
from st_codegen.st.errors import Problem, StCheckError
from st_codegen.st.types import ArrayType, BlockType, EnumType, Type

#: Statements inside of statements are followed by recursion, here and by all that reads a checked tree.
MAX_NESTED = 30
MAX_LOOPS = 12


class Statements:
    """Checks the body of one unit; an error in a statement does not hide those of the next."""

    def __init__(self, declarations: Declarations, unit: DeclaredUnit, problems: list[Problem]) -> None:
        self._expressions = declarations.expressions(unit)
        self._scope = self._expressions.scope
        self._problems = problems
        self._loops = 0
        self._depth = 0

    def body(self, nodes: Iterable[t.Statement]) -> tuple[t.Statement, ...]:
        """Check statements; those that are free of errors."""
        self._depth += 1
        try:
            return self._body(nodes)
        finally:
            self._depth -= 1

    def _body(self, nodes: Iterable[t.Statement]) -> tuple[t.Statement, ...]:
        made: list[t.Statement] = []
        for node in nodes:
            with noted(self._problems):
                if self._depth > MAX_NESTED or self._loops > MAX_LOOPS:
                    raise failure(node, f"more than {MAX_NESTED} nested statements or {MAX_LOOPS} nested loops")
                made.append(self._statement(node))
        return tuple(made)

    def _statement(self, node: t.Statement) -> t.Statement:  # noqa: PLR0911 - one return a case
        match node:
            case t.Assign():
                return self._assignment(node)
            case t.CallStatement():
                call = self._expressions.call(node.call)
                if not isinstance(call, t.Call):
                    raise failure(node, "the result of this function is not used")
                return replace(node, call=call)
            case t.If():
                return self._if(node)
            case t.Case():
                return self._case(node)
            case t.For():
                return self._for(node)
            case t.While():
                condition = self._condition(node.condition)
                return replace(node, condition=condition, body=self._loop_body(node.body))
            case t.Repeat():
                body = self._loop_body(node.body)
                return replace(node, body=body, condition=self._condition(node.condition))
            case t.Exit() | t.Continue():
                if not self._loops:
                    raise failure(node, f"{type(node).__name__.upper()} outside of a loop")
                return node
            case t.Return():
                return node
            case _:
                raise TypeError(node)

    def _condition(self, node: t.Expression) -> t.Expression:
        """A condition; a wrong one is reported, and checking goes on with what it guards."""
        try:
            return self._expressions.condition(node)
        except StCheckError as error:
            self._problems += error.problems
            return node

    def _loop_body(self, nodes: Iterable[t.Statement]) -> tuple[t.Statement, ...]:
        self._loops += 1
        try:
            return self.body(nodes)
        finally:
            self._loops -= 1

    def _assignment(self, node: t.Assign) -> t.Assign:
        target = self._expressions.check(node.target)
        check_assignable(self._scope, target, node.target)
        holder = target.type
        while isinstance(holder, ArrayType):
            holder = holder.element
        if isinstance(holder, BlockType):
            raise failure(node, f"instances of '{holder}' cannot be assigned")
        value = self._expressions.as_type(node.value, target.type, is_stored=True)
        return replace(node, target=target, value=value)

    def _if(self, node: t.If) -> t.If:
        branches = tuple(
            replace(branch, condition=self._condition(branch.condition), body=self.body(branch.body))
            for branch in node.branches
        )
        return replace(node, branches=branches, otherwise=self.body(node.otherwise))

    def _case(self, node: t.Case) -> t.Case:
        selector = self._expressions.value(node.selector)
        type_ = selector.type
        if not isinstance(type_, EnumType) and not type_.is_integral:
            raise failure(node.selector, f"CASE selects by an integer or an enumeration, not by {type_}")
        taken: list[tuple[int, int]] = []
        branches = []
        for branch in node.branches:
            labels = []
            for label in branch.choices:
                with noted(self._problems):
                    labels.append(self._label(label, type_, taken))
            branches.append(replace(branch, body=self.body(branch.body), labels=tuple(labels)))
        return replace(node, selector=selector, branches=tuple(branches), otherwise=self.body(node.otherwise))

    def _label(self, node: t.Range, type_: Type, taken: list[tuple[int, int]]) -> tuple[int, int]:
        low = cast(int, self._expressions.constant(node.lower, type_).value)
        high = cast(int, self._expressions.constant(node.upper, type_).value)
        if low > high:
            raise failure(node, f"the range {low}..{high} is empty")
        if any(low <= other_high and other_low <= high for other_low, other_high in taken):
            raise failure(node, f"the label {low if low == high else f'{low}..{high}'} stands in this CASE already")
        taken.append((low, high))
        return low, high

    def _for(self, node: t.For) -> t.For:
        expressions = self._expressions
        counter = expressions.check(node.counter)
        check_assignable(self._scope, counter, node.counter)
        if not isinstance(counter, t.VariableRef) or counter.variable.section in (t.Section.IN_OUT, t.Section.GLOBAL):
            raise failure(node.counter, "a FOR loop counts with a variable of its own unit")
        type_ = counter.type
        if not type_.is_integer:
            raise failure(node.counter, f"a FOR loop counts with an integer, not with {type_}")
        start = expressions.as_type(node.start, type_, is_stored=True)
        stop = expressions.as_type(node.stop, type_)
        step = expressions.as_type(node.step, type_)
        if isinstance(step, t.Constant) and step.value == 0:
            raise failure(node, "a FOR loop with a step of zero never ends")
        self._scope.counters.append(counter.variable)
        try:
            body = self._loop_body(node.body)
        finally:
            self._scope.counters.pop()
        self._check_bounds(stop, step, body)
        return replace(node, counter=counter, start=start, stop=stop, step=step, body=body)

    def _check_bounds(self, stop: t.Expression, step: t.Expression, body: tuple[t.Statement, ...]) -> None:
        """Controllers differ in whether they evaluate the bound of a loop once or in every round."""
        assigned = walk.assigned_variables(body)
        for bound in (stop, step):
            for part in walk.expressions(bound):
                if isinstance(part, t.VariableRef) and part.variable in assigned:
                    raise failure(part.position, f"'{part.variable.name}' bounds this FOR loop and is assigned in it")
