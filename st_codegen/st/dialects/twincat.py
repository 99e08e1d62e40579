"""TwinCAT 3: conversions that lose nothing need not be written."""

from __future__ import annotations

from types import MappingProxyType

from st_codegen.st.dialects.dialect import Dialect
from st_codegen.st.types import INT, LTIME, NUMBERS, TIME_MS

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
