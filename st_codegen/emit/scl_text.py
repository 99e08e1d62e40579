"""The words of SCL in portable code: marks of local names, quoted names, literals with their type, named arguments."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from st_codegen.emit.blocks.listing import Block

_TOKEN = re.compile(
    r"\(\*.*?\*\)|'[^']*'|[A-Za-z_]\w*|\d+#\w+|\d+\.\d+(?:[eE][+-]?\d+)?|\d+|\s+|[<>=:*]{1,2}|.", re.DOTALL
)
_BLANK = re.compile(r"\s|\(\*")
#: Functions with several arguments, which SCL wants by name.
_NAMED_ARGUMENTS = {"MIN": ("IN1", "IN2"), "MAX": ("IN1", "IN2"), "SHR": ("IN", "N")}
_BRACKETS = re.compile(r"\b((?:END)?)_?(IF|FOR|WHILE|CASE|REPEAT)\b")


@dataclass
class _Call:
    """An open parenthesis: of which function's call, and how many arguments were begun."""

    name: str
    arguments: int = 1


def scl_code(code: str, block: Block, names: Collection[str], words: Any) -> str:
    """The body of a block as SCL; `names` are those of all blocks and types of the project.

    `words` are the macros of `templates/scl/words.st.j2`: how SCL writes what portable text writes otherwise.
    """
    own = local_names(block)
    tokens: list[str] = _TOKEN.findall(code)
    visible = [number for number, token in enumerate(tokens) if not _BLANK.match(token)]
    before = {second: first for first, second in itertools.pairwise(visible)}
    after = dict(itertools.pairwise(visible))
    open_calls: list[_Call] = []
    written = []
    for number, token in enumerate(tokens):
        last = tokens[before[number]] if number in before else ""
        following = tokens[after[number]] if number in after else ""
        if token == "(":
            open_calls.append(_Call(last))
            written.append(f"({words.argument(_NAMED_ARGUMENTS[last][0])} " if last in _NAMED_ARGUMENTS else "(")
        elif token == ")":
            open_calls.pop()
            written.append(token)
        elif token == "," and open_calls and open_calls[-1].name in _NAMED_ARGUMENTS:
            names_of = _NAMED_ARGUMENTS[open_calls[-1].name]
            written.append(f", {words.argument(names_of[open_calls[-1].arguments])}")
            open_calls[-1].arguments += 1
        elif re.fullmatch(r"\d+\.\d.*", token):
            written.append(words.literal(token))
        elif not re.match(r"[A-Za-z_]", token) or last == "." or (open_calls and _names(following)):
            written.append(token)  # a field or the name of an argument, too
        elif token in own and not (token == block.name and not _names(following)):
            written.append(words.local(token))
        elif token in names:
            written.append(words.quoted(token))
        else:
            written.append(words.truncation() if token == "TRUNC" else token)
    return "".join(written)


def _names(token: str) -> bool:
    """Whether what stands in front of a token is assigned, or is the name of an argument."""
    return token[:1] == ":" or token == "=>"


def local_names(block: Block) -> frozenset[str]:
    """The names that a block declares, its own included where it is a function's result."""
    declared = (*block.inputs, *block.outputs, *block.in_outs, *block.variables, *block.constants)
    names = {variable.name for variable in declared} | {table.name for table in block.tables}
    names |= {code.constant for code in block.codes}
    return frozenset({*names, block.name} if block.kind == "FUNCTION" else names)


def scl_section(code: str, block: Block, names: Collection[str], title: str, words: Any) -> str:
    """A section of a body as a region; one whose statements reach into the next has its title as a comment."""
    text = scl_code(code, block, names, words)
    found = Counter(_BRACKETS.findall(re.sub(r"\(\*.*?\*\)", " ", text, flags=re.DOTALL)))
    is_whole = all(number == found["" if end else "END", word] for (end, word), number in found.items())
    return str(words.region(title, text) if is_whole else words.titled(title, text))
