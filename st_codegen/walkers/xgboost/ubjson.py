"""Reader of UBJSON, the binary JSON of XGBoost's `.ubj` files (https://ubjson.org, draft 12).

Numbers are big-endian. Typed arrays become NumPy arrays, which XGBoost's trees are made of. Every length is checked
against the bytes that are left before anything is allocated.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from st_codegen.errors import InputError, counted
from st_codegen.walkers.limits import Things, check_count

_NUMBERS = {b"i": ">i1", b"U": ">u1", b"I": ">i2", b"l": ">i4", b"L": ">i8", b"d": ">f4", b"D": ">f8"}
_INTEGERS = frozenset(b"iUIlL")
_CONSTANTS: dict[bytes, object] = {b"Z": None, b"T": True, b"F": False}
_NO_OP = b"N"

#: XGBoost nests 8 deep; a limit keeps hostile files from exhausting the stack.
_MAX_DEPTH = 64


def loads(data: bytes) -> Any:
    """UBJSON -> dictionaries, lists, strings, numbers, booleans, None, and NumPy arrays for typed arrays.

    Raises InputError that names the byte where the data is cut or wrong.
    """
    reader = _UbjsonReader(data)
    return reader.value(reader.marker(), 0)


def entry(data: bytes, name: str) -> bytes:
    """The UBJSON of one entry of the object that `data` is. Raises InputError where there is not one such."""
    reader = _UbjsonReader(data)
    found: list[bytes] = []
    if reader.marker() != b"{" or reader.header() != (None, None):
        raise reader.fail("not an object without a count")
    while reader.peek() != b"}":
        key, start = reader.text(), reader.position
        reader.value(reader.marker(), 1)
        if key == name:
            found.append(data[start : reader.position])
    if len(found) != 1:
        raise reader.fail(f"{len(found)} entries '{name}', expected one")
    return found[0]


class _UbjsonReader:
    def __init__(self, data: bytes) -> None:
        self.data = data
        self.position = 0
        self.values = self.containers = 0

    def fail(self, message: str) -> InputError:
        return InputError(f"not an XGBoost model (UBJSON, byte {self.position}: {message})")

    def take(self, count: int) -> bytes:
        if not 0 <= count <= len(self.data) - self.position:
            raise self.fail(f"{counted(count, 'byte')} declared, {len(self.data) - self.position} left")
        taken = self.data[self.position : self.position + count]
        self.position += count
        return taken

    def marker(self) -> bytes:
        while (marker := self.take(1)) == _NO_OP:
            pass
        return marker

    def peek(self) -> bytes:
        return self.data[self.position : self.position + 1]

    def length(self) -> int:
        """A count of bytes or entries; an entry takes one byte or more."""
        marker = self.marker()
        if marker[0] not in _INTEGERS:
            raise self.fail(f"marker {marker!r} where a length is expected")
        count = int(self.number(marker))
        if not 0 <= count <= len(self.data) - self.position:
            raise self.fail(f"a length of {count}, {len(self.data) - self.position} bytes left")
        return count

    def number(self, marker: bytes) -> int | float:
        code = _NUMBERS[marker]
        result: int | float = np.frombuffer(self.take(np.dtype(code).itemsize), code)[0].item()
        return result

    def text(self) -> str:
        raw = self.take(self.length())
        try:
            return raw.decode("utf-8")
        except UnicodeDecodeError:
            raise self.fail("a string that is not UTF-8") from None

    def value(self, marker: bytes, depth: int) -> Any:
        if depth > _MAX_DEPTH:
            raise self.fail(f"nested more than {_MAX_DEPTH} deep")
        self.values += 1
        check_count(self.values, Things.NUMBERS, "in UBJSON that are not in arrays of one type")
        if marker in _NUMBERS:
            return self.number(marker)
        if marker in _CONSTANTS:
            return _CONSTANTS[marker]
        if marker in (b"S", b"H"):
            return self.text()
        if marker == b"C":
            return self.take(1).decode("latin-1")
        if marker == b"[":
            return self.array(depth)
        if marker == b"{":
            return self.object(depth)
        raise self.fail(f"unknown marker {marker!r}")

    def container(self) -> None:
        """Count an array or an object."""
        self.containers += 1
        check_count(self.containers, Things.OBJECTS)

    def header(self) -> tuple[bytes | None, int | None]:
        """Type and count of a container, where it declares them."""
        kind = None
        if self.peek() == b"$":
            self.take(1)
            kind = self.take(1)
            if self.peek() != b"#":
                raise self.fail("a typed container without a count")
        if self.peek() != b"#":
            return kind, None
        self.take(1)
        return kind, self.length()

    def array(self, depth: int) -> Any:
        self.container()
        kind, count = self.header()
        if kind in _NUMBERS and kind is not None and count is not None:
            dtype = np.dtype(_NUMBERS[kind])
            return np.frombuffer(self.take(count * dtype.itemsize), dtype).astype(dtype.newbyteorder("="))
        if kind is not None:
            raise self.fail(f"an array of type {kind!r}")
        result = []
        if count is None:
            while (marker := self.marker()) != b"]":
                result.append(self.value(marker, depth + 1))
        else:
            for _ in range(count):
                result.append(self.value(self.marker(), depth + 1))
        return result

    def object(self, depth: int) -> dict[str, Any]:
        self.container()
        kind, count = self.header()
        if kind is not None:
            raise self.fail(f"an object of type {kind!r}")
        result: dict[str, Any] = {}
        while count is None or len(result) < count:
            if count is None and self.peek() == b"}":
                self.take(1)
                break
            key = self.text()
            if key in result:
                raise self.fail(f"the key '{key}' twice")
            result[key] = self.value(self.marker(), depth + 1)
        return result
