"""TwinCAT's XML files (.TcPOU, .TcGVL, .TcDUT): from bytes to declarations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from lxml import etree

from st_codegen.st.syntax import declarations as d
from st_codegen.st.syntax.parser import parse_scanned
from st_codegen.st.syntax.scan import Scanned
from st_codegen.st.syntax.xml_file import XmlFile, open_xml

_REFUSED = {
    "Property": "properties are not supported: use a method",
    "Action": "actions are not supported: use a method",
    "Transition": "transitions are not supported",
    "Itf": "interfaces are not supported",
}


def read_xml(name: str, content: bytes) -> tuple[list[d.Declaration], list[Scanned]]:
    """The declarations of one TwinCAT file and its scanned texts.

    Raises `StSyntaxError` for anything that is not such a file, and for what is not supported in it.
    """
    file = open_xml(name, content, is_huge=True)
    if file.root.tag != "TcPlcObject":
        raise file.error(file.root, f"the root element is '{file.root.tag}', not 'TcPlcObject'")
    declarations: list[d.Declaration] = []
    for element in file.root:
        match element.tag:
            case "POU":
                declarations.append(_pou(file, element))
            case "GVL":
                scanned = file.scan(_only(file, element, "Declaration"), element.get("Name", ""))
                attributes = tuple(part for found in scanned.attributes.values() for part in found)
                blocks = parse_scanned(scanned, "globals")
                where = scanned.segment.position(0)
                declarations.append(d.GlobalDeclarations(element.get("Name", ""), blocks, attributes, position=where))
            case "DUT":
                declarations += parse_scanned(file.scan(_only(file, element, "Declaration"), ""), "types")
            case tag:
                raise file.error(element, _REFUSED.get(tag, f"unknown element '{tag}'"))
    if not declarations:
        raise file.error(file.root, "the file holds no POU, GVL or DUT")
    return declarations, file.scans


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


def _pou(file: XmlFile, element: etree._Element) -> d.PouDeclaration:
    pou = _with_body(file, element, element.get("Name", ""))
    methods = [_with_body(file, child, f"{pou.name}.{child.get('Name', '')}") for child in _children(file, element)]
    return replace(pou, methods=tuple(methods))


def _with_body(file: XmlFile, element: etree._Element, qualified: str) -> d.PouDeclaration:
    head: d.PouDeclaration = parse_scanned(file.scan(_only(file, element, "Declaration"), qualified), "head")
    if head.name.upper() != element.get("Name", "").upper():
        raise file.error(element, f"the file says '{element.get('Name', '')}', its declaration says '{head.name}'")
    implementation = _only(file, element, "Implementation")
    languages = [child.tag for child in implementation]
    if languages != ["ST"]:
        shown = ", ".join(str(tag) for tag in languages) or "nothing"
        raise file.error(implementation, f"'{qualified}' is implemented in {shown}; only ST is supported")
    return replace(head, body=parse_scanned(file.scan(implementation[0], qualified), "body"))
