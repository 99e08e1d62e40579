"""A study: one profile, several ways to compensate."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field

from st_codegen.errors import InputError, Problems, counted
from st_codegen.files.number_text import parse_number, parse_whole
from st_codegen.processes import Progress
from st_codegen.project.bundle import Bundle
from st_codegen.rig.compensator import EmittedCompensator, restricted
from st_codegen.rig.motion import CompensationCase, LoadSource, Rig, compare, lead_time_s, outside, plan, run
from st_codegen.rig.motion_files import MotionStudy
from st_codegen.rig.profiles import MotionProfile, profile_named
from st_codegen.rig.tasks import TaskForm
from st_codegen.te.latency import LONGEST_LEAD_S
from st_codegen.te.purpose import transmission_error

#: `--lead auto`
AUTO = -1.0
_LONGEST_LEAD_US = LONGEST_LEAD_S * 1e6
#: Inputs of the block that have an option of their own.
_OWN_OPTIONS = {"fLead_s": "--lead", "fFullSpeed_rpm": "--law"}


@dataclass(frozen=True)
class MotionWish:
    """What is asked for: sets of orders, laws, forms; `lead_s`, AUTO for all known delays.

    `load`, `ahead`: as in CompensationCase; `outputs_per_cycle`: as `generate` takes it, None: no model waits.
    """

    orders: tuple[tuple[int, ...], ...]
    laws: tuple[str, ...] = ("published", "continuous")
    forms: tuple[TaskForm, ...] = (TaskForm.TWO, TaskForm.ONE)
    lead: float = 0.0
    target: str = "twincat"
    inputs: Mapping[str, float] = field(default_factory=dict)
    load: LoadSource = LoadSource.NONE
    ahead: bool = False
    outputs_per_cycle: int | None = None


def parse_orders(texts: Sequence[str], bundle: Bundle) -> tuple[tuple[int, ...], ...]:
    """Sets of orders from texts such as `0,1,39` or `all`; all of the bundle without any. Raises InputError."""
    have = transmission_error(bundle).orders
    found: list[tuple[int, ...]] = []
    for text in texts or ("all",):
        if text.strip() == "all":
            found.append(have)
            continue
        try:
            wanted = tuple(parse_whole(part) for part in text.split(","))
        except ValueError:
            raise InputError(f"orders '{text}' are not whole numbers with commas between them, as in 0,1,39") from None
        restricted(bundle, wanted)
        found.append(tuple(order for order in have if order in wanted))
    return tuple(dict.fromkeys(found))


def parse_lead(text: str) -> float:
    """Seconds from microseconds, or AUTO. Raises InputError."""
    if text == "auto":
        return AUTO
    try:
        value = parse_number(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= _LONGEST_LEAD_US:
        raise InputError(f"lead '{text}': give microseconds from 0 to {_LONGEST_LEAD_US:g}, or auto")
    return value * 1e-6


def parse_inputs(texts: Sequence[str]) -> dict[str, float]:
    """Inputs of the block from texts such as `fBlendTime_s=0.05`. Raises one InputError for all that are none."""
    found, problems = {}, Problems("--set")
    for text in texts:
        name, _, value = text.partition("=")
        if option := _OWN_OPTIONS.get(name.strip()):
            problems.add(f"'{text}': give {option}, after which a case is called")
        try:
            found[name.strip()] = parse_number(value)
        except ValueError:
            problems.add(f"'{text}': give an input of FB_Compensator as in fBlendTime_s=0.05")
    problems.raise_if_any()
    return found


def with_oil(rig: Rig, temperature_C: float | None, drift_K_per_min: float | None) -> Rig:
    """This rig with another oil temperature at the start, another drift, where they are given."""
    given = {"start_C": temperature_C, "drift_K_per_min": drift_K_per_min}
    changes = {key: value for key, value in given.items() if value is not None}
    thermal = dataclasses.replace(rig.axis.thermal, **changes)
    return dataclasses.replace(rig, axis=dataclasses.replace(rig.axis, thermal=thermal))


def simulate(
    rig: Rig,
    bundle: Bundle,
    profile: str | MotionProfile,
    wish: MotionWish,
    *,
    seed: int = 0,
    progress: Progress | None = None,
    compensators: MutableMapping[tuple[int, ...], EmittedCompensator] | None = None,
) -> MotionStudy:
    """Move without compensation, then once for each set of orders, law and form.

    `compensators`: the generated code by its orders, kept from study to study with the same bundle, target and outputs
    in a cycle. Raises InputError, GeneratedCodeError.
    """
    known = {} if compensators is None else compensators
    _check_ratio(rig, bundle)
    cycle = rig.tasks.main_us * 1e-6
    motion = profile_named(profile, cycle) if isinstance(profile, str) else profile
    planned = plan(rig, motion, seed=seed)
    total, done = 1 + len(wish.orders) * len(wish.laws) * len(wish.forms), 0

    def next_is(what: str) -> None:
        if progress is not None:
            progress(done, total, what)

    next_is("without compensation")
    before = run(rig, planned)
    done = 1
    outcomes = []
    for orders in wish.orders:
        compensator = known.get(orders) or EmittedCompensator(
            restricted(bundle, orders), wish.target, wish.outputs_per_cycle
        )
        known[orders] = compensator
        for law in wish.laws:
            for form in wish.forms:
                lead = lead_time_s(rig, form) if wish.lead == AUTO else wish.lead
                next_is(f"{counted(len(orders), 'order')}, {law}, {form}")
                case = CompensationCase(orders, law, form, lead, wish.inputs, wish.load, wish.ahead)
                outcomes.append(compare(rig, planned, before, compensator, case))
                done += 1
    next_is("")
    return MotionStudy(rig, planned, before, tuple(outcomes), outside(next(iter(known.values())), planned))


def _check_ratio(rig: Rig, bundle: Bundle) -> None:
    ratio = transmission_error(bundle).reduction_ratio
    if ratio != rig.model.reduction_ratio:
        raise InputError(f"the bundle is for the reduction ratio {ratio:g}, the rig has {rig.model.reduction_ratio:g}")
