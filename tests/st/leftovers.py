"""What generated text has no use for, in whatever dialect."""

from __future__ import annotations

from st_codegen.st import tree as t
from st_codegen.st import walk
from st_codegen.st.errors import Problem


def unused_variables(project: t.Project) -> tuple[Problem, ...]:
    """Local variables and constants that the body of their unit does not mention, in the order of the text."""
    found = []
    for pou in project.pous.values():
        read = {part.variable for part in walk.all_expressions(pou.body) if isinstance(part, t.VariableRef)}
        unread = (variable for variable in pou.variables if variable.section is t.Section.VAR and variable not in read)
        found += [Problem(variable.position, f"'{variable.name}' is declared and not used") for variable in unread]
    return tuple(sorted(found))
