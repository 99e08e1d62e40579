"""Costs of small pieces of Structured Text."""

from st_codegen.cost.operations import as_mapping
from st_codegen.cost.profile import load_profile
from st_codegen.cost.report import project_cost
from st_codegen.cost.units import Units
from st_codegen.st import parse_project

PROFILE = load_profile()


def project(text, dialect="twincat"):
    return parse_project({"t.st": text}, dialect)


def block(body, variables="", inputs=""):
    """A function block FB_T."""
    given = f"VAR_INPUT {inputs} END_VAR\n" if inputs else ""
    return f"FUNCTION_BLOCK FB_T\n{given}VAR {variables} END_VAR\n{body}\nEND_FUNCTION_BLOCK\n"


VARIABLES = """
    i : DINT; n : DINT; m : DINT; x : LREAL; y : LREAL; r : REAL; b : BOOL; c : BOOL;
    a : ARRAY[0..7] OF LREAL; q : ARRAY[0..3, 0..4] OF LREAL; s : ARRAY[0..7] OF LREAL;
"""
CONSTANTS = """END_VAR
VAR CONSTANT
    T : ARRAY[0..99] OF LREAL := [100(1.5)];
    K : ARRAY[0..3] OF DINT := [3, 1, 4, 1];
    ROWS : ARRAY[0..5] OF DINT := [0, 40, 42, 45, 80, 80];
    W : LREAL := 2.0; L : DINT := 5;
"""


def unit(body, variables=VARIABLES + CONSTANTS, before="", inputs=""):
    """The cost of FB_T with all variables that the tests use."""
    checked = project(before + block(body, variables, inputs))
    return Units(checked, PROFILE).of("FB_T")


def counts(body, **more):
    return as_mapping(unit(body, **more).cost.total)


def cost(text, dialect="twincat", entries=None):
    return project_cost(project(text, dialect), PROFILE, entries)
