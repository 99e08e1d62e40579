"""All axes of a fleet, in processes of this machine or on a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from st_codegen.errors import InputError, Problems
from st_codegen.files.temporary import held
from st_codegen.files.text import make_folder
from st_codegen.fleet.axes import FleetAxis
from st_codegen.fleet.shared import with_shared
from st_codegen.fleet.stages import RECORD, TRAIN, AxisResult, do_axis
from st_codegen.training.search import Backend, spread

#: Called with (axes done, axes, name of the one that is done, its result).
AxisDone = Callable[[int, int, str, AxisResult], None]
#: By this file a folder is known as that of a fleet, in which folders of axes may be replaced.
MARK = "fleet.state"
_MARK_TEXT = "st-codegen fleet keeps its results here: a run goes on where the last one was. One run at a time.\n"
#: So often all axes that are left are tried together; after that each alone, so that one cannot take others with it.
_TOGETHER = 2


def run_fleet(
    axes: Sequence[FleetAxis], out: Path, backend: Backend, progress: AxisDone | None = None
) -> dict[str, AxisResult]:
    """Do every axis in a folder of its own below `out`; what is done already is not done again. By name, in order.

    Workers write there, so a cluster's machines see the campaigns and `out` under the same paths as this one. Where a
    worker ends, another one does its axes again. Raises InputError where `out` cannot be a fleet's folder, or another
    run works there, or no scheduler answers; what is wrong with an axis is in its result.
    """
    out = out.resolve()
    _check_place(axes, out)
    with held(out / MARK, _MARK_TEXT) as is_mine:
        if not is_mine:
            raise InputError(f"{out}: another run of st-codegen fleet works there; wait for it, or name another --out")
        axes = _sharing(axes, out, backend)
        results: dict[str, AxisResult] = {}
        for name, result in _results(axes, out, backend, results):
            is_here = not result.facts or (out / name / RECORD).is_file()
            results[name] = (
                result if is_here else AxisResult(errors={TRAIN: f"its worker has another {out}: share the disk"})
            )
            if progress:
                progress(len(results), len(axes), name, results[name])
        return {axis.name: results[axis.name] for axis in axes}


def _sharing(axes: Sequence[FleetAxis], out: Path, backend: Backend) -> Sequence[FleetAxis]:
    """The axes with what they share; where workers end again and again, each has models of its own."""
    for _ in range(_TOGETHER):
        try:
            return with_shared(axes, out, backend)
        except _ends_of_workers(backend):
            continue
    return axes


def _results(
    axes: Sequence[FleetAxis], out: Path, backend: Backend, known: dict[str, AxisResult]
) -> Iterator[tuple[str, AxisResult]]:
    """The result of each axis as soon as it is there; `known` grows while they are taken."""
    ends = _ends_of_workers(backend)
    for _ in range(_TOGETHER):
        try:
            yield from spread(do_axis, {a.name: (a, out) for a in axes if a.name not in known}, backend)
            return
        except ends:
            continue
    for axis in [axis for axis in axes if axis.name not in known]:
        try:
            yield from spread(do_axis, {axis.name: (axis, out)}, Backend(2, backend.scheduler))
        except ends:
            yield axis.name, AxisResult(errors={TRAIN: "its worker process ended each time (out of memory?)"})


def _ends_of_workers(backend: Backend) -> tuple[type[Exception], ...]:
    """What is raised where a worker process ended and nobody does its work again."""
    if backend.scheduler is None:
        return (BrokenProcessPool,)
    try:
        from distributed import KilledWorker
    except ImportError:  # the backend says which extra it needs
        return (BrokenProcessPool,)
    return (BrokenProcessPool, KilledWorker)


def _check_place(axes: Sequence[FleetAxis], out: Path) -> None:
    """Raise InputError where results would replace something else, or stand among measurements."""
    problems = Problems(str(out))
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file; the results need a folder")
    if out.is_dir() and any(out.iterdir()) and not (out / MARK).is_file():
        raise InputError(f"{out} exists and holds something else: name another --out")
    for path in (path.resolve() for axis in axes for path in (axis.campaign, *axis.earlier, axis.rig)):
        if out in (path, *path.parents) or path in out.parents:
            problems.add(f"{out} and {path}: results and inputs stand in each other; name another --out")
    problems.raise_if_any()
    make_folder(out)
