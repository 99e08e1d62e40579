"""What a text may not have where it is to be proved: all that gives its statements another meaning than they say.

The executors read checked statements. Conditional compilation, comments that compilers end at different places,
addresses that two variables may share, values that survive a restart or are set by a method that runs before the first
call, and names that belong to another input are not seen there. They are refused here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from st_codegen.emit.blocks.model import input_variables, renamed
from st_codegen.ir import ModelIR
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.runner import GeneratedCode
from st_codegen.st import Project, walk
from st_codegen.st import tree as t
from st_codegen.st.check.flow import all_reached
from st_codegen.st.syntax import declarations as d
from st_codegen.st.syntax.scan import CommentKind, Scanned

#: Methods that TwinCAT and CODESYS call by themselves, before the first call of a block.
_UNCALLED = {"FB_INIT", "FB_REINIT", "FB_EXIT"}


#: Siemens: where the variables of a block lie in memory, not what is in them.
_MEMORY = re.compile(r"\{\s*S7_Optimized_Access\s*:=\s*'(?:TRUE|FALSE)'\s*\}")

#: Conversions by their types, and those that are the same everywhere, as TRUNC is: of bits, or nothing is lost.
_TYPE = r"(?:BOOL|BYTE|[DL]?WORD|U?[SDL]?INT|L?REAL|L?TIME)"
_CONVERSION = re.compile(rf"\b(?:{_TYPE}_)?TO_{_TYPE}\b", re.IGNORECASE)
_EXACT = {"LREAL_TO_REAL", "REAL_TO_LREAL", "BOOL_TO_DINT", "DINT_TO_DWORD", "DWORD_TO_DINT", "DINT_TO_LREAL"}
_EXACT |= {f"{narrow}_TO_DINT" for narrow in ("SINT", "USINT", "INT", "UINT")}
#: Attributes that change no value; others may keep it over a restart, or let something else write it.
_HARMLESS = {"hide", "linkalways", "no_check", "qualified_only", "strict"}
#: What ends a line, and so a comment, for some compilers only.
_LINE_ENDS = "\x0b\x0c\x1c\x1d\x1e\x85\u2028\u2029"


def check_text(code: GeneratedCode, block: str) -> None:
    """Raise NotProvedError for what gives a block, or what it calls, another meaning than its statements say."""
    units = [code.project.pous[key] for key in all_reached(code.project, block.upper())]
    for unit in units:
        if unit.base is not None or unit.modifiers or _UNCALLED & set(unit.methods):
            raise NotProvedError(f"{unit.position}: {unit.name} extends a block or has a method that nobody calls")
        _check_statements(unit)
    keys = {unit.key for unit in units}
    declared = [item for item in code.source.declarations if isinstance(item, d.PouDeclaration | d.GlobalDeclarations)]
    owners = [item for item in declared if isinstance(item, d.GlobalDeclarations) or item.name.upper() in keys]
    files = {item.position.file for item in owners}
    for problem in code.implicit_conversions:
        if problem.position.file in files:
            raise NotProvedError(f"{problem}: a conversion that is left to the compiler")
    names = {Path(file).name for file in files}
    for path in code.folder.rglob("*"):
        if path.name in names and _has_other_line_ends(path.read_bytes().decode("utf-8", "replace")):
            raise NotProvedError(f"{path.name}: a character that ends a line for some compilers only")
    for scanned in code.source.scans:
        if scanned.segment.file in files:
            _check_scanned(scanned)
    for owner in owners:
        for variable in _kept_elsewhere(owner):
            raise NotProvedError(f"{variable.position}: {variable.name} has an address, or survives a restart")


def _has_other_line_ends(text: str) -> bool:
    return any(end in text for end in _LINE_ENDS) or text.count("\r") != text.count("\r\n")


def _check_scanned(scanned: Scanned) -> None:
    """Raise NotProvedError for conversions, comments and pragmas that compilers read differently."""
    segment = scanned.segment
    for found in (match for span in segment.spans for match in _CONVERSION.finditer(segment.text, *span)):
        if found[0].upper() not in _EXACT:
            where = scanned.segment.position(found.start())
            raise NotProvedError(f"{where}: {found[0]}: what the type does not hold, compilers convert differently")
    for comment in scanned.comments:
        if comment.kind is CommentKind.NESTED:
            where = scanned.segment.position(comment.start)
            raise NotProvedError(f"{where}: a comment in a comment, which compilers end at different places")
    for pragma in scanned.pragmas:
        if not _MEMORY.fullmatch(pragma.text) and pragma.attribute not in _HARMLESS:
            where = scanned.segment.position(pragma.start)
            raise NotProvedError(f"{where}: the pragma {pragma.text} may change what the text does")


def _check_statements(unit: t.Pou) -> None:
    """Raise NotProvedError for loops that change their bounds, inputs that are changed, and arithmetic in REAL."""
    for expression in walk.all_expressions(unit.body):
        if isinstance(expression, t.Binary | t.StandardCall) and str(expression.type) == "REAL":
            raise NotProvedError(f"{expression.position}: arithmetic in REAL, which rounds after each operation")
    for statement in walk.statements(unit.body):
        if isinstance(statement, t.For):
            if isinstance(statement.start, t.Constant) and statement.start == statement.stop:
                raise NotProvedError(
                    f"{statement.position}: a loop of one round, which a compiler is known to leave out"
                )
            changed = {statement.variable} | walk.assigned_variables(statement.body)
            if changed & set().union(*map(walk.variables, (statement.start, statement.stop, statement.step))):
                raise NotProvedError(
                    f"{statement.position}: a loop whose bounds change in it, which some compilers see"
                )
    for variable in walk.assigned_variables(unit.body):
        if variable.section is t.Section.INPUT and variable.storage is t.Storage.INSTANCE:
            raise NotProvedError(f"{unit.position}: {unit.name} assigns its input {variable.name}")


def _kept_elsewhere(owner: d.PouDeclaration | d.GlobalDeclarations) -> Iterator[d.VariableDeclaration]:
    """Variables with addresses, or that survive a restart. Of globals a proof reads constants only."""
    for block in owner.blocks:
        if isinstance(owner, d.PouDeclaration) or "CONSTANT" in block.qualifiers:
            survives = bool(block.qualifiers - {"CONSTANT"})
            yield from (variable for variable in block.variables if survives or variable.address is not None)


def check_interface(model: ModelIR, project: Project, block: str, outputs: tuple[int, ...]) -> None:
    """Raise NotProvedError where the inputs and outputs of a block are not those of the model, by name and type."""
    unit = project.pous[block.upper()]
    for found, wanted in _wrong_names(model, unit, outputs):
        raise NotProvedError(f"{unit.name}.{found} stands where the model has {wanted}")
    if unit.section(t.Section.IN_OUT):
        raise NotProvedError(f"{unit.name} has parameters that it changes")


def output_names(model: ModelIR, outputs: tuple[int, ...]) -> list[str]:
    """What a block calls the outputs of a model: by the model's own names, unless it holds several models."""
    alone = outputs == tuple(range(len(model.variables)))
    return list(model.variables) if alone else [f"fOut{number + 1}" for number in outputs]


def _wrong_names(model: ModelIR, unit: t.Pou, outputs: tuple[int, ...]) -> Iterator[tuple[str, str]]:
    taken = {variable.key for variable in unit.variables if variable.section is not t.Section.INPUT}
    for variable, own in zip(unit.section(t.Section.INPUT), input_variables(model.features), strict=True):
        wanted = renamed(own) if own.name.upper() in taken else own
        if variable.key != wanted.name.upper() or str(variable.type) != "LREAL":
            yield f"{variable.name} : {variable.type}", f"{wanted.name} : LREAL"
    numbers = [variable for variable in unit.section(t.Section.OUTPUT) if str(variable.type) != "BOOL"]
    for number, wanted_name in zip(outputs, output_names(model, outputs), strict=True):
        kind = "DINT" if model.classes is not None and number == 0 else "LREAL"
        variable = numbers[number]
        if variable.key != wanted_name.upper() or str(variable.type) != kind:
            yield f"{variable.name} : {variable.type}", f"{wanted_name} : {kind}"
