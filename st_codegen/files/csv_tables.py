"""CSV tables: a header of names above rows of texts and numbers.

Exports of other tools, with `;` or tabs between the cells and with decimal commas, are read as well: a semicolon, else
a tab, in the first line says so.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from st_codegen.errors import InputError, Problems, counted, meant
from st_codegen.files.number_text import parse_number
from st_codegen.files.text import read_text

#: A number with a decimal comma; one with a decimal point; and one that may have that, or digits in groups of three.
_WITH_COMMA = re.compile(r"\s*[+-]?[0-9]*,[0-9]+([eE][+-]?[0-9]+)?\s*")
_WITH_POINT = re.compile(r"\s*[+-]?(0*|[0-9]{4,})\.[0-9]+\s*|\s*[+-]?[0-9]*\.([0-9]{1,2}|[0-9]{4,})\s*")
_GROUPED = re.compile(r"[+-]?[1-9][0-9]{0,2}\.[0-9]{3}")
_FOR_EXCEL = re.compile(r'"?sep=([,;\t|])"?', re.IGNORECASE)
#: a comma that surely stands in front of decimals: another one may group thousands
_DECIMAL_COMMA = re.compile(r"(?!\s*[+-]?[1-9][0-9]{0,2},[0-9]{3}\s*$)" + _WITH_COMMA.pattern)


def csv_text(rows: Iterable[Iterable[object]]) -> str:
    """Rows of cells as the text of a file; None is empty."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


class RowError(InputError):
    """A row that cannot be used: its line, and why."""

    def __init__(self, line: int, reason: str) -> None:
        super().__init__(f"line {line}: {reason}")
        self.line, self.reason = line, reason


@dataclass(frozen=True)
class CsvRow:
    """A row of a table: its last line in the file, and its cells."""

    line: int
    cells: tuple[str, ...]


@dataclass(frozen=True)
class CsvTable:
    """The rows below a header. A row with more or fewer cells than the header is refused where it is asked for one.

    empty: the lines below the header that have cells with nothing in them; they are none of the rows.
    comma_line: one in which a number has a decimal comma; None where there is none. pointed: the columns in which a
    number has a decimal point for sure.
    """

    names: tuple[str, ...]
    rows: tuple[CsvRow, ...]
    decimal_comma: bool
    empty: tuple[int, ...] = ()
    comma_line: int | None = None
    pointed: frozenset[str] = frozenset()

    def text(self, row: CsvRow, name: str) -> str:
        """A cell, without the blanks around it. Raises RowError."""
        if len(row.cells) != len(self.names):
            raise RowError(row.line, f"{counted(len(row.cells), 'value')}, the header has {len(self.names)}")
        return row.cells[self.names.index(name)].strip()

    def number(self, row: CsvRow, name: str, *, is_finite: bool = True) -> float:
        """A cell as a number. Raises RowError."""
        cell = self.text(row, name)
        if not cell and not is_finite:
            raise RowError(row.line, f"{name}: '' is not a number; a missing one is written nan")
        if self.comma_line is not None and name not in self.pointed and _GROUPED.fullmatch(cell):
            raise RowError(
                row.line,
                f"{name}: '{cell}' is {cell.replace('.', '')} or {cell.replace('.', ',')}, since numbers have decimal "
                f"commas (line {self.comma_line}): write one of these",
            )
        try:
            return parse_number(cell, decimal_comma=self.decimal_comma, is_finite=is_finite)
        except ValueError as error:
            raise RowError(row.line, f"{name}: {_cut(str(error))}") from None

    def numbers(self, names: Sequence[str], problems: Problems, *, is_finite: bool = True) -> npt.NDArray[np.float64]:
        """Columns as float64 (rows, names); every cell that is no number is noted and stands as 0."""
        values = np.zeros((len(self.rows), len(names)))
        for number, row in enumerate(self.rows):
            for column, name in enumerate(names):
                with problems.collect():
                    values[number, column] = self.number(row, name, is_finite=is_finite)
        return values


def csv_files(folder: Path, *, below: bool = False) -> list[Path]:
    """The tables in a folder, or `below` it in folders as well, by their names: `.csv` in whatever case."""
    return sorted((folder.rglob if below else folder.glob)("*.[cC][sS][vV]"))


def read_csv(path: Path, wanted: Sequence[str] = ()) -> CsvTable:
    """Read a table; `wanted` are columns that must be there. Empty lines count as nothing.

    Raises InputError for what is no text, has no header, lacks a wanted column, or has the name of a column twice.
    """
    text = read_text(path)
    head, _, body = text.partition("\n")
    told = told_separator(head)
    text = f"\n{body}" if told else text  # lines keep their numbers
    separator = told or separator_of(text)
    lines = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    try:
        read = [CsvRow(lines.line_num, tuple(row)) for row in lines]
    except csv.Error as error:  # above all a field of more than 131,072 characters
        raise InputError(f"{path}, line {lines.line_num}: not readable as a table ({error})") from None
    rows = [row for row in read if any(cell.strip() for cell in row.cells)]
    if not rows:
        raise InputError(f"{path}: the file is empty; the first line must name the columns")
    empty = (row for row in read if len(row.cells) > 1 or row.cells == ("",))  # "" in quotes: a line has no cells
    names = tuple(name.strip() for name in rows[0].cells)
    problems = Problems(str(path))
    missing = [name for name in wanted if name not in names]
    if missing:
        is_one = len(missing) == 1
        which = f"the column '{missing[0]}' is" if is_one else f"the columns {', '.join(map(repr, missing))} are"
        near = meant_column(missing[0], names, wanted) if is_one else ""
        problems.add(f"{which} missing; the table needs {','.join(wanted)}{near}")
    for name in sorted({name for name in names if name and names.count(name) > 1}):
        problems.add(f"the column '{_cut(name)}' is there twice")
    problems.raise_if_any()
    below = {row.line for row in empty if row.line > rows[0].line} - {row.line for row in rows}
    # a comma in a column that nobody reads as numbers, as in a list or a note, says nothing of those that are
    of_numbers = [place for place, name in enumerate(names) if not wanted or name in wanted]
    # semicolons are there since commas stand in numbers; tabs are written with points as well
    is_comma = separator == ";" or (
        separator == "\t" and any(_some(_DECIMAL_COMMA, row, of_numbers) for row in rows[1:])
    )
    comma_line = next((row.line for row in rows[1:] if is_comma and _some(_WITH_COMMA, row, of_numbers)), None)
    pointed = [n for n in of_numbers if comma_line and any(_some(_WITH_POINT, row, [n]) for row in rows[1:])]
    with_point = frozenset(names[n] for n in pointed)
    return CsvTable(names, tuple(rows[1:]), is_comma, tuple(sorted(below)), comma_line, with_point)


def _some(pattern: re.Pattern[str], row: CsvRow, places: Sequence[int]) -> bool:
    return any(pattern.fullmatch(row.cells[place]) for place in places if place < len(row.cells))


def meant_column(name: str, columns: Iterable[str], read: Collection[str]) -> str:
    """The end of a message on a missing column: one that may be meant, or nothing.

    It is none that is read already, and none whose name ends in another unit (`temperature_K` for `temperature_C`).
    """
    unit = name.lower().rpartition("_")
    near = [one for one in columns if one not in read and (not unit[1] or one.lower().endswith(f"_{unit[2]}"))]
    return meant(name, map(_cut, near))


def with_underscores(columns: Mapping[str, npt.NDArray[np.float64]]) -> dict[str, npt.NDArray[np.float64]]:
    """Columns that are found also by the names that LightGBM makes of theirs: `oil temp` is `oil_temp` in its files.

    (`Dataset::set_feature_names`.) No name stands for a column where two columns would bear it, unless one bears it
    in the table.
    """
    made = [underscored(name) for name in columns]
    times = Counter(made)
    return {name: columns[own] for name, own in zip(made, columns, strict=True) if times[name] == 1} | dict(columns)


def underscored(name: str) -> str:
    """The name that LightGBM makes of that of a column."""
    return name.replace(" ", "_")


def header_of(path: Path) -> tuple[str, ...]:
    """The names in the first line of a file, without reading the rest; none where that line is no text.

    Raises InputError for a file that cannot be read.
    """
    try:
        with path.open("rb") as file:
            line = file.readline().decode("utf-8-sig")
            if told := told_separator(line):
                line = file.readline().decode("utf-8")
    except UnicodeDecodeError:
        return ()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    try:
        return tuple(cell.strip() for cell in next(csv.reader([line], delimiter=told or separator_of(line)), []))
    except csv.Error:
        return ()


def told_separator(line: str) -> str | None:
    """The character between cells, from a first line that is for Excel alone (`sep=;`); None for any other line."""
    found = _FOR_EXCEL.fullmatch(line.strip(" \r\n"))
    return None if found is None else found[1]


def separator_of(text: str) -> str:
    """The character between the cells of a table, told from its first line."""
    first = text.partition("\n")[0].strip()
    # a tab beside commas is a blank behind one of them, or part of a name
    return ";" if ";" in first else "\t" if "\t" in first and "," not in first else ","


def _cut(text: str) -> str:
    return text if len(text) <= 80 else f"{text[:60]} .. {text[-15:]}"
