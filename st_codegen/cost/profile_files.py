"""The profiles that come with st-codegen."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

#: Profile that is used where none is named.
DEFAULT = "cx5140"


def profiles_folder() -> Path:
    """`profiles/` of the installed package, or of the checkout."""
    installed = Path(str(files("st_codegen"))) / "profiles"
    return installed if installed.is_dir() else Path(__file__).resolve().parent.parent.parent / "profiles"


def profile_names() -> list[str]:
    """The profiles that come with st-codegen."""
    return sorted(path.stem for path in profiles_folder().glob("*.toml"))
