"""Changes of generated text by hand, which a proof or a check has to notice."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np


def change_once(path: Path, pattern: str, change: str | Callable[[re.Match[str]], str]) -> None:
    """Change the first place of a file that a pattern matches; there must be one."""
    changed, count = re.subn(pattern, change, path.read_text(encoding="utf-8"), count=1)
    assert count == 1
    path.write_text(changed, encoding="utf-8")


def ulp(match: re.Match[str]) -> str:
    """What was matched first, and behind it the number next to the one that was matched second."""
    return match[1] + repr(float(np.nextafter(float(match[2]), np.inf)))
