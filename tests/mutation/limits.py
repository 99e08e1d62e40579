"""A plugin of pytest that ends a test which goes on for much longer than it did unchanged: `-p tests.mutation.limits`.

One limit for all tests of a mutant would let the first one loop for as long as all of them may take.
"""

import json
import os
import resource
import time
from pathlib import Path

import pytest

#: The variable of the environment that names a file of the seconds of processor time that each test may take.
LIMITS = "ST_CODEGEN_TEST_LIMITS"


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_logstart(nodeid: str) -> None:
    """Let the process be ended where the test that starts takes longer than it may."""
    seconds = json.loads(Path(os.environ[LIMITS]).read_text())[nodeid]
    # the hard limit stays: tests give limits of their own to processes, which none could raise
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    resource.setrlimit(resource.RLIMIT_CPU, (int(time.process_time() + seconds) + 1, hard))
