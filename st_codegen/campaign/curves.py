"""Curve files: the transmission error (TE) over one revolution of the output shaft, as the rig writes it.

A file is one run at constant conditions and has four columns: angle and TE forward, angle and TE backward, in deg.
Forward angles run from 0 up to 360, backward angles from 360 down to 0. Samples are equidistant in time. The rig's
own header has a typing error; it is read with it, corrected, or absent. Separators `,`, `;` or
tabs, decimal point or comma.

The conditions stand in the file name (`Test_25degree/1000rpm/1000.0rpm1100.0Nm25.0deg.csv`) or in a file
`conditions.csv` (`file,speed_rpm,torque_Nm,temperature_C`) at the top of the campaign's folder.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.campaign.conditions import CONDITION_COLUMNS, OperatingPoint
from st_codegen.errors import InputError, counted, extra_package
from st_codegen.files.csv_tables import RowError, csv_files, read_csv, separator_of, told_separator
from st_codegen.files.number_text import parse_number
from st_codegen.files.text import encoding_fault, whole_file
from st_codegen.ir.arrays import FloatArray
from st_codegen.te.harmonics import Direction

#: the header of the rig, with its typing error
RIG_HEADER = (
    "Poisition_Output_Reducer_Fw",
    "Transmission_Error_Fw",
    "Position_Output_Reducer_Bw",
    "Transmission_Error_Bw",
)
CONDITIONS_FILE = "conditions.csv"
_POLARS = ("polars", "train", "reading and writing curve files")
#: name of a column as it is compared (lower case) -> its number; the last is the corrected header
_COLUMNS = {name.lower(): place for place, name in enumerate(RIG_HEADER)} | {"position_output_reducer_fw": 0}
_NUMBER = r"(-?\d+(?:[.,]\d+)?)"
_NAME = re.compile(rf"{_NUMBER}rpm_?{_NUMBER}Nm_?{_NUMBER}deg(?:C|ree)?.*", re.IGNORECASE)
#: a curve must cover this part of a revolution (deg): an order needs whole periods to be told from its neighbours
_LEAST_SPAN_DEG = 350.0
#: and no larger part may be without a sample
MOST_GAP_DEG = 360.0 - _LEAST_SPAN_DEG
_LEAST_SAMPLES = 100


@dataclass(frozen=True)
class Curve:
    """One revolution in one direction: angle of the output shaft and TE, both deg, float64 (n,), in order of time."""

    angle_deg: FloatArray
    te_deg: FloatArray


@dataclass(frozen=True)
class Run:
    """One file: conditions, and one curve a direction."""

    conditions: OperatingPoint
    curves: Mapping[Direction, Curve]


@dataclass(frozen=True)
class RunFile:
    """A curve file and its conditions."""

    path: Path
    conditions: OperatingPoint


class BadFileError(InputError):
    """A curve file that cannot be used: which, why, and in which line (None where it is the file as a whole)."""

    def __init__(self, path: Path, line: int | None, reason: str) -> None:
        super().__init__(f"{path}: {reason}" if line is None else f"{path}, line {line}: {reason}")
        self.path, self.line, self.reason = path, line, reason

    def __reduce__(self) -> tuple[Any, ...]:
        return (type(self), (self.path, self.line, self.reason), self.__dict__)


def conditions_from_name(path: Path) -> OperatingPoint | None:
    """The conditions that a file name states, or None."""
    found = _NAME.fullmatch(path.stem)
    return OperatingPoint(*(float(number.replace(",", ".")) for number in found.groups())) if found else None


def run_paths(points: Sequence[OperatingPoint]) -> list[str]:
    """Where the files of runs stand below a campaign's folder: by the rig's names, or numbered.

    Numbered files, which need a `conditions.csv` beside them, where runs repeat, or where a name would not be read as
    its conditions again (`1e+16rpm`).
    """
    paths = [point.rig_path() for point in points]
    readable = all(conditions_from_name(path) == point for path, point in zip(paths, points, strict=True))
    if readable and len(set(points)) == len(points):
        return [path.as_posix() for path in paths]
    return [f"run_{number:05d}.csv" for number in range(1, len(points) + 1)]


def scan(folder: Path) -> tuple[tuple[RunFile, ...], tuple[BadFileError, ...]]:
    """The curve files below a folder that have conditions, and what is wrong with the others.

    A file named in `conditions.csv` has the conditions given there, whatever its name says. Raises InputError where
    there is no folder or no file at all.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    listed, bad = _listed(folder / CONDITIONS_FILE)
    files = []
    for path in csv_files(folder, below=True):
        if path.name.lower() == CONDITIONS_FILE or any(part.startswith(".") for part in path.relative_to(folder).parts):
            continue
        conditions = listed.get(path) or conditions_from_name(path)
        if conditions is None:
            reason = "no conditions that can be read, in {} or as 1000rpm100Nm25deg in its name"
            bad.append(BadFileError(path, None, reason.format(CONDITIONS_FILE)))
        else:
            files.append(RunFile(path, conditions))
    if not files and not bad:
        raise InputError(f"{folder}: no curve files (*.csv)")
    return tuple(sorted(files, key=lambda file: (file.conditions, file.path))), tuple(bad)


def _listed(path: Path) -> tuple[dict[Path, OperatingPoint], list[BadFileError]]:
    """What a `conditions.csv` says of the files beside and below it."""
    listed: dict[Path, OperatingPoint] = {}
    bad: list[BadFileError] = []
    if not path.is_file():
        return listed, bad
    try:
        table = read_csv(path, ("file", *CONDITION_COLUMNS))
    except InputError as error:
        return listed, [BadFileError(path, None, str(error).removeprefix(f"{path}: "))]
    for row in table.rows:
        try:
            name = table.text(row, "file")
            numbers = [table.number(row, column) for column in CONDITION_COLUMNS]
        except RowError as error:
            bad.append(BadFileError(path, error.line, error.reason))
            continue
        target = path.parent / name
        if "\0" in name or not target.is_file():
            bad.append(BadFileError(path, row.line, f"there is no file '{name}'"))
        elif target in listed:
            bad.append(BadFileError(path, row.line, f"the file '{name}' is there twice"))
        else:
            listed[target] = OperatingPoint(*numbers)
    return listed, bad


@dataclass(frozen=True)
class _Layout:
    """How a curve file is written: numbers of the four columns, lines above the first row, separators."""

    columns: tuple[int | None, ...]
    skip: int
    separator: str
    decimal_comma: bool


def read_run(path: Path, conditions: OperatingPoint) -> Run:
    """Read one curve file. Memory: the file's numbers, 32 bytes a sample.

    Raises BadFileError with the line and the reason: not text, a value that is not a finite number, a missing column,
    too few samples, less than a revolution or gaps in it, a direction that runs the wrong way.
    """
    layout = _layout(path)
    table = _table(path, layout)
    curves = {}
    for number, direction in enumerate(Direction):
        angle_column, te_column = layout.columns[2 * number : 2 * number + 2]
        if angle_column is None or te_column is None:
            continue
        angle, te = table[angle_column], table[te_column]
        if len(angle) and angle.null_count() == te.null_count() == len(angle):
            continue  # the direction was not run: its columns are empty
        curves[direction] = _curve(path, layout, direction, angle, te)
    if not curves:
        raise BadFileError(path, layout.skip + 1, "no values in any column")
    return Run(conditions, curves)


def _layout(path: Path) -> _Layout:
    try:
        with path.open(encoding="utf-8-sig") as file:
            # the tabs at an end are the cells of a direction that was not run
            first, second = file.readline().strip(" \r\n"), file.readline().strip(" \r\n")
            if told := told_separator(first):
                first, second = second, file.readline().strip(" \r\n")
            if file.newlines == "\r":
                raise BadFileError(path, None, "lines end in CR alone, as in 'CSV (Macintosh)'; save it as plain CSV")
    except UnicodeDecodeError:
        raise BadFileError(path, None, encoding_fault(path.read_bytes())) from None
    except OSError as error:
        raise BadFileError(path, None, f"cannot be read ({error.strerror or error})") from None
    if not first:
        raise BadFileError(path, 1, "the file is empty")
    separator = told or separator_of(first)
    names = [name.lower() for name in _cells(first, separator)]
    has_header = any(name in _COLUMNS for name in names) or not any(_is_number(name) for name in names)
    sample = _cells(second if has_header else first, separator)
    columns = _header_columns(path, names) if has_header else _plain_columns(path, names)
    return _Layout(columns, bool(told) + has_header, separator, any("," in cell for cell in sample))


def _cells(line: str, separator: str) -> list[str]:
    """The values of a line; a quoted one may hold the separator."""
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def _header_columns(path: Path, names: Sequence[str]) -> tuple[int | None, ...]:
    found: list[int | None] = [None] * 4
    for column, name in enumerate(names):
        if name not in _COLUMNS:
            raise BadFileError(path, 1, f"unknown column '{name}'; the header is {','.join(RIG_HEADER)}")
        if found[_COLUMNS[name]] is not None:
            raise BadFileError(path, 1, f"the column '{name}' is there twice")
        found[_COLUMNS[name]] = column
    for number in (0, 2):
        if (found[number] is None) != (found[number + 1] is None):
            raise BadFileError(path, 1, f"only one of {RIG_HEADER[number]} and {RIG_HEADER[number + 1]} is there")
    return tuple(found)


def _plain_columns(path: Path, names: Sequence[str]) -> tuple[int | None, ...]:
    if len(names) != len(RIG_HEADER):
        raise BadFileError(
            path, 1, f"{counted(len(names), 'column')} and no header; a curve file has {len(RIG_HEADER)}"
        )
    return tuple(range(len(RIG_HEADER)))


def _is_number(text: str) -> bool:
    try:
        parse_number(text, decimal_comma=True, is_finite=False)
    except ValueError:
        return False
    return True


def _table(path: Path, layout: _Layout) -> list[Any]:
    """The columns of a file, by number; empty cells are null."""
    pl = extra_package(*_POLARS)
    width = sum(column is not None for column in layout.columns)
    try:
        frame = pl.read_csv(
            path,
            has_header=False,
            skip_lines=layout.skip,
            separator=layout.separator,
            decimal_comma=layout.decimal_comma,
            glob=False,
            schema={f"c{number}": pl.Float64 for number in range(width)},
        )
    except (pl.exceptions.PolarsError, OSError) as error:
        raise _first_fault(path, layout, width, str(error)) from None
    return list(frame.get_columns())


def _first_fault(path: Path, layout: _Layout, width: int, otherwise: str) -> BadFileError:
    """Reads a file that Polars refuses line by line, to say where and why."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            for line, text in enumerate(file, 1):
                cells = _cells(text, layout.separator)
                if line <= layout.skip or cells in ([], [""]):
                    continue
                if len(cells) != width:
                    return BadFileError(path, line, f"{counted(len(cells), 'value')}, {width} are expected")
                for cell in cells:
                    if cell and not _is_number(cell):
                        return BadFileError(path, line, f"'{cell[:40]}' is not a number")
    except UnicodeDecodeError:
        return BadFileError(path, None, encoding_fault(path.read_bytes()))
    except OSError as error:
        return BadFileError(path, None, f"cannot be read ({error.strerror or error})")
    return BadFileError(path, None, f"not readable as a table ({otherwise.splitlines()[0]})")


def _curve(path: Path, layout: _Layout, direction: Direction, angle: Any, te: Any) -> Curve:
    """One direction's columns, checked. A shorter direction may end in empty cells."""
    arrays = []
    for column in (angle, te):
        values = column.to_numpy()
        arrays.append(values[: _end(values)] if column.null_count() else values)
    if len(arrays[0]) != len(arrays[1]):
        raise BadFileError(path, layout.skip + 1 + min(map(len, arrays)), f"{direction}: an empty cell beside a value")
    for array in arrays:
        if not np.isfinite(array).all():
            line = layout.skip + 1 + int(np.argmin(np.isfinite(array)))
            raise BadFileError(path, line, f"{direction}: an empty cell, or a value that is not finite")
    samples = len(arrays[0])
    if samples < _LEAST_SAMPLES:
        raise BadFileError(path, layout.skip + samples, f"{direction}: only {counted(samples, 'sample')}")
    span = float(np.ptp(arrays[0]))
    if span < _LEAST_SPAN_DEG:
        hint = "; it looks like rad, and must be deg" if 6.0 < span < 6.6 else ""
        raise BadFileError(path, layout.skip + samples, f"{direction}: the angle covers {span:.4g} deg of 360{hint}")
    if (gap := largest_gap(arrays[0])) > MOST_GAP_DEG:
        reason = f"{direction}: {gap:.4g} deg of the revolution are without a sample; were samples lost?"
        raise BadFileError(path, layout.skip + samples, reason)
    if _runs_down(arrays[0]) == (direction is Direction.FORWARD):
        # an angle that begins anew at 360 deg, as of a turn that starts elsewhere, ends below where it began
        arrays[0] = np.unwrap(arrays[0], period=360.0)
    if _runs_down(arrays[0]) == (direction is Direction.FORWARD):
        runs = "down" if direction is Direction.FORWARD else "up"
        raise BadFileError(path, layout.skip + 1, f"{direction}: the angle runs {runs}; are the directions exchanged?")
    return Curve(*arrays)


def _runs_down(angle_deg: FloatArray) -> bool:
    return bool(angle_deg[-1] < angle_deg[0])


def largest_gap(angle_deg: FloatArray) -> float:
    """The largest part of a revolution without a sample, deg; 0 where there is a sample in every 5 deg."""
    turned = np.mod(angle_deg, 360.0)
    if np.bincount((turned // 5.0).astype(np.int64), minlength=72)[:72].all():
        return 0.0
    ordered = np.sort(turned)
    return float(np.diff(ordered, append=ordered[0] + 360.0).max())


def _end(values: FloatArray) -> int:
    """Number of values up to the last one that is there."""
    there = np.flatnonzero(~np.isnan(values))
    return int(there[-1]) + 1 if len(there) else 0


def write_run(run: Run, path: Path, *, digits: int | None = None) -> None:
    """Write a run in the rig's own layout: its header, `,` and decimal points; the file appears complete or not at all.

    digits: decimals of a number, None for as many as give the same float64 again. A shorter direction ends in empty
    cells.
    """
    pl = extra_package(*_POLARS)
    columns = [array for direction in Direction for array in _arrays(run, direction)]
    longest = max(map(len, columns))
    padded = {
        name: pl.Series(array).extend_constant(None, longest - len(array))
        for name, array in zip(RIG_HEADER, columns, strict=True)
    }
    with whole_file(path) as partial:
        pl.DataFrame(padded).write_csv(partial, float_precision=digits)


def _arrays(run: Run, direction: Direction) -> tuple[FloatArray, FloatArray]:
    curve = run.curves.get(direction)
    if curve is None:
        return np.empty(0), np.empty(0)
    return np.asarray(curve.angle_deg, np.float64), np.asarray(curve.te_deg, np.float64)
