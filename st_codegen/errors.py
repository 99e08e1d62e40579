"""The exceptions of st-codegen.

Every message names what is wrong (file, model, operator, feature) and what to do about it. Input errors are collected,
so that one run reports all of them: see `Problems`. Each has a code, from the place that made it: see `diagnostics`.
"""

from __future__ import annotations

import decimal
import difflib
import importlib
import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import PurePath
from types import FrameType
from typing import Any, NamedTuple

from st_codegen.diagnostics import code_for

#: So many messages of one kind are shown as one.
_MANY_ALIKE = 8

#: A message that collects problems shows so many of them.
MOST_SHOWN = 50


#: Modules whose functions note problems for others: the place of a message is that of their caller.
_FOR_OTHERS = ("errors", "files.toml_tables", "files.csv_tables")


def counted(number: int, one: str, many: str = "") -> str:
    """A number with its noun, as messages and pages count.

    >>> counted(1, "model"), counted(0, "axis", "axes"), counted(10_000, "row")
    ('1 model', '0 axes', '10,000 rows')
    """
    return f"{number:,} {one if number == 1 else many or f'{one}s'}"


def at_most(bound: float, digits: int = 2) -> str:
    """An upper bound in so many digits, rounded up: what is printed is a bound, too.

    >>> at_most(1.0004, 3), at_most(0.25), at_most(-1.0004, 3), at_most(12341.0), at_most(float("inf"))
    ('1.01', '0.25', '-1', '13000', 'inf')
    """
    return _rounded(bound, digits, decimal.ROUND_CEILING)


def at_least(bound: float, digits: int = 2) -> str:
    """A lower bound in so many digits, rounded down.

    >>> at_least(1.0096, 3), at_least(-1.0004, 3)
    ('1', '-1.01')
    """
    return _rounded(bound, digits, decimal.ROUND_FLOOR)


def _rounded(bound: float, digits: int, rounding: str) -> str:
    short = decimal.Context(prec=digits, rounding=rounding, Emin=-400).create_decimal(repr(float(bound)))
    return f"{float(short):.{15 if abs(float(short)) < 1e6 else digits}g}"


def closest(name: str, known: Iterable[str], alike: float = 0.6) -> str | None:
    """The known name that is spelt most like a name, or None; case counts for nothing, nor does `-` in place of `_`.

    alike: how much of both must be the same, 0 to 1 (`difflib.SequenceMatcher.ratio`).

    >>> closest("Speed_RPM", ["speed_rpm", "torque_Nm"])
    'speed_rpm'
    """
    by_spelling = {_spelt(one): one for one in known}
    near = difflib.get_close_matches(_spelt(name), by_spelling, 1, alike)
    return by_spelling[near[0]] if near else None


def meant(name: str, known: Iterable[str], alike: float = 0.6) -> str:
    """The end of a message on a name that nothing has: the known name that may be meant, or nothing."""
    near = closest(name, known, alike)
    return f"; did you mean '{near}'?" if near else ""


def _spelt(name: str) -> str:
    return name.lower().replace("-", "_")


class StCodegenError(Exception):
    """Base class: everything that the command line reports with exit code 2 and no traceback."""

    def __init__(self, *arguments: object) -> None:
        super().__init__(*arguments)
        self._place = _place(self)
        self._codes: tuple[str, ...] = ()

    @property
    def codes(self) -> tuple[str, ...]:
        """The codes of all that this error says, as in `st_codegen.diagnostics`; one where it says one thing."""
        return self._codes or (code_for(self._place, (kind.__name__ for kind in type(self).__mro__)),)


def _place(error: Exception) -> str:
    """Where an error is made: the room, module and function (`walkers.files:read`); empty outside of the package."""
    frame: FrameType | None = sys._getframe(2)
    while frame is not None:
        module = frame.f_globals.get("__name__", "").removeprefix("st_codegen.")
        is_constructor = frame.f_code.co_name == "__init__" and frame.f_locals.get("self") is error
        if not (is_constructor or module in _FOR_OTHERS):
            ours = frame.f_globals.get("__name__", "").startswith("st_codegen.")
            return f"{module}:{frame.f_code.co_qualname}" if ours else ""
        frame = frame.f_back
    return ""


class InputError(StCodegenError):
    """Something the user gave us cannot be used: a file, a model, a bundle, a name."""


class UnsupportedModelError(InputError):
    """A model, operator or option that no walker or target can express."""


class UntrustedFileError(InputError):
    """A file whose loading can run code, given without `--trust-pickle`."""


class MissingExtraError(InputError):
    """An optional dependency is not installed, or older (`installed`: its version) than the least that is known.

    Or it is installed and cannot be imported: `fails` says why.
    """

    def __init__(
        self, package: str, extra: str, purpose: str, installed: str = "", least: str = "", fails: str = ""
    ) -> None:
        what, how = "which is not installed", "pip install"
        if installed:
            # rules of a library change: those of older versions were not read, and models would be compiled wrong
            what, how = f"{least} or newer; {installed} is installed", "pip install --upgrade"
        if fails:
            what, how = f"which is installed and cannot be imported ({fails})", "pip install --force-reinstall"
        super().__init__(f"{purpose} needs the package '{package}', {what}: {how} \"st-codegen[{extra}]\"")


def extra_package(package: str, extra: str, purpose: str) -> Any:
    """A package of an extra, imported for a purpose.

    Raises MissingExtraError where it is not installed, or where it is older than the requirements of st-codegen say,
    or cannot be imported.
    """
    name = package.partition(".")[0]
    try:
        module = importlib.import_module(package)
    except ImportError as error:
        if isinstance(error.__cause__, KeyboardInterrupt):  # what native code makes of Ctrl-C
            raise error.__cause__ from None
        if isinstance(error, ModuleNotFoundError) and error.name and error.name.partition(".")[0] == name:
            raise MissingExtraError(name, extra, purpose) from None
        raise MissingExtraError(name, extra, purpose, fails=" ".join(str(error).split())) from None
    installed, least = str(getattr(sys.modules[name], "__version__", "")), least_versions().get(name, "")
    if is_older(installed, least):
        raise MissingExtraError(name, extra, purpose, installed, least)
    return module


def is_older(installed: str, least: str) -> bool:
    """Whether a version is older than the least one; one that is not known (empty, `0+unknown`) is not."""
    ours, wanted = ((*map(int, re.findall(r"\d+", version)[:3]), 0, 0, 0)[:3] for version in (installed, least))
    return any(ours) and ours < wanted


#: What is imported under another name than it is installed by.
_IMPORTED_AS = {"scikit-learn": "sklearn", "xgboost-cpu": "xgboost"}


class Requirement(NamedTuple):
    """A package that st-codegen needs, the least version of it ("": any), and the extra ("": always) that needs it."""

    package: str
    least: str
    extra: str


def requirements() -> list[Requirement]:
    """What the installed st-codegen says it needs. Raises PackageNotFoundError where it is on the path only."""
    from importlib import metadata

    found = []
    for text in metadata.requires("st-codegen") or []:
        package = re.match(r"([\w.-]+)(?:>=([\d.]+))?", text)
        extra = re.search(r"extra\s*==\s*['\"]([\w-]+)['\"]", text)
        if package is not None and package[1] != "st-codegen":
            found.append(Requirement(package[1], package[2] or "", extra[1] if extra else ""))
    return found


@cache
def least_versions() -> dict[str, str]:
    """The least version of each package that has one, by the name that is imported; none where nothing is required."""
    try:
        return {_IMPORTED_AS.get(one.package, one.package): one.least for one in requirements() if one.least}
    except ImportError:
        return {}


class TargetError(InputError):
    """A model is valid but the chosen target cannot hold it."""


class GeneratedCodeError(StCodegenError):
    """Generated files are missing, changed by hand, or left by an interrupted run."""


class DefectError(Exception):
    """What st-codegen made is wrong: nothing that a user did. The command line ends with exit code 70."""


class Problems:
    """Collects input errors and raises them as one.

    >>> problems = Problems("bundle.toml")
    >>> with problems.collect():
    ...     raise InputError("no [bundle] table")
    >>> problems.add("feature 'speed': no unit")
    >>> problems.raise_if_any()
    Traceback (most recent call last):
    ...
    st_codegen.errors.InputError: bundle.toml: 2 problems
      - no [bundle] table
      - feature 'speed': no unit
    """

    def __init__(self, subject: str = "") -> None:
        self.subject = subject  # empty: whoever catches the error puts one in front
        self.errors: list[InputError] = []

    def add(self, message: str) -> None:
        """Note a problem and go on."""
        self.errors.append(InputError(message))

    def collect(self, where: str = "") -> _Collector:
        """A context in which an `InputError` is noted instead of raised, with `where` in front of it if given."""
        return _Collector(self, where)

    def raise_if_any(self) -> None:
        """Raise all that was noted as one error; what was noted twice is said once.

        Raises the single error unchanged (with its own class) when there is just one that already names the subject.
        Several errors are raised as UnsupportedModelError when all of them are, otherwise as InputError.
        """
        if not self.errors:
            return
        self.errors = list({str(error): error for error in self.errors}.values())
        if len(self.errors) == 1:
            only = self.errors[0]
            text = str(only)
            if text.startswith(self.subject):
                raise only
            file = PurePath(self.subject).name
            if file and text.startswith(f"{file}: "):  # the subject is the file that the message names
                raise _with_text(only, self.subject + text.removeprefix(file))
            raise with_subject(only, self.subject)
        shown = _grouped([str(error) for error in self.errors])
        lines = "\n".join(f"  - {text}".replace("\n", "\n  ") for text in shown[:MOST_SHOWN])
        if len(shown) > MOST_SHOWN:
            lines += f"\n  - and {len(shown) - MOST_SHOWN} more"
        unsupported = all(isinstance(error, UnsupportedModelError) for error in self.errors)
        kind = UnsupportedModelError if unsupported else InputError
        together = kind(f"{self.subject}{': ' if self.subject else ''}{len(self.errors)} problems\n{lines}")
        together._codes = tuple(dict.fromkeys(code for error in self.errors for code in error.codes))
        raise together


def _grouped(messages: list[str]) -> list[str]:
    """The messages, those that say the same together.

    What several files have alike is one line with their names; of many messages that differ in quoted names and numbers
    alone, the first with the count of the others is left.
    """
    messages, files = _by_file(messages)
    kinds = [re.sub(r"'[^']*'|\d+", "*", message) for message in messages]
    counts, all_of_kind = Counter(kinds), Counter[str]()
    for kind, number in zip(kinds, files, strict=True):
        all_of_kind[kind] += number
    shown: dict[tuple[str, int], str] = {}
    for number, (kind, message) in enumerate(zip(kinds, messages, strict=True)):
        if counts[kind] <= _MANY_ALIKE:
            shown[kind, number] = message
        elif (kind, 0) not in shown:
            others = f"; and {all_of_kind[kind] - files[number]} more that differ in names and numbers only"
            shown[kind, 0] = message + others + _subjects(kind, kinds, messages)
    return list(shown.values())


def _by_file(messages: list[str]) -> tuple[list[str], list[int]]:
    """The messages, where those that say the same of several files name the files and are said once; of how many."""
    alike: dict[tuple[bool, str], list[str]] = {}
    for message in messages:
        subject, _, said = message.partition(": ")
        is_file = bool(said and PurePath(subject).suffix) and not any(mark in subject for mark in ("\n", ", ", "'"))
        alike.setdefault((is_file, said if is_file else message), []).append(subject)
    return (
        [f"{_listed(files)}: {said}" if is_file else said for (is_file, said), files in alike.items()],
        [len(files) for files in alike.values()],
    )


def _listed(names: list[str]) -> str:
    """Names in a row: all of few, of many the first and how many more there are."""
    if len(names) > _MANY_ALIKE + 1:
        return f"{', '.join(names[:_MANY_ALIKE])} and {len(names) - _MANY_ALIKE} more"
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _subjects(kind: str, kinds: list[str], messages: list[str]) -> str:
    """What the other messages of a kind are about, such as files, where each has a name of its own in front."""
    subjects = [message.partition(": ")[0] for other, message in zip(kinds, messages, strict=True) if other == kind]
    others = subjects[1:]
    if len(set(subjects)) < len(subjects) or any(" " in subject for subject in others):
        return ""
    more = ", .." if len(others) > _MANY_ALIKE else ""
    return f" ({', '.join(others[:_MANY_ALIKE])}{more})"


class _Collector:
    """Notes the InputError of a `with` block, and lets the program go on behind it."""

    def __init__(self, problems: Problems, where: str) -> None:
        self.problems = problems
        self.where = where

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        if isinstance(error, InputError):
            self.problems.errors.append(with_subject(error, self.where) if self.where else error)
            return True
        return False


def with_subject(error: InputError, subject: str) -> InputError:
    """An error of the same class with the subject in front; a missing extra concerns no file and stays as it is."""
    if isinstance(error, MissingExtraError):
        return error
    return _with_text(error, f"{subject}: {error}")


def _with_text(error: InputError, text: str) -> InputError:
    """An error of the same class and code that says something else."""
    named = type(error).__new__(type(error))  # classes have constructors of their own
    named.__dict__.update(error.__dict__)
    named.args = (text,)
    return named


@contextmanager
def errors_name(subject: str) -> Iterator[None]:
    """Put the file or class that is read in front of the message of any InputError in a block."""
    try:
        yield
    except InputError as error:
        raise with_subject(error, subject) from None
