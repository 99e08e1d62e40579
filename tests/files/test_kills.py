"""Writers that are killed at each of their steps leave what was there, or what they were to write, and no rubbish."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("fcntl")
pytest.importorskip("polars")
pytest.importorskip("skops")


@pytest.mark.thorough
def test_a_killed_writer_leaves_the_old_files_or_the_new_ones(tmp_path):
    program = [sys.executable, "-W", "ignore", "-m", "tests.files.kills", str(tmp_path)]
    ended = subprocess.run(program, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr[-3000:]
    found = json.loads(ended.stdout)
    assert len(found) == 5
    for name, counts in found.items():
        assert counts["torn"] == 0, (name, counts)
        assert counts["left"] == [], (name, counts)
        # killed while it wrote the old files stayed, killed while it tidied up the new ones were there
        assert counts["old"] > 10, (name, counts)
        assert counts["new"] > 1, (name, counts)
        # only in a folder that existed files take their places one by one, each of them whole
        assert bool(counts["mixed"]) == (name == "texts over another"), (name, counts)
