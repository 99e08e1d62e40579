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
min = 100.0                          # where max is the same, the models know that one value
max = 1800.0

[play]                               # optional, with order 0 and both directions: FB_Compensator takes the load's sign
angle_deg = 0.0084                   # mean backward less mean forward, without load
torque_feature = "torque_Nm"         # holds the magnitude of the load

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
factor = 1.03                        # optional, where the models are those of several axes: what this axis has of them
turn_rad = -0.02                     # added to the phase; order 0: offset_deg, added to the mean

[[term]]                             # added to the harmonic of its order and direction; as many as needed
direction = "forward"
order = 39
cosine = {file = "structural_resonance_forward.onnx", output = 0}     # deg; order 0: amplitude, the mean
sine = {file = "structural_resonance_forward.onnx", output = 1}
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from st_codegen.emit.literals import identifier
from st_codegen.errors import InputError, Problems
from st_codegen.files.toml_tables import TomlTable, read_toml, shown
from st_codegen.ir import Feature
from st_codegen.te.harmonics import AxisCorrection, Direction, HarmonicOutput, Play, Quantity, TransmissionError

BUNDLE_FILE = "bundle.toml"
#: A play beyond this is no play of a gear, deg at the output.
LARGEST_PLAY = 10.0
#: No axis has more than this of what others of its type have, and none is turned by more.
LARGEST_FACTOR, LARGEST_TURN_RAD, LARGEST_OFFSET_DEG = 100.0, 6.3, 360.0


def read_description(path: Path) -> TransmissionError:
    """What a `bundle.toml` describes; its outputs name files in place of models.

    Raises one InputError that lists every problem.
    """
    problems = Problems(str(path))
    with TomlTable(read_toml(path), "", problems) as file:
        described = _described(file)
    problems.raise_if_any()
    return TransmissionError(**described)


def _described(file: TomlTable) -> dict[str, Any]:
    """The parts of a TransmissionError; what is wrong with them is noted."""
    with file.table("bundle", required=True) as bundle:
        name = bundle.text("name")
        bundle.text("description", "")
        if name:
            with bundle.collect():
                identifier(name, "bundle name")
        ratio = bundle.number("reduction_ratio", low=1e-6, high=1e6)
        speed = bundle.text("speed_feature")
        directions = bundle.list_of("directions", lambda key, entry: bundle.choice_of(key, entry, Direction))
        orders = bundle.list_of("orders", bundle.whole_of)
        if len(set(orders)) != len(orders):
            bundle.note(f"orders = {list(orders)} names an order twice")
        tasks = bundle.whole("tasks", 1, low=1, high=2)
    directions = tuple(dict.fromkeys(directions))
    features = _features(file)
    # a feature with another fault still counts as named
    named = [str(table.values.get("name", "")) for table in TomlTable(file.values, "", Problems("")).tables("feature")]
    if speed and speed not in named:
        bundle.note(f"speed_feature = '{speed}' is none of the features ({', '.join(named)})")
    harmonics, corrections = _harmonics(file, orders, directions)
    outputs = harmonics + _terms(file, orders, directions)
    _check_files(outputs, file.problems)
    return {
        "name": name,
        "features": features,
        "speed_feature": named.index(speed) if speed in named else 0,
        "reduction_ratio": ratio,
        "orders": orders,
        "directions": directions,
        "outputs": outputs,
        "tasks": tasks,
        "play": _play(file, named, speed, orders, directions) if "play" in file else None,
        "corrections": corrections,
    }


def _play(
    file: TomlTable, named: Sequence[str], speed: str, orders: Sequence[int], directions: Sequence[Direction]
) -> Play | None:
    """The table [play]; what is wrong with it is noted."""
    with file.table("play") as table:
        angle = table.number("angle_deg", low=0.0, high=LARGEST_PLAY, unit="deg")
        torque = table.text("torque_feature")
        if table.is_sound and (torque not in named or torque == speed):
            others = ", ".join(name for name in named if name != speed)
            table.note(f"torque_feature = '{torque}' is none of the features beside the speed ({others})")
        if table.is_sound and not (0 in orders and len(directions) == 2):
            table.note("a play needs the mean, order 0, of both directions")
    return Play(angle, named.index(torque)) if table.is_sound else None


def _features(file: TomlTable) -> tuple[Feature, ...]:
    features: dict[str, Feature] = {}
    for table in file.tables("feature", required=True):
        with table:
            name, unit = table.text("name"), table.text("unit")
            lower, upper = table.number("min"), table.number("max")
        if not table.is_sound:
            continue
        with table.collect():
            identifier(name, "feature name", "f")
            if name in features:
                raise InputError(f"the name '{name}' is used twice")
            features[name] = Feature(name, unit, lower, upper)
    return tuple(features.values())


def _harmonics(
    file: TomlTable, orders: Sequence[int], directions: Sequence[Direction]
) -> tuple[tuple[HarmonicOutput, ...], tuple[AxisCorrection, ...]]:
    """The references of all [[harmonic]] tables, in the order of directions and orders; each must be complete.

    With the corrections of those that have one.
    """
    found: dict[tuple[Direction, int], tuple[HarmonicOutput, ...]] = {}
    corrections: list[AxisCorrection] = []
    for table in file.tables("harmonic", required=True):
        with table:
            direction, order = _direction_and_order(table)
            announced = direction in directions and order in orders
            if table.is_sound and not announced:
                table.note(f"order {order} {direction} is not announced in [bundle]")
            if table.is_sound and (direction, order) in found:
                table.note(f"order {order} {direction} is given twice")
            references = _references(table, direction, order, tuple(Quantity), _complete(order))
            corrections += _correction(table, direction, order)
        found.setdefault((direction, order), references)
    missing = [f"order {o} {d}" for d in directions for o in orders if (d, o) not in found]
    if missing:
        file.note(f"harmonics announced in [bundle] without a [[harmonic]] table: {', '.join(missing)}")
    references = tuple(reference for d in directions for o in orders for reference in found.get((d, o), ()))
    return references, tuple(corrections)


def _correction(table: TomlTable, direction: Direction, order: int) -> list[AxisCorrection]:
    """What the axis has of a harmonic; none where the table says nothing of it."""
    key, limit, unit = ("turn_rad", LARGEST_TURN_RAD, "rad") if order else ("offset_deg", LARGEST_OFFSET_DEG, "deg")
    if "factor" not in table and key not in table:
        table.declare("factor", key)
        return []
    factor = table.number("factor", 1.0, low=0.0, high=LARGEST_FACTOR)
    return [
        AxisCorrection(direction, order, factor, **{key: table.number(key, 0.0, low=-limit, high=limit, unit=unit)})
    ]


def _terms(file: TomlTable, orders: Sequence[int], directions: Sequence[Direction]) -> tuple[HarmonicOutput, ...]:
    """The references of all [[term]] tables, in the order of the file."""
    found: tuple[HarmonicOutput, ...] = ()
    for table in file.tables("term"):
        with table:
            direction, order = _direction_and_order(table)
            if table.is_sound and (direction not in directions or order not in orders):
                table.note(f"there is no harmonic of order {order} {direction} to add to")
            known = (Quantity.AMPLITUDE, Quantity.COSINE, Quantity.SINE)
            found += _references(table, direction, order, known, _complete(order)[-1:], added=True)
    return found


def _direction_and_order(table: TomlTable) -> tuple[Direction, int]:
    """What a table is about; forward and order 0 stand in for what is missing or wrong."""
    return table.choice("direction", Direction) or Direction.FORWARD, table.whole("order")


def _references(
    table: TomlTable,
    direction: Direction,
    order: int,
    known: Sequence[Quantity],
    complete: Sequence[set[Quantity]],
    *,
    added: bool = False,
) -> tuple[HarmonicOutput, ...]:
    """The models that a table names; `complete`: the sets of quantities of which it must have one."""
    files = {quantity: _file(table, quantity) for quantity in known if quantity in table}
    table.declare(*known)
    if set(files) not in complete and table.is_sound:
        wanted = " or ".join(" and ".join(sorted(pair)) for pair in complete)
        table.note(f"order {order} needs {wanted}, it has {' and '.join(sorted(files)) or 'none'}")
    return tuple(
        HarmonicOutput(direction, order, quantity, file, output, added)
        for quantity, (file, output) in sorted(files.items())
    )


def _file(table: TomlTable, quantity: Quantity) -> tuple[str, int]:
    """The file and the output of a quantity, written as a file name or as `{file = .., output = ..}`."""
    value = table.values[quantity]
    if isinstance(value, str):
        return value, 0
    if not isinstance(value, dict):
        table.note(f"{quantity} = {shown(value)}; give a file name, or {{file = .., output = ..}}")
        return "", 0
    with table.table(quantity) as inline:
        return inline.text("file"), inline.whole("output", 0)


def _complete(order: int) -> list[set[Quantity]]:
    """What says all about a harmonic; the last can be added to another."""
    if order == 0:
        return [{Quantity.AMPLITUDE}]
    return [{Quantity.AMPLITUDE, Quantity.PHASE}, {Quantity.COSINE, Quantity.SINE}]


def _check_files(references: Sequence[HarmonicOutput], problems: Problems) -> None:
    """A file is named by its stem, and stands in the bundle's folder."""
    files: dict[str, str] = {}
    for reference in references:
        file = reference.model
        if Path(file).name != file:
            problems.add(f"file '{file}': model files stand beside {BUNDLE_FILE}, without a path")
        stem = Path(file).stem
        if files.setdefault(stem, file) != file:
            problems.add(f"'{files[stem]}' and '{file}' give two models of the name {stem}")
