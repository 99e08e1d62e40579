"""PLCopen XML (TC6, version 2.0 and 2.01): from elements to declarations.

Arrays of numbers are turned into tables while the file is parsed, so that the elements of a large table never exist
all at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from lxml import etree

from st_codegen.st import tree as t
from st_codegen.st.errors import Position, StSyntaxError
from st_codegen.st.syntax import declarations as d
from st_codegen.st.syntax.parser import parse_scanned, parse_segment
from st_codegen.st.syntax.scan import Scanned, Segment
from st_codegen.st.syntax.tables import parse_table
from st_codegen.st.syntax.xml_file import XmlFile, line_of, open_xml, tag_of
from st_codegen.st.tree import PouKind

NAMESPACES = ("http://www.plcopen.org/xml/tc6_0200", "http://www.plcopen.org/xml/tc6_0201")
#: Where the CODESYS family keeps lists of global variables.
_GLOBALS = "http://www.3s-software.com/plcopenxml/globalvars"
#: Additional data that would change the meaning if it were skipped, by the last part of its name.
_MEANINGFUL = {"method", "property", "pou", "datatype", "union", "interface", "action", "pouinheritance"}
_SECTIONS = {
    "inputVars": t.Section.INPUT,
    "outputVars": t.Section.OUTPUT,
    "inOutVars": t.Section.IN_OUT,
    "localVars": t.Section.VAR,
    "tempVars": t.Section.TEMP,
}
_KINDS = {
    "function": PouKind.FUNCTION,
    "functionBlock": PouKind.FUNCTION_BLOCK,
    "program": PouKind.PROGRAM,
}
_QUALIFIERS = {"constant": "CONSTANT", "retain": "RETAIN", "persistent": "PERSISTENT"}


def looks_like_plcopen(beginning: bytes) -> bool:
    """Whether a file that begins so is PLCopen XML."""
    return b"http://www.plcopen.org/xml/tc6" in beginning


def read_plcopen(name: str, content: bytes) -> tuple[list[d.Declaration], list[Scanned]]:
    """The declarations of a project in PLCopen XML, and its scanned texts.

    Raises `StSyntaxError` for anything that is no such file, and for what is not supported in it.
    """
    tables: dict[etree._Element, d.NumberTable] = {}

    def shrink(element: etree._Element) -> None:
        table = _plain_table(element, name) if tag_of(element) == "arrayValue" else None
        if table is not None:
            tables[element] = table
            element.clear()

    file = open_xml(name, content, shrink)
    namespace = etree.QName(file.root).namespace
    if namespace not in NAMESPACES or tag_of(file.root) != "project":
        raise file.error(file.root, f"the root element is '{file.root.tag}', not the 'project' of PLCopen XML")
    reader = _PlcopenReader(file, tables, f"{{{namespace}}}")
    return list(reader.declarations()), file.scans


def _plain_table(element: etree._Element, file: str) -> d.NumberTable | None:
    """The numbers of an arrayValue; None where it holds anything else."""
    cells = []
    for value in element:
        simple = value[0] if len(value) == 1 else None
        if simple is None or tag_of(simple) != "simpleValue" or value.get("repetitionValue", "1") != "1":
            return None
        cells.append(simple.get("value", ""))
    if not cells or any("," in cell for cell in cells):
        return None
    try:
        values, kind = parse_table(f"[{','.join(cells)}]")
    except ValueError:
        return None
    return d.NumberTable(values, kind, position=Position(file, line_of(element), 1))


@dataclass
class _PlcopenReader:
    file: XmlFile
    tables: dict[etree._Element, d.NumberTable]
    namespace: str
    #: The unit that is being read.
    pou: str = ""

    # --- elements ---

    def _all(self, parent: etree._Element, *tags: str) -> Iterator[etree._Element]:
        """The descendants of an element along a path of tags."""
        yield from parent.findall("/".join(f"{self.namespace}{tag}" for tag in tags))

    def _one(self, parent: etree._Element, tag: str) -> etree._Element:
        found = parent.findall(f"{self.namespace}{tag}")
        if len(found) != 1:
            where = parent.get("name") or tag_of(parent)
            raise self.file.error(parent, f"'{where}' needs exactly one <{tag}>, it has {len(found)}")
        return found[0]

    def _get(self, element: etree._Element, name: str) -> str:
        value = element.get(name)
        if value is None:
            raise self.file.error(element, f"<{tag_of(element)}> has no attribute '{name}'")
        return value

    def _at(self, element: etree._Element) -> Position:
        return self.file.position(element, self.pou)

    # --- declarations ---

    def declarations(self) -> Iterator[d.Declaration]:
        """All types, units and lists of globals, in the order of the file."""
        root = self.file.root
        self._refuse_meaningful_extras(root)
        for element in self._all(root, "types", "dataTypes", "dataType"):
            yield self._data_type(element)
        for element in self._all(root, "types", "pous", "pou"):
            yield self._pou(element)
        for path in (("configuration",), ("configuration", "resource")):
            for element in self._all(root, "instances", "configurations", *path, "globalVars"):
                yield self._globals(element)
        for element in self._all(root, "addData", "data"):
            if element.get("name") == _GLOBALS:
                yield from map(self._globals, self._all(element, "globalVars"))

    def _refuse_meaningful_extras(self, root: etree._Element) -> None:
        for data in root.iter(f"{self.namespace}data"):
            kind = data.get("name", "").rpartition("/")[2].lower()
            if kind in _MEANINGFUL:
                raise self.file.error(data, f"additional data '{kind}' is not supported: plain PLCopen XML is expected")

    def _data_type(self, element: etree._Element) -> d.TypeDeclaration:
        name, where = self._get(element, "name"), self._at(element)
        base = self._one(element, "baseType")
        inner = base[0] if len(base) == 1 else base
        initial = self._initial(element)
        if tag_of(inner) == "struct":
            return d.StructDeclaration(name, None, self._variables(inner), position=where)
        if tag_of(inner) == "enum":
            values = tuple(self._enum_value(value) for value in self._all(inner, "values", "value"))
            bases = [tag_of(spec) for spec in self._all(inner, "baseType", "*")]
            if initial is not None and not isinstance(initial, t.Identifier):
                raise self.file.error(element, f"the initial value of '{name}' is no name")
            return d.EnumDeclaration(name, values, bases[0] if bases else None, initial, position=where)
        return d.AliasDeclaration(name, self._type(base), initial, position=where)

    def _enum_value(self, element: etree._Element) -> d.Enumerator:
        value = element.get("value")
        expression = None if value is None else self._expression(value, element)
        return d.Enumerator(self._get(element, "name"), expression, position=self._at(element))

    def _pou(self, element: etree._Element) -> d.PouDeclaration:
        name = self._get(element, "name")
        kind = _KINDS.get(self._get(element, "pouType"))
        if kind is None:
            raise self.file.error(element, f"'{name}' is a '{element.get('pouType')}', not one of {', '.join(_KINDS)}")
        for tag in ("actions", "transitions"):
            if len(element.findall(f"{self.namespace}{tag}/*")):
                raise self.file.error(element, f"'{name}' has {tag}, which are not supported")
        interface, self.pou = self._one(element, "interface"), name
        results = [self._type(found) for found in self._all(interface, "returnType")]
        made = d.PouDeclaration(
            kind=kind,
            name=name,
            blocks=tuple(self._blocks(interface)),
            body=self._body(element),
            return_type=results[0] if results else None,
            position=self._at(element),
        )
        self.pou = ""
        return made

    def _blocks(self, interface: etree._Element) -> Iterator[d.VariableBlock]:
        for child in interface:
            tag = tag_of(child)
            if tag in _SECTIONS:
                yield self._block(child, _SECTIONS[tag])
            elif tag not in ("returnType", "documentation", "addData"):
                raise self.file.error(child, f"'{self.pou}': <{tag}> is not supported")

    def _body(self, element: etree._Element) -> tuple[t.Statement, ...]:
        body = self._one(element, "body")
        languages = [tag_of(child) for child in body]
        if languages[:1] != ["ST"]:
            found = ", ".join(languages) or "nothing"
            raise self.file.error(body, f"'{self.pou}' is implemented in {found}; only ST is read")
        statements: tuple[t.Statement, ...] = parse_scanned(self.file.scan(body[0], self.pou), "body")
        return statements

    def _globals(self, element: etree._Element) -> d.GlobalDeclarations:
        block = self._block(element, t.Section.GLOBAL)
        return d.GlobalDeclarations(element.get("name", ""), (block,), position=self._at(element))

    def _block(self, element: etree._Element, section: t.Section) -> d.VariableBlock:
        qualifiers = frozenset(word for name, word in _QUALIFIERS.items() if element.get(name) in ("true", "1"))
        return d.VariableBlock(section, qualifiers, self._variables(element), position=self._at(element))

    def _variables(self, parent: etree._Element) -> tuple[d.VariableDeclaration, ...]:
        return tuple(
            d.VariableDeclaration(
                self._get(element, "name"),
                self._type(self._one(element, "type")),
                self._initial(element),
                element.get("address"),
                position=self._at(element),
            )
            for element in self._all(parent, "variable")
        )

    # --- types ---

    def _type(self, parent: etree._Element) -> d.TypeSpec:
        """The type that is the only child of an element."""
        if len(parent) != 1:
            raise self.file.error(parent, f"a type is one element, here are {len(parent)}")
        element, tag, where = parent[0], tag_of(parent[0]), self._at(parent[0])
        match tag:
            case "derived":
                return d.NamedType(self._get(element, "name"), position=where)
            case "array":
                ranges = tuple(self._range(found) for found in self._all(element, "dimension"))
                if not ranges:
                    raise self.file.error(element, "an array without a dimension")
                return d.ArraySpec(ranges, self._base(element), position=where)
            case "string" | "wstring":
                length = element.get("length")
                size = None if length is None else self._expression(length, element)
                return d.StringSpec(size, tag == "wstring", position=where)
            case "pointer":
                return d.PointerSpec(self._base(element), position=where)
            case "subrangeSigned" | "subrangeUnsigned":
                base = self._base(element)
                if not isinstance(base, d.NamedType):
                    raise self.file.error(element, "a subrange of something that is no integer type")
                return d.SubrangeSpec(base.name, self._range(self._one(element, "range")), position=where)
            case _ if tag in ("struct", "enum") or len(element):
                raise self.file.error(element, f"a <{tag}> needs a name of its own: declare it as a data type")
            case _:
                return d.NamedType(tag, position=where)

    def _base(self, element: etree._Element) -> d.TypeSpec:
        return self._type(self._one(element, "baseType"))

    def _range(self, element: etree._Element) -> t.Range:
        lower, upper = (self._expression(self._get(element, end), element) for end in ("lower", "upper"))
        return t.Range(lower, upper, position=self._at(element))

    # --- values ---

    def _initial(self, element: etree._Element) -> d.Initial | None:
        found = list(self._all(element, "initialValue"))
        return self._value(found[0]) if found else None

    def _value(self, parent: etree._Element) -> d.Initial:
        if len(parent) != 1:
            raise self.file.error(parent, f"a value is one element, here are {len(parent)}")
        element = parent[0]
        match tag_of(element):
            case "simpleValue":
                return self._expression(self._get(element, "value"), element)
            case "arrayValue":
                return self.tables.get(element) or self._array_value(element)
            case "structValue":
                members = tuple(
                    d.MemberInitial(self._get(value, "member"), self._value(value), position=self._at(value))
                    for value in self._all(element, "value")
                )
                return d.StructInitial(members, position=self._at(element))
            case tag:
                raise self.file.error(element, f"<{tag}> is no value")

    def _array_value(self, element: etree._Element) -> d.Initial:
        items: list[d.Initial | d.Repeated] = []
        for value in self._all(element, "value"):
            text = value.get("repetitionValue", "1")
            if not (text.isascii() and text.isdigit()) or len(text) > 9:
                raise self.file.error(value, f"repetitionValue '{text[:40]}' is no count")
            inner = self._value(value)
            items.append(inner if text == "1" else d.Repeated(int(text), inner, position=self._at(value)))
        return d.ArrayInitial(tuple(items), position=self._at(element))

    def _expression(self, text: str, element: etree._Element) -> t.Expression:
        """The expression that stands in an attribute of an element."""
        segment = Segment(f"x := {text};", self.file.name, line_of(element), pou=self.pou)
        try:
            parsed: tuple[t.Statement, ...] = parse_segment(segment, "body")
        except StSyntaxError:
            parsed = ()
        match parsed:
            case (t.Assign(target=t.Identifier(), value=value),):
                return value
            case _:
                shown = text if len(text) <= 40 else f"{text[:37]}..."
                raise self.file.error(element, f"'{shown}' is no value")
