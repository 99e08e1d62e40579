"""One number for what a model computes, whatever file it came in."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable
from enum import Enum
from typing import Any

import numpy as np

from st_codegen.ir.model import ModelIR

#: What says where a model comes from, what it is called and on which data it was trained, not what it computes.
_LABELS = frozenset({"source", "seen"})


def digest(model: ModelIR) -> str:
    """SHA-256, in hexadecimal, of the features, operations and numbers of a model; its name and source do not count.

    Two files of one format that hold the same trained model have the same digest, whenever they were saved. Fields
    that have their default value do not count, so that a new field of an operation leaves the digests as they are.
    """
    found = hashlib.sha256()
    _add(dataclasses.replace(model, name="m"), found.update)
    return found.hexdigest()


def _add(value: Any, update: Callable[[bytes], None]) -> None:
    """Feed a value to the hash: its kind and length, then its content, so that no two values read alike."""
    if isinstance(value, np.ndarray):
        update(f"array {value.dtype.kind}{value.dtype.itemsize} {value.shape};".encode())
        update(np.ascontiguousarray(value, value.dtype.newbyteorder("<")).tobytes())
    elif dataclasses.is_dataclass(value):
        update(f"{type(value).__name__} {{".encode())
        for field in dataclasses.fields(value):
            content = getattr(value, field.name)
            if field.name not in _LABELS and not _is_default(content, field):
                update(f"{field.name}=".encode())
                _add(content, update)
        update(b"}")
    elif isinstance(value, list | tuple):
        update(f"list {len(value)};".encode())
        for entry in value:
            _add(entry, update)
    else:
        text = repr(
            value.value if isinstance(value, Enum) else value.item() if isinstance(value, np.generic) else value
        )
        update(f"{len(text)} {text};".encode())


def _is_default(content: Any, field: dataclasses.Field[Any]) -> bool:
    # repr: a default of 0.0 is not -0.0, and NaN is NaN
    return field.default is not dataclasses.MISSING and repr(content) == repr(field.default)
