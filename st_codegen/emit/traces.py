"""What editors and version control change in a generated file without changing what it says.

Opened and saved in TwinCAT's development environment, a file gets line numbers for breakpoints, the version of the
product and identifiers of its own; version control may change line ends, an editor the byte order mark.
"""

from __future__ import annotations

import re
from pathlib import PurePath

_OBJECTS = (".tcpou", ".tcdut", ".tcgvl", ".tctto")
_GUID = rb"\{[0-9A-Fa-f]{8}(?:-[0-9A-Fa-f]{4}){3}-[0-9A-Fa-f]{12}\}"


def _lines(pattern: bytes) -> re.Pattern[bytes]:
    """Whole lines, from the indent to the line end."""
    return re.compile(rb"^[ \t]*" + pattern + rb"[ \t]*\n?", re.MULTILINE | re.DOTALL)


def _in_text(pattern: bytes) -> re.Pattern[bytes]:
    return re.compile(pattern)


#: Elements that hold an identifier and nothing else: XAE adds some and renews others.
_IDENTIFIERS = (rb">{", _lines(rb"<(\w+)>" + _GUID + rb"</\1>"), b"")
#: What is taken out of TwinCAT's files, by their suffix: bytes that it cannot be without, what it is, and what stays in
#: its place. Patterns are slow on large texts, and most have nothing to take out.
_OF_OBJECTS = (
    (b"<LineIds", _lines(rb'<LineIds Name="[^"]*">\s*(?:<LineId [^<>]*/>\s*)*</LineIds>'), b""),
    (b" ProductVersion=", _in_text(rb' ProductVersion="[^"]*"'), b""),
    (b' Id="{', _in_text(rb'( Id=")' + _GUID + rb'"'), rb'\1"'),
    (b"<ObjectProperties />", _lines(rb"<ObjectProperties />"), b""),
    _IDENTIFIERS,
)
_OF_PROJECTS = (
    (b"<ProgramVersion>", _lines(rb"<ProgramVersion>[^<]*</ProgramVersion>"), b""),
    _IDENTIFIERS,
    # the file that a build makes, and the settings of the environment's own parts
    (
        b"<ItemGroup>",
        _lines(rb'<ItemGroup>\s*<None Include="[^"]*\.tmc">\s*<SubType>Content</SubType>\s*</None>\s*</ItemGroup>'),
        b"",
    ),
    (b"<ProjectExtensions>", _lines(rb"<ProjectExtensions>.*?</ProjectExtensions>"), b""),
)
_OF_SYSTEMS = (
    (b'="', _in_text(rb' (?:TcVersion|TmcHash|TmcPath|NeedCalleeCall)="[^"]*"'), b""),
    # what is read from the PLC project again: its mapped variables and their types
    (b"<Vars ", _lines(rb'<Vars VarGrpType="[^"]*"[^>]*>.*?</Vars>'), b""),
    (b"<DataTypes>", _lines(rb"<DataTypes>.*?</DataTypes>"), b""),
    (b"<JsonDynPous>", _lines(rb"<JsonDynPous>.*?</JsonDynPous>"), b""),
    (b"<Io/>", _lines(rb"<Io/>"), b""),
)
_OF_SOLUTIONS = (
    (b"# ", _lines(rb"# [^\n]*"), b""),
    (b"VisualStudioVersion", _lines(rb"VisualStudioVersion = [^\n]*"), b""),
    (
        b"GlobalSection",
        _lines(
            rb"GlobalSection\(ExtensibilityGlobals\) = postSolution\n\s*SolutionGuid = "
            + _GUID
            + rb"\s*EndGlobalSection"
        ),
        b"",
    ),
)
_TRACES = {
    **dict.fromkeys(_OBJECTS, _OF_OBJECTS),
    ".plcproj": _OF_PROJECTS,
    ".tsproj": _OF_SYSTEMS,
    ".sln": _OF_SOLUTIONS,
}


def without_traces(name: str, content: bytes) -> bytes:
    """The content of a file, by which it is compared with another; `name` tells whether it is TwinCAT's."""
    content = content.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n")
    for needed, pattern, kept in _TRACES.get(PurePath(name).suffix.lower(), ()):
        if needed in content:
            content = pattern.sub(kept, content)
    return content.rstrip() + b"\n"
