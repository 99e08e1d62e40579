"""What a manifest may hold: it is read from folders that anybody may have changed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


class _Optional(str):
    """A key that need not be there."""


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**31


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _is_range(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(_is_number, value)) and value[0] <= value[1]


def _is_pair_of_counts(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(_is_count, value))


def _is_fingerprint(value: Any) -> bool:
    return isinstance(value, str) and 0 < len(value) <= 16 and set(value) <= set("0123456789abcdef")


#: A type or a test of a value; a list of such; a mapping of keys, in which `...` stands for every key.
_FEATURE: dict[Any, Any] = {"name": str, "unit": str, "range": _is_range, _Optional("range_from"): str}
_MODEL: dict[Any, Any] = {
    "block": str,
    "outputs": [str],
    _Optional("ports"): [{"unit": str, _Optional("range"): _is_range}],
    "features": [{**_FEATURE, _Optional("limited"): bool}],
    _Optional("block_outputs"): [_is_count],
    _Optional("labels"): [lambda value: value is None or isinstance(value, (str, int, float))],
    **dict.fromkeys(map(_Optional, ("layout", "library", "class", "digest")), str),
    **dict.fromkeys(map(_Optional, ("shared", "exact", "accepts_nan")), bool),
    **dict.fromkeys(map(_Optional, ("trees", "nodes", "support_vectors")), _is_count),
    _Optional("kinds"): [str],
    _Optional("real"): [lambda value: value is None or _is_number(value)],
}
_PURPOSE: dict[Any, Any] = {
    _Optional("calls"): _is_count,
    _Optional("reduction_ratio"): _is_number,
    _Optional("orders"): [_is_count],
}
_COMPARED: dict[Any, Any] = {
    "number": _is_count,
    "inputs": [str],
    "outputs": [str],
    _Optional("rows"): _is_count,
    _Optional("calls"): _is_count,
    _Optional("fixed"): {...: str},
}
_COMPARISON: dict[Any, Any] = {
    _Optional("fingerprint"): _is_fingerprint,
    _Optional("rows"): _is_count,
    _Optional("lengths"): _is_pair_of_counts,
    _Optional("blocks"): {...: _COMPARED},
}
_SHAPE: dict[Any, Any] = {
    "format": _is_count,
    "files": {...: str},
    _Optional("models"): {...: _MODEL},
    _Optional("blocks"): {...: {_Optional("data_bytes"): _is_count}},
    _Optional("transmission_error"): _PURPOSE,
    _Optional("provenance"): {...: str},
    _Optional("choices"): {},
    _Optional("comparison"): _COMPARISON,
}


def check_manifest(content: Any) -> None:
    """Raise ValueError, which names the place, where a manifest holds what its readers do not expect.

    Keys that are not known here pass, and so do those of an older version that are missing and have a default.
    """
    _check(content, _SHAPE, "")


def _check(value: Any, shape: Any, place: str) -> None:
    if isinstance(shape, Mapping):
        if not isinstance(value, dict):
            raise ValueError(f"{place or 'the file'} is no table")
        for key, entry in shape.items():
            if key is ...:
                for name, own in value.items():
                    _check(own, entry, f"{place}.{name}".lstrip("."))
            elif key in value:
                _check(value[key], entry, f"{place}.{key}".lstrip("."))
            elif not isinstance(key, _Optional):
                raise ValueError(f"{place or 'the file'} has no {key}")
    elif isinstance(shape, list):
        if not isinstance(value, list):
            raise ValueError(f"{place} is no list")
        for number, own in enumerate(value):
            _check(own, shape[0], f"{place}[{number}]")
    elif not (isinstance(value, shape) if isinstance(shape, type) else shape(value)):
        raise ValueError(f"{place} is not as it is written")
