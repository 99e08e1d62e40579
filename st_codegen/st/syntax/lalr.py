"""A parser on the tables that lark makes of the grammar, for texts that the grammar takes.

Lark's own loop counts lines and columns, makes a value for each level of precedence around an expression, and is ready
to explain each error, which took most of the time of reading a project. What is not taken here is for lark to explain.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from re import Match, Pattern
from typing import Any, NamedTuple

from lark import Lark, Token
from lark.parse_tree_builder import ExpandSingleChild
from lark.parsers.lalr_analysis import Shift

_END = "$END"


class Reduce(NamedTuple):
    """A rule that is complete: what makes its value of those of its symbols, how many these are, and its name.

    make: None where the value of the only symbol stays as it is.
    """

    make: Callable[[list[Any]], Any] | None
    size: int
    name: str


@dataclass(frozen=True)
class StateLexer:
    """How words are recognised in a state: the pattern of all, of which some may be others, and what is passed over."""

    match: Callable[[str, int], Match[str] | None]
    special: dict[str, Pattern[str]]
    ignored: frozenset[str]


@dataclass(frozen=True)
class ParseTables:
    """For each state: what symbols do there (the next state, or what is complete before them), and its words.

    raised: the state behind rules that keep a value as it is, by the state below them, the first one and the symbol.
    """

    first: dict[str, int]
    last: dict[str, int]
    actions: dict[int, dict[str, Any]]
    words: dict[int, StateLexer]
    raised: dict[tuple[int, int, str], int] = field(default_factory=dict)

    @classmethod
    def of(cls, lark: Lark) -> ParseTables:
        """Those of a grammar. Raises AttributeError or ValueError for a lark that keeps them elsewhere."""
        inside: Any = lark  # only the class Lark itself is promised to stay
        parser = inside.parser.parser.parser
        table = parser.parse_table
        actions = {
            state: {
                str.__str__(symbol): to if action is Shift else _reduce(to, parser.callbacks)
                for symbol, (action, to) in row.items()
            }
            for state, row in table.states.items()
        }
        words = {state: _words(lexer) for state, lexer in inside.parser.lexer.lexer.lexers.items()}
        return cls(table.start_states, table.end_states, actions, words)

    def parse(self, text: str, start: str) -> Any:
        """What a text means by a start of the grammar; None for a text that it does not take."""
        state, last, at = self.first[start], self.last[start], 0
        states: list[Any] = [state]
        values: list[Any] = []
        while (found := _next(text, at, self.words[state])) is not None:
            token, at = found
            kind = token.type
            while isinstance(to := self.actions[state].get(kind), Reduce):
                if to.make is None:
                    state = states[-1] = self._raised(states[-2], state, kind)
                else:
                    parts = values[len(values) - to.size :]
                    del states[len(states) - to.size :], values[len(values) - to.size :]
                    values.append(to.make(parts))
                    state = self.actions[states[-1]][to.name]
                    states.append(state)
                if kind == _END and state == last:
                    return values[-1]
            if to is None:
                return None
            state = to
            states.append(state)
            values.append(token)
        return None

    def _raised(self, below: int, state: int, kind: str) -> Any:
        """The state behind all rules in turn that keep the value on top as it is."""
        key = (below, state, kind)
        if key not in self.raised:
            raised: Any = state
            while isinstance(to := self.actions[raised].get(kind), Reduce) and to.make is None:
                raised = self.actions[below][to.name]
            self.raised[key] = raised
        return self.raised[key]


def _next(text: str, at: int, words: StateLexer) -> tuple[Token, int] | None:
    """The token that begins at a place or behind blanks there, and its end; None where there is none."""
    while at < len(text):
        match = words.match(text, at)
        if match is None or match.lastgroup is None:
            return None
        kind = match.lastgroup
        begin, at = at, match.end()
        if kind not in words.ignored:
            if kind in words.special and (word := words.special[kind].fullmatch(match[0])):
                kind = word.lastgroup or kind
            return Token(kind, match[0], begin), at
    return Token(_END, "", at), at


def _reduce(rule: Any, callbacks: dict[Any, Any]) -> Reduce:
    make, size = callbacks[rule], len(rule.expansion)
    keeps = size == 1 and isinstance(make, ExpandSingleChild)
    return Reduce(None if keeps else make, size, str.__str__(rule.origin.name))


def _words(lexer: Any) -> StateLexer:
    (pattern,) = lexer.scanner._mres
    special = {}
    for kind, choice in lexer.callback.items():
        (special[kind],) = choice.scanner._mres
    return StateLexer(pattern.match, special, frozenset(lexer.ignore_types))
