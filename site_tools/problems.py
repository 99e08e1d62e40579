"""The page of all codes of messages: cause and cure of each."""

from __future__ import annotations

import re

from st_codegen.diagnostics import DIAGNOSTICS

#: Codes by their beginnings.
GROUPS = {
    "STC10": "Command line and machine",
    "STC11": "Files and folders",
    "STC12": "Models",
    "STC13": "Names and configuration",
    "STC14": "Targets and sizes",
    "STC15": "Generated code",
    "STC16": "Data",
    "STC17": "Controllers",
    "STC2": "Answers that are no",
    "STC9": "Defects",
}


def page() -> str:
    """The page as Markdown, a section a code."""
    lines = [
        "# Codes of messages",
        "",
        "Every message of a refusal has a code below it. `st-codegen explain CODE` shows the same text.",
        "In Python, `error.codes` has them. A message that lists several problems has the codes of all.",
        "",
    ]
    for start, title in GROUPS.items():
        lines += [f"## {title}", ""]
        for entry in sorted(DIAGNOSTICS, key=lambda entry: entry.code):
            if entry.code.startswith(start):
                lines += [f"### {entry.code}: {entry.title}", ""]
                lines += [f"**Cause.** {_marked(entry.cause)}", "", f"**What to do.** {_marked(entry.cure)}", ""]
    return "\n".join(lines) + "\n"


def _marked(text: str) -> str:
    """Options, commands and names of files as code."""
    words = (
        r"(pip install '[^']+'|st-codegen (?:MODELS --out FOLDER|[a-z]+)(?: --help)?|--[a-z][\w-]*|[\w/]+\.toml|bValid)"
    )
    return re.sub(rf"(?<![\w`-]){words}", r"`\1`", text)
