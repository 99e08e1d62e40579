"""Finished fits on disk, so that a search that was killed goes on where it was.

One SQLite file; a fit is known by everything that decides its result (`search.Task.key`). Only the process that runs
the search writes, and each finished fit is one transaction: a kill loses the fits that were running, nothing else.
"""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

import numpy as np

from st_codegen.errors import InputError
from st_codegen.files.text import make_folder
from st_codegen.ir.arrays import FloatArray


class FitStore:
    """Predictions of finished fits: key -> (out-of-fold predictions, predictions at the test points)."""

    def __init__(self, path: Path | None) -> None:
        """Open or make the file; None: only in memory. Raises InputError for a file of another kind."""
        if path is not None:
            make_folder(path.parent)
        self._name = str(path)
        with self._errors_named():
            self._database = sqlite3.connect(":memory:" if path is None else path)
            self._database.execute(
                "CREATE TABLE IF NOT EXISTS fits (key TEXT PRIMARY KEY, folds BLOB, test BLOB, cost REAL)"
            )

    def __enter__(self) -> FitStore:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._database.close()

    def get(self, key: str) -> tuple[FloatArray, FloatArray, float] | None:
        """The predictions of a finished fit, and its cost. Raises InputError for a damaged file."""
        with self._errors_named():
            row = self._database.execute("SELECT folds, test, cost FROM fits WHERE key = ?", (key,)).fetchone()
        return None if row is None else (np.frombuffer(row[0]), np.frombuffer(row[1]), float(row[2]))

    def put(self, key: str, folds: FloatArray, test: FloatArray, cost: float) -> None:
        """Keep the predictions and the cost of a fit. Raises InputError where the file cannot be written."""
        with self._errors_named(), self._database:
            row = (key, folds.tobytes(), test.tobytes(), cost)
            self._database.execute("INSERT OR REPLACE INTO fits VALUES (?, ?, ?, ?)", row)

    @contextlib.contextmanager
    def _errors_named(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.OperationalError as error:  # the disk is full, the file is read-only or a folder
            raise InputError(f"{self._name}: the finished fits cannot be kept ({error})") from None
        except sqlite3.DatabaseError:
            raise InputError(f"{self._name} is not a file of finished fits: name another one, or delete it") from None
