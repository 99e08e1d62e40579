"""The sums of a campaign's curves as one Parquet file, so that no curve file is read twice."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.campaign.curves import RunFile
from st_codegen.campaign.orders import Sums
from st_codegen.errors import InputError, extra_package
from st_codegen.files.text import whole_file
from st_codegen.te.harmonics import Direction

#: changes with the way sums are made, or files are judged: a file of another version is made anew
_VERSION = 12
_POLARS = ("polars", "train", "keeping what was read of a campaign")


class SumsFile:
    """What was read of one folder: by path (relative), with size and time of change of the file it came from.

    A file of another folder is made anew: two campaigns that were unpacked at the same time have names, sizes and times
    in common.
    """

    def __init__(self, folder: Path, band: int) -> None:
        self.folder = folder
        self._rows: dict[str, list[dict[str, Any]]] = {}
        self._head = {"version": _VERSION, "band": band, "folder": str(folder.resolve())}

    @classmethod
    def read(cls, path: Path, folder: Path, band: int) -> SumsFile:
        """What a Parquet file holds; empty where it is missing, of another version, folder or band.

        Raises InputError for a file that cannot be read, or holds something else, which would be written over.
        """
        pl = extra_package(*_POLARS)
        new = cls(folder, band)
        if not path.exists() or (path.is_file() and not path.stat().st_size):
            return new
        try:
            frame = pl.read_parquet(path, glob=False)
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
        except pl.exceptions.PolarsError:
            frame = None
        if frame is None or not {"version", "band", "plain_fft"} <= set(frame.columns):
            raise InputError(f"{path} is not a file of what was read of curve files: name another one, or delete it")
        if "folder" not in frame.columns:  # version 1
            return new
        if any(frame[name].unique().to_list() != [value] for name, value in new._head.items()):
            return new
        for row in frame.iter_rows(named=True):
            new._rows.setdefault(row["file"], []).append(row)
        return new

    def partition(self, files: Sequence[RunFile]) -> tuple[dict[Path, dict[Direction, Sums]], list[RunFile]]:
        """The sums of files that are unchanged, and the files to read. What is no longer there is forgotten."""
        known, new, kept = {}, [], {}
        for file in files:
            name = self._name(file.path)
            rows = self._rows.get(name)
            if rows and all((row["size"], row["changed_ns"]) == _stamp(file.path) for row in rows):
                known[file.path] = {Direction(row["direction"]): _sums(row) for row in rows}
                kept[name] = rows
            else:
                new.append(file)
        self._rows = kept
        return known, new

    def add(self, path: Path, curves: dict[Direction, Sums]) -> None:
        """Keep the sums of the curves that a file holds."""
        size, changed = _stamp(path)
        name = self._name(path)
        head = {**self._head, "file": name, "size": size, "changed_ns": changed}
        self._rows[name] = [
            {
                **head,
                "direction": direction.value,
                "samples": sums.samples,
                "te_square": sums.te_square,
                "begin": sums.begin,
                "turns": sums.turns,
                "moved_deg": sums.moved_deg,
                "ends": sums.ends.ravel(),
                "spikes": sums.spikes.ravel(),
                "angle": sums.angle.view(np.float64),
                "te": sums.te.view(np.float64),
                "plain_fft": sums.plain_fft.view(np.float64),
            }
            for direction, sums in curves.items()
        ]

    def write(self, path: Path) -> None:
        """Write the file; it appears whole or not at all."""
        pl = extra_package(*_POLARS)
        rows = [row for name in sorted(self._rows) for row in self._rows[name]]
        if not rows:
            return
        columns = {name: [row[name] for row in rows] for name in rows[0]}
        content = io.BytesIO()  # polars' own errors of the disk have neither number nor file
        pl.DataFrame(columns).write_parquet(content)
        with whole_file(path) as partial:
            partial.write_bytes(content.getbuffer())

    def _name(self, path: Path) -> str:
        return path.relative_to(self.folder).as_posix()


def _stamp(path: Path) -> tuple[int, int]:
    status = path.stat()
    return status.st_size, status.st_mtime_ns


def _sums(row: dict[str, Any]) -> Sums:
    def complex_array(name: str) -> Any:
        return np.asarray(row[name], np.float64).view(np.complex128)

    return Sums(
        row["samples"],
        complex_array("angle"),
        complex_array("te"),
        row["te_square"],
        complex_array("plain_fft"),
        np.asarray(row["ends"], np.float64).reshape(2, 4),
        np.asarray(row["spikes"], np.float64).reshape(4, -1),
        row["begin"],
        row["turns"],
        row["moved_deg"],
    )
