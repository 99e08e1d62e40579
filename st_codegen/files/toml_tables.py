"""TOML files: tables whose keys are declared by reading them.

A reader asks a table for each key it knows, with type, range, unit and default. Whatever is wrong is noted, a stand-in
of the right type is returned, and reading goes on, so that one message lists all problems. A key that nobody asked for
is unknown: it is refused with the known key that is spelt most like it.

>>> problems = Problems("axis.toml")
>>> with TomlTable({"inertia_kgm2": -1.0, "coulomb_nm": 2}, "[motor]", problems) as motor:
...     _ = motor.number("inertia_kgm2", low=0.0, high=10.0, unit="kg m2"), motor.number("coulomb_Nm", 0.1)
>>> problems.raise_if_any()
Traceback (most recent call last):
...
st_codegen.errors.InputError: axis.toml: 2 problems
  - [motor]: inertia_kgm2 = -1.0 is outside 0 .. 10 kg m2
  - [motor]: unknown key 'coulomb_nm'; did you mean 'coulomb_Nm'? Known are inertia_kgm2, coulomb_Nm
"""

from __future__ import annotations

import math
import numbers
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from enum import StrEnum
from pathlib import Path
from typing import Any, TypeVar

from st_codegen.errors import InputError, Problems, closest
from st_codegen.files.text import read_text

#: The longest value that a message shows in full, in characters.
_SHOWN = 60
_E = TypeVar("_E", bound=StrEnum)
_T = TypeVar("_T")


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file. Raises InputError for what cannot be read as text or as TOML."""
    return parse_toml(read_text(path), str(path))


def parse_toml(text: str, subject: str) -> dict[str, Any]:
    """The content of TOML text; `subject` names it in messages. Raises InputError for what is no TOML."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{subject}: not readable as TOML (its tables and lists are nested too deeply)") from None
    except ValueError as error:  # TOMLDecodeError, or int() on thousands of digits
        raise InputError(f"{subject}: not readable as TOML ({error})") from None


def nearest(name: str, known: Iterable[str]) -> str:
    """The tail of a message on an unknown name: the known name that is spelt most like it, and all of them."""
    names = list(known)
    near = closest(name, names)
    listed = f"nown are {', '.join(names)}" if names else "nothing is known here"
    if near is None:
        return f"k{listed}" if names else listed
    return f"did you mean '{near}'? K{listed}"


class TomlTable:
    """One table of a TOML file, read key by key; as a context it refuses the keys that nobody asked for at its end.

    values: what `tomllib` made of the table; where: how messages name it, as in `[axis.motor]` (empty for the file as
    a whole); problems: where faults are noted.
    """

    def __init__(self, values: Mapping[str, Any], where: str, problems: Problems) -> None:
        self.values = values
        self.where = where
        self.problems = problems
        self._asked: list[str] = []
        self._noted_before = len(problems.errors)

    def __enter__(self) -> TomlTable:
        self._noted_before = len(self.problems.errors)
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if error is None:
            self.refuse_others()

    @property
    def is_sound(self) -> bool:
        """Whether nothing was noted since the `with` block of this table began."""
        return len(self.problems.errors) == self._noted_before

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def note(self, message: str) -> None:
        """Note a problem, with the name of this table in front."""
        self.problems.add(f"{self.where}: {message}" if self.where else message)

    def collect(self) -> AbstractContextManager[None, bool]:
        """A context in which an InputError is noted, with this table's name in front, instead of raised."""
        return self.problems.collect(self.where)

    def refuse_others(self) -> None:
        """Note every key that was not asked for."""
        known = list(dict.fromkeys(self._asked))
        for key in sorted(set(self.values) - set(known)):
            kind, name = ("key", f"'{_cut(key)}'") if self.where else ("table", f"[{_cut(key)}]")
            self.note(f"unknown {kind} {name}; {nearest(key, known)}")

    # -- values

    def number(
        self,
        key: str,
        default: float | None = None,
        *,
        low: float = -math.inf,
        high: float = math.inf,
        unit: str = "",
        meaning: str = "",
    ) -> float:
        """A finite number in low .. high, both allowed. Without a default the key must be there."""
        found = self._get(key, default, meaning)
        if found is None:
            return math.nan
        value = self.number_of(key, found, low, high, unit)
        return value if value is not None else math.nan if default is None else default

    def whole(self, key: str, default: int | None = None, *, low: int = 0, high: int = 10**6) -> int:
        """A whole number in low .. high, both allowed. Without a default the key must be there."""
        found = self._get(key, default, "")
        if found is None:
            return low
        value = self.whole_of(key, found, low, high)
        return value if value is not None else low if default is None else default

    def text(self, key: str, default: str | None = None) -> str:
        """A text. Without a default the key must be there."""
        found = self._get(key, default, "")
        if isinstance(found, str):
            return found
        if found is not None:
            self.note(f"{key} = {shown(found)} is not a text")
        return default or ""

    def flag(self, key: str, default: bool) -> bool:
        """The truth value of a key, or the default; anything else is noted as a problem."""
        found = self._get(key, default, "")
        if isinstance(found, bool):
            return found
        self.note(f"{key} = {shown(found)} is neither true nor false")
        return default

    def choice(self, key: str, kind: type[_E]) -> _E | None:
        """One of the texts of an enumeration; None where it is none of them."""
        found = self._get(key, None, "")
        return None if found is None else self.choice_of(key, found, kind)

    def list_of(self, key: str, read: Callable[[str, Any], _T | None]) -> tuple[_T, ...]:
        """A list that must be there; each entry is read by a function such as `whole_of`, bad ones are noted."""
        found = self._get(key, None, "")
        if found is None:
            return ()
        if not isinstance(found, list | tuple):
            self.note(f"{key} = {shown(found)} is not a list")
            return ()
        return tuple(value for value in (read(key, entry) for entry in found) if value is not None)

    # -- a value of its own, or an entry of a list

    def number_of(
        self, key: str, found: Any, low: float = -math.inf, high: float = math.inf, unit: str = ""
    ) -> float | None:
        """A value as a finite number within bounds, or None with a note."""
        if isinstance(found, bool) or not isinstance(found, numbers.Real):
            self.note(f"{key} = {shown(found)} is not a number")
            return None
        try:
            value = float(found)
        except OverflowError:
            value = math.inf
        if not math.isfinite(value):
            self.note(f"{key} = {shown(found)} is not finite")
        elif not low <= value <= high:
            self.note(f"{key} = {shown(found)} is outside {low:g} .. {high:g} {unit}".rstrip())
        else:
            return value
        return None

    def whole_of(self, key: str, found: Any, low: int = 0, high: int = 10**6) -> int | None:
        """A value as a whole number within bounds, or None with a note."""
        is_whole = isinstance(found, numbers.Integral) or (isinstance(found, float) and found.is_integer())
        if isinstance(found, bool) or not is_whole:
            self.note(f"{key} = {shown(found)} is not a whole number")
        elif not low <= found <= high:
            self.note(f"{key} = {shown(found)} is outside {low} .. {high}")
        else:
            return int(found)
        return None

    def choice_of(self, key: str, found: Any, kind: type[_E]) -> _E | None:
        """A value as one of an enumeration's texts, or None with a note."""
        if isinstance(found, str) and found in set(kind):
            return kind(found)
        self.note(f"{key} = {shown(found)}; {nearest(found if isinstance(found, str) else '', kind)}")
        return None

    # -- tables inside

    def table(self, key: str, *, required: bool = False) -> TomlTable:
        """The table of a key; the first of several, which is an error, and an empty one where there is none."""
        found = self._get(key, None, "") if required else self._asked_for(key)
        if isinstance(found, Mapping):
            return TomlTable(found, self._name_of(key), self.problems)
        if isinstance(found, Sequence) and found and all(isinstance(entry, Mapping) for entry in found):
            self.note(f"[[{key}]]: one table is wanted, not a list of tables; write [{key}]")
            return TomlTable(found[0], self._name_of(key), self.problems)  # so that nothing in it is called missing
        if found is not None:
            self.note(f"{key} = {shown(found)} is not a table; write [{self._inner(key)}]")
        return TomlTable({}, self._name_of(key), self.problems)

    def tables(self, key: str, *, required: bool = False) -> tuple[TomlTable, ...]:
        """The tables `[[key]]`, in the order of the file."""
        found = self._get(key, None, "") if required else self._asked_for(key)
        if found is None:
            return ()
        if isinstance(found, Mapping):
            self.note(f"[{key}]: a list of tables is wanted; write [[{self._inner(key)}]] above each")
            return ()
        if not isinstance(found, list) or not all(isinstance(entry, Mapping) for entry in found):
            self.note(f"{key} = {shown(found)}: tables are wanted; write [[{self._inner(key)}]] above each")
            return ()
        if required and not found:
            self.note(f"{key} is empty: one table [[{key}]] for each is wanted")
        return tuple(TomlTable(entry, f"[[{key}]] {number}", self.problems) for number, entry in enumerate(found, 1))

    def declare(self, *keys: str) -> None:
        """Keys that are known, though nobody reads them here."""
        self._asked.extend(keys)

    def _asked_for(self, key: str) -> Any:
        self._asked.append(key)
        return self.values.get(key)

    def _get(self, key: str, default: Any, meaning: str) -> Any:
        """The value of a key, or its default; None, with a note, where a key without a default is missing."""
        found = self._asked_for(key)
        if found is None and default is None:
            self.note(f"'{key}' is missing" + (f" ({meaning})" if meaning else ""))
        return default if found is None else found

    def _inner(self, key: str) -> str:
        found = re.match(r"\[{1,2}([^\[\]]+)\]", self.where)
        return f"{found[1]}.{key}" if found else key

    def _name_of(self, key: str) -> str:
        if not self.where or (self.where.startswith("[") and not self.where.startswith("[[")):
            return f"[{self._inner(key)}]"
        return f"{self.where}, {key}"


def shown(value: Any) -> str:
    """A value as a message shows it: cut where it is long."""
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= 10**_SHOWN:
        return f"a number of about {round(value.bit_length() * math.log10(2))} digits"
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a list that holds such a number, or lists in lists
        text = f"a {type(value).__name__}"
    return _cut(text)


def _cut(text: str) -> str:
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]} .."
