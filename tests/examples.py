"""How many examples a property test tries.

`HYPOTHESIS_PROFILE`: `repeat` (default) tries the same few examples every time, so that a red run means a changed
program; `explore` tries as many new ones; `nightly` (`make nightly`) tries twenty times as many new ones.
"""

from __future__ import annotations

import os
from typing import Any

from hypothesis import settings

PROFILE = os.environ.get("HYPOTHESIS_PROFILE", "repeat")
_MOST = 50
_TIMES = 20 if PROFILE == "nightly" else 1


def register() -> None:
    """Make the profiles known and load the chosen one."""
    settings.register_profile("repeat", derandomize=True, deadline=None, max_examples=_MOST)
    settings.register_profile("explore", deadline=None, print_blob=True, max_examples=_MOST)
    settings.register_profile("nightly", deadline=None, print_blob=True, max_examples=_TIMES * _MOST)
    settings.load_profile(PROFILE)


def examples(count: int = _MOST, **others: Any) -> settings:
    """Settings of a test that tries `count` examples in a quick run; `others` are those of hypothesis."""
    assert count <= _MOST, "more belong into the nightly profile"
    return settings(max_examples=_TIMES * count, deadline=None, **others)
