"""CODESYS: what is written for it is of the portable subset."""

from __future__ import annotations

from dataclasses import replace

from st_codegen.st.dialects.iec import IEC

CODESYS = replace(IEC, name="codesys")
