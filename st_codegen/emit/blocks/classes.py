"""Labels of classifiers in generated text: in the header, and as an enumeration where a target has such types."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from st_codegen.emit.blocks.application import Enumeration, EnumValue
from st_codegen.emit.foreign_names import is_foreign
from st_codegen.emit.literals import capitalised, identifier, is_keyword, spelt
from st_codegen.ir import Classes, Label, ModelIR

#: Characters of a label that are shown.
_SHOWN = 60
#: Characters of a label that become part of a name.
_NAME = 32
#: Labels that a header lists; the enumeration has all.
_LISTED = 200


def label_text(label: Label) -> str:
    """A label as it may stand in a comment of any file: printable ASCII, and nothing that ends a comment or CDATA."""
    if not isinstance(label, str):
        return str(label)
    shown = label if len(label) <= _SHOWN else label[:_SHOWN] + ".."
    text = ascii(shown)
    # a string that ends a comment, or that a template or a reader of XML may take for its own
    return re.sub(r"[*\]<>&{}$%#]", lambda found: f"\\x{ord(found[0]):02x}", text)


def class_lines(classes: Classes) -> Iterator[str]:
    """The labels by number, for the header of a block."""
    for number, label in enumerate(classes.labels[:_LISTED]):
        yield f"Class {number}: {label_text(label)}"
    if len(classes.labels) > _LISTED:
        yield f"Classes {_LISTED} to {len(classes.labels) - 1}: not listed here"


def class_type(model: ModelIR) -> Enumeration | None:
    """E_<Name>Class, the numbers of the classes by name; None for a model that is no classifier."""
    if model.classes is None:
        return None
    name = capitalised(identifier(model.name, "model name", "E_"))
    names = _names(model.classes.labels)
    return Enumeration(
        f"E_{name}Class",
        (f"Classes of FB_{name}, the values of its output {model.variables[0]}.",),
        tuple(
            EnumValue(value, number, label_text(label))
            for number, (value, label) in enumerate(zip(names, model.classes.labels, strict=True))
        ),
    )


def _names(labels: Sequence[Label]) -> list[str]:
    """A name for each label: its letters and digits, with the word Class where these alone would be none."""
    names: list[str] = []
    taken: set[str] = set()
    for number, label in enumerate(labels):
        text = re.sub("^-", "minus_", spelt(str(label)))
        text = re.sub(r"_+", "_", re.sub(r"[^A-Za-z0-9_]", "_", text)[:_NAME]).strip("_")
        name = capitalised(text)
        if not name[:1].isalpha() or is_keyword(name) or is_foreign(name):
            name = f"Class_{text or number}"
        while name.lower() in taken:
            name = f"{name}_number_{number}"
        taken.add(name.lower())
        names.append(name)
    return names
