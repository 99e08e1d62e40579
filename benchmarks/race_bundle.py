"""The whole transmission error in the race: 38 models, both directions, and the sum of ten harmonics.

Two bundles: the families that the paper chose for each order, and one family whose thresholds all lie on the grid of
operating points, so that every model is a table. Without the measured table the example bundle takes their place.
"""

from __future__ import annotations

import dataclasses
import hashlib
import shutil
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.contenders import CACHE, Built, compiled
from benchmarks.harness import Harness, Result

ROWS = 500


def te_bundles(harness: Harness, folder: Path, known: list[Result]) -> Iterator[Result]:
    """Results of all bundles; `known` are those of this run for single models."""
    from tests.families import CHOICE, SHARED

    if not SHARED.is_dir():
        print("the measured table is not beside this checkout: the example bundle takes the place of the real one")
        yield from _bundle("te-bundle-example", _example(), harness, folder / "example", {}, known)
        return
    hgbm = {order: ("hgbm",) * len(chosen) for order, chosen in CHOICE.items()}
    for name, choice in {"te-bundle-paper": CHOICE, "te-bundle-hgbm": hgbm}.items():
        models = trained(name, choice)
        yield from _bundle(name, models, harness, folder / f"{name}-made", choice, known)


def trained(name: str, choice: dict[int, tuple[str, ...]]) -> Path:
    """The folder of a trained bundle; kept in build/race/ as long as its recipe and the table are the same."""
    from tests import families

    recipe = Path(families.__file__).read_bytes() + (families.SHARED / "rv160n_harmonics.csv").read_bytes()
    folder = CACHE / f"{name}-{hashlib.sha256(recipe).hexdigest()[:16]}"
    if not folder.is_dir():
        partial = folder.with_suffix(".partial")
        shutil.rmtree(partial, ignore_errors=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            families.write_bundle(partial, choice)
        partial.rename(folder)
    return folder


def _example() -> Path:
    return Path(__file__).resolve().parent.parent / "examples" / "rv160n" / "models"


def _bundle(
    name: str,
    models: Path,
    harness: Harness,
    folder: Path,
    choice: dict[int, tuple[str, ...]],
    known: list[Result],
) -> Iterator[Result]:
    from st_codegen.bundle import load
    from st_codegen.cost import load_profile, project_cost
    from st_codegen.generate import generate
    from st_codegen.st import load_project
    from st_codegen.targets import TARGETS

    folder.mkdir(parents=True, exist_ok=True)
    bundle = load(models, trust_pickle=True)
    start = time.perf_counter()
    generated = generate(bundle, TARGETS["twincat"], folder)
    seconds = time.perf_counter() - start
    project = load_project([generated.folder], "twincat")
    cost = project_cost(project, load_profile(), ["FB_Compensator"])
    predict, _ = _translated(project, "FB_TEPredict", folder)
    exact, note = _compared(bundle, predict, project, harness, folder)
    built, rows = _translated(project, "FB_Compensator", folder)
    warm, cold = harness.times(built, rows, folder)
    count = harness.instructions(built, rows, folder)
    operations = sum(cost.cycle[0].operations.values())
    note += (
        f"; worst case on cx5140: {cost.warm_us:.1f} us warm, {cost.cold_us:.1f} us cold, {operations:,} operations"
        f"{'' if not cost.unbounded else ', loops without a bound'}"
    )
    yield Result(
        name,
        "st-codegen",
        round(warm, 1),
        round(cold, 1),
        None if count is None else round(count, 1),
        built.code_bytes,
        built.data_bytes,
        round(seconds, 3),
        round(built.compile_s, 3),
        exact,
        note=note,
    )
    yield from _added_up(name, choice, known)
    yield _library(name, bundle, rows, harness, folder)


def _translated(project: Any, block: str, folder: Path) -> tuple[Built, np.ndarray]:
    """A block as C, and rows of its inputs: angles and operating points at random, the rest as declared."""
    from benchmarks.st_to_c import ports, translate
    from st_codegen.st.typed import Section

    source = folder / f"{block}.c"
    source.write_text(translate(project, block, "race"))
    built = compiled([source], _fresh(folder / f"made-{block}"), 0.0, ports(project, block)[1])
    random = np.random.default_rng(1)
    known = {
        "FTHETAOUT_RAD": random.uniform(0.0, 2 * np.pi, ROWS),
        "FSPEED_RPM": random.uniform(200.0, 1800.0, ROWS),
        "FTORQUE_NM": random.uniform(0.0, 1800.0, ROWS),
        "FTEMPERATURE_C": random.uniform(25.0, 35.0, ROWS),
        "BENABLE": np.ones(ROWS),
    }
    inputs = project.pous[block.upper()].section(Section.INPUT)
    columns = [known.get(variable.key, np.full(ROWS, float(variable.initial))) for variable in inputs]
    return built, np.column_stack(columns)


def _fresh(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _compared(bundle: Any, built: Built, project: Any, harness: Harness, folder: Path) -> tuple[bool, str]:
    """Amplitudes and phases of the translated FB_TEPredict against the libraries, model by model.

    Models of trees must be equal in every bit; the others within what `bounds` derives for the row. Parts (cosine and
    sine) are not among the outputs of the block, so harmonics that are made of them are left out.
    """
    from st_codegen import bounds
    from st_codegen.ir import Quantity

    te = bundle.transmission_error
    _, rows = _translated(project, "FB_TEPredict", folder)
    values = harness.values(built, rows, folder)
    offset = {}
    at = 0
    for direction in te.directions:
        for quantity in (Quantity.AMPLITUDE, Quantity.PHASE):
            offset[direction, quantity] = at
            at += len(te.orders)
    models = {model.ir.name: model for model in bundle.models}
    compared, others = 0, 0
    exact = True
    for output in te.outputs:
        if (output.direction, output.quantity) not in offset:
            continue
        model = models[output.model]
        got = values[:, offset[output.direction, output.quantity] + te.orders.index(output.order)]
        expected = model.predict(rows)[:, output.output]
        if model.ir.exact:
            compared += 1
            exact &= bool(np.array_equal(got, expected))
        else:
            others += 1
            allowed = bounds.difference_bound(model.ir, rows)[:, output.output]
            exact &= bool(np.all(np.abs(got - expected) <= allowed))
    return exact, f"{compared} outputs of trees equal bit for bit, {others} others within their bound"


def _added_up(name: str, choice: dict[int, tuple[str, ...]], known: list[Result]) -> Iterator[Result]:
    """What the fastest peers would take: the times of this run for one model of each family, added up."""
    families = [family for chosen in choice.values() for family in chosen for _ in ("forward", "backward")]
    total = Result(name, "peers", 0.0, 0.0, note="fastest peer of each family, one model measured, added up")
    for family in families:
        peers = [r for r in known if r.case == f"rig-{family}" and r.contender != "st-codegen" and r.ns_warm]
        if not peers:
            return
        total.ns_warm = round(total.ns_warm + min(peer.ns_warm for peer in peers), 1)
        total.ns_cold = round(total.ns_cold + min(peer.ns_cold for peer in peers), 1)
    if families:
        yield total


def _library(name: str, bundle: Any, rows: np.ndarray, harness: Harness, folder: Path) -> Result:
    """All models by their libraries from Python; the sum of the harmonics is not counted."""

    def call(row: np.ndarray) -> None:
        for model in bundle.models:
            model.predict(row)

    points = rows[:, 1:4]  # behind the angle
    warm, cold = harness.times(Built(0.0, call=call), np.ascontiguousarray(points), folder)
    result = Result(name, "library", round(warm, 1), round(cold, 1), note="called from Python")
    return dataclasses.replace(result, exact=True)
