"""The portable subset of IEC 61131-3: what strict compilers of several vendors accept, no conversion left out.

Pieces of text that are no more than spelling are judged by `check.portable`; the checker reads them, too.
"""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

from st_codegen.st.dialects.dialect import Dialect
from st_codegen.st.types import DINT, LTIME, NUMBERS, TIME_NS

_BITS, _REALS = "(?:BYTE|WORD|DWORD|LWORD)", "L?REAL"

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
