"""A plugin of pytest that tells coverage which test runs, and times those that pass: `-p tests.mutation.contexts`."""

import json
import time
from collections import defaultdict
from collections.abc import Generator
from pathlib import Path

import coverage
import pytest

_seconds: defaultdict[str, float] = defaultdict(float)
_failed: set[str] = set()


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, None, None]:
    """Name the context of a test, its fixtures included, and add up its processor time."""
    measured = coverage.Coverage.current()
    if measured is not None:
        measured.switch_context(item.nodeid)
    start = time.process_time()
    yield
    _seconds[item.nodeid] += time.process_time() - start
    if measured is not None:
        measured.switch_context("")


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Remember what failed."""
    if report.failed:
        _failed.add(report.nodeid)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write the seconds of each test that passed beside the data of coverage."""
    measured = coverage.Coverage.current()
    if measured is not None:
        Path(f"{measured.config.data_file}.seconds").write_text(
            json.dumps({test: seconds for test, seconds in _seconds.items() if test not in _failed})
        )
