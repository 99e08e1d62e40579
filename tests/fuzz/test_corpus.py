"""Files that once crashed, hung, or were read wrongly: refused in one line, or accepted and equal, ever since."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.thorough

pytest.importorskip("polars")
pytest.importorskip("xgboost")
pytest.importorskip("onnxruntime")


def test_nothing_of_the_corpus_fails_again_and_every_seed_is_accepted():
    """In a process of its own: children of one in which libraries have threads would wait for these."""
    ended = subprocess.run(
        [sys.executable, "-W", "ignore", "-m", "tests.fuzz.replay"],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr[-3000:]
    results = json.loads(ended.stdout)
    assert len(results) >= 20
    for name, (result, shown) in results.items():
        wanted = {"accepted and equal"} if name.endswith("/seed") else {"refused", "accepted and equal"}
        assert result in wanted, (name, result, shown)
