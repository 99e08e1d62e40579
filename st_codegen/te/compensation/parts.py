"""What the blocks of the compensation share: ports, checks of inputs, calls."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial

from st_codegen.emit.blocks.listing import Block, BlockVariable, Code, CodeSection
from st_codegen.emit.blocks.model import header_lines, input_variables
from st_codegen.emit.literals import real
from st_codegen.te.compensation.codes import TE_ERROR
from st_codegen.te.harmonics import Direction, TransmissionError

#: The type of one number for each harmonic; strict compilers want a name for arrays that blocks exchange.
HARMONICS_TYPE = "T_Harmonics"

#: Ends of names of what belongs to a direction.
SUFFIX = {Direction.FORWARD: "Fw", Direction.BACKWARD: "Bw"}

#: Inputs beyond these are no measurement but a fault.
LARGEST_ANGLE = 1e9
LARGEST_INPUT = 1e9

#: What the machine gives to the law, which limits it to no range of a model.
SIGNED_SPEED = "input speed, its sign is the direction, rpm"


@dataclass(frozen=True)
class Check:
    """An input that must lie within a closed range, and the code where it does not.

    `kept`: the local variable that keeps the last usable value, for calls in which the input is not usable.
    """

    name: str
    lower: str
    upper: str
    code: Code
    kept: str = ""


def check(name: str, lower: float, upper: float, code: Code, kept: str = "") -> Check:
    """A check with its limits as text."""
    return Check(name, real(lower), real(upper), code, kept)


@dataclass(frozen=True)
class CallArgument:
    """One argument of a call; with the list of signals that its value stands in, where it is one."""

    name: str
    value: str
    list: str = ""


def operating_point(te: TransmissionError) -> tuple[BlockVariable, ...]:
    """The features as the machine gives them: of the speed the models take the magnitude."""
    inputs = list(input_variables(te.features))
    speed = inputs[te.speed_feature]
    comment = f"sign: direction; magnitude, for the models: {speed.comment}"
    inputs[te.speed_feature] = replace(speed, comment=comment)
    return tuple(inputs)


def order_index(te: TransmissionError) -> tuple[BlockVariable, ...]:
    """The variable of loops over the harmonics; none for one harmonic, since loops of one round are not written."""
    return (dint("nOrder", "number of the harmonic"),) if len(te.orders) > 1 else ()


def names_of(variables: Iterable[BlockVariable]) -> list[str]:
    """The names of variables, in their order."""
    return [variable.name for variable in variables]


def same(names: Iterable[str]) -> list[CallArgument]:
    """Arguments that are called as the variables that are passed."""
    return [CallArgument(name, name) for name in names]


def _declared(type_: str, name: str, comment: str, initial: str = "") -> BlockVariable:
    """Declare a variable of a type."""
    return BlockVariable(name, type_, initial=initial, comment=comment)


lreal, boolean, dint = (partial(_declared, type_) for type_ in ("LREAL", "BOOL", "DINT"))


def error_output() -> BlockVariable:
    """The error code of a block."""
    return BlockVariable("eError", TE_ERROR.type, comment="NONE, or why bValid is FALSE")


def set_parts(te: TransmissionError) -> list[tuple[str, str]]:
    """Names and meanings of a set of coefficients: the two parts of every harmonic, for each direction."""
    return [
        (f"a{part}{SUFFIX[direction]}", f"A_k * {function}(phi_k) {direction}, deg")
        for direction in te.directions
        for part, function in (("Cosine", "cos"), ("Sine", "sin"))
    ]


def set_variables(te: TransmissionError) -> tuple[BlockVariable, ...]:
    """A set of coefficients as variables."""
    return tuple(BlockVariable(name, HARMONICS_TYPE, comment=comment) for name, comment in set_parts(te))


def within_function() -> Block:
    """F_IsWithin: the only comparison that the blocks make with a number that may be none."""
    return Block(
        "F_IsWithin",
        header_lines(
            "F_IsWithin: TRUE for a number within fLower .. fUpper; FALSE for what is no number.",
            "NaN is recognised before anything is compared with it.",
        ),
        inputs=(
            lreal("fValue", "any 64 bits"),
            lreal("fLower", "lower limit, itself allowed"),
            lreal("fUpper", "upper limit, itself allowed"),
        ),
        sections=(CodeSection("not a number, then the range", "te_within", {}),),
        kind="FUNCTION",
        result="BOOL",
    )
