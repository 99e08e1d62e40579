"""What the readers of XML share: nothing in a file from outside is trusted, and every piece of text has its place."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from lxml import etree

from st_codegen.st.errors import Position, Problem, StSyntaxError
from st_codegen.st.syntax.scan import Scanned, Segment, scan

OnEnd = Callable[[etree._Element], None]
#: The text of CDATA may be tens of megabytes: it is skipped from bracket to bracket.
_DECLARED = re.compile(r"<!\[CDATA\[(?:[^]]++|](?!]>))*+]]>|<!--.*?-->|(<![A-Za-z]+)", re.DOTALL)


@dataclass
class XmlFile:
    """An XML file and the scanned pieces of Structured Text that were found in it so far."""

    name: str
    text: str
    root: etree._Element
    scans: list[Scanned] = field(default_factory=list)
    _cursor: int = 0

    def error(self, element: etree._Element | None, message: str) -> StSyntaxError:
        """A syntax error at an element."""
        return StSyntaxError([Problem(self.position(element), message)])

    def position(self, element: etree._Element | None, pou: str = "") -> Position:
        """The position of an element, which is the start of its line."""
        return Position(self.name, line_of(element) if element is not None else 1, 1, pou)

    def segment(self, element: etree._Element, pou: str) -> Segment:
        """The text of an element and where it starts in the file."""
        text = "".join(str(part) for part in element.itertext())
        first_line = line_of(element)
        at = self.text.find(text, self._cursor) if text else -1
        if at < 0:
            return Segment(text, self.name, first_line, 1, pou)
        self._cursor = at + len(text)
        return Segment(text, self.name, self.text.count("\n", 0, at) + 1, at - self.text.rfind("\n", 0, at), pou)

    def scan(self, element: etree._Element, pou: str) -> Scanned:
        """Scan the text of an element, and remember it."""
        scanned = scan(self.segment(element, pou))
        self.scans.append(scanned)
        return scanned


def checked_text(name: str, content: bytes) -> str:
    """The text of an XML file. Raises `StSyntaxError` for other encodings than UTF-8, document types and entities."""
    try:
        text = content.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        where = Position(name, 1, 1)
        raise StSyntaxError([Problem(where, f"not UTF-8 text ({error.reason} at byte {error.start})")]) from None
    for match in _DECLARED.finditer(text):
        if match[1]:
            line = text.count("\n", 0, match.start()) + 1
            message = f"'{match[1]}' is not allowed: these files have no document type and no entities"
            raise StSyntaxError([Problem(Position(name, line, 1), message)])
    return text


def open_xml(name: str, content: bytes, on_end: OnEnd | None = None, is_huge: bool = False) -> XmlFile:
    """Parse an XML file without document type, entities and network; `on_end` sees each element when it is complete.

    `is_huge` takes away the limits on the length of texts, and on the depth of elements.
    """
    text = checked_text(name, content)
    events = etree.iterparse(
        io.BytesIO(content),
        events=("end",),
        encoding="utf-8",  # the text is what was checked, whatever the file says
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        dtd_validation=False,
        huge_tree=is_huge,
        remove_comments=True,
        remove_pis=True,
    )
    try:
        for _, element in events:
            if on_end is not None:
                on_end(element)
    except (etree.XMLSyntaxError, ValueError) as error:
        # what the parser found, at its line
        where = Position(name, getattr(error, "lineno", None) or 1, 1)
        raise StSyntaxError([Problem(where, f"not well-formed XML: {error}")]) from None
    return XmlFile(name, text, events.root)


def tag_of(element: etree._Element) -> str:
    """The tag of an element without its namespace."""
    return etree.QName(element).localname


def line_of(element: etree._Element) -> int:
    """The line on which an element starts."""
    # lxml-stubs have no type for it
    found: Any = element.sourceline
    return int(found or 1)
