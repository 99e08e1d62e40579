"""Cross-validation of many candidates on many targets: parallel, resumable, the same bits for the same seed.

A task is one candidate on one target: it is fitted once a fold for predictions of the rows left out, and once on all
rows for the test points. Tasks are independent, so they run in processes of this machine or on a Dask cluster.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from st_codegen.errors import InputError, extra_package
from st_codegen.ir.arrays import FloatArray
from st_codegen.processes import Progress, end_with_parent, interruptible
from st_codegen.threads import one_thread
from st_codegen.training.cost import worst_case_us
from st_codegen.training.families import Learner
from st_codegen.training.store import FitStore

#: How long a Dask scheduler may take to answer.
TIMEOUT = "10s"
#: What must be loaded before its threads are limited.
LEARNERS = ("sklearn.ensemble", "sklearn.svm")
_LIBRARIES = ("numpy", "scikit-learn", "lightgbm", "xgboost-cpu")
_K = TypeVar("_K")
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class FitTask:
    """A candidate on one target: rows to learn from, rows to predict. `folds` of 1 or less: no cross-validation."""

    candidate: Learner
    x: FloatArray
    y: FloatArray
    x_test: FloatArray
    folds: int
    seed: int
    name: str = ""

    @property
    def key(self) -> str:
        """SHA-256 over all that decides the result, the versions of the libraries included."""
        digest = hashlib.sha256(f"{self.candidate.key}|{self.folds}|{self.seed}|{versions(_LIBRARIES)}".encode())
        digest.update(fold_numbers(self.x, self.folds, self.seed).tobytes())
        for array in (self.x, self.y, self.x_test):
            digest.update(str(array.shape).encode())
            digest.update(np.ascontiguousarray(array, np.float64).tobytes())
        return digest.hexdigest()


@dataclass(frozen=True)
class FitOutcome:
    """Predictions of a task: of each row by the model that did not see it (n,), and of the test points.

    cost_us: worst case of one evaluation (see `cost`), infinite for what cannot be compiled.
    """

    folds: FloatArray
    test: FloatArray
    cost_us: float


@lru_cache
def versions(libraries: tuple[str, ...]) -> str:
    """The versions of those of some libraries that are installed, as text for a key."""
    found = {}
    for name in libraries:
        with contextlib.suppress(PackageNotFoundError):
            found[name] = version(name)
    return json.dumps(found)


def point_numbers(x: FloatArray) -> npt.NDArray[np.intp]:
    """The operating point of each row of x (n, features), (n,): numbers from 0, in the order in which points appear."""
    _, first, inverse = np.unique(x, axis=0, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[inverse.reshape(-1)]


def fold_numbers(x: FloatArray, folds: int, seed: int) -> npt.NDArray[np.intp]:
    """The fold of each row of x (n, features), (n,): parts with about as many operating points each, at random.

    Runs at one point are of one fold, or a model would be judged at points that it has learned. There are at most as
    many folds as points.
    """
    points = point_numbers(x)
    count = int(points.max(initial=-1)) + 1
    numbers = np.arange(count) % max(1, min(folds, count))
    return np.random.default_rng(seed).permutation(numbers)[points]


def run_task(task: FitTask) -> FitOutcome:
    """Fit and predict, in one thread of every library."""
    with one_thread(*LEARNERS):
        folds = np.full(len(task.y), np.nan)
        if task.folds > 1:
            number = fold_numbers(task.x, task.folds, task.seed)
            for fold in np.unique(number):
                left_out = number == fold
                model = task.candidate.fit(task.x[~left_out], task.y[~left_out], task.seed)
                folds[left_out] = model.predict(task.x[left_out])
        model = task.candidate.fit(task.x, task.y, task.seed)
        test = model.predict(task.x_test) if len(task.x_test) else np.empty(0)
    try:
        cost = worst_case_us(model)
    except InputError:
        cost = np.inf
    return FitOutcome(folds, np.asarray(test, np.float64), cost)


@dataclass(frozen=True)
class Backend:
    """Where tasks run: `jobs` processes here, or the workers of the Dask scheduler at an address."""

    jobs: int = 1
    scheduler: str | None = None

    @contextlib.contextmanager
    def configured(self) -> Iterator[None]:
        """joblib set up for it. Raises MissingExtraError, and InputError where no scheduler answers."""
        joblib = extra_package("joblib", "train", "training")
        if self.scheduler is None:
            # a job alone has no workers: it may run in a worker of another backend
            with joblib.parallel_config(**({"backend": "sequential"} if self.jobs == 1 else {"n_jobs": self.jobs})):
                yield
            return
        distributed = extra_package("distributed", "dask", "training on a Dask cluster")
        try:
            client = distributed.Client(self.scheduler, timeout=TIMEOUT, set_as_default=True)
        except (OSError, ValueError) as error:
            raise InputError(f"no Dask scheduler answers at '{self.scheduler}' ({error})") from None
        with client, joblib.parallel_config(backend="dask", n_jobs=-1):
            yield


@dataclass(frozen=True)
class Fitting:
    """Where fits run, where finished ones are kept, and who is told of each."""

    store: FitStore
    backend: Backend = Backend()
    progress: Progress | None = None

    def outcomes(self, tasks: Sequence[FitTask]) -> tuple[FitOutcome, ...]:
        """Those of all tasks, in their order; what the store has is not run again, what is finished goes into it."""
        keys = [task.key for task in tasks]
        found: dict[str, FitOutcome] = {}
        missing: dict[str, FitTask] = {}
        for key, task in zip(keys, tasks, strict=True):
            known = self.store.get(key)
            if known is not None:
                found[key] = FitOutcome(*known)
            else:
                missing.setdefault(key, task)
        for done, (key, outcome) in enumerate(spread(run_task, missing, self.backend), len(tasks) - len(missing) + 1):
            self.store.put(key, outcome.folds, outcome.test, outcome.cost_us)
            found[key] = outcome
            if self.progress:
                self.progress(done, len(tasks), missing[key].name)
        return tuple(found[key] for key in keys)


def spread(
    work: Callable[[_Item], _Result], items: Mapping[_K, _Item], backend: Backend
) -> Iterator[tuple[_K, _Result]]:
    """Do a work on each item where the backend says, and give each result with its key as soon as it is there."""
    if not items:
        return
    with backend.configured(), interruptible():
        import joblib

        parallel: Any = joblib.Parallel(return_as="generator_unordered", batch_size=1, pre_dispatch="4*n_jobs")
        yield from parallel(joblib.delayed(_keyed)(work, key, item) for key, item in items.items())


def _keyed(work: Callable[[_Item], _Result], key: _K, item: _Item) -> tuple[_K, _Result]:
    end_with_parent()
    result = work(item)
    _forget_samples()
    return key, result


def _forget_samples() -> None:
    """Drop the call stacks that a Dask worker has sampled, a hundred a second: it keeps those of an hour, 0.7 MB/s."""
    if "distributed" in sys.modules:
        from distributed import get_worker

        with contextlib.suppress(ValueError):  # not in a worker
            worker: Any = get_worker()
            for history in (worker.profile_history, worker.profile_keys_history):
                worker.loop.add_callback(history.clear)  # there, where a page may be reading it
