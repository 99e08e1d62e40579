"""`st-codegen doctor`: what is installed, what is missing, and how to get it."""

from __future__ import annotations

import platform
import re
import sys
from importlib import metadata

import click

from st_codegen import __version__

#: Extras that collect others, and those of developers.
_COLLECTIONS = {"all", "dev"}


@click.command(
    "doctor",
    epilog="""\b
Examples:
  st-codegen doctor""",
)
def command() -> None:
    """Show versions of Python, st-codegen and the packages of each extra, what is missing, and how to get it.

    Exit code 1 where a package that st-codegen always needs is missing.
    """
    click.echo(f"st-codegen {__version__}, Python {platform.python_version()} on {platform.platform()}")
    click.echo(f"from {sys.prefix}")
    try:
        required = metadata.requires("st-codegen") or []
    except metadata.PackageNotFoundError:
        click.echo("not installed as a package, only on the path: the requirements are not known")
        return
    missing: list[str] = []
    for extra, names in _by_extra(required).items():
        states = {name: _version(name) for name in names}
        shown = ", ".join(f"{name} {version or 'MISSING'}" for name, version in states.items())
        click.echo(f"{extra or 'always'}: {shown}")
        if not all(states.values()):
            missing.append(extra)
    for extra in filter(None, missing):
        click.echo(f"to get {extra}: pip install 'st-codegen[{extra}]'")
    if "" in missing:
        lacking = " ".join(name for name in _by_extra(required)[""] if not _version(name))
        click.echo(f"packages that are always needed are missing: pip install {lacking}")
    sys.exit(1 if "" in missing else 0)


def _by_extra(required: list[str]) -> dict[str, list[str]]:
    """The names of the packages of each extra, '' for those that are always needed."""
    found: dict[str, list[str]] = {}
    for text in required:
        name = re.match(r"[A-Za-z0-9._-]+", text)
        extra = re.search(r"extra\s*==\s*['\"]([\w-]+)['\"]", text)
        key = extra[1] if extra else ""
        if name is not None and name[0] != "st-codegen" and key not in _COLLECTIONS:
            found.setdefault(key, []).append(name[0])
    return dict(sorted(found.items()))


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""
