"""The portable subset of IEC 61131-3: what strict compilers of several vendors accept, no conversion left out.

`refused_text`, `comments` and `has_pragmas` are asked by `check.portable` alone, which judges what is written for
everybody; the checker reads such text, too.
"""

from __future__ import annotations

from types import MappingProxyType

from st_codegen.st.dialects.dialect import Dialect
from st_codegen.st.syntax.scan import CommentKind
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
    refused_text=MappingProxyType(
        {
            r"\bEND_(?:IF|CASE|FOR|WHILE|REPEAT)\b(?!\s*;)": "is not followed by a semicolon",
            r"(?<![0-9A-Z_#.])[0-9][0-9_]*E[+-]?[0-9]+": "is a real literal without a dot",
            r"\*\*": "is not portable: multiply, or use EXPT",
            r"\bCONTINUE\b": "is not portable: use IF",
            r"\b(?:AND_THEN|OR_ELSE)\b": "is not portable: nest IF",
            r"\b[A-Z0-9_]*__[A-Z0-9_]*\b": "has two underscores in a row",
            r"\b(?:POINTER|REFERENCE)\s+TO\b": "is not portable",
            r"\b(?:ADR|SIZEOF)\s*\(": "is not portable",
            r"\b(?:THIS|SUPER)\s*\^": "is not portable",
            r"\bEXTENDS\b": "is not portable",
            r"\bUNION\b": "is not portable: test for NaN with x < 1.0 OR x > -1.0",
            r"\b(?:TANH|FLOOR|CEIL|ATAN2)\b": "is no standard function",
            r"%[IQM][XBWDL]?\*": "is not portable: an address needs a number",
        }
    ),
    comments=frozenset({CommentKind.BLOCK}),
    has_pragmas=False,
)
