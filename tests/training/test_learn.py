"""From a table to a bundle that compiles: faulty runs, targets, choice, export."""

import math
import tomllib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from st_codegen.campaign.harmonic_table import HarmonicTable, joined
from st_codegen.cli.train import _summary
from st_codegen.driver import Evaluator, predict
from st_codegen.errors import InputError, at_least, at_most
from st_codegen.ir.reference import evaluate
from st_codegen.project.bundle import load
from st_codegen.te.harmonics import Direction, Play, Quantity
from st_codegen.training.choice import choose, loss
from st_codegen.training.cost import worst_case_us
from st_codegen.training.errors import errors_of
from st_codegen.training.export import save_model, write_bundle
from st_codegen.training.families import Learner
from st_codegen.training.faulty import Faulty, faulty_runs
from st_codegen.training.faulty_gain import Gain, gains, near_to
from st_codegen.training.learn import (
    LearningPlan,
    bundle_head,
    check_learnable,
    copies,
    interval,
    learn,
    only_exportable,
    play_deg,
    split_rows,
)
from st_codegen.training.page import _faulty_section, _models_section
from st_codegen.training.paper import reconstruction
from st_codegen.training.search import Fitting, fold_numbers
from st_codegen.training.store import FitStore
from st_codegen.training.study import SearchSettings, Solution, study
from st_codegen.training.tables import _gain_section
from st_codegen.training.targets import Coordinates, RobustUnit, combined, kinds, mean_direction, values
from st_codegen.walkers.objects import from_estimator
from tests.training.conftest import ORDERS, a_table

FEW = (
    Learner("SVM", {"C": 10.0, "epsilon": 0.05, "lengths": (200.0, 500.0, 8.0)}),
    Learner("DT", {"min_samples_leaf": 2}),
    Learner("ERT", {"n_estimators": 8}),
)
SETTINGS = SearchSettings(FEW, folds=3)


def changed(table, rows, change):
    coefficients = np.array(table.coefficients)
    coefficients[rows] = change(coefficients[rows])
    return HarmonicTable(
        table.backward, table.speed_rpm, table.torque_Nm, table.temperature_C, table.orders, coefficients
    )


@pytest.fixture(scope="module")
def lessons():
    both = joined([a_table(noise=1e-6), a_table(backward=True, noise=1e-6)])
    with FitStore(None) as store:
        return both, [
            learn(both, direction, LearningPlan(SETTINGS, repeats=2), Fitting(store)) for direction in Direction
        ]


@pytest.mark.parametrize("order", ORDERS)
def test_targets_give_the_coefficients_back(table, order):
    c = table.column(order)
    for kind in kinds(order):
        parts = tuple(values(c, q, order, mean_direction(c)) for q in kind.quantities(order))
        # polar coordinates and back: phases up to 2 pi carry an error of 2 pi * eps
        assert np.abs(combined(order, kind, parts) - c).max() <= 8 * np.pi * np.finfo(float).eps * np.abs(c).max()


def test_phases_are_turned_so_that_they_do_not_jump():
    angles = np.linspace(np.pi - 0.5, np.pi + 0.5, 50)
    c = 1e-3 * np.exp(1j * angles)
    assert np.ptp(values(c, Quantity.PHASE, 156)) > 6
    assert np.ptp(values(c, Quantity.PHASE, 156, mean_direction(c))) == pytest.approx(1.0)


def test_units_are_robust():
    y = np.concatenate([np.random.default_rng(0).normal(3.0, 2.0, 1000), [1e6]])
    unit = RobustUnit.of(y)
    assert unit.centre == pytest.approx(3.0, abs=0.3)
    assert unit.size == pytest.approx(2.0, rel=0.15)
    assert np.allclose(unit.centre + unit.size * unit.scaled(y), y, rtol=1e-12)
    assert RobustUnit.of(np.ones(5)).size == 1.0


def test_errors_go_around_the_circle():
    truth, guess = np.exp(1j * np.array([3.1, 1.0])), 2 * np.exp(1j * np.array([-3.1, 1.0]))
    errors = errors_of(39, guess, truth)
    assert errors.phase_mae == pytest.approx((2 * np.pi - 6.2) / 2)
    assert errors.bare_phase_mae == pytest.approx(3.1)
    assert errors.amplitude_mae == pytest.approx(1.0)
    assert errors_of(0, np.array([-1 + 0j]), np.array([1 + 0j])).amplitude_mae == 2.0


def test_faulty_runs_are_found_and_good_ones_kept(table):
    assert not faulty_runs(table).rows.any()
    spoiled = np.array([20, 77])
    # the coefficients of another speed, and a run that is off by a third in all orders
    bad = changed(table, spoiled[:1], lambda c: table.coefficients[[110]])
    bad = changed(bad, spoiled[1:], lambda c: c * (1.33 + 0j))
    found = faulty_runs(bad)
    assert np.array_equal(np.flatnonzero(found.rows), spoiled)
    assert 156 in found.orders[20]
    assert not faulty_runs(table.rows(np.arange(10))).rows.any()


def test_where_more_runs_look_faulty_than_may_be_left_out_or_too_few_are_there_to_tell_it_is_said(table):
    assert faulty_runs(table).not_judged == ""
    spoiled = np.arange(0, len(table), 9)
    found = faulty_runs(changed(table, spoiled, lambda c: c * (1.5 + 0.5 * np.arange(len(spoiled))[:, None] % 2)))
    assert 0 < found.rows.sum() < len(spoiled)
    said = f"of {len(table)} no more than {found.rows.sum()} are called faulty, and there are others"
    assert found.not_judged.startswith(said)
    few = faulty_runs(table.rows(np.arange(10)))
    assert "none was looked for" in few.not_judged


@pytest.mark.parametrize(("orders", "by_speed"), [((0,), 5), ((1,), 5), ((0,), 12), ((0, 1), 5)])
def test_few_numbers_call_no_sound_run_faulty(orders, by_speed):
    """Smooth tables with normal noise: of a single order 78 of 300 had a faulty run, and 1 % is the rate."""
    random, found = np.random.default_rng(4), 0
    speed, torque = (axis.ravel() for axis in np.meshgrid(np.linspace(200, 1800, 9), np.linspace(0, 1200, by_speed)))
    for _ in range(120):
        noise = 1e-4 * (random.standard_normal((len(speed), len(orders), 2)) @ [1, 1j])
        clean = 1e-3 * (1 + speed / 3600 + torque / 4000)
        coefficients = np.where(np.array(orders) == 0, (clean[:, None] + noise).real, clean[:, None] + noise)
        sound = HarmonicTable(speed < 0, speed, torque, 0 * speed + 30, orders, coefficients)
        found += faulty_runs(sound).rows.any()
    # five of 120 happen once in 125 times at 1 %
    assert found < 5


def test_a_single_bad_number_is_no_faulty_run(table):
    coefficients = np.array(table.coefficients)
    coefficients[30, 2] *= 3
    one = HarmonicTable(
        table.backward, table.speed_rpm, table.torque_Nm, table.temperature_C, table.orders, coefficients
    )
    assert not faulty_runs(one).rows[30]


def test_the_gain_of_leaving_faulty_runs_out(table):
    """A run with another speed's coefficients spoils what is learned beside it, and nothing far away."""
    bad = changed(table, np.array([60]), lambda c: table.coefficients[[110]])
    rows = np.arange(len(table)) == 60
    solution = Solution(
        156, Coordinates.PARTS, (Learner("DT", {"min_samples_leaf": 1}),) * 2, np.empty(0), np.empty(0), 1.0,
        errors_of(156, bad.column(156), bad.column(156)),
    )  # fmt: skip
    faulty = Faulty(rows, np.zeros(len(bad)), ((),) * len(bad))
    with FitStore(None) as store:
        found = gains(bad, faulty, [solution], SETTINGS, Fitting(store))[156]
        assert gains(bad, replace(faulty, rows=rows & False), [solution], SETTINGS, Fitting(store)) == {}
    assert found.near_without < 0.9 * found.near_with
    share = near_to(bad, rows).sum() / len(bad)
    assert share < 0.5
    # what changes is near: the mean over all sound rows moves by the share of these rows
    assert found.sound_with - found.sound_without < 1.5 * share * (found.near_with - found.near_without)


def test_near_rows_are_one_step_away(table):
    near = near_to(table, np.arange(len(table)) == 60)
    centre, steps = table.conditions[60], [np.diff(np.unique(column)).max() for column in table.conditions.T]
    within = (np.abs(table.conditions - centre) <= np.array(steps) * 1.001).all(axis=1)
    assert np.array_equal(near, within)


def test_copies_of_the_speed_are_one_input_of_the_compiled_model(table):
    candidate = Learner("ERT", {"n_estimators": 5, "speed_copies": 3})
    y = np.abs(table.column(156))
    model = candidate.fit(table.conditions, y, 0)
    assert model.named_steps["trees"].n_features_in_ == table.conditions.shape[1] + 2
    loaded = from_estimator(model, "copied")
    assert len(loaded.ir.features) == table.conditions.shape[1]
    assert np.array_equal(evaluate(loaded.ir, table.conditions).ravel(), model.predict(table.conditions))


def test_splits(table):
    mask = split_rows(table, LearningPlan(SETTINGS))
    assert mask.sum() == round(0.2 * len(table))
    assert np.array_equal(mask, split_rows(table, LearningPlan(SETTINGS)))
    points = table.conditions[[3, 9]]
    assert np.flatnonzero(split_rows(table, LearningPlan(SETTINGS, test_points=points))).tolist() == [3, 9]
    with pytest.raises(InputError, match="lacks 1 of 3 test points"):
        split_rows(table, LearningPlan(SETTINGS, test_points=np.vstack([points, [[1, 2, 3]]])))
    with pytest.raises(InputError, match="at least 20 are needed"):
        split_rows(table.rows(np.arange(5)), LearningPlan(SETTINGS))


def test_learned_models_predict_points_kept_apart(lessons):
    _, (forward, _) = lessons
    for order, errors in forward.test_errors.items():
        truth = forward.study.test.column(order)
        # a constant, their median, is what no learning at all would give
        constant = np.median(truth.real) + 1j * np.median(truth.imag)
        assert errors.complex_mae < max(0.5 * np.abs(truth - constant).mean(), 3e-6), order
        assert forward.intervals[order].half_width > 0


def test_that_nothing_was_learned_is_said():
    """An order of noise had an error like any other, and nothing beside it."""
    sound, random = a_table(noise=1e-6), np.random.default_rng(2)
    coefficients = np.array(sound.coefficients)
    coefficients[:, 2] = random.standard_normal((len(sound), 2)) @ [1e-4, 1e-4j]
    rows = replace(sound, coefficients=coefficients)
    settings = replace(
        SETTINGS, candidates=tuple(c for c in SETTINGS.candidates if c.family == "DT") or SETTINGS.candidates[:1]
    )
    with FitStore(None) as store:
        lesson = learn(rows, rows.directions()[0], LearningPlan(settings), Fitting(store))
    noise = sound.orders[2]
    assert lesson.test_errors[noise].complex_mae >= lesson.constant_mae(noise)
    assert lesson.remarks()[0].startswith(f"forward, order {noise} of ")
    assert "no better predicted than by the mean of the runs" in lesson.remarks()[0]


def test_parts_are_chosen_where_phases_wrap():
    table = a_table(torques=15)
    coefficients = np.array(table.coefficients)
    # once and a half around the circle over the range of torque
    coefficients[:, 2] = 1e-3 * np.exp(1j * table.torque_Nm / 200)
    turning = replace(table, coefficients=coefficients).only([39])
    with FitStore(None) as store:
        searched = study(turning, turning, SearchSettings(FEW[:1], 3), Fitting(store))
    (solution,) = choose(searched).solutions
    polar = next(s for s in searched.solutions(39) if s.kind is Coordinates.POLAR)
    assert solution.kind is Coordinates.PARTS
    assert solution.errors.complex_mae < 0.5 * polar.errors.complex_mae


def test_the_choice_keeps_the_cost_limit(lessons):
    _, (forward, _) = lessons
    free = choose(forward.study)
    limit = free.cost_us / 2
    limited = choose(forward.study, limit_us=limit)
    assert limited.cost_us <= limit < free.cost_us
    assert sum(map(loss, limited.solutions)) >= sum(map(loss, free.solutions))
    # each order alone: no cheaper-or-equal pair of models is better than the chosen one
    for solution in free.solutions:
        assert loss(solution) == min(loss(s) for s in forward.study.solutions(solution.order))
    with pytest.raises(InputError, match="are allowed: model fewer orders"):
        choose(forward.study, limit_us=0.1)


def test_what_cannot_be_compiled_is_not_chosen(table):
    with FitStore(None) as store:
        searched = study(table, table, SearchSettings((Learner("ELM", {"neurons": 20}),), 3), Fitting(store))
    with pytest.raises(InputError, match="none of the families that were tried can be compiled"):
        choose(searched)


@pytest.mark.thorough
@pytest.mark.parametrize("form", ["native", "skops"])
def test_the_bundle_compiles_and_predicts_the_same(lessons, tmp_path, form):
    both, learned = lessons
    models = [model for lesson in learned for model in lesson.models]
    write_bundle(tmp_path / "models", bundle_head(both, "small", 81.0), models, form)
    bundle = load(tmp_path / "models")
    assert bundle.purpose.te.orders == ORDERS
    rows = both.conditions[:40]
    columns = dict(zip(("speed_rpm", "torque_Nm", "temperature_C"), rows.T, strict=True))
    # the emitted text, inside the declared ranges
    predicted = predict(bundle, columns, Evaluator.ST)
    for model in models:
        assert np.allclose(predicted[model.stem], model.estimator.predict(rows), rtol=1e-9, atol=1e-12), model.stem


def unloaded(gap, scatter=0.0, torque_Nm=0.0, speeds=(100.0, 900.0, 1800.0)):
    """Means of runs in both directions that differ by a gap, which grows with speed."""
    speed, oil = (part.ravel() for part in np.meshgrid(speeds, [25.0, 30.0, 35.0]))
    random, n = np.random.default_rng(3), len(speed)
    mean = np.concatenate([np.full(n, -0.02), -0.02 + gap + 1e-7 * (speed - 100.0)])
    mean = mean + random.normal(0, scatter, 2 * n)
    backward = np.repeat([False, True], n)
    both = np.tile(speed, 2), np.full(2 * n, torque_Nm), np.tile(oil, 2)
    return HarmonicTable(backward, *both, (0,), mean[:, None].astype(complex))


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (unloaded(0.008), 0.008),
        (unloaded(0.008, speeds=(700.0, 900.0)), 0.008 + 6e-5),
        (unloaded(0.008, scatter=1e-3), pytest.approx(0.008, abs=2e-3)),
        (unloaded(0.001, scatter=1e-2), None),
        (unloaded(-0.008), None),
        (unloaded(20.0), None),
        (unloaded(0.008, torque_Nm=50.0), None),
        (unloaded(0.008).rows(np.arange(9)), None),
        (unloaded(0.008).rows([0, 1, 2, 9, 10, 11]), None),
    ],
)
def test_a_campaign_shows_its_play_where_it_is_sure(rows, expected):
    found = play_deg(rows)
    assert found is None if expected is None else found == pytest.approx(expected, abs=1e-9) or found == expected


def test_four_pairs_of_runs_show_no_play_by_chance():
    """Three standard errors of two degrees of freedom were one in 21 campaigns."""
    random, found = np.random.default_rng(6), 0
    speed, none = np.tile([100.0, 400.0, 700.0, 1000.0], 2), np.zeros(8)
    for _ in range(400):
        means = random.normal(0.001, 1e-4, (8, 1)).astype(complex)
        found += play_deg(HarmonicTable(np.arange(8) > 3, speed, none, none + 30.0, (0,), means)) is not None
    assert found < 4


def test_ranges_are_those_of_the_runs_learned_from():
    """A faulty run at the fastest speed is left out: no model has seen that speed."""
    sound = a_table()
    fastest = int(np.argmax(sound.speed_rpm))
    speed, coefficients = np.array(sound.speed_rpm), np.array(sound.coefficients)
    speed[fastest] += 500.0
    coefficients[fastest] += 0.05 * np.where(np.array(sound.orders) == 0, 1.0, 1.0 + 1.0j)
    rows = replace(sound, speed_rpm=speed, coefficients=coefficients)
    direction = rows.directions()[0]
    settings = replace(SETTINGS, candidates=SETTINGS.candidates[:1])
    with FitStore(None) as store:
        lesson = learn(rows, direction, LearningPlan(settings), Fitting(store))
    assert bundle_head(lesson.learned_from, "small", 81.0).ranges[0, 1] < speed[fastest]


def test_a_page_counts_no_faulty_runs_that_were_not_looked_for():
    """Of 20 runs it said that none is faulty, with the rule by which they are found."""
    few = faulty_runs(a_table().rows(np.arange(8)))
    lesson = SimpleNamespace(direction="forward", faulty=few, train=SimpleNamespace(conditions=np.zeros((8, 3))))
    section = _faulty_section(lesson)
    assert section.title == "Faulty runs, forward"
    assert section.text == "None was looked for, since there are too few runs to tell them."


def test_a_faulty_run_among_those_kept_apart_is_not_one_of_the_training_part():
    """The models are learned from all runs but it, though the training part has none that is faulty."""
    sound, settings = a_table(noise=1e-6), replace(SETTINGS, candidates=SETTINGS.candidates[1:2])
    kept_apart = np.flatnonzero(split_rows(sound, LearningPlan(settings)))
    rows = changed(sound, kept_apart[3:4], lambda c: c + 0.05 * np.where(np.array(ORDERS) == 0, 1.0, 1.0 + 1.0j))
    with FitStore(None) as store:
        lesson = learn(rows, Direction.FORWARD, LearningPlan(settings), Fitting(store))
        kept = learn(rows, Direction.FORWARD, LearningPlan(settings, keep_faulty=True), Fitting(store))
    assert (lesson.faulty.rows.sum(), lesson.left_out, kept.left_out) == (0, 1, 0)
    assert "0 faulty runs left out (1 of all runs for the models);" in _summary(lesson, "left out").title
    assert "runs of both but 1 that is faulty where" in _models_section(lesson).text
    assert "faulty" not in _models_section(kept).text
    assert "0 faulty runs kept;" in _summary(kept, "kept").title


def test_temperatures_in_kelvin_are_refused():
    """They were learned, and the blocks, which are given degC, then took the lowest of them at all times."""
    rows = a_table()
    with pytest.raises(InputError, match="look like K"):
        check_learnable(replace(rows, temperature_C=rows.temperature_C + 273.15))


def test_a_speed_with_the_sign_of_the_direction_is_refused():
    """It was learned, and the bundle had a range below zero, which reconcile refuses."""
    rows = a_table()
    with pytest.raises(
        InputError, match="2 runs with a speed of 0 rpm or less, the first at -200 rpm, 0 N m and 25 degC"
    ):
        check_learnable(replace(rows, speed_rpm=np.where(np.arange(len(rows)) < 2, -200.0, rows.speed_rpm)))


def test_a_table_in_another_unit_than_deg_is_asked_about():
    """In arcsec it was learned without a word, and the blocks corrected by their limit, far from the error."""
    settings = replace(SETTINGS, candidates=SETTINGS.candidates[1:2])
    for factor, asked in ((1.0, ""), (60.0, "5.16 deg, so 418 deg"), (3600.0, "310 deg, so 2.51e+04 deg")):
        rows = a_table()
        rows = replace(rows, coefficients=factor * rows.coefficients)
        with FitStore(None) as store:
            lesson = learn(rows, Direction.FORWARD, LearningPlan(settings), Fitting(store))
        said = lesson.beyond_limit(81.0)
        assert said.startswith(f"forward, order 0: up to {asked} at the motor, where the blocks") if asked else not said


def test_runs_with_the_numbers_of_another_one_are_told():
    sound = a_table(noise=1e-6)
    rows = changed(sound, [5, 9], lambda c: np.array(sound.coefficients)[[4, 4]])
    assert (copies(sound), copies(rows)) == (0, 3)
    again = joined([rows, rows])  # runs that repeat at one point
    assert copies(again) == 6
    assert copies(joined([sound, sound])) == 0
    settings = replace(SETTINGS, candidates=SETTINGS.candidates[1:2])
    with FitStore(None) as store:
        lesson = learn(rows, Direction.FORWARD, LearningPlan(settings), Fitting(store))
    assert f"forward, 3 of {len(rows)} runs: the very numbers of a run at another" in lesson.remarks()[-1]


def test_a_direction_that_was_measured_over_less_than_the_range_is_told():
    """One range is for both: inputs are in it where only the other direction was measured."""
    both = joined([a_table(), a_table(backward=True)])
    slow = both.rows(~both.backward | (both.speed_rpm < 1000.0))
    head = bundle_head(slow, "small", 81.0)
    assert head.narrower(slow.direction(Direction.FORWARD).conditions) == []
    assert head.narrower(slow.direction(Direction.BACKWARD).conditions) == ["speed_rpm 100 to 950"]


def test_the_play_stands_in_the_bundle(lessons, tmp_path):
    both, learned = lessons
    models = [model for lesson in learned for model in lesson.models]
    for known in (None, 0.007):
        head = replace(bundle_head(both, "small", 81.0), play_deg=known)
        write_bundle(tmp_path / "models", head, models)
        te = load(tmp_path / "models").purpose.te
        assert te.play == (Play(0.007, 1) if known and 0 in te.orders else None)


def test_a_bundle_replaces_only_a_bundle(lessons, tmp_path):
    both, learned = lessons
    head = bundle_head(both, "small", 81.0)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("keep me")
    with pytest.raises(InputError, match="exists and is no bundle"):
        write_bundle(tmp_path / "mine", head, learned[0].models)
    assert (tmp_path / "mine" / "thesis.txt").read_text() == "keep me"
    write_bundle(tmp_path / "new", head, learned[0].models)
    first = sorted(path.name for path in (tmp_path / "new").iterdir())
    write_bundle(tmp_path / "new", head, learned[1].models)
    assert first != sorted(path.name for path in (tmp_path / "new").iterdir())
    assert not {name for name in first if name != "bundle.toml"} & {path.name for path in (tmp_path / "new").iterdir()}
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_what_somebody_wrote_into_a_bundle_is_kept_or_named(lessons, tmp_path):
    """The description, two tasks and terms of an earlier bundle were gone without a word."""
    both, learned = lessons
    head, folder = bundle_head(both, "small", 81.0), tmp_path / "models"
    assert write_bundle(folder, head, learned[0].models) == ()
    file = folder / "bundle.toml"
    plain = file.read_text()
    terms = '\n[[term]]\ndirection = "forward"\norder = 0\namplitude = "mine.txt"\n'
    own = plain.replace("[bundle]", '[bundle]\ndescription = "cell 4"\ntasks = 2')
    file.write_text(own.replace("[[harmonic]]", "[[harmonic]]\nfactor = 1.03", 1) + terms)
    said = write_bundle(folder, head, learned[0].models)
    assert said == ("1 [[term]] table (whose files stay)", "factor of 1 harmonic")
    assert load(folder).purpose.te.tasks == 2
    kept = tomllib.loads(file.read_text())
    assert (kept["bundle"].pop("description"), kept["bundle"].pop("tasks")) == ("cell 4", 2)
    assert kept == tomllib.loads(plain)


def test_what_else_stands_in_the_folder_of_a_bundle_stays(lessons, tmp_path):
    """The options of [build] and notes of the user's were removed by the next `train`."""
    both, learned = lessons
    head = bundle_head(both, "small", 81.0)
    folder = tmp_path / "models"
    write_bundle(folder, head, learned[0].models)
    (folder / "st-codegen.toml").write_text('[build]\ntarget = ["iec"]\n')
    for own in ("notes", "forward"):  # a direction is no file of ours
        (folder / own).mkdir()
        (folder / own / "first.txt").write_text("keep me")
    write_bundle(folder, head, learned[1].models)
    assert (folder / "st-codegen.toml").read_text().startswith("[build]")
    assert all((folder / own / "first.txt").read_text() == "keep me" for own in ("notes", "forward"))
    assert all(model.source.file.rpartition("_")[2].startswith("backward") for model in load(folder).irs)
    own = next(path.name for path in folder.iterdir() if path.name.startswith("A0"))
    (folder / own.replace("backward", "forward")).write_text("mine")
    with pytest.raises(InputError, match="is none of the files that are replaced, and a new one has its name"):
        write_bundle(folder, head, learned[0].models)
    assert (folder / own.replace("backward", "forward")).read_text() == "mine"


def test_onnx_files_list_their_operator_sets_in_one_order(tmp_path, monkeypatch):
    """They stood in the order of a set, which differs from run to run: the same training gave other bytes."""
    skl2onnx = pytest.importorskip("skl2onnx")
    tree = Learner("DT", {"max_depth": 2}).fit(np.eye(3), np.arange(3.0), 0)
    (tmp_path / "other").mkdir()
    name = save_model(tree, tmp_path, "A0_forward", "onnx")
    convert = skl2onnx.to_onnx

    def reversed_sets(*arguments, **options):
        made = convert(*arguments, **options)
        made.opset_import.reverse()
        return made

    monkeypatch.setattr(skl2onnx, "to_onnx", reversed_sets)
    save_model(tree, tmp_path / "other", "A0_forward", "onnx")
    assert (tmp_path / name).read_bytes() == (tmp_path / "other" / name).read_bytes()


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("family", "params"),
    [
        ("ERT", {"n_estimators": 3}),
        ("ERT", {"n_estimators": 3, "speed_copies": 3}),
        ("SVM", FEW[0].params),
        ("MLP", None),
    ],
)
def test_onnx(table, tmp_path, family, params):
    pytest.importorskip("skl2onnx")
    params = params or {"scaled": True, "hidden_layer_sizes": (6,), "solver": "lbfgs", "max_iter": 50}
    settings = SearchSettings((Learner(family, params),), folds=2)
    with FitStore(None) as store:
        lesson = learn(table.only([0, 39]), Direction.FORWARD, LearningPlan(settings), Fitting(store))
    write_bundle(tmp_path / "models", bundle_head(table, "small", 81.0), lesson.models, "onnx")
    bundle = load(tmp_path / "models")
    for model, loaded in zip(sorted(lesson.models, key=lambda m: m.stem), bundle.models, strict=True):
        expected = model.estimator.predict(table.conditions)
        size = np.abs(expected).max()
        # float32 parameters and sums of some hundred terms
        assert np.abs(loaded.predict(table.conditions).ravel() - expected).max() < 1e-4 * size, model.stem


def test_only_families_that_fit_the_form():
    kept = only_exportable(SearchSettings((*FEW, Learner("LGBM", {}), Learner("ELM", {}))), "onnx")
    assert [candidate.family for candidate in kept.candidates] == ["SVM", "DT", "ERT"]
    with pytest.raises(InputError, match="none of these families can be saved as onnx: SVM, MLP, RF"):
        only_exportable(SearchSettings((Learner("LGBM", {}),)), "onnx")


def test_reconstruction_is_parsevals(table):
    theta = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    guess = table.coefficients * 1.05
    truth = table.curves(theta)
    off = truth - replace(table, coefficients=guess).curves(theta)
    percent = 100 * np.sqrt((off**2).mean(axis=1)) / np.sqrt((truth**2).mean(axis=1))
    deg, median, high = reconstruction(table, table.orders, guess)
    assert median == pytest.approx(np.median(percent), rel=1e-9)
    assert high == pytest.approx(np.percentile(percent, 95), rel=1e-9)
    assert deg == pytest.approx(np.median(np.sqrt((off**2).mean(axis=1))), rel=1e-9)


def test_interval():
    made = interval([1.0, 2.0, 3.0], 0.25)
    assert made.mean == 2.0
    assert made.half_width == pytest.approx(4.3026527 * math.sqrt(1 / 3 + 1 / 4))
    assert str(made) == "2 +- 3.3"
    assert str(interval([2.0], 0.25)) == "2, of one split", "it was +- inf"


def test_more_splits_of_the_same_rows_tell_an_error_no_better_than_its_interval_says():
    """A mean, learned from four of five normal numbers: 95 % of intervals held the error in 55 % of all campaigns."""
    random = np.random.default_rng(8)
    true, held = np.sqrt(1.0 + 1.0 / 32) * np.sqrt(2.0 / np.pi), 0
    for _ in range(300):
        y, errors = random.standard_normal(40), []
        for _ in range(20):
            mixed = random.permutation(y)
            errors.append(np.abs(mixed[:8] - mixed[8:].mean()).mean())
        found = interval(errors, 8 / 32)
        held += abs(found.mean - true) <= found.half_width
    assert held / 300 > 0.9


def test_what_is_better_without_the_faulty_runs_is_bold():
    mae = [{1: SimpleNamespace(complex_mae=size), 39: SimpleNamespace(complex_mae=1.0)} for size in (6.0, 5.0)]
    comparison = SimpleNamespace(
        gains={1: Gain(4.0, 3.0, 2.0, 1.0), 39: Gain(3.0, 4.0, 1.0, 1.0)}, with_faulty=mae[0], chosen_errors=mae[1]
    )
    table = _gain_section(comparison).table
    assert [float(value) for value in table.rows[0]] == [1, 2, 1, 4, 3, 6, 5]
    assert table.strong == {(0, 2), (0, 4), (0, 6)}


def repeated_points(table, times):
    """The table several times over, with other noise each time."""
    random = np.random.default_rng(1)
    return joined([changed(table, slice(None), lambda c: c + 1e-6 * random.normal(size=c.shape)) for _ in range(times)])


def test_runs_at_one_operating_point_are_kept_apart_together(table):
    many = repeated_points(table, 3)
    is_test = split_rows(many, LearningPlan(SETTINGS))
    assert is_test.sum() == 3 * round(0.2 * len(table))
    points = [set(map(tuple, many.conditions[rows])) for rows in (is_test, ~is_test)]
    assert not points[0] & points[1]
    # a table without repeated points is split as before
    assert np.array_equal(split_rows(table, LearningPlan(SETTINGS)), is_test[: len(table)])
    fold = fold_numbers(many.conditions, 5, 0)
    assert np.array_equal(fold[: len(table)], fold[len(table) : 2 * len(table)])
    assert np.array_equal(np.unique(fold), np.arange(5))
    few = repeated_points(table.rows(np.arange(19)), 3)
    with pytest.raises(InputError, match="19 operating points in one direction, forward: at least 20"):
        split_rows(few, LearningPlan(SETTINGS))


def test_more_folds_than_points_leave_each_point_out_once(table):
    few = table.rows(np.arange(12))
    with FitStore(None) as store:
        searched = study(few, few, SearchSettings(FEW[1:2], folds=100), Fitting(store))
    (outcome,) = searched.outcomes[0, Coordinates.POLAR][0]
    assert np.isfinite(outcome.folds).all()
    with FitStore(None) as store, pytest.raises(InputError, match="9 operating points left to learn from"):
        study(table.rows(np.arange(9)), few, SETTINGS, Fitting(store))


def test_numbers_that_libraries_cannot_square_are_refused(table):
    huge = replace(changed(table, slice(0, 1), lambda c: c * 1e30), speed_rpm=table.speed_rpm * 1e14)
    with pytest.raises(InputError, match=r"5 problems(?s:.*)speed_rpm reaches 1\.8e\+17; no more than 1e\+15"):
        check_learnable(huge)


def test_amplitudes_without_an_inverse_have_phases():
    c = np.array([1e-310 * np.exp(1j), 1e-3 * np.exp(2j), 0.0])
    assert mean_direction(c) == pytest.approx(2.0)
    errors = errors_of(1, c * np.exp(0.25j), c)
    assert errors_of(1, np.array([1e-200 + 0j]), np.array([1e-200j])).phase_mae == pytest.approx(np.pi / 2)
    assert errors.phase_mae == pytest.approx((0.25 + 0.25 + 0.0) / 3)


def test_the_cost_is_that_of_the_models_that_are_written(table):
    """A tree of all runs is deeper than one of the training part: the limit holds for what is written."""
    settings = SearchSettings((Learner("ERT", {"n_estimators": 8}), Learner("DT", {"max_depth": 2})), folds=3)
    only = table.only([0])
    with FitStore(None) as store:
        free = learn(only, Direction.FORWARD, LearningPlan(settings), Fitting(store))
        assert free.cost_us == sum(worst_case_us(model.estimator) for model in free.models)
        limit = (free.cost_us + free.choice.cost_us) / 2
        assert free.choice.cost_us < limit < free.cost_us
        limited = learn(only, Direction.FORWARD, LearningPlan(settings, limit_us=limit), Fitting(store))
        assert limited.cost_us <= limit
        assert limited.choice.solutions[0].candidates[0].family == "DT"
        alone = replace(settings, candidates=settings.candidates[:1])
        with pytest.raises(
            InputError, match=rf"all runs .* take {at_most(free.cost_us, 4)} us .*{at_least(limit, 6)} us are"
        ):
            learn(only, Direction.FORWARD, LearningPlan(alone, limit_us=limit), Fitting(store))
