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
_IDENTIFIERS = (_lines(rb"<(\w+)>" + _GUID + rb"</\1>"), b"")
#: What is taken out of TwinCAT's files, by their suffix, and what stays in its place.
_OF_OBJECTS = (
    (_lines(rb'<LineIds Name="[^"]*">\s*(?:<LineId [^<>]*/>\s*)*</LineIds>'), b""),
    (_in_text(rb' ProductVersion="[^"]*"'), b""),
    (_in_text(rb'( Id=")' + _GUID + rb'"'), rb'\1"'),
    (_lines(rb"<ObjectProperties />"), b""),
    _IDENTIFIERS,
)
_OF_PROJECTS = (
    (_lines(rb"<ProgramVersion>[^<]*</ProgramVersion>"), b""),
    _IDENTIFIERS,
    # the file that a build makes, and the settings of the environment's own parts
    (_lines(rb'<ItemGroup>\s*<None Include="[^"]*\.tmc">\s*<SubType>Content</SubType>\s*</None>\s*</ItemGroup>'), b""),
    (_lines(rb"<ProjectExtensions>.*?</ProjectExtensions>"), b""),
)
_OF_SYSTEMS = (
    (_in_text(rb' (?:TcVersion|TmcHash|TmcPath|NeedCalleeCall)="[^"]*"'), b""),
    # what is read from the PLC project again: its mapped variables and their types
    (_lines(rb'<Vars VarGrpType="[^"]*"[^>]*>.*?</Vars>'), b""),
    (_lines(rb"<DataTypes>.*?</DataTypes>"), b""),
    (_lines(rb"<JsonDynPous>.*?</JsonDynPous>"), b""),
    (_lines(rb"<Io/>"), b""),
)
_OF_SOLUTIONS = (
    (_lines(rb"# [^\n]*"), b""),
    (_lines(rb"VisualStudioVersion = [^\n]*"), b""),
    (
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
    for pattern, kept in _TRACES.get(PurePath(name).suffix.lower(), ()):
        content = pattern.sub(kept, content)
    return content.rstrip() + b"\n"
