"""What is kept of work on a fleet: SHA-256 of what decides a result, by which it is known to be done, and failures."""

from __future__ import annotations

import csv
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.errors import StCodegenError
from st_codegen.files.text import file_sha256

#: What else decides results beside the version of st-codegen.
LIBRARIES = ("numpy", "scipy", "scikit-learn", "lightgbm", "xgboost-cpu", "skops", "onnx", "skl2onnx", "polars")


def sha256_of(*texts: str) -> str:
    """The SHA-256 of some texts, in their order."""
    return hashlib.sha256(json.dumps(texts).encode()).hexdigest()


def content_of(*arrays: Any) -> str:
    """The SHA-256 of the bytes of some arrays, in their order."""
    return sha256_of(*(np.ascontiguousarray(array).tobytes().hex() for array in arrays))


def content_hash(path: Path) -> str:
    """The SHA-256 of a file, or of all files below a folder and their paths."""
    return sha256_of(*(f"{name} {digest}" for name, digest in file_hashes(path.parent, path.name).items()))


def file_hashes(folder: Path, place: str) -> dict[str, str]:
    """The SHA-256 of a file, or of each below a folder, by its path relative to `folder`; empty where there is none."""
    root = folder / place
    files = sorted(root.rglob("*")) if root.is_dir() else [root]
    found = {}
    for path in files:
        if path.is_file():
            found[path.relative_to(root).as_posix()] = file_sha256(path)
    return found


def failure(error: Exception) -> tuple[str, bool]:
    """What went wrong, and whether it is a defect of ours: nothing that a user can mend."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}", False
    if isinstance(error, StCodegenError | OSError | UnicodeError | csv.Error | MemoryError | RecursionError):
        return str(error) or type(error).__name__, False
    return f"a defect of st-codegen: {type(error).__name__}: {error}", True
