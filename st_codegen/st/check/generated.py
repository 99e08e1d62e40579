"""What no generated text has, in whatever dialect: constructs that compilers in use get wrong."""

from __future__ import annotations

from collections.abc import Iterator

from st_codegen.st import tree as t
from st_codegen.st import walk
from st_codegen.st.check.constants import NotConstantError, evaluate
from st_codegen.st.errors import Problem
from st_codegen.st.types import Scalar


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
