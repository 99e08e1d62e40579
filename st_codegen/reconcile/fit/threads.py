"""Linear algebra on one thread: the matrices are small, and threads cost more than they bring."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext


def one_thread() -> AbstractContextManager[object]:
    """Holds BLAS to one thread while it is entered, where threadpoolctl (it comes with scikit-learn) is installed.

    On a busy machine of two cores the threads wait for each other: a harmonic table took three times as long with two.
    The sums also have the same order then, so a report has the same digits on every number of cores.
    """
    try:
        from threadpoolctl import threadpool_limits
    except ImportError:
        return nullcontext()
    limits: AbstractContextManager[object] = threadpool_limits(limits=1, user_api="blas")
    return limits
