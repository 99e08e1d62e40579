"""SCL for S7-1500, after `syntax.scl` has taken its marks away: the rules of the portable subset."""

from __future__ import annotations

from dataclasses import replace

from st_codegen.st.dialects.iec import IEC

SCL = replace(IEC, name="scl")
