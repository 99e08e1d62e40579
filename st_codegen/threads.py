"""Numerical libraries on one thread: results do not depend on the number of cores, and processes do not wait."""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Iterator


@contextlib.contextmanager
def one_thread(*modules: str) -> Iterator[None]:
    """Hold the linear algebra and the OpenMP of all loaded libraries to one thread inside the block.

    `modules` are imported first, since the limit holds for libraries that are loaded. On two busy cores the threads of
    small matrices wait for each other: a harmonic table took three times as long with two. Sums also have the same
    order then, and so the same digits on every number of cores. Without threadpoolctl (it comes with scikit-learn)
    nothing is held.
    """
    for module in modules:
        importlib.import_module(module)
    try:
        from threadpoolctl import threadpool_limits
    except ImportError:
        yield
        return
    with threadpool_limits(limits=1):
        yield
