"""How many examples a property test tries.

`HYPOTHESIS_PROFILE`: `repeat` (default) tries the same few examples every time, so that a red run means a changed
program; `explore` tries as many new ones; `nightly` (`make nightly`) tries twenty times as many new ones.
"""

from __future__ import annotations

import os
from typing import Any

from hypothesis import HealthCheck, settings

PROFILE = os.environ.get("HYPOTHESIS_PROFILE", "repeat")
_MOST = 50
_TIMES = 20 if PROFILE == "nightly" else 1
#: A machine may be slow: no example has a deadline, and making examples may take long.
_PATIENT: dict[str, Any] = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}


def register() -> None:
    """Make the profiles known and load the chosen one."""
    settings.register_profile("repeat", **_PATIENT, derandomize=True, max_examples=_MOST)
    settings.register_profile("explore", **_PATIENT, print_blob=True, max_examples=_MOST)
    settings.register_profile("nightly", **_PATIENT, print_blob=True, max_examples=_TIMES * _MOST)
    settings.load_profile(PROFILE)


def examples(count: int = _MOST, **others: Any) -> settings:
    """Settings of a test that tries `count` examples in a quick run; `others` are those of hypothesis."""
    assert count <= _MOST, "more belong into the nightly profile"
    others["suppress_health_check"] = [*others.get("suppress_health_check", ()), *_PATIENT["suppress_health_check"]]
    return settings(max_examples=_TIMES * count, deadline=None, **others)
