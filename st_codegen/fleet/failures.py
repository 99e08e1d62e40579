"""What went wrong with an axis, as a text."""

from __future__ import annotations

import csv

from st_codegen.errors import StCodegenError


def failure(error: Exception) -> tuple[str, bool]:
    """What went wrong, and whether it is a defect of ours: nothing that a user can mend."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}", False
    if isinstance(error, StCodegenError | OSError | UnicodeError | csv.Error | MemoryError | RecursionError):
        return str(error) or type(error).__name__, False
    return f"a defect of st-codegen: {type(error).__name__}: {error}", True
