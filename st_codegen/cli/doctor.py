"""`st-codegen doctor`: what is installed, what is missing, and how to get it."""

from __future__ import annotations

import platform
import re
import sys
from importlib import metadata

import click

from st_codegen import __version__
from st_codegen.errors import is_older

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
        required = metadata.requires("st-codegen") or []
    except metadata.PackageNotFoundError:
        click.echo("not installed as a package, only on the path: the requirements are not known")
        return
    missing: list[str] = []
    lacking: list[str] = []
    for extra, packages in _by_extra(required).items():
        shown = []
        for name, least in packages.items():
            version = _version(name)
            bad = (
                f"{version}, TOO OLD ({least} is needed)" if is_older(version, least) else "" if version else "MISSING"
            )
            shown.append(f"{name} {bad or version}")
            if bad:
                missing += [extra] * (extra not in missing)
                lacking += [f"'{name}>={least}'" if least else name] * (not extra)
        click.echo(f"{extra or 'always'}: {', '.join(shown)}")
    for extra in filter(None, missing):
        click.echo(f"to get {extra}: pip install --upgrade 'st-codegen[{extra}]'")
    if lacking:
        click.echo(f"packages that are always needed are missing or too old: pip install {' '.join(lacking)}")
    sys.exit(1 if lacking else 0)


def _by_extra(required: list[str]) -> dict[str, dict[str, str]]:
    """The packages of each extra with their least versions, '' for those that are always needed."""
    found: dict[str, dict[str, str]] = {}
    for text in required:
        package = re.match(r"([A-Za-z0-9._-]+)(?:>=([\d.]+))?", text)
        extra = re.search(r"extra\s*==\s*['\"]([\w-]+)['\"]", text)
        key = extra[1] if extra else ""
        if package is not None and package[1] != "st-codegen" and key not in _COLLECTIONS:
            found.setdefault(key, {})[package[1]] = package[2] or ""
    return dict(sorted(found.items()))


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""
