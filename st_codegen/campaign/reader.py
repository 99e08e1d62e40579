"""A whole campaign of curve files: read in parallel, file by file, reduced to sums, kept as Parquet.

Of 160 million samples (11 GB of text) only the sums of `orders.Sums` stay, some 30 KB a curve: all that fitting any
set of orders needs. They are kept in a Parquet file; a file whose size and time of change are the same is not read
again. Memory is a worker's one file and the sums. Workers may be those of a cluster that sees the same paths.
"""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np

from st_codegen.campaign.conditions import Conditions, OperatingPoint, temperatures_of_no_oil
from st_codegen.campaign.curves import MOST_GAP_DEG, BadFileError, RunFile, read_run, scan
from st_codegen.campaign.harmonic_table import HarmonicTable
from st_codegen.campaign.orders import BAND, OrderFit, Sums, curve_sums, fit_orders
from st_codegen.campaign.spikes import LEAST_ROW, longest_row, repeated
from st_codegen.campaign.sums_file import SumsFile
from st_codegen.errors import InputError, Problems, at_most, counted, extra_package
from st_codegen.processes import Progress, end_with_parent
from st_codegen.te.harmonics import Direction

#: workers by default: each takes some 150 MB, and a disk does not feed more
MOST_JOBS = 4
#: what is read in the time in which workers start (a second and more): less is read without them
_WITHOUT_WORKERS_BYTES = 32 * 2**20
#: in place of a number: wherever the work of joblib is done around the call (`joblib.parallel_config`)
AROUND = -1
#: TE that scatters over a turn by this times the median of all curves is none, nor is one of a degree and more: a
#: resonance lifts a curve some 50 times, and the TE of reducers is some hundredths of a degree
_APART, _NO_TE_DEG = 100.0, 1.0
#: TE of as many values as this is not rounded so coarsely that a sound run has only one
_MANY_VALUES = 20
#: with fewer curves no median tells what is usual
_LEAST_CURVES = 5
#: seconds between two writes of what is read so far
_KEEP_EVERY = 30.0


@dataclass(frozen=True)
class MeasuredCurve:
    """One curve of a campaign."""

    path: Path
    conditions: OperatingPoint
    direction: Direction
    sums: Sums


@dataclass(frozen=True)
class Campaign:
    """All curves of a folder, in order of conditions, file and direction; `bad` are the files that were left out."""

    folder: Path
    curves: tuple[MeasuredCurve, ...]
    bad: tuple[BadFileError, ...]

    @property
    def samples(self) -> int:
        """Number of samples of all curves."""
        return sum(curve.sums.taken for curve in self.curves)

    @property
    def spikes(self) -> str:
        """Which samples are in no result, since they lie far from those around them; empty for none."""
        spiky = [curve for curve in self.curves if curve.sums.spikes.size]
        if not spiky:
            return ""
        counts = [curve.sums.spikes.shape[1] for curve in spiky]
        most = max(float(np.abs(curve.sums.spikes[2]).max()) for curve in spiky)
        row = max(longest_row(curve.sums.spikes[3]) for curve in spiky)
        what, rows = ("sample", f", up to {row} in a row") if row >= LEAST_ROW else ("single sample", "")
        return (
            f"{counted(sum(counts), what)} of {counted(len(spiky), 'curve')}, at most {max(counts)} of one{rows}, "
            f"up to {at_most(most)} deg off those around them: {self._files(spiky)}"
        )

    @property
    def rounded(self) -> str:
        """Which curves are taken over other angles than were read, since these are rounded; empty for none."""
        moved = [curve for curve in self.curves if curve.sums.moved_deg]
        if not moved:
            return ""
        most = max(curve.sums.moved_deg for curve in moved)
        return (
            f"the rounded angles of {counted(len(moved), 'curve')}, in whose place smooth ones stand, up to "
            f"{at_most(most)} deg off: {self._files(moved)}"
        )

    def _files(self, curves: Sequence[MeasuredCurve]) -> str:
        """The first files of some curves."""
        files = sorted({curve.path.relative_to(self.folder).as_posix() for curve in curves})
        return f"{', '.join(files[:5])}{', ..' if len(files) > 5 else ''}"

    @property
    def at(self) -> Conditions:
        """The directions and operating points of the curves."""
        return Conditions.of_runs((curve.direction, curve.conditions) for curve in self.curves)

    def fits(self, orders: Sequence[int], progress: Progress | None = None) -> tuple[OrderFit, ...]:
        """The orders of every curve. Raises InputError that names curves with too few samples for an order."""
        problems = Problems(f"{self.folder}: order analysis")
        fits = []
        for done, curve in enumerate(self.curves):
            if progress:
                progress(done, len(self.curves), curve.path.name)
            try:
                fits.append(fit_orders(curve.sums, orders))
            except InputError as error:
                problems.add(f"{curve.path}, {curve.direction}: {error}")
        problems.raise_if_any()
        return tuple(fits)

    def table(self, fits: Sequence[OrderFit]) -> HarmonicTable:
        """The harmonic table of fitted curves."""
        if not fits:
            raise InputError(f"{self.folder}: no curves")
        at = self.at
        coefficients = np.stack([fit.coefficients for fit in fits])
        return HarmonicTable(at.sign < 0, at.speed_rpm, at.torque_Nm, at.temperature_C, fits[0].orders, coefficients)


def read_campaign(
    folder: Path,
    *,
    skip_bad: bool = False,
    band: int = BAND,
    jobs: int | None = None,
    cache: Path | None = None,
    progress: Progress | None = None,
) -> Campaign:
    """Read all curve files below a folder.

    band: highest order; jobs: worker processes (default: none for a small campaign, else the cores, at most MOST_JOBS;
    AROUND); cache: Parquet file with what was read before (made where it is missing; None: none). Bad files are all
    reported in one InputError with file, line and reason, or left out with `skip_bad` (then `Campaign.bad` lists them).
    Raises InputError also where nothing good is left.
    """
    files, bad = scan(folder)
    kept = SumsFile.read(cache, folder, band) if cache else SumsFile(folder, band)
    known, new = kept.partition(files)
    results: dict[Path, dict[Direction, Sums]] = known
    faults = list(bad)
    started = time.monotonic()
    for done, (file, result) in enumerate(_read_all(new, band, jobs), len(known)):
        if progress:
            progress(done, len(files), file.path.name)
        if isinstance(result, BadFileError):
            faults.append(result)
            continue
        results[file.path] = result
        kept.add(file.path, result)
        if cache and time.monotonic() - started > _KEEP_EVERY:
            kept.write(cache)
            started = time.monotonic()
    if cache and new:
        kept.write(cache)
    for fault in _apart([file for file in files if file.path in results], results):
        faults.append(fault)
        del results[fault.path]
    _put_back_repeated(results)
    for fault in list(_full_of_spikes(results)):
        faults.append(fault)
        del results[fault.path]
    if faults and not skip_bad:
        problems = Problems(f"{folder}: bad curve files (leave them out with --skip-bad; in a fleet: skip_bad = true)")
        faults.sort(key=lambda error: (error.path, error.line or 0))
        problems.errors.extend(faults)
        problems.raise_if_any()
    curves = [
        MeasuredCurve(file.path, file.conditions, direction, sums)
        for file in files
        if file.path in results
        for direction, sums in results[file.path].items()
    ]
    if not curves:
        raise InputError(
            f"{folder}: no usable curve files; the first of {counted(len(faults), 'problem')}: {faults[0]}"
        )
    return Campaign(folder, tuple(curves), tuple(faults))


def _apart(files: Sequence[RunFile], results: Mapping[Path, Mapping[Direction, Sums]]) -> Iterator[BadFileError]:
    """Files that cannot be what they say: a temperature that no oil has beside others, TE of another size than all."""
    scatter = {
        file.path: max(math.sqrt(max(_variance(sums), 0.0)) for sums in results[file.path].values()) for file in files
    }
    usual = median(scatter.values()) if len(files) >= _LEAST_CURVES else math.inf
    dead = _dead(results)
    oil = np.array([file.conditions.temperature_C for file in files])
    for file, wrong in zip(files, temperatures_of_no_oil(oil), strict=True):
        if wrong:
            reason = f"a temperature of {file.conditions.temperature_C:g} degC, in the median run {np.median(oil):g}"
            cause = "another unit"
        elif scatter[file.path] > max(_APART * usual, _NO_TE_DEG):
            reason = f"TE scatters by {scatter[file.path]:.2g} deg in the turn, in the median run by {usual:.2g}"
            cause = "an error code, or another unit"
        elif file.path in dead:
            reason = f"{' and '.join(dead[file.path])}: TE is the same in all samples, unlike in most runs"
            cause = "a dead channel"
        else:
            continue
        yield BadFileError(file.path, None, f"{reason}: {cause}? Correct it or leave it out")


def _dead(results: Mapping[Path, Mapping[Direction, Sums]]) -> dict[Path, list[Direction]]:
    """Files with curves of one value, where the median curve of the direction has so many that no rounding did it."""
    found: dict[Path, list[Direction]] = {}
    for direction in Direction:
        own = {path: run[direction].values for path, run in results.items() if direction in run}
        if len(own) >= _LEAST_CURVES and median(own.values()) >= _MANY_VALUES:
            for path in (path for path, values in own.items() if values == 1):
                found.setdefault(path, []).append(direction)
    return found


def _variance(sums: Sums) -> float:
    """The variance of TE over the samples of a curve, deg^2."""
    return sums.te_square / sums.samples - float(abs(sums.te[0] / sums.samples)) ** 2


def _put_back_repeated(results: dict[Path, dict[Direction, Sums]]) -> None:
    """Put samples that stand out at one angle in several curves back into them: the turn has something there."""
    curves = [(path, direction, sums) for path, run in results.items() for direction, sums in run.items()]
    step = 2.0 * np.pi / min((sums.in_turn for *_, sums in curves), default=1)
    again = repeated([sums.spikes[0] for *_, sums in curves], 1.5 * step)
    for (path, direction, sums), own in zip(curves, again, strict=True):
        if own.any():
            results[path] = {**results[path], direction: sums.with_spikes(own)}


def _lack_one_place(curves: Sequence[Sums]) -> bool:
    """Whether as much is left out of all curves, about one angle of the turn, to a tenth of it."""
    if any(not sums.spikes.size for sums in curves):
        return False
    middles = np.array([np.exp(1j * sums.spikes[0]).mean() for sums in curves])
    shares = np.array([sums.spikes.shape[1] / sums.taken for sums in curves])
    apart, near = np.abs(np.angle(middles / middles[0])) / (2.0 * np.pi), 0.1 * float(shares.min())
    return bool(apart.max() < near and np.ptp(shares) < near)


def _full_of_spikes(results: Mapping[Path, Mapping[Direction, Sums]]) -> Iterator[BadFileError]:
    """Files of which so many samples in a row are left out that they would be refused without them, too.

    None where all curves have such a row at one place: the turn has something there.
    """
    curves = [sums for run in results.values() for sums in run.values()]
    if len(curves) > 1 and _lack_one_place(curves):
        return
    for path, run in results.items():
        reasons = [
            f"{direction}: {sums.row_left_out} samples in a row lie far from those around them, and without them about "
            f"{gap:.3g} deg of the revolution have none"
            for direction, sums in run.items()
            if sums.row_left_out and (gap := 360.0 * (sums.row_left_out + 1) / sums.in_turn) > MOST_GAP_DEG
        ]
        if reasons:
            yield BadFileError(path, None, f"{'; '.join(reasons)}: was a line or a counter disturbed?")


def _read_all(
    files: Sequence[RunFile], band: int, jobs: int | None
) -> Iterator[tuple[RunFile, dict[Direction, Sums] | BadFileError]]:
    """Results in order of the files, as they come in."""
    workers = min(jobs or (1 if _are_few(files) else min(os.cpu_count() or 1, MOST_JOBS)), len(files))
    if workers <= 1 and (jobs != AROUND or not files):
        yield from ((file, _reduced(file, band)) for file in files)
        return
    joblib = extra_package("joblib", "train", "reading curve files in parallel")
    count = {} if jobs == AROUND else {"n_jobs": workers}
    parallel = joblib.Parallel(**count, return_as="generator", batch_size=1, pre_dispatch="2*n_jobs")
    yield from zip(files, parallel(joblib.delayed(_reduced)(file, band) for file in files), strict=True)


def _are_few(files: Sequence[RunFile]) -> bool:
    """Whether files are read before workers would have started. One that cannot be looked at is told of later."""
    size = 0
    for file in files:
        with contextlib.suppress(OSError):
            size += file.path.stat().st_size
        if size > _WITHOUT_WORKERS_BYTES:
            return False
    return True


def _reduced(file: RunFile, band: int) -> dict[Direction, Sums] | BadFileError:
    """The sums of a file, or why it has none; errors are values here, so that one bad file stops nothing."""
    os.environ.setdefault("POLARS_MAX_THREADS", "1")  # the workers are the parallelism
    end_with_parent()
    try:
        run = read_run(file.path, file.conditions)
        return {direction: curve_sums(curve, band) for direction, curve in run.curves.items()}
    except BadFileError as error:
        return error
    except InputError as error:
        return BadFileError(file.path, None, str(error))
