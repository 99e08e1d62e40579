"""The dialects of Structured Text: a table of rules each."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from st_codegen.errors import InputError
from st_codegen.st.dialects.dialect import Dialect
from st_codegen.st.dialects.iec import CODESYS, IEC, SCL
from st_codegen.st.dialects.twincat import TWINCAT

__all__ = ["CODESYS", "DIALECTS", "IEC", "SCL", "TWINCAT", "Dialect", "find_dialect"]

#: All dialects by name.
DIALECTS: Mapping[str, Dialect] = MappingProxyType({dialect.name: dialect for dialect in (CODESYS, IEC, SCL, TWINCAT)})


def find_dialect(dialect: Dialect | str) -> Dialect:
    """The dialect of a name. Raises `InputError` with the known names when there is none of it."""
    if isinstance(dialect, Dialect):
        return dialect
    if dialect not in DIALECTS:
        raise InputError(f"unknown dialect '{dialect}': known are {', '.join(DIALECTS)}")
    return DIALECTS[dialect]
