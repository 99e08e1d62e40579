"""What the dialects of Structured Text differ in: the columns of their tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from st_codegen.st.types import Elementary


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
