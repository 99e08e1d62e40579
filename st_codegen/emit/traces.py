"""What editors and version control change in a generated file without changing what it says.

Opened and saved in TwinCAT's development environment, a file gets line numbers for breakpoints, the version of the
product and identifiers of its own; version control may change line ends, an editor the byte order mark.
"""

from __future__ import annotations

import re

_TWINCAT = (".tcpou", ".tcdut", ".tcgvl", ".tctto", ".plcproj")
_GUID = rb"\{[0-9A-Fa-f]{8}(?:-[0-9A-Fa-f]{4}){3}-[0-9A-Fa-f]{12}\}"
#: What is taken out of TwinCAT's files, and what stays in its place.
_TRACES = (
    (rb'[ \t]*<LineIds Name="[^"]*">\s*(?:<LineId [^<>]*/>\s*)*</LineIds>[ \t]*\n?', b""),
    (rb' ProductVersion="[^"]*"', b""),
    (rb"[ \t]*<ProgramVersion>[^<]*</ProgramVersion>[ \t]*\n?", b""),
    # elements of a project file that hold an identifier and nothing else: XAE adds some and renews others
    (rb"[ \t]*<(\w+)>" + _GUID + rb"</\1>[ \t]*\n?", b""),
    (rb'( Id=")' + _GUID + rb'"', rb'\1"'),
)


def without_traces(name: str, content: bytes) -> bytes:
    """The content of a file, by which it is compared with another; `name` tells whether it is TwinCAT's."""
    content = content.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n")
    if name.lower().endswith(_TWINCAT):
        for pattern, kept in _TRACES:
            content = re.sub(pattern, kept, content)
    return content.rstrip() + b"\n"
