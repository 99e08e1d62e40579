"""How much a model file may hold: checked before it is unpacked or read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from st_codegen.errors import InputError

#: Bytes of a model file, packed and unpacked, above which it is not read. A forest of this size has about 4 million
#: nodes, whose text no controller takes; and reading takes several times as many bytes of memory.
DEFAULT_MAX_MODEL_BYTES = 256 * 2**20

#: Features, or outputs, of one model: nothing else in some files bounds these numbers.
MAX_COLUMNS = 100_000


class _Limit:
    """The limit of this process."""

    size = DEFAULT_MAX_MODEL_BYTES


def set_max_model_bytes(limit: int) -> None:
    """Change the limit for all files that this process reads from here on."""
    _Limit.size = limit


@contextmanager
def limited_to(limit: int) -> Iterator[None]:
    """Change the limit for the files that are read in a block."""
    before = _Limit.size
    set_max_model_bytes(limit)
    try:
        yield
    finally:
        set_max_model_bytes(before)


def check_size(size: int, how: str = "") -> None:
    """Raise InputError for more bytes than allowed; `how` says how they are counted."""
    if size > _Limit.size:
        raise InputError(
            f"{size} bytes{' ' + how if how else ''}, at most {_Limit.size} are read; "
            "if you trust the file, raise the limit with --max-model-bytes"
        )
