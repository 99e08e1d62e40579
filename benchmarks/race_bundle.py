"""The whole transmission error in the race: 38 models, both directions, and the sum of ten harmonics.

Two bundles: the families that the paper chose for each order, and for each order the family that predicts best among
those whose thresholds lie on the grid of operating points, so that every model is a table. Without the measured table
the example bundle takes their place.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import shutil
import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.contenders import CACHE, Built, compiled, estimate
from benchmarks.harness import Harness, Result
from benchmarks.isolated import FailedError, isolated

ROWS = 500
#: Seconds for one bundle
LIMIT = 1800.0
#: Families that put their thresholds between the points of the grid and nowhere else
TABLE_FAMILIES = ("dt", "gbm", "hgbm", "lgbm", "rf", "xgbm")
Choice = dict[int, tuple[str, ...]]


def te_bundles(
    harness: Harness, folder: Path, known: list[Result], is_chosen: Callable[[str], bool]
) -> Iterator[Result]:
    """Results of the bundles with chosen names; `known` are those of this run for single models."""
    from tests.families import CHOICE, SHARED

    made: dict[str, Callable[[], tuple[Path, Choice]]]
    if SHARED.is_dir():
        made = {
            "te-bundle-paper": lambda: (trained("te-bundle-paper", CHOICE), CHOICE),
            "te-bundle-table": lambda: (trained("te-bundle-table", table_choice()), table_choice()),
        }
    else:
        print("the measured table is not beside this checkout: the example bundle takes the place of the real one")
        made = {"te-bundle-example": lambda: (_example(), {})}
    for name, make in made.items():
        if not is_chosen(name):
            continue
        try:
            yield from isolated(partial(_bundle, name, make, harness, folder / name, known), LIMIT)
        except FailedError as error:
            yield Result(name, "st-codegen", error=str(error))


def _recipe() -> bytes:
    """What trained bundles depend on."""
    from tests import families

    return Path(families.__file__).read_bytes() + (families.SHARED / "rv160n_harmonics.csv").read_bytes()


def table_choice() -> Choice:
    """For each order and quantity the family of TABLE_FAMILIES with the smallest error on a third of the points.

    Chosen in the forward direction, on points that the models have not seen, as the paper chose its own.
    """
    from sklearn.base import clone
    from sklearn.model_selection import train_test_split

    from tests.families import CHOICE, families, harmonic_table

    kept = CACHE / f"table-choice-{hashlib.sha256(_recipe() + repr(TABLE_FAMILIES).encode()).hexdigest()[:16]}.json"
    if kept.is_file():
        return {int(order): tuple(chosen) for order, chosen in json.loads(kept.read_text()).items()}
    x, columns = harmonic_table("forward")
    learn, judge = train_test_split(np.arange(len(x)), test_size=1 / 3, random_state=0)
    choice: Choice = {}
    for order, published in CHOICE.items():
        best = []
        for letter in ("A", "phi")[: len(published)]:
            y = columns[f"{letter}{order}"]
            errors = {}
            for family in TABLE_FAMILIES:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    model = clone(families()[family]).fit(x[learn], y[learn])
                    errors[family] = float(np.sqrt(np.mean((model.predict(x[judge]) - y[judge]) ** 2)))
            best.append(min(errors, key=errors.__getitem__))
        choice[order] = tuple(best)
    CACHE.mkdir(parents=True, exist_ok=True)
    kept.write_text(json.dumps(choice))
    return choice


def trained(name: str, choice: Choice) -> Path:
    """The folder of a trained bundle; kept in build/race/ as long as its recipe and the table are the same."""
    from tests import families

    folder = CACHE / f"{name}-{hashlib.sha256(_recipe() + repr(choice).encode()).hexdigest()[:16]}"
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
    name: str, make: Callable[[], tuple[Path, Choice]], harness: Harness, folder: Path, known: list[Result]
) -> list[Result]:
    from benchmarks.bound import expected
    from benchmarks.st_to_c import ports
    from st_codegen.cost.profile import load_profile
    from st_codegen.cost.report import project_cost
    from st_codegen.driver import generate
    from st_codegen.emit.targets import TARGETS
    from st_codegen.project.bundle import load
    from st_codegen.st import load_project

    models, choice = make()
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
    note += f"; worst case on cx5140: {estimate(cost)}, {operations:,} operations"
    ours = Result(
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
        expected_most=expected(cost.cycle[0].operations, sum(ports(project, "FB_Compensator"))),
    )
    return [ours, *_added_up(name, choice, known), _library(name, bundle, rows, harness, folder)]


def _translated(project: Any, block: str, folder: Path) -> tuple[Built, np.ndarray]:
    """A block as C, and rows of its inputs: angles and operating points at random, the rest as declared."""
    from benchmarks.st_to_c import ports, translate
    from st_codegen.st.tree import Section

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
    from st_codegen.proof import bounds
    from st_codegen.te.harmonics import Quantity

    te = bundle.purpose.te
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


def _added_up(name: str, choice: Choice, known: list[Result]) -> Iterator[Result]:
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
