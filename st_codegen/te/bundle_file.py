"""`bundle.toml`: what the models of a transmission error (TE) bundle are for.

[bundle]
name = "rv160n"
reduction_ratio = 81.0
speed_feature = "speed_rpm"          # holds the input speed in rpm
directions = ["forward", "backward"]
orders = [0, 1, 39]
tasks = 1                            # 2: models in a slow task, harmonic sum and correction in a fast one

[[feature]]                          # in the order in which the models take them
name = "speed_rpm"
unit = "rpm"
min = 100.0
max = 1800.0

[[harmonic]]                         # one for each order and direction
direction = "forward"
order = 1
amplitude = "A1_forward.txt"         # deg; order 0: the signed mean, and no phase
phase = "phi1_forward.txt"           # rad

[[harmonic]]
direction = "forward"
order = 39
cosine = {file = "parts39_forward.onnx", output = 0}     # A*cos(phi), deg
sine = {file = "parts39_forward.onnx", output = 1}       # A*sin(phi), deg

[[term]]                             # added to the harmonic of its order and direction; as many as needed
direction = "forward"
order = 39
cosine = {file = "structural_resonance_forward.onnx", output = 0}     # deg; order 0: amplitude, the mean
sine = {file = "structural_resonance_forward.onnx", output = 1}
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from st_codegen.emit.literals import identifier
from st_codegen.errors import InputError, Problems
from st_codegen.ir import Direction, Feature, Quantity

BUNDLE_FILE = "bundle.toml"


@dataclass(frozen=True)
class Reference:
    """A model named in a [[harmonic]] or [[term]] (`added`) table: `file`, or `{file, output}`."""

    direction: Direction
    order: int
    quantity: Quantity
    file: str
    output: int
    added: bool = False


@dataclass(frozen=True)
class Description:
    """The checked contents of a `bundle.toml`; `references` in the order of directions and orders."""

    name: str
    reduction_ratio: float
    speed_feature: int
    directions: tuple[Direction, ...]
    orders: tuple[int, ...]
    features: tuple[Feature, ...]
    references: tuple[Reference, ...]
    tasks: int = 1


def read_description(path: Path) -> Description:
    """Read a `bundle.toml`. Raises one InputError that lists every problem."""
    try:
        text = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not readable as TOML ({error})") from None
    problems = Problems(str(path))
    description = _Reader(text, problems).description()
    problems.raise_if_any()
    return description


class _Reader:
    """Reads bundle.toml; whatever is wrong is collected."""

    def __init__(self, text: dict[str, Any], problems: Problems) -> None:
        self.text = text
        self.problems = problems
        for key in sorted(set(text) - {"bundle", "feature", "harmonic", "term"}):
            problems.add(f"unknown table [{key}]; known are [bundle], [[feature]], [[harmonic]] and [[term]]")

    def _value(self, table: dict[str, Any], key: str, kind: type | tuple[type, ...], where: str) -> Any:
        value = table.get(key)
        if value is None:
            self.problems.add(f"{where}: '{key}' is missing")
        elif not isinstance(value, kind) or isinstance(value, bool):
            self.problems.add(f"{where}: '{key}' is {value!r}, which has the wrong type")
            value = None
        return value

    def _unknown(self, table: dict[str, Any], known: set[str], where: str) -> None:
        for key in sorted(set(table) - known):
            self.problems.add(f"{where}: unknown key '{key}'; known are {', '.join(sorted(known))}")

    def _tables(self, key: str, *, silent: bool = False) -> list[dict[str, Any]]:
        tables = self.text.get(key, [])
        if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables) or not tables:
            if not silent:
                self.problems.add(f"[[{key}]] is missing: one table for each {key}")
            return []
        return tables

    def description(self) -> Description:
        features = self._features()
        # a feature with another fault still counts as named
        head = self._head([table.get("name", "") for table in self._tables("feature", silent=True)])
        references = self._references(head["orders"], head["directions"])
        references += self._terms(head["orders"], head["directions"])
        _check_files(references, self.problems)
        return Description(features=features, references=tuple(references), **head)

    def _features(self) -> tuple[Feature, ...]:
        features: list[Feature] = []
        for number, table in enumerate(self._tables("feature"), 1):
            where = f"[[feature]] {number}"
            self._unknown(table, {"name", "unit", "min", "max"}, where)
            name = self._value(table, "name", str, where)
            unit = self._value(table, "unit", str, where)
            lower = self._value(table, "min", (int, float), where)
            upper = self._value(table, "max", (int, float), where)
            if None in (name, unit, lower, upper):
                continue
            with self.problems.collect():
                identifier(name, "feature name")
                if name in [feature.name for feature in features]:
                    raise InputError(f"{where}: the name '{name}' is used twice")
                features.append(Feature(name, unit, float(lower), float(upper)))
        return tuple(features)

    def _head(self, features: Sequence[str]) -> dict[str, Any]:
        table = self.text.get("bundle", {})
        where = "[bundle]"
        known = {"name", "reduction_ratio", "speed_feature", "directions", "orders", "tasks", "description"}
        self._unknown(table, known, where)
        tasks = table.get("tasks", 1)
        if isinstance(tasks, bool) or tasks not in (1, 2):
            self.problems.add(f"{where}: tasks = {tasks!r}; give 1, or 2 for models in a slow task of their own")
            tasks = 1
        name = self._value(table, "name", str, where)
        with self.problems.collect():
            identifier(name or "bundle", "bundle name")
        ratio = self._value(table, "reduction_ratio", (int, float), where)
        if ratio is not None and not 0 < ratio < 1e6:
            self.problems.add(f"{where}: reduction_ratio = {ratio} is not a positive number")
        speed = self._value(table, "speed_feature", str, where)
        if speed is not None and speed not in features:
            self.problems.add(f"{where}: speed_feature = '{speed}' is none of the features ({', '.join(features)})")
        orders = self._value(table, "orders", list, where) or []
        if not all(isinstance(order, int) and not isinstance(order, bool) and 0 <= order < 10**6 for order in orders):
            self.problems.add(f"{where}: orders = {orders} are not whole numbers from 0")
        if len(set(map(str, orders))) != len(orders):
            self.problems.add(f"{where}: orders = {orders} names an order twice")
        directions = []
        for text in self._value(table, "directions", list, where) or []:
            try:
                directions.append(Direction(text))
            except ValueError:
                self.problems.add(f"{where}: direction {text!r}; known are {', '.join(Direction)}")
        return {
            "name": name or "",
            "reduction_ratio": float(ratio or 1.0),
            "speed_feature": features.index(speed) if speed in features else 0,
            "orders": tuple(orders),
            "directions": tuple(dict.fromkeys(directions)),
            "tasks": tasks,
        }

    def _references(self, orders: Sequence[int], directions: Sequence[Direction]) -> list[Reference]:
        """All model references, in the order of directions and orders; every harmonic must be complete."""
        found: dict[tuple[str, int], list[Reference]] = {}
        for number, table in enumerate(self._tables("harmonic"), 1):
            where = f"[[harmonic]] {number}"
            self._unknown(table, {"direction", "order", *Quantity}, where)
            direction = self._value(table, "direction", str, where)
            order = self._value(table, "order", int, where)
            if direction is None or order is None:
                continue
            if direction not in directions or order not in orders:
                self.problems.add(f"{where}: order {order} {direction} is not announced in [bundle]")
                continue
            if (direction, order) in found:
                self.problems.add(f"{where}: order {order} {direction} is given twice")
                continue
            found[direction, order] = self._harmonic(table, Direction(direction), order, where)
        missing = [f"order {o} {d}" for d in directions for o in orders if (d, o) not in found]
        if missing:
            self.problems.add(f"harmonics announced in [bundle] without a [[harmonic]] table: {', '.join(missing)}")
        return [reference for d in directions for o in orders for reference in found.get((d, o), [])]

    def _terms(self, orders: Sequence[int], directions: Sequence[Direction]) -> list[Reference]:
        """What is added to harmonics, in the order of the file."""
        found: list[Reference] = []
        if "term" not in self.text:
            return found
        for number, table in enumerate(self._tables("term"), 1):
            where = f"[[term]] {number}"
            self._unknown(table, {"direction", "order", *_complete(0)[0], *_complete(1)[-1]}, where)
            direction = self._value(table, "direction", str, where)
            order = self._value(table, "order", int, where)
            if direction is None or order is None:
                continue
            if direction not in directions or order not in orders:
                self.problems.add(f"{where}: there is no harmonic of order {order} {direction} to add to")
                continue
            found += self._harmonic(table, Direction(direction), order, where, added=True)
        return found

    def _harmonic(
        self, table: dict[str, Any], direction: Direction, order: int, where: str, *, added: bool = False
    ) -> list[Reference]:
        given = {quantity for quantity in Quantity if quantity in table}
        complete = _complete(order)[-1:] if added else _complete(order)
        if given not in complete:
            wanted = " or ".join(" and ".join(sorted(pair)) for pair in complete)
            self.problems.add(f"{where}: order {order} needs {wanted}, it has {' and '.join(sorted(given)) or 'none'}")
            return []
        references = []
        for quantity in sorted(given):
            value = table[quantity]
            file, output = (value.get("file"), value.get("output", 0)) if isinstance(value, dict) else (value, 0)
            if not isinstance(file, str) or not isinstance(output, int) or isinstance(output, bool):
                self.problems.add(f"{where}: {quantity} = {value!r}; give a file name, or {{file = .., output = ..}}")
                continue
            references.append(Reference(direction, order, quantity, file, output, added))
        return references


def _complete(order: int) -> list[set[Quantity]]:
    """What says all about a harmonic; the last can be added to another."""
    if order == 0:
        return [{Quantity.AMPLITUDE}]
    return [{Quantity.AMPLITUDE, Quantity.PHASE}, {Quantity.COSINE, Quantity.SINE}]


def _check_files(references: Sequence[Reference], problems: Problems) -> None:
    """A file is named by its stem, and stands in the bundle's folder."""
    files: dict[str, str] = {}
    for reference in references:
        if Path(reference.file).name != reference.file:
            problems.add(f"file '{reference.file}': model files stand beside {BUNDLE_FILE}, without a path")
        stem = Path(reference.file).stem
        if files.setdefault(stem, reference.file) != reference.file:
            problems.add(f"'{files[stem]}' and '{reference.file}' give two models of the name {stem}")
