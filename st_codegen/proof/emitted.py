"""What the compiler has written is read back before anybody gets it."""

from __future__ import annotations

from pathlib import Path

from st_codegen.errors import DefectError, GeneratedCodeError
from st_codegen.proof.runner import GeneratedCode
from st_codegen.st.check.generated import single_rounds
from st_codegen.st.check.portable import violations_in

#: Problems that a message lists.
_NAMED = 5


def check_emitted(folder: Path, dialect: str, *, portable: bool) -> None:
    """Read the text of a folder as a strict compiler would, and look for what no generated text may have.

    `portable`: the text claims to be of the portable subset as a whole. Raises DefectError that lists what is wrong.
    """
    try:
        code = GeneratedCode(folder, dialect)
        problems = single_rounds(code.project)
        if portable:
            problems += violations_in(code.source, code.project)
    except GeneratedCodeError as error:
        raise DefectError(f"st-codegen wrote text that it cannot read itself, please report this: {error}") from error
    if problems:
        shown = [f"  - {problem}" for problem in problems[:_NAMED]]
        shown += [f"  - and {len(problems) - _NAMED} more"] if len(problems) > _NAMED else []
        raise DefectError("\n".join(["st-codegen wrote text that it must not write, please report this:", *shown]))
