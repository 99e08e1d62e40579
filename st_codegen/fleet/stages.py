"""One axis: train, compile, check, reconcile. A stage that is done, with the same input and options, is not done again.

Its folder keeps in `stages.json`, for each finished stage, the SHA-256 of all that decides its result, those of the
files that it wrote, and what the fleet's page needs of it. A stage is done again where any of these differs, and its
entry goes before its files change: a kill in between costs that stage alone.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from st_codegen.campaign.harmonic_table import HarmonicTable, joined
from st_codegen.driver import generate
from st_codegen.errors import InputError
from st_codegen.files.folders import write_texts
from st_codegen.files.made_by import MADE_BY, VERSION
from st_codegen.files.text import make_folder, read_text, write_text
from st_codegen.fleet.axes import FleetAxis, TextCheck
from st_codegen.fleet.estimates import estimates
from st_codegen.fleet.records import LIBRARIES, content_hash, content_of, failure, file_hashes, sha256_of
from st_codegen.fleet.shared import axis_plan, axis_table, copy_models, shared_part
from st_codegen.project.bundle import load
from st_codegen.proof.prove.certificate import certificate
from st_codegen.proof.prove.prove import prove
from st_codegen.proof.verify import verify
from st_codegen.reconcile.judge.claims import Conclusions
from st_codegen.reconcile.mistakes.single_runs import AS_IS
from st_codegen.reconcile.plan.next_runs import next_runs
from st_codegen.reconcile.report.pages import report_texts
from st_codegen.reconcile.run import reconcile_files
from st_codegen.reconcile.spectrum import is_spectrum
from st_codegen.rig.effects import catalogue
from st_codegen.rig.model import read_rig
from st_codegen.threads import one_thread
from st_codegen.training.export import write_bundle
from st_codegen.training.learn import LEAST_POINTS, bundle_head, learn
from st_codegen.training.search import LEARNERS, Fitting, versions
from st_codegen.training.shared import own_errors
from st_codegen.training.store import FitStore
from st_codegen.training.study import operating_points

RECORD = "stages.json"
TRAIN, COMPILE, CHECK, RECONCILE = "train", "compile", "check", "reconcile"
EARLIER = "earlier"
#: The version of the facts that a stage keeps of itself: a stage whose facts are of another one is done again.
FACTS = "3"
#: What is said in place of options of `reconcile`, which a fleet does not have.
_IN_A_FLEET = (
    "; in a fleet: correct the files of the campaign, which the models learn from, too, or give as_is = true to take "
    "them as they are"
)
#: What a stage writes, below the folder of the axis.
PLACES = {TRAIN: "models", COMPILE: "plc", CHECK: "certificate.json", RECONCILE: "reconcile"}


@dataclass(frozen=True)
class AxisStage:
    """A stage of one axis: what decides its result beside the version, what it writes, and what does it."""

    name: str
    place: str
    decides: tuple[str, ...]
    work: Callable[[], dict[str, Any]]
    needs: str = ""


@dataclass(frozen=True)
class AxisResult:
    """What came of an axis: facts of each finished stage; for each that failed, why; `defect`: whether it is ours.

    done_now: the stages that were done in this run; the other finished ones were done before.
    """

    facts: dict[str, dict[str, Any]] = field(default_factory=dict)
    errors: dict[str, str] = field(default_factory=dict)
    done_now: tuple[str, ...] = ()
    defect: bool = False

    def line(self) -> str:
        """What is said of the axis while others are done."""
        if self.errors:
            stage, text = next(iter(self.errors.items()))
            return f"{stage} failed: {text}"
        before = "" if self.done_now else " (done before)"
        return f"{self.facts[CHECK]['how']}, {self.facts[RECONCILE]['verdict'].replace('_', ' ')}{before}"


def do_axis(job: tuple[FleetAxis, Path]) -> AxisResult:
    """All stages of an axis, in its folder below the one given. What fails is in the result; nothing is raised."""
    axis, out = job
    folder = out / axis.name
    token = MADE_BY.set(f"st-codegen {VERSION}: axis {axis.name} of a fleet")  # the same wherever it is done
    try:
        make_folder(folder)
        with one_thread(*LEARNERS, "scipy.linalg"):
            stages = _Stages(axis, folder, out)
            result = _done(list(stages.all()), folder)
            is_ours = stages.shared is not None and shared_part(stages.shared, axis.name).defect
            return replace(result, defect=result.defect or is_ours)
    except Exception as error:  # one axis stops no other
        text, defect = failure(error)
        return AxisResult(errors={TRAIN: text}, defect=defect)
    finally:
        MADE_BY.reset(token)


def changes_of(found: Conclusions) -> list[str]:
    """What reconcile changed of the rig's own effects, or found none of, in words."""
    changed = [("no " if one.is_gone else "changed ") + one.before.name for one in found.retuned]
    return list(dict.fromkeys([*changed, *["changed zero_offset_deg"] * found.offset_changed]))


def _done(stages: list[AxisStage], folder: Path) -> AxisResult:
    """Do the stages that are not done yet, those of which what they need did not fail."""
    kept, keys, errors = _read_record(folder), dict[str, str](), dict[str, str]()
    _remove_others(folder / EARLIER, {folder / stage.place for stage in stages})
    facts: dict[str, dict[str, Any]] = {}
    done, defect = [], False
    for stage in stages:
        if stage.needs in errors:
            errors[stage.name] = f"not done, since {stage.needs} failed"
            _forget(kept, stage, folder)
            continue
        needed = keys.get(stage.needs, "")
        key = keys[stage.name] = sha256_of(FACTS, VERSION, versions(LIBRARIES), needed, stage.name, *stage.decides)
        entry = kept.get(stage.name)
        if entry is not None and entry["key"] == key and entry["files"] == file_hashes(folder, stage.place):
            facts[stage.name] = entry["facts"]
            continue
        _forget(kept, stage, folder)
        try:
            # as it is read where the run goes on, the order of keys included
            found = json.loads(json.dumps(stage.work(), sort_keys=True, allow_nan=False))
            kept[stage.name] = {"key": key, "files": file_hashes(folder, stage.place), "facts": found}
            _write_record(folder, kept)
            facts[stage.name] = found
            done.append(stage.name)
        except Exception as error:  # the next stage may not need this one
            errors[stage.name], is_ours = failure(error)
            defect |= is_ours
            _remove(folder / stage.place)
    return AxisResult(facts, errors, tuple(done), defect)


class _Stages:
    """The stages of an axis, with what decides each."""

    def __init__(self, axis: FleetAxis, folder: Path, out: Path) -> None:
        self.axis, self.folder = axis, folder
        self.shared = out / axis.shared if axis.shared else None
        self.options = axis.options

    def all(self) -> Iterator[AxisStage]:
        """In the order in which they are done."""
        options = asdict(self.options)
        target, check, as_is = (options.pop(key) for key in ("target", "check", "as_is"))
        reads, ratio = content_hash(self.axis.campaign), repr(self._rig.constants.reduction_ratio)
        decides = [reads, ratio, self.axis.name, repr(sorted(options.items()))]
        if self.shared is not None:
            part = shared_part(self.shared, self.axis.name)
            decides += [part.key, part.error]
        yield AxisStage(TRAIN, PLACES[TRAIN], tuple(decides), self._train)
        yield AxisStage(COMPILE, PLACES[COMPILE], (target,), self._compile, TRAIN)
        yield AxisStage(CHECK, PLACES[CHECK], (check,), self._check, COMPILE)
        reconciled = (self._rig.text(), repr((self.options.skip_bad, as_is)))
        for number, path in enumerate((*self.axis.earlier, self.axis.campaign), 1):
            is_last = path == self.axis.campaign
            name = RECONCILE if is_last else f"{EARLIER} {number}"
            place = PLACES[RECONCILE] if is_last else f"{EARLIER}/{number}"
            reads = content_hash(path) if path.exists() else ""

            def work(path: Path = path, place: str = place) -> dict[str, Any]:
                return self._reconcile(path, place)

            yield AxisStage(name, place, (reads, *reconciled), work)

    @cached_property
    def _rig(self) -> Any:
        return read_rig(self.axis.rig)

    def _train(self) -> dict[str, Any]:
        plan = axis_plan(self.options)
        measured = axis_table(self.axis)
        table = measured.table
        left_out = {"left_out": list(measured.left_out)}
        with FitStore(None) as store:
            shared = self._shared(self.shared, table, store) if self.shared is not None else {}
            if shared.get("shared", {}).get("taken"):
                return left_out | shared
            lessons = [learn(table, direction, plan, Fitting(store)) for direction in table.directions()]
        learned_from = joined([lesson.learned_from for lesson in lessons])
        head = bundle_head(learned_from, self.axis.name, self._rig.constants.reduction_ratio)
        models = [model for lesson in lessons for model in lesson.models]
        write_bundle(self.folder / PLACES[TRAIN], head, models, self.options.format)
        return {
            "models": len(models),
            **left_out,
            **shared,
            "test_complex_mae_deg": {
                f"{lesson.direction} {order}": errors.complex_mae
                for lesson in lessons
                for order, errors in lesson.test_errors.items()
            },
        }

    def _shared(self, shared: Path, table: HarmonicTable, store: FitStore) -> dict[str, Any]:
        """Decide by `shared.RULE` whether the axis takes the models of its type, and write them where it does."""
        part = shared_part(shared, self.axis.name)
        found: dict[str, Any] = {"taken": False, "why_not": part.error}
        if not part.error:
            try:
                own = float(own_errors(table, axis_plan(self.options), part.points, Fitting(store)).mean())
            except InputError as error:
                return {"shared": found | {"why_not": str(error)}}
            few = min(operating_points(table.direction(one)) for one in table.directions()) < LEAST_POINTS
            found |= {
                "taken": part.mean_square <= own,
                "rms_deg": math.sqrt(part.mean_square),
                "own_rms_deg": math.sqrt(own),
                "own": "average of its training runs" if few else "own models",
            }
        if not found["taken"]:
            return {"shared": found}
        return {"models": copy_models(shared, part, self.folder / PLACES[TRAIN]), "shared": found}

    def _compile(self) -> dict[str, Any]:
        # what stood here was removed: layouts are chosen afresh
        made = generate(self._bundle, self.options.target, self.folder / PLACES[COMPILE])
        return {"files": len(made.files), "bytes": sum(made.files.values())}

    def _check(self) -> dict[str, Any]:
        generated = self.folder / PLACES[COMPILE]
        if self.options.check is TextCheck.VERIFY:
            compared = verify(self._bundle, generated, jobs=1)
            return {"passed": compared.passed, "how": "agree on a sample" if compared.passed else "not found to agree"}
        report = prove(self._bundle, generated)
        content = certificate(self._bundle, self.folder / PLACES[TRAIN], generated, report)
        write_text(self.folder / PLACES[CHECK], json.dumps(content, indent=1, sort_keys=True) + "\n")
        return {
            "passed": report.proved,
            "how": report.summary,
            "not_proved": {r.model: r.reason for r in report.results if not r.is_proved},
        }

    def _reconcile(self, measured: Path, place: str) -> dict[str, Any]:
        if is_spectrum(measured):
            raise InputError(f"{measured}: an order spectrum; a fleet wants curves or a harmonic table")
        options = self.options
        accepted, scale = ({AS_IS}, 1.0) if options.as_is else ((), None)
        try:
            result = reconcile_files(
                self._rig, measured, catalogue(), scale=scale, accept=accepted, skip_bad=options.skip_bad
            )
        except InputError as error:
            if not any(option in str(error) for option in ("--scale", "--accept")):
                raise
            raise InputError(f"{error}{_IN_A_FLEET}") from None
        write_texts(self.folder / place, report_texts(result, next_runs(result)))
        found = result.conclusions
        return {
            "measured": content_of(result.data.at.axes, result.data.at.sign, result.data.orders, result.data.values),
            "verdict": result.verdict,
            "effects": list(dict.fromkeys(claim.piece.effect.name for claim in found.claims)),
            "changed": changes_of(found),
            "gap": asdict(result.held_out),
            "cannot_show": list(result.cannot_show),
            "not_looked_at": list(result.data.not_looked_at),
            "estimates": [asdict(one) for one in estimates(result)],
        }

    @cached_property
    def _bundle(self) -> Any:
        return load(self.folder / PLACES[TRAIN])


def _read_record(folder: Path) -> dict[str, Any]:
    """What is known to be done; nothing where the file is missing or not as it was written."""
    try:
        found = json.loads(read_text(folder / RECORD))
        return {name: entry for name, entry in found.items() if {"key", "files", "facts"} <= entry.keys()}
    except (InputError, ValueError, AttributeError, RecursionError):
        return {}


def _write_record(folder: Path, kept: dict[str, Any]) -> None:
    write_text(folder / RECORD, json.dumps(kept, indent=1, sort_keys=True, allow_nan=False) + "\n")


def _forget(kept: dict[str, Any], stage: AxisStage, folder: Path) -> None:
    """Say that a stage is not done, and remove what it wrote."""
    if kept.pop(stage.name, None) is not None:
        _write_record(folder, kept)
    _remove(folder / stage.place)


def _remove_others(folder: Path, places: set[Path]) -> None:
    """Remove what no stage writes, such as reports of campaigns that fleet.toml does not name any more.

    Where the folder is a link it is another one, of which nothing is known.
    """
    for path in sorted(folder.iterdir()) if folder.is_dir() and not folder.is_symlink() else ():
        if path not in places:
            _remove(path)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
