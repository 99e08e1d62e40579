"""Takes the times: the C program of harness.c around a contender, callgrind, and Python's own clock."""

from __future__ import annotations

import ctypes
import os
import shutil
import statistics
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.contenders import Built

WARM_ROWS, COLD_CALLS, PASSES, COUNTED = int(os.environ.get("RACE_WARM_ROWS", "256")), 61, 31, 32
#: Runs of the program
RUNS, COLD_RUNS = 3, 1
#: Calls from Python that take longer are repeated less
SLOW_CALL_S = 0.005


@dataclass
class Result:
    """A row of race.json."""

    case: str
    contender: str
    ns_warm: float | None = None
    ns_cold: float | None = None
    instructions: float | None = None
    code_bytes: int | None = None
    data_bytes: int | None = None
    generate_s: float | None = None
    compile_s: float | None = None
    exact: bool | None = None
    error: str = ""
    note: str = ""
    expected_most: int | None = None


class Harness:
    """The C program that times libraries, and its way to empty the caches for what is called from Python."""

    def __init__(self, folder: Path) -> None:
        source = Path(__file__).with_name("harness.c")
        self.program = folder / "harness"
        subprocess.run(["gcc", "-O2", "-o", self.program, source, "-ldl"], check=True)
        shared = folder / "evict.so"
        subprocess.run(["gcc", "-O2", "-shared", "-fPIC", "-Dmain=unused", "-o", shared, source, "-ldl"], check=True)
        self._evict = ctypes.CDLL(str(shared)).evict
        self._evict.argtypes = [ctypes.c_char_p]
        self.valgrind = shutil.which("valgrind")

    def values(self, built: Built, rows: np.ndarray, folder: Path) -> np.ndarray:
        """All outputs of all rows."""
        if built.call is not None:
            return np.array([np.asarray(built.call(rows[i : i + 1]), np.float64).ravel() for i in range(len(rows))])
        raw = self._run(built, rows, folder, "values", 0)
        return np.frombuffer(raw, np.float64).reshape(len(rows), built.outputs)

    def times(self, built: Built, rows: np.ndarray, folder: Path) -> tuple[float, float]:
        """ns a call, warm and cold: the smallest of the medians of several runs, for others use the machine, too."""
        if built.call is not None:
            return self._python_times(built.call, rows)
        warm = [float(self._run(built, rows[:WARM_ROWS], folder, "warm", PASSES)) for _ in range(RUNS)]
        cold = [float(self._run(built, rows[:WARM_ROWS], folder, "cold", COLD_CALLS)) for _ in range(COLD_RUNS)]
        return min(warm), min(cold)

    def instructions(self, built: Built, rows: np.ndarray, folder: Path) -> float | None:
        """Instructions a call, mean over some rows."""
        if self.valgrind is None or built.library is None:
            return None
        try:
            return self._counted(built, rows, folder)
        except subprocess.CalledProcessError:  # instructions that valgrind does not know
            return None

    def _counted(self, built: Built, rows: np.ndarray, folder: Path) -> float:
        out = folder / "callgrind.out"
        command = ["valgrind", "--tool=callgrind", "--toggle-collect=race", f"--callgrind-out-file={out}"]
        self._run(built, rows[:COUNTED], folder, "count", COUNTED, command)
        total = next(line for line in out.read_text().splitlines() if line.startswith("summary:"))
        # a part of the first call makes what is made once: it is taken out by a second run of that call alone
        self._run(built, rows[:1], folder, "count", 0, command)
        first = next(line for line in out.read_text().splitlines() if line.startswith("summary:"))
        return (int(total.split()[1]) - int(first.split()[1])) / COUNTED

    def _run(
        self, built: Built, rows: np.ndarray, folder: Path, mode: str, passes: int, before: list[str] | None = None
    ) -> bytes:
        file = folder / "rows.bin"
        np.ascontiguousarray(rows, np.float64).tofile(file)
        command = [*(before or []), self.program, built.library, file, rows.shape[1], built.outputs, mode, passes]
        return subprocess.run([str(part) for part in command], check=True, capture_output=True).stdout

    def _python_times(self, call: Callable[[np.ndarray], object], rows: np.ndarray) -> tuple[float, float]:
        single = [np.ascontiguousarray(rows[i : i + 1]) for i in range(WARM_ROWS)]
        start = time.perf_counter()
        for row in single[:4]:
            call(row)
        # a slow call needs no repeats for the clock's sake
        is_slow = time.perf_counter() - start > 4 * SLOW_CALL_S
        calls, passes, cold_calls = (2, 7, 15) if is_slow else (16, PASSES, COLD_CALLS)
        warm = []
        for _ in range(passes):
            begin = time.thread_time_ns()
            for row in single[:calls]:
                call(row)
            warm.append((time.thread_time_ns() - begin) / calls)
        cold = []
        for row in single[:cold_calls]:
            self._evict(None)
            begin = time.perf_counter_ns()
            call(row)
            cold.append(time.perf_counter_ns() - begin)
        parts = [warm[at::RUNS] for at in range(RUNS)]
        return min(statistics.median(part) for part in parts), statistics.median(cold)
