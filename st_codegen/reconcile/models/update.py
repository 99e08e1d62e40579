"""Back to the controller: the bundle with what was found, compiled, verified, and in the loop of the new rig."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from st_codegen.driver import generate
from st_codegen.emit.targets import target_named
from st_codegen.errors import GeneratedCodeError, InputError, Problems
from st_codegen.ir.arrays import FloatArray
from st_codegen.processes import Progress
from st_codegen.project.bundle import Bundle, load
from st_codegen.proof.verify import verify
from st_codegen.proof.verify_report import VerifyReport
from st_codegen.reconcile.models.bundle_files import check_changeable, write_updated
from st_codegen.reconcile.models.terms import Decision, decide
from st_codegen.reconcile.result import Reconciliation
from st_codegen.rig.compensator import EmittedCompensator
from st_codegen.rig.machine import another_specimen, machine_of
from st_codegen.rig.model import RigModel
from st_codegen.rig.motion import CompensationCase, Size, compare, lead_time_s, or_none, plan, run
from st_codegen.rig.profiles import profile_named
from st_codegen.rig.tasks import TaskForm
from st_codegen.te.bundle_file import BUNDLE_FILE, read_description
from st_codegen.te.purpose import transmission_error

#: folders below the output
MODELS, CODE = "models", "plc"
LAW = "continuous"
#: the rehearsal moves another specimen than the fitted one: its sizes differ by this share (standard deviation), as in
#: the example. A draw that leaves the bounds of a parameter is drawn anew
SPREAD, FIRST_SPECIMEN, MOST_DRAWS = 0.02, 11, 20


@dataclass(frozen=True)
class Wish:
    """What to update and how: the bundle's folder, target, profile of the rehearsal (empty: none), rows to verify."""

    models: Path
    target: str = "twincat"
    profile: str = "cycloidal"
    rows: int = 10_000
    trust_pickle: bool = False


@dataclass(frozen=True)
class Moved:
    """A motion of the new rig with one bundle, or none: sizes of the output's error, and the error in deg over time.

    whole: over all of the motion; full: where the compensator corrects with its full weight.
    """

    name: str
    orders: tuple[int, ...]
    whole: Size
    full: Size
    error_deg: FloatArray


@dataclass(frozen=True)
class Motion:
    """The rehearsal: without compensation, with the old, with the new compensator; time in s.

    form: the tasks of the text; specimen: the seed of the machine that moved, which is not the fitted one.
    """

    profile: str
    form: TaskForm
    specimen: int
    lead_s: float
    time_s: FloatArray
    cases: tuple[Moved, ...]


@dataclass(frozen=True)
class Update:
    """What became of a bundle. files: the models that were added; none where nothing entered it."""

    models: Path
    target: str
    decisions: tuple[Decision, ...]
    files: tuple[str, ...]
    verified: VerifyReport | None
    motion: Motion | None

    def as_json(self) -> dict[str, Any]:
        """The key `models` of report.json."""
        moved = self.motion
        return {
            "source": str(self.models),
            "target": self.target,
            "files": list(self.files),
            "orders": [
                {
                    "order": d.order,
                    "effects": list(d.effects),
                    "new": d.new,
                    "entered": d.entered,
                    "reason": d.reason,
                    "before": d.before_deg,
                    "after": d.after_deg,
                }
                for d in self.decisions
            ],
            "verify": None if self.verified is None else self.verified.as_json(),
            "motion": moved
            and {
                "profile": moved.profile,
                "specimen": {"spread": SPREAD, "seed": moved.specimen},
                "law": LAW,
                "tasks": str(moved.form),
                "lead_us": round(moved.lead_s * 1e6, 3),
                "cases": [
                    {
                        "compensator": c.name,
                        "orders": list(c.orders),
                        "rms": c.whole.rms,
                        "max": c.whole.maximum,
                        "full_rms": or_none(c.full.rms),
                        "full_max": or_none(c.full.maximum),
                    }
                    for c in moved.cases
                ],
            },
        }


def check_models(rig: RigModel, wish: Wish) -> None:
    """Refuse what cannot work before anything is computed. Raises one InputError."""
    problems = Problems(str(wish.models))
    with problems.collect():
        description = read_description(wish.models / BUNDLE_FILE)
        check_changeable(wish.models / BUNDLE_FILE)
        ratio = rig.constants.reduction_ratio
        if description.reduction_ratio != ratio:
            problems.add(
                f"the bundle is for the reduction ratio {description.reduction_ratio:g}, the rig has {ratio:g}"
            )
    with problems.collect():
        target_named(wish.target)
    with problems.collect():
        if wish.profile:
            profile_named(wish.profile, machine_of(rig).tasks.main_us * 1e-6)
    problems.raise_if_any()


def update_models(result: Reconciliation, wish: Wish, out: Path, progress: Progress | None) -> Update:
    """Write the bundle with its new terms to `out`/models and its text to `out`/plc, proven equal.

    `out` is a folder for this alone. Raises InputError for a bundle that does not go with the rig, GeneratedCodeError
    where the text differs from the models.
    """

    def step(number: int, what: str) -> None:
        if progress is not None:
            progress(number, 7, what)

    step(0, "loading models")
    old = load(wish.models, trust_pickle=wish.trust_pickle)
    decisions = tuple(decide(old, result))
    if not any(decision.entered for decision in decisions):
        return Update(wish.models, wish.target, decisions, (), None, None)
    step(1, "writing models")
    files = write_updated(old, wish.models, decisions, out / MODELS)
    new = load(out / MODELS, trust_pickle=wish.trust_pickle)
    step(2, "compiling")
    generate(new, wish.target, out / CODE)
    step(3, "verifying")
    proof = verify(new, out / CODE, rows=wish.rows)
    if not proof.passed:
        failed = ", ".join(model.name for model in proof.models if not model.passed)
        raise GeneratedCodeError(f"the generated text differs from the models: {failed}")
    moved = rehearse(result, old, new, wish, step) if wish.profile else None
    step(7, "")
    return Update(wish.models, wish.target, decisions, files, proof, moved)


def rehearse(result: Reconciliation, old: Bundle, new: Bundle, wish: Wish, step: Callable[[int, str], None]) -> Motion:
    """Move a machine along a profile: without compensation, with the old text, with the new one.

    It is another specimen of the new rig: on the rig that the terms were read from they would prove themselves.
    """
    seed, specimen = _unseen(result.new_rig)
    rig = machine_of(specimen)
    try:
        planned = plan(rig, profile_named(wish.profile, rig.tasks.main_us * 1e-6))
    except InputError as error:
        raise InputError(f"rehearsal of the new models: {error}") from None
    dialect = target_named(wish.target).dialect
    form = TaskForm.SPLIT if dialect == "twincat" else TaskForm.ONE  # others have no programs of two tasks
    lead = lead_time_s(rig, form)
    step(4, "moving without compensation")
    before = run(rig, planned)
    cases: list[Moved] = []
    for number, (name, bundle) in enumerate((("old", old), ("new", new))):
        step(5 + number, f"moving with the {name} compensator")
        compensator = EmittedCompensator(bundle, dialect)
        orders = transmission_error(bundle).orders
        outcome = compare(rig, planned, before, compensator, CompensationCase(orders, LAW, form, lead))
        if not cases:
            cases.append(Moved("none", (), outcome.before, outcome.full_before, outcome.error_before_deg))
        cases.append(Moved(name, orders, outcome.after, outcome.full_after, outcome.error_after_deg))
    return Motion(planned.profile.name, form, seed, lead, planned.time_s[planned.first :], tuple(cases))


def _unseen(rig: RigModel) -> tuple[int, RigModel]:
    """A machine of the same kind that no fit has seen, and its seed. Raises InputError."""
    kinds = {effect.name: type(effect) for effect in rig.effects}
    problem = InputError("no specimen could be drawn")
    for seed in range(FIRST_SPECIMEN, FIRST_SPECIMEN + MOST_DRAWS):
        try:
            return seed, another_specimen(rig, kinds, SPREAD, seed)
        except InputError as error:
            problem = error
    raise InputError(f"rehearsal of the new models: {problem}")
