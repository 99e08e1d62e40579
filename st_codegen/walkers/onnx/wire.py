"""Counts what protobuf would make of the bytes of an ONNX file, before it makes it.

A message that says nothing takes two bytes in the file and hundreds in memory. Numbers are passed over in runs.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from st_codegen.errors import InputError
from st_codegen.walkers.limits import Things, check_count

#: Messages inside messages; protobuf itself reads 100.
MAX_DEPTH = 100


def _tags(wire_type: int) -> bytes:
    """The tags of one byte, fields 1 to 15, as a class of a regular expression."""
    return b"[" + b"".join(b"\\x%02x" % (field << 3 | wire_type) for field in range(1, 16)) + b"]"


_VARINT = rb"[\x80-\xff]{0,9}+[\x00-\x7f]"
_NUMBERS = re.compile(b"(?:" + _tags(0) + _VARINT + b"|" + _tags(5) + b".{4}|" + _tags(1) + b".{8})++", re.DOTALL)
_ONE_VARINT = re.compile(_VARINT)
_LENGTHS = {1: 8, 5: 4}


def check_messages(data: bytes, descriptor: Any) -> None:
    """Raise InputError where a file holds more messages, texts or packed numbers than allowed, or is cut."""
    _Counter(data).message(0, len(data), descriptor, 0)


class _Counter:
    def __init__(self, data: bytes) -> None:
        self.data = data
        self.messages = self.texts = self.packed = 0

    def varint(self, position: int, end: int) -> tuple[int, int]:
        """A number of the format and the position behind it."""
        found = _ONE_VARINT.match(self.data, position, end)
        if found is None:
            raise InputError(f"not an ONNX model, or truncated at byte {position}; export or copy the file again")
        value = 0
        for shift, byte in enumerate(found[0]):
            value |= (byte & 127) << (7 * shift)
        return value, found.end()

    def message(self, position: int, end: int, descriptor: Any, depth: int) -> None:
        """Count a message and those inside it."""
        self.messages += 1
        check_count(self.messages, Things.OBJECTS)
        if depth > MAX_DEPTH:
            raise InputError(f"messages nested more than {MAX_DEPTH} deep; the model file is damaged")
        fields = {field.number: field for field in descriptor.fields}
        while position < end:
            run = _NUMBERS.match(self.data, position, end)
            if run is not None:
                position = run.end()
                continue
            tag, position = self.varint(position, end)
            wire_type = tag & 7
            if wire_type == 0:
                _, position = self.varint(position, end)
                continue
            if wire_type in _LENGTHS:
                length = _LENGTHS[wire_type]
            elif wire_type == 2:
                length, position = self.varint(position, end)
            else:  # groups, which ONNX does not have
                raise InputError(f"not an ONNX model: wire type {wire_type} at byte {position}")
            if length > end - position:
                raise InputError(f"not an ONNX model, or truncated at byte {position}; export or copy the file again")
            if wire_type == 2:
                self.content(position, position + length, fields.get(tag >> 3), depth)
            position += length

    def content(self, position: int, end: int, field: Any, depth: int) -> None:
        """Count what a field of some bytes holds; the bytes of a field that is not known stay bytes."""
        if field is not None and field.message_type is not None:
            self.message(position, end, field.message_type, depth + 1)
        elif field is None or field.type in (field.TYPE_STRING, field.TYPE_BYTES):
            self.texts += 1
            check_count(self.texts, Things.TEXTS)
        else:  # packed numbers; the last byte of each is below 128
            self.packed += int(np.count_nonzero(np.frombuffer(self.data, np.uint8, end - position, position) < 128))
            check_count(self.packed, Things.NUMBERS)
