"""How much a model file may hold: checked before it is unpacked, or made into objects.

Everything is bounded by one number, the bytes of `--max-model-bytes`: the file, what it unpacks to, and the things in
it, each of which takes a multiple of its few bytes once it is an object in memory.
"""

from __future__ import annotations

from enum import Enum

from st_codegen.errors import InputError

#: Bytes of a model file, packed and unpacked, above which it is not read. A forest of this size has about 4 million
#: nodes, whose text no controller takes; and reading takes several times as many bytes of memory.
DEFAULT_MAX_MODEL_BYTES = 256 * 2**20

#: Features, or outputs, of one model: nothing else in some files bounds these numbers.
MAX_COLUMNS = 100_000


class Things(Enum):
    """What is counted in a file, and one for how many bytes of the limit may be there."""

    NUMBERS = "numbers", 16
    TEXTS = "texts", 64
    OBJECTS = "objects", 256
    TREES = "trees", 2048
    MEMBERS = "members", 4096


class _Limit:
    """The limit of this process."""

    size = DEFAULT_MAX_MODEL_BYTES
    features: int | None = None


def set_features(count: int | None) -> None:
    """Say how many features a row has, for all files that this process reads from here on and that do not say so."""
    _Limit.features = count


def stated_features() -> int | None:
    """How many features the user says that a row has."""
    return _Limit.features


def set_max_model_bytes(limit: int) -> None:
    """Change the limit for all files that this process reads from here on."""
    _Limit.size = limit


def max_model_bytes() -> int:
    """The limit for the files that this process reads."""
    return _Limit.size


def check_size(size: int, how: str = "") -> None:
    """Raise InputError for more bytes than allowed; `how` says how they are counted."""
    _check(size, "bytes", _Limit.size, how)


def check_count(count: int, things: Things, where: str = "") -> None:
    """Raise InputError for more of some things than allowed."""
    name, bytes_each = things.value
    _check(count, name, most(bytes_each), where)


def most(bytes_each: int) -> int:
    """How many things of a size the limit allows."""
    return max(1, _Limit.size // bytes_each)


def check_json(data: bytes) -> None:
    """Raise InputError for JSON that would make more objects, lists or numbers than allowed."""
    check_count(data.count(b"{") + data.count(b"["), Things.OBJECTS)
    check_count(data.count(b","), Things.NUMBERS)


def _check(count: int, name: str, allowed: int, how: str) -> None:
    if count > allowed:
        raise InputError(
            f"{count} {name}{' ' + how if how else ''}, at most {allowed} are read; "
            "if you trust the file, raise the limit with --max-model-bytes"
        )
