"""`st-codegen doctor`: what is installed, what is missing, and how to get it."""

from __future__ import annotations

import platform
import sys
from importlib import metadata

import click

from st_codegen import __version__
from st_codegen.errors import is_older, requirements

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

    Exit code 1 where a package that st-codegen always needs is missing or too old.
    """
    click.echo(f"st-codegen {__version__}, Python {platform.python_version()} on {platform.platform()}")
    click.echo(f"from {sys.prefix}")
    try:
        required = requirements()
    except metadata.PackageNotFoundError:
        click.echo("not installed as a package, only on the path: the requirements are not known")
        return
    lacking: dict[str, list[str]] = {}
    for extra in sorted({one.extra for one in required} - _COLLECTIONS):
        states = []
        for one in (one for one in required if one.extra == extra):
            version = state = _version(one.package)
            if not version:
                state = "MISSING"
            elif is_older(version, one.least):
                state = f"{version}, TOO OLD ({one.least} is needed)"
            states.append(f"{one.package} {state}")
            if state != version:
                lacking.setdefault(extra, []).append(f'"{one.package}>={one.least}"' if one.least else one.package)
        click.echo(f"{extra or 'always'}: {', '.join(states)}")
    for extra in filter(None, lacking):
        # double quotes: cmd of Windows knows no others
        click.echo(f'to get {extra}: pip install --upgrade "st-codegen[{extra}]"')
    if "" in lacking:
        click.echo(f"packages that are always needed are missing or too old: pip install {' '.join(lacking[''])}")
    sys.exit(1 if "" in lacking else 0)


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""
