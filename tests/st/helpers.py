"""Runs small pieces of Structured Text in one copy and in rows, and checks that they agree."""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

from st_codegen.st import Machine, Problem, StCheckError, StRuntimeError, parse_project
from st_codegen.st.check.check import check
from st_codegen.st.check.portable import violations_in
from st_codegen.st.dialects import IEC
from st_codegen.st.syntax.source import ParsedFiles
from st_codegen.st.tree import Project

ROWS = 3


def bits(value: Any) -> Any:
    """Something that is equal when all bits are."""
    if isinstance(value, np.ndarray):
        return (value.dtype.str, value.tobytes())
    if isinstance(value, np.generic):
        return bits(value.item())
    return struct.pack("<d", value) if isinstance(value, float) else (type(value).__name__, value)


def block(body: str, variables: str = "", before: str = "", inputs: str = "") -> str:
    """A function block FB_T; `variables` and `inputs` are declarations."""
    given = f"VAR_INPUT {inputs} END_VAR\n" if inputs else ""
    return f"{before}\nFUNCTION_BLOCK FB_T\n{given}VAR {variables} END_VAR\n{body}\nEND_FUNCTION_BLOCK\n"


@lru_cache(maxsize=50)
def project(text: str, dialect: str = "twincat") -> Project:
    return parse_project({"t.st": text}, dialect)


def problems(text: str, dialect: str = "twincat") -> list[str]:
    """What the checker says, without positions."""
    with pytest.raises(StCheckError) as caught:
        project(text, dialect)
    return [problem.message for problem in caught.value.problems]


def violations(source: ParsedFiles) -> tuple[Problem, ...]:
    """What in a source, which the checker must accept, is not portable."""
    return violations_in(source, check(source, IEC))


def run(text: str, read: str | tuple[str, ...], dialect: str = "twincat", calls: int = 1, **inputs: Any) -> Any:
    """Call FB_T in one copy and in rows and read variables, which must agree. Raises what both raise."""
    checked = project(text, dialect)
    names = (read,) if isinstance(read, str) else read
    results: list[Any] = []
    errors: list[StRuntimeError] = []
    for machine in (Machine(checked, ROWS, loop_limit=1000), Machine(checked, loop_limit=1000)):
        instance = machine.instance("FB_T")
        try:
            for _ in range(calls):
                instance(**inputs)
        except StRuntimeError as error:
            errors.append(error)
        else:
            values = [instance[name] for name in names]
            is_plain = machine.rows is None
            results.append([value if is_plain or isinstance(value, dict) else value[0] for value in values])
    if errors:
        assert len(errors) == 2, f"only one machine fails: {errors[0]}"
        first, second = errors
        assert (first.kind, first.position, first.row) == (second.kind, second.position, second.row)
        assert [bits(value) for value in first.operands] == [bits(value) for value in second.operands]
        assert first.detail == second.detail
        raise first
    if not any(isinstance(value, dict) for value in results[1]):
        assert [bits(value) for value in results[0]] == [bits(value) for value in results[1]]
    return results[1][0] if isinstance(read, str) else tuple(results[1])


def value(expression: str, type_: str, dialect: str = "twincat", before: str = "", **given: tuple[str, Any]) -> Any:
    """An expression of a type in one copy and in rows, with variables given as (type, value)."""
    inputs = "".join(f"{name} : {kind}; " for name, (kind, _) in given.items())
    text = block(f"zResult := {expression};", f"zResult : {type_};", before, inputs)
    return run(text, "zResult", dialect, **{name: number for name, (_, number) in given.items()})


def fault(expression: str, type_: str, dialect: str = "twincat", **given: tuple[str, Any]) -> str:
    """The kind of the error that an expression gives in one copy and in rows."""
    with pytest.raises(StRuntimeError) as caught:
        value(expression, type_, dialect, **given)
    return caught.value.kind
