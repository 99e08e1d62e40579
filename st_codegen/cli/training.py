"""What the commands that train share: options of a search, and how they become settings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from st_codegen.cli.choices import FAMILIES, LARGEST_SEED
from st_codegen.cli.console import FILE, Whole, gathered, refuse_unused, together
from st_codegen.errors import InputError

if TYPE_CHECKING:
    from st_codegen.training.search import Backend
    from st_codegen.training.study import SearchSettings


def _settings(families: str, folds: int, seed: int) -> SearchSettings:
    """The settings of a search. Raises InputError for an unknown family."""
    from st_codegen.training.families import candidates
    from st_codegen.training.study import SearchSettings

    names = [name.strip() for name in families.split(",") if name.strip()]
    if not names:
        raise InputError(f"--families is empty; known are {', '.join(FAMILIES)}")
    return SearchSettings(candidates(names), folds, seed)


def _backend(backend: str, scheduler: str | None, jobs: int | None) -> Backend:
    """Where fits run. Raises InputError where backend and scheduler do not fit together."""
    from st_codegen.training.search import Backend

    if (backend == "dask") != (scheduler is not None):
        raise InputError("--backend dask and --scheduler ADDRESS go together: give both or none")
    if scheduler is not None:
        refuse_unused("on a Dask cluster, whose workers are as many as they are", "jobs")
    return Backend(-1 if jobs is None else jobs, scheduler)


#: The options --families, --folds and --seed: `settings`.
_settings_options = gathered(
    "settings",
    _settings,
    click.option(
        "--families",
        default=",".join(FAMILIES),
        metavar="NAMES",
        help="Families to try, with commas between; train leaves out those that its --format cannot save, always ELM.",
    ),
    click.option(
        "--folds", type=Whole(min=2), default=10, help="Parts of the validation, no more than operating points."
    ),
    click.option(
        "--seed",
        type=Whole(min=0, max=LARGEST_SEED),
        default=0,
        help="The same seed gives the same numbers; the bytes of .skops files differ each time.",
    ),
)
#: The options --backend, --scheduler and --jobs: `where`.
place_options = gathered(
    "where",
    _backend,
    click.option(
        "-j", "--jobs", type=Whole(min=1), default=None, help="Worker processes at most (default: all cores)."
    ),
    click.option(
        "--backend",
        type=click.Choice(["local", "dask"]),
        default="local",
        help="Where work is done: processes of this machine, or the workers of a Dask cluster.",
    ),
    click.option("--scheduler", metavar="ADDRESS", help="Address of the Dask scheduler, as in tcp://host:8786."),
)
#: The options of a search: `settings`, `where` and `work`.
search_options = together(
    _settings_options,
    place_options,
    click.option(
        "--work",
        type=FILE,
        default=Path("build/fits.sqlite"),
        help="File of finished fits: a run that was stopped goes on where it was.",
    ),
)
