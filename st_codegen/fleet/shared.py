"""Models that the axes of a type share: learned once for all that ask for it, kept below the fleet's folder.

Of each group of axes with one type and the same options a folder in `shared.models` has a bundle with the models, and
`shared.json` with the SHA-256 of all that decides it, and for each axis the `bundle.toml` with its corrections and what
the models leave on its held-out runs. Whether an axis takes them is decided where it is trained (`stages`).
"""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.campaign.harmonic_table import HarmonicTable
from st_codegen.errors import InputError
from st_codegen.files.folders import replace_folder
from st_codegen.files.made_by import VERSION
from st_codegen.files.temporary import temporary_folder
from st_codegen.files.text import make_folder, read_text, write_text
from st_codegen.fleet.axes import AxisOptions, FleetAxis, TextCheck
from st_codegen.fleet.records import LIBRARIES, content_hash, failure, file_hashes, sha256_of
from st_codegen.ir.arrays import FloatArray
from st_codegen.rig.model import read_rig
from st_codegen.te.bundle_file import BUNDLE_FILE, LARGEST_FACTOR
from st_codegen.threads import one_thread
from st_codegen.training.export import bundle_text, write_bundle
from st_codegen.training.learn import LearningPlan, bundle_head
from st_codegen.training.measured import Measured, measured_table
from st_codegen.training.search import LEARNERS, Backend, Fitting, spread, versions
from st_codegen.training.shared import held_out_points, learn_shared
from st_codegen.training.store import FitStore

PLACE, RECORD = "shared.models", "shared.json"
RULE = (
    "Rule: an axis takes the models of its type, with a factor and an offset of phase or mean for each order, "
    "fitted without the runs held out, where on runs at operating points that none of the models has seen they leave "
    "no larger mean square of the transmission error than its own models do; where it has too few runs for own models, "
    "than the average of its training runs does. The same runs decide and are reported, so that the smaller of the two "
    "numbers is a little too small."
)

_LEFT_OUT = (
    f"its campaign cannot be read, has other directions than most, or sizes above {LARGEST_FACTOR:g} times the others'"
)


@dataclass(frozen=True)
class SharedPart:
    """What a group's models are for one axis: key of the group, the runs held out, what is left there, bundle.toml.

    points: float64 (points, 3); mean_square: deg^2; error: why there are no models of the group for the axis, and
    defect: whether that is ours.
    """

    key: str
    points: FloatArray
    mean_square: float
    bundle: str
    error: str = ""
    defect: bool = False


def axis_table(axis: FleetAxis) -> Measured:
    """The harmonic table of an axis' newest campaign. Raises InputError."""
    o = axis.options
    return measured_table(axis.campaign, o.orders, o.most_orders, skip_bad=o.skip_bad, where=Backend(1))


def axis_plan(options: AxisOptions) -> LearningPlan:
    """The plan by which the models of an axis are learned, from its options."""
    return LearningPlan(options.settings(), options.test_share, None, options.limit_us, keep_faulty=options.keep_faulty)


def with_shared(axes: Sequence[FleetAxis], out: Path, backend: Backend) -> tuple[FleetAxis, ...]:
    """Learn what axes share that say `share`, and give each the folder of it; what is done is not done again."""
    groups: dict[str, list[FleetAxis]] = {}
    for axis in axes:
        if axis.options.share:
            groups.setdefault(_group(axis), []).append(axis)
    groups = {name: own for name, own in groups.items() if len(own) > 1}
    keys = {name: _key(own) for name, own in groups.items()}
    missing = {name: own for name, own in groups.items() if not _is_done(out / PLACE / name, keys[name])}
    wanted = {axis.name: axis for own in missing.values() for axis in own}
    tables = {name: table for name, table in spread(_table, wanted, backend) if table is not None}
    jobs = {
        name: (
            own,
            {axis.name: tables[axis.name] for axis in own if axis.name in tables},
            keys[name],
            out / PLACE / name,
        )
        for name, own in missing.items()
    }
    for _ in spread(_learn_group, jobs, backend):
        pass
    places = {axis.name: f"{PLACE}/{name}" for name, own in groups.items() for axis in own}
    return tuple(replace(axis, shared=places.get(axis.name, "")) for axis in axes)


def shared_part(folder: Path, name: str) -> SharedPart:
    """What the models in a group's folder are for one axis."""
    found = json.loads(read_text(folder / RECORD))
    own = found["axes"].get(name)
    error = found["error"] or ("" if own else _LEFT_OUT)
    own = own or {"mean_square": 0.0, "bundle": ""}
    return SharedPart(found["key"], np.array(found["points"], np.float64), **own, error=error, defect=found["defect"])


def copy_models(folder: Path, part: SharedPart, target: Path) -> int:
    """Make a bundle of an axis from its group's; returns the number of models."""
    make_folder(target.parent)
    with temporary_folder(target.parent) as made:
        stage = made / "bundle"
        stage.mkdir()
        files = [path for path in sorted(folder.iterdir()) if path.name not in (RECORD, BUNDLE_FILE)]
        for path in files:
            shutil.copyfile(path, stage / path.name)
        (stage / BUNDLE_FILE).write_text(part.bundle, encoding="utf-8", newline="\n")
        replace_folder(stage, target)
    return len(files)


def _group(axis: FleetAxis) -> str:
    """A folder's name for the axes of a type with the same options but for target, check and as_is."""
    options = replace(axis.options, target="", check=TextCheck.PROVE, as_is=False)
    return sha256_of(axis.type, repr(sorted(asdict(options).items())))[:12]


def _key(axes: Sequence[FleetAxis]) -> str:
    contents = [
        f"{axis.name} {content_hash(axis.campaign) if axis.campaign.exists() else ''} {_ratio(axis)!r}" for axis in axes
    ]
    return sha256_of(VERSION, versions(LIBRARIES), _group(axes[0]), *contents)


def _ratio(axis: FleetAxis) -> float:
    return read_rig(axis.rig).constants.reduction_ratio


def _is_done(folder: Path, key: str) -> bool:
    try:
        found = json.loads(read_text(folder / RECORD))
        return bool(found["key"] == key and found["files"] == _files(folder) and not found["defect"])
    except (InputError, ValueError, KeyError, TypeError, RecursionError):
        return False


def _files(folder: Path) -> dict[str, str]:
    return {name: digest for name, digest in file_hashes(folder.parent, folder.name).items() if name != RECORD}


def _table(axis: FleetAxis) -> HarmonicTable | None:
    """The table of an axis; None where there is none: its own training says why."""
    try:
        with one_thread(*LEARNERS, "scipy.linalg"):
            return axis_table(axis).table
    except Exception:
        return None


def _learn_group(job: tuple[list[FleetAxis], dict[str, HarmonicTable], str, Path]) -> None:
    """Learn the models of a group and write its folder; what fails is written as the reason."""
    axes, tables, key, folder = job
    if folder.exists():
        shutil.rmtree(folder)
    found: dict[str, Any] = {"key": key, "error": "", "defect": False, "points": [], "axes": {}}
    try:
        with one_thread(*LEARNERS, "scipy.linalg"):
            found |= _learned(axes, tables, folder)
    except Exception as error:  # each axis has models of its own then
        found["error"], found["defect"] = failure(error)
    make_folder(folder)
    write_text(folder / RECORD, json.dumps(found | {"files": _files(folder)}, indent=1, sort_keys=True) + "\n")


def _learned(axes: Sequence[FleetAxis], tables: dict[str, HarmonicTable], folder: Path) -> dict[str, Any]:
    usual = Counter(tuple(table.directions()) for table in tables.values()).most_common(1)
    tables = {name: table for name, table in tables.items() if [tuple(table.directions())] == [key for key, _ in usual]}
    if len(tables) < 2:
        raise InputError("fewer than two axes of the type have a campaign of the same directions that can be read")
    options = axes[0].options
    points = held_out_points(tables, options.test_share, options.seed)
    with FitStore(None) as store:
        lesson = learn_shared(tables, axis_plan(options), points, Fitting(store))
    ends = np.concatenate([rows.conditions for rows in lesson.learned_from.values()])
    ranges = np.stack([ends.min(axis=0), ends.max(axis=0)], 1)
    ratios = {axis.name: _ratio(axis) for axis in axes}
    heads = {
        name: replace(bundle_head(rows, name, ratios[name]), ranges=ranges)
        for name, rows in lesson.learned_from.items()
    }
    write_bundle(
        folder, replace(next(iter(heads.values())), name="shared", play_deg=None), lesson.models, options.format
    )
    files = {path.stem: path.name for path in folder.iterdir()}
    own = {
        name: {
            "mean_square": float(lesson.errors[name].mean()) if len(lesson.errors[name]) else 0.0,
            "bundle": bundle_text(heads[name], lesson.models, files, lesson.corrections[name]),
        }
        for name in tables
        if all(correction.factor <= LARGEST_FACTOR for correction in lesson.corrections[name])
    }
    return {"points": points.tolist(), "axes": own}
