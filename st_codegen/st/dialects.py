"""The dialects of Structured Text: a table of rules each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from st_codegen.errors import InputError
from st_codegen.st.types import DINT, INT, LTIME, NUMBERS, TIME_MS, TIME_NS, Elementary


@dataclass(frozen=True, eq=False)
class Dialect:
    """The rules of one dialect. The checker reads them and never asks which dialect it is.

    Every field is a question about text; a new dialect answers all that have no default.
    """

    name: str

    #: The elementary types by upper-case name, strings excepted.
    types: Mapping[str, Elementary]
    #: The type of the values of an enumeration that names none.
    enum_base: Elementary

    #: Whether a value may stand where a type that loses nothing is asked for: INT for DINT, REAL for LREAL, a bit
    #: string for an integer, an enumeration for its base.
    has_widening: bool
    #: Whether a literal without a dot may be a real number, and 0 and 1 may be BOOL.
    has_loose_literals: bool
    #: Whether bit strings are computed with like unsigned integers, and integers with NOT, AND, OR, XOR and shifts.
    has_numeric_bits: bool
    #: Whether an array may have fewer initial values than elements.
    has_partial_initialisers: bool
    #: Whether an input may be assigned inside of its block, and from outside without a call.
    has_assignable_inputs: bool
    #: Whether all variables of a program may be read from outside, not only its inputs and outputs.
    has_open_programs: bool
    #: Whether `x < 1.0 OR x > -1.0`, which every number passes, may be asked of NaN. Other comparisons with NaN stop
    #: the controller.
    has_number_test: bool

    #: Why a function is refused, by a pattern of its upper-case name.
    refused_functions: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))

    def without_implicit_conversions(self) -> Dialect:
        """These rules, but every conversion has to be written, and bit strings are not computed with."""
        return replace(self, has_widening=False, has_loose_literals=False, has_numeric_bits=False)


_BITS, _REALS = "(?:BYTE|WORD|DWORD|LWORD)", "L?REAL"

#: The portable subset of IEC 61131-3: what strict compilers of several vendors accept, no conversion left out. Pieces
#: of text that are no more than spelling are judged by `check.portable`; the checker reads them, too.
IEC = Dialect(
    name="iec",
    types=MappingProxyType({**NUMBERS, "TIME": TIME_NS, "LTIME": LTIME}),
    enum_base=DINT,
    has_widening=False,
    has_loose_literals=False,
    has_numeric_bits=False,
    has_partial_initialisers=False,
    has_assignable_inputs=False,
    has_open_programs=False,
    has_number_test=True,
    refused_functions=MappingProxyType(
        {
            "ATAN2": "is not in the standard: use ATAN",
            r"TO_\w+": "is not portable: name the source type, too",
            rf"L?TIME_TO_\w+|\w+_TO_L?TIME|{_BITS}_TO_{_REALS}|{_REALS}_TO_{_BITS}": (
                "gives different results on different controllers"
            ),
        }
    ),
)

#: What is written for CODESYS, and SCL for S7-1500 once `syntax.scl` has taken its marks away.
CODESYS, SCL = replace(IEC, name="codesys"), replace(IEC, name="scl")

#: TwinCAT 3: conversions that lose nothing need not be written.
TWINCAT = Dialect(
    name="twincat",
    types=MappingProxyType({**NUMBERS, "TIME": TIME_MS, "LTIME": LTIME}),
    enum_base=INT,
    has_widening=True,
    has_loose_literals=True,
    has_numeric_bits=True,
    has_partial_initialisers=True,
    has_assignable_inputs=True,
    has_open_programs=True,
    has_number_test=False,
)

#: All dialects by name.
DIALECTS: Mapping[str, Dialect] = MappingProxyType({dialect.name: dialect for dialect in (CODESYS, IEC, SCL, TWINCAT)})


def find_dialect(dialect: Dialect | str) -> Dialect:
    """The dialect of a name. Raises `InputError` with the known names when there is none of it."""
    if isinstance(dialect, Dialect):
        return dialect
    if dialect not in DIALECTS:
        raise InputError(f"unknown dialect '{dialect}': known are {', '.join(DIALECTS)}")
    return DIALECTS[dialect]
