"""The vendor's XML for machine learning models: elements, typed attributes, rows of numbers.

The files come from outside: no document type, no entities, sizes checked before anything is allocated for them.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from lxml import etree

from st_codegen.errors import InputError, counted, errors_name
from st_codegen.ir import FloatArray, Function, IntArray, Kernel
from st_codegen.walkers.limits import Things, check_count

#: Activation functions and kernels by the vendor's names, which carry the prefixes ACT_FN_ and KERNEL_FN_ in a file.
ACTIVATIONS = {
    "SIGMOID": Function.LOGISTIC,
    "EXP": Function.EXP,
    "TANH": Function.TANH,
    "RELU": Function.RELU,
    "SOFTPLUS": Function.SOFTPLUS,
    "IDENTITY": Function.IDENTITY,
}
KERNELS = {
    "LINEAR": Kernel.LINEAR,
    "POLYNOMIAL": Kernel.POLYNOMIAL,
    "RBF": Kernel.RBF,
    "SIGMOID": Kernel.SIGMOID,
}
MAX_INPUTS = 1 << 16
#: So much of a text from outside is shown in a message.
SHOWN = 30
_DECLARED = re.compile(rb"<!(?!--|\[CDATA\[)")
_NOT_NUMERIC = re.compile(r"[^0-9eE+\-.,\s]")


def parse(content: bytes, file: str) -> etree._Element:
    """The root element. Raises InputError for what is no XML, or has a document type or entities."""
    if _DECLARED.search(content):
        raise InputError(f"{file}: a document type or an entity is not allowed in a model file")
    with errors_name(file):
        check_count(content.count(b"<"), Things.OBJECTS)
        check_count(content.count(b"="), Things.OBJECTS, "with values")
        check_count(content.count(b","), Things.NUMBERS)
    # the text is what was searched: UTF-8, whatever the file says
    parser = etree.XMLParser(
        encoding="utf-8",
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        huge_tree=True,
        remove_comments=True,
        remove_pis=True,
    )
    try:
        return etree.fromstring(content, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise InputError(f"{file}: not well-formed XML: {error}") from None


@dataclass(frozen=True)
class XmlElement:
    """An element and the typed attributes of this format: the prefix says the type, a list of one is a scalar."""

    element: etree._Element
    file: str

    @property
    def tag(self) -> str:
        return str(self.element.tag)

    def error(self, message: str) -> InputError:
        """An error at this element."""
        return InputError(f"{self.file}, line {self.element.sourceline}: <{self.tag}>: {message}")

    def optional(self, tag: str) -> XmlElement | None:
        """The child of a name, if there is one."""
        found = self.element.findall(tag)
        if len(found) > 1:
            raise self.error(f"{len(found)} elements <{tag}>, one is expected; several engines in a file are not read")
        return XmlElement(found[0], self.file) if found else None

    def only(self, tag: str) -> XmlElement:
        """The child of a name."""
        found = self.optional(tag)
        if found is None:
            raise self.error(f"no element <{tag}>")
        return found

    def numbered(self, stem: str, count: int) -> list[XmlElement]:
        """Children stem1 .. stemN; exactly so many."""
        found = [child for child in self.element if str(child.tag).startswith(stem)]
        if len(found) != count or [child.tag for child in found] != [f"{stem}{n + 1}" for n in range(len(found))]:
            raise self.error(f"elements {stem}1, {stem}2, ..: {count} announced, {len(found)} there")
        return [XmlElement(child, self.file) for child in found]

    def text(self, name: str) -> str:
        """The text of an attribute. Raises InputError where there is none."""
        value = self.element.get(name)
        if value is None:
            raise self.error(f"no attribute '{name}'")
        return value

    def _value(self, name: str, *prefixes: str) -> str:
        for prefix in prefixes:
            value = self.element.get(f"{prefix}_{name}")
            if value is not None:
                return value
        raise self.error(f"no attribute '{prefixes[0]}_{name}'")

    def count(self, name: str, most: int) -> int:
        """A whole number from 0 to `most`."""
        text = self._value(name, "int64", "int", "int32").strip()
        if not (text.isascii() and text.isdigit()) or len(text) > 12 or int(text) > most:
            raise self.error(f"{name} is '{text[:SHOWN]}', expected is a whole number up to {most:,}")
        return int(text)

    def double(self, name: str) -> float:
        """The only float64 number of an attribute."""
        values = self.doubles(name)
        if len(values) != 1:
            raise self.error(f"{name} has {counted(len(values), 'number')}, one is expected")
        return float(values[0])

    def doubles(self, name: str) -> FloatArray:
        """The float64 numbers of an attribute."""
        return self._numbers(name, self._value(name, "arrfp64", "fp64", "arrfp32", "fp32"))

    def singles(self, name: str) -> FloatArray:
        """The float32 numbers of an attribute, as float64."""
        values = self._numbers(name, self._value(name, "arrfp32", "fp32"))
        with np.errstate(over="ignore"):
            rounded = values.astype(np.float32).astype(np.float64)
        if not np.all(np.isfinite(rounded)):
            raise self.error(f"{name} has a number beyond float32")
        return rounded

    def integers(self, name: str) -> IntArray:
        """The whole numbers of an attribute."""
        values = self._numbers(name, self._value(name, "arrint64", "int64", "arrint32", "int32"))
        if np.any(values != np.rint(values)) or np.any(np.abs(values) > 2**31):
            raise self.error(f"{name} has a number that is no whole number of 32 bits")
        return values.astype(np.int64)

    def _numbers(self, name: str, text: str) -> FloatArray:
        bad = _NOT_NUMERIC.search(text)
        if bad:
            entry = text[text.rfind(",", 0, bad.start()) + 1 :].partition(",")[0].strip()
            raise self.error(f"{name}: '{entry[:SHOWN]}' is no finite number")
        try:
            values = np.array(text.split(","), dtype=np.float64)
        except ValueError as error:
            raise self.error(f"{name}: {str(error)[:100]}") from None
        if not np.all(np.isfinite(values)):
            raise self.error(f"{name} has a number that is not finite")
        return values

    def matrix(self, read: Callable[[XmlElement, str], FloatArray]) -> FloatArray:
        """Rows of numbers, as many as announced."""
        rows = self.count("rows", len(self.element))
        columns = self.count("columns", MAX_INPUTS)
        values = [read(row, "vals") for row in self.numbered("Row", rows)]
        if not values or any(len(row) != columns for row in values):
            lengths = sorted({len(row) for row in values})
            raise self.error(f"rows of {columns} numbers are announced, there are some of {lengths[:5]}")
        return np.vstack(values)
