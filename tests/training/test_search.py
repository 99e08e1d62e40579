"""The search: the same bits whatever the order, the process or an interruption; nothing finished is lost."""

import os
import signal
import subprocess
import sys
import time
from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest

from st_codegen.errors import InputError
from st_codegen.training import search
from st_codegen.training.cost import worst_case_us
from st_codegen.training.families import FAMILIES, Learner, candidates, family_named
from st_codegen.training.search import Backend, FitTask, Fitting, fold_numbers, run_task, spread
from st_codegen.training.store import FitStore
from st_codegen.walkers.objects import from_estimator
from tests.training.conftest import a_table

SMALL = (
    Learner("SVM", {"C": 10.0, "epsilon": 0.05, "lengths": (300.0, 500.0, 8.0)}),
    Learner("ERT", {"n_estimators": 5}),
    Learner("LGBM", {"n_estimators": 10}),
)


def the_tasks(chosen=SMALL, folds=3):
    table = a_table()
    y = np.abs(table.column(39))
    train, test = table.conditions[::2], table.conditions[1::2]
    return [FitTask(candidate, train, y[::2], test, folds, 7, candidate.family) for candidate in chosen]


def same(one, other):
    return all(
        np.array_equal(a.folds, b.folds, equal_nan=True) and np.array_equal(a.test, b.test) and a.cost_us == b.cost_us
        for a, b in zip(one, other, strict=True)
    )


@pytest.mark.parametrize("name", FAMILIES)
def test_every_family_learns_and_repeats_to_the_bit(name, table):
    family = family_named(name)
    x, y = table.conditions, np.abs(table.column(39))
    for params, by_authors in ((family.grid[0], False), (family.authors, True)):
        small = {key: min(value, 20) if key in ("n_estimators", "max_iter") else value for key, value in params.items()}
        candidate = Learner(name, small, by_authors)
        one, other = candidate.fit(x, y, 3), candidate.fit(x, y, 3)
        values = one.predict(x)
        assert values.shape == y.shape
        assert np.array_equal(values, other.predict(x))
        if not by_authors and name != "MLP":  # 20 steps of L-BFGS are few
            assert np.abs(values - y).mean() < 0.5 * np.abs(y - np.median(y)).mean()
        if family.forms:
            loaded = from_estimator(one, "model")
            assert np.allclose(loaded.predict(x).ravel(), values, rtol=1e-6, atol=1e-9)
            assert 0 < worst_case_us(one) < 10_000
        else:
            with pytest.raises(InputError):
                worst_case_us(one)


def test_unknown_family():
    with pytest.raises(InputError, match="unknown family 'KNN'; known are SVM, MLP"):
        candidates(["KNN"])


def test_cost_counts_levels_and_vectors(table):
    x, y = table.conditions, np.abs(table.column(39))
    flat, deep = (worst_case_us(Learner("DT", {"max_depth": d}).fit(x, y, 0)) for d in (1, 3))
    ten, one = (worst_case_us(Learner("RF", {"max_depth": 3, "n_estimators": n}).fit(x, y, 0)) for n in (10, 1))
    # a call is c, a tree levels * a + b: two levels more, nine trees more
    level, trees = (deep - flat) / 2, (ten - one) / 9
    assert 0.0 < level < flat
    assert 2.0 < trees / level <= 3.5
    call = one - trees
    assert 0.0 < call < level


def test_a_split_of_the_first_feature_costs_what_one_of_the_last_does():
    x = np.arange(8.0)[:, None] * np.eye(3)[:, None]
    first, _, last = (worst_case_us(Learner("DT", {"max_depth": 3}).fit(one, np.arange(8.0), 0)) for one in x)
    assert first == last


def test_folds_are_of_one_size_and_cover_all():
    x = np.arange(309.0).reshape(103, 3)
    numbers = fold_numbers(x, 10, 0)
    sizes = np.bincount(numbers)
    assert sizes.min() >= 10
    assert sizes.max() <= 11
    assert not np.array_equal(numbers, fold_numbers(x, 10, 1))


@pytest.mark.parametrize("folds", [0, 1])
def test_less_than_two_folds_leave_nothing_out(folds):
    outcome = run_task(the_tasks((Learner("DT", {}),), folds)[0])
    assert np.isnan(outcome.folds).all() and np.isfinite(outcome.test).all()


def test_out_of_fold_predictions_never_saw_their_row():
    task = the_tasks((Learner("DT", {}),))[0]
    outcome = run_task(task)
    number = fold_numbers(task.x, task.folds, task.seed)
    for fold in range(task.folds):
        out = number == fold
        model = task.candidate.fit(task.x[~out], task.y[~out], task.seed)
        assert np.array_equal(outcome.folds[out], model.predict(task.x[out]))


@pytest.mark.thorough
def test_two_processes_and_any_order_give_the_same_bits():
    tasks = the_tasks()
    with FitStore(None) as store:
        alone = Fitting(store).outcomes(tasks)
    with FitStore(None) as store:
        together = Fitting(store, Backend(2)).outcomes(tasks[::-1])[::-1]
    assert same(alone, together)


def test_finished_fits_are_not_fitted_again(tmp_path, monkeypatch):
    tasks = the_tasks()
    with FitStore(tmp_path / "fits.sqlite") as store:
        first = Fitting(store).outcomes(tasks[:2])
    monkeypatch.setattr("st_codegen.training.search.run_task", lambda task: pytest.fail(task.name))
    with FitStore(tmp_path / "fits.sqlite") as store:
        assert same(first, Fitting(store).outcomes(tasks[:2]))


def test_what_decides_a_result_is_in_its_key():
    task = the_tasks()[0]
    others = [
        FitTask(SMALL[1], task.x, task.y, task.x_test, task.folds, task.seed),
        FitTask(task.candidate, task.x, task.y + 1e-12, task.x_test, task.folds, task.seed),
        FitTask(task.candidate, task.x[1:], task.y[1:], task.x_test, task.folds, task.seed),
        FitTask(task.candidate, task.x, task.y, task.x_test[1:], task.folds, task.seed),
        FitTask(task.candidate, task.x, task.y, task.x_test, 4, task.seed),
        FitTask(task.candidate, task.x, task.y, task.x_test, task.folds, 8),
    ]
    assert len({task.key, *(other.key for other in others)}) == len(others) + 1


def test_not_a_store(tmp_path):
    (tmp_path / "fits.sqlite").write_text("this is no database, and long enough to be seen as none" * 20)
    with pytest.raises(InputError, match="not a file of finished fits"):
        FitStore(tmp_path / "fits.sqlite")


KILLED = """
import sys, time
from pathlib import Path
import st_codegen.training.search as search
from tests.training.test_search import the_tasks
from st_codegen.training.store import FitStore

slow = search.run_task
def run(task):
    if task.name == "LGBM":
        print("here", flush=True)
        time.sleep(6000)
    return slow(task)
search.run_task = run
with FitStore(Path(sys.argv[1])) as store:
    search.Fitting(store).outcomes(the_tasks())
"""


def test_killed_and_resumed(tmp_path):
    path = tmp_path / "fits.sqlite"
    process = subprocess.Popen([sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "here\n"
    process.send_signal(signal.SIGKILL)
    process.wait(600)
    tasks = the_tasks()
    ran = []
    with FitStore(path) as store:
        assert [store.get(task.key) is not None for task in tasks] == [True, True, False]
        resumed = Fitting(store, Backend(1), lambda done, total, name: ran.append((done, total, name))).outcomes(tasks)
    assert ran == [(3, 3, "LGBM")]
    with FitStore(None) as store:
        assert same(resumed, Fitting(store).outcomes(tasks))


def test_no_scheduler_answers(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(search, "TIMEOUT", "1s")
    backend = Backend(1, "tcp://127.0.0.1:1")
    with FitStore(None) as store, pytest.raises(InputError, match="no Dask scheduler answers"):
        Fitting(store, backend).outcomes(the_tasks())


@pytest.mark.slow
def test_a_dask_worker_is_killed_and_nothing_is_lost():
    """Two worker processes, one of which is killed while it works: all results are there, and the same bits."""
    distributed = pytest.importorskip("distributed")
    tasks = the_tasks(tuple(Learner("ERT", {"n_estimators": n}) for n in range(40, 64)))
    with FitStore(None) as store:
        alone = Fitting(store).outcomes(tasks)
    killed = []
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit=0
    ) as cluster:

        def kill(done, total, name):
            if done >= total // 4 and not killed:
                killed.append(next(iter(cluster.workers.values())).pid)
                os.kill(killed[0], signal.SIGKILL)

        with FitStore(None) as store:
            spread = Fitting(store, Backend(1, cluster.scheduler_address), kill).outcomes(tasks)
    assert killed
    assert same(alone, spread)


def test_a_worker_keeps_no_samples_of_what_is_done(monkeypatch):
    """Dask's workers keep the call stacks of an hour, which grow with the axes of a fleet."""
    distributed = pytest.importorskip("distributed")
    worker = SimpleNamespace(
        profile_history=deque([(0.0, {})]),
        profile_keys_history=deque([(0.0, {})]),
        loop=SimpleNamespace(add_callback=lambda call: call()),
    )
    monkeypatch.setattr(distributed, "get_worker", lambda: worker)
    assert dict(spread(len, {"a": "xyz"}, Backend(1))) == {"a": 3}
    assert not worker.profile_history and not worker.profile_keys_history


@pytest.mark.slow
def test_a_real_worker_has_what_is_emptied():
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        found = dict(spread(_kept_after, dict.fromkeys(range(8), 1.2), Backend(1, cluster.scheduler_address)))
        with distributed.Client(cluster) as client:
            kept = client.run(lambda dask_worker: len(dask_worker.profile_history))
    assert len(found) == 8 and max(kept.values()) <= 2


def _kept_after(seconds):
    time.sleep(seconds)
