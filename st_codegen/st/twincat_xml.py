"""TwinCAT's XML files (.TcPOU, .TcGVL, .TcDUT): from bytes to pieces of Structured Text with their places.

The files come from outside, so nothing in them is trusted: no document type, no entities, no network, bounded size.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from lxml import etree

from st_codegen.st import nodes as n
from st_codegen.st.errors import Position, Problem, StSyntaxError
from st_codegen.st.parser import parse_scanned
from st_codegen.st.scan import Scanned, Segment, scan

_DECLARED = re.compile(r"<!\[CDATA\[.*?\]\]>|<!--.*?-->|(<![A-Za-z]+)", re.DOTALL)
_REFUSED = {
    "Property": "properties are not supported: use a method",
    "Action": "actions are not supported: use a method",
    "Transition": "transitions are not supported",
    "Itf": "interfaces are not supported",
}


@dataclass
class XmlFile:
    """A TwinCAT object and the scanned pieces of text that were found in it so far."""

    name: str
    text: str
    root: etree._Element
    scans: list[Scanned]
    _cursor: int = 0

    def error(self, element: etree._Element | None, message: str) -> StSyntaxError:
        """A syntax error at an element."""
        line = _line(element) if element is not None else 1
        return StSyntaxError([Problem(Position(self.name, line, 1), message)])

    def segment(self, element: etree._Element, pou: str) -> Segment:
        """The text of an element and where it starts in the file."""
        text = element.text or ""
        first_line = _line(element)
        at = self.text.find(text, self._cursor) if text else -1
        if at < 0:
            return Segment(text, self.name, first_line, 1, pou)
        self._cursor = at + len(text)
        return Segment(text, self.name, self.text.count("\n", 0, at) + 1, at - self.text.rfind("\n", 0, at), pou)

    def scan(self, element: etree._Element, pou: str) -> Scanned:
        """Scan the text of an element."""
        scanned = scan(self.segment(element, pou))
        self.scans.append(scanned)
        return scanned


def read_xml(name: str, content: bytes) -> tuple[list[n.Declaration], list[Scanned]]:
    """The declarations of one TwinCAT file and its scanned texts.

    Raises `StSyntaxError` for anything that is not such a file, and for what is not supported in it.
    """
    file = _open(name, content)
    objects = [child for child in file.root if isinstance(child.tag, str)]
    declarations: list[n.Declaration] = []
    for element in objects:
        match element.tag:
            case "POU":
                declarations.append(_pou(file, element))
            case "GVL":
                scanned = file.scan(_only(file, element, "Declaration"), element.get("Name", ""))
                attributes = tuple(part for found in scanned.attributes.values() for part in found)
                blocks = parse_scanned(scanned, "globals")
                where = scanned.segment.position(0)
                declarations.append(n.GlobalList(element.get("Name", ""), blocks, attributes, position=where))
            case "DUT":
                declarations += parse_scanned(file.scan(_only(file, element, "Declaration"), ""), "types")
            case tag:
                raise file.error(element, _REFUSED.get(tag, f"unknown element '{tag}'"))
    if not declarations:
        raise file.error(file.root, "the file holds no POU, GVL or DUT")
    return declarations, file.scans


def _open(name: str, content: bytes) -> XmlFile:
    where = Position(name, 1, 1)
    try:
        text = content.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise StSyntaxError([Problem(where, f"not UTF-8 text ({error.reason} at byte {error.start})")]) from None
    for match in _DECLARED.finditer(text):
        if match[1]:
            line = text.count("\n", 0, match.start()) + 1
            message = f"'{match[1]}' is not allowed: a TwinCAT file has no document type and no entities"
            raise StSyntaxError([Problem(Position(name, line, 1), message)])
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        dtd_validation=False,
        huge_tree=True,
        remove_comments=True,
    )
    try:
        root = etree.fromstring(content, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        line = getattr(error, "lineno", None) or 1
        raise StSyntaxError([Problem(Position(name, line, 1), f"not well-formed XML: {error}")]) from None
    if root.tag != "TcPlcObject":
        raise StSyntaxError([Problem(where, f"the root element is '{root.tag}', not 'TcPlcObject'")])
    return XmlFile(name, text, root, [])


def _line(element: etree._Element) -> int:
    # lxml-stubs have no type for it
    found: Any = element.sourceline
    return int(found or 1)


def _only(file: XmlFile, parent: etree._Element, tag: str) -> etree._Element:
    found = parent.findall(tag)
    if len(found) != 1:
        raise file.error(parent, f"'{parent.get('Name', parent.tag)}' needs exactly one <{tag}>")
    return found[0]


def _children(file: XmlFile, parent: etree._Element) -> Iterator[etree._Element]:
    for child in parent:
        if child.tag in _REFUSED:
            raise file.error(child, f"{parent.get('Name', '')}.{child.get('Name', '')}: {_REFUSED[child.tag]}")
        if child.tag == "Method":
            yield child


def _pou(file: XmlFile, element: etree._Element) -> n.PouDeclaration:
    pou = _with_body(file, element, element.get("Name", ""))
    methods = [_with_body(file, child, f"{pou.name}.{child.get('Name', '')}") for child in _children(file, element)]
    return replace(pou, methods=tuple(methods))


def _with_body(file: XmlFile, element: etree._Element, qualified: str) -> n.PouDeclaration:
    head: n.PouDeclaration = parse_scanned(file.scan(_only(file, element, "Declaration"), qualified), "head")
    if head.name.upper() != element.get("Name", "").upper():
        raise file.error(element, f"the file says '{element.get('Name', '')}', its declaration says '{head.name}'")
    implementation = _only(file, element, "Implementation")
    languages = [child.tag for child in implementation]
    if languages != ["ST"]:
        shown = ", ".join(str(tag) for tag in languages) or "nothing"
        raise file.error(implementation, f"'{qualified}' is implemented in {shown}; only ST is supported")
    return replace(head, body=parse_scanned(file.scan(implementation[0], qualified), "body"))
