"""`st-codegen init`: the configuration of a folder of models, from what the files know."""

from __future__ import annotations

import tomllib
from functools import partial
from pathlib import Path

import click

from st_codegen.cli.console import FOLDER, PLACE, quiet_option, reading_words, say, trust_option


@click.command(
    "init",
    epilog="""\b
Examples:
  st-codegen init models/
  st-codegen init models/ --training-data train.csv      with the range of each feature in that table
  st-codegen init models/ --force                        over a configuration that is there""",
)
@click.argument("models", type=FOLDER)
@click.option(
    "--training-data",
    type=PLACE,
    default=None,
    help="CSV with a column for each feature, by its name in the models: writes lowest and highest value of each, and "
    "the file's SHA-256.",
)
@click.option("--force", is_flag=True, help="Replace a configuration that is there.")
@trust_option
@quiet_option
def command(models: Path, training_data: Path | None, force: bool, trust_pickle: bool, quiet: bool) -> None:
    """Write st-codegen.toml into the folder MODELS: names and units of its models, to be completed by hand.

    Files that cannot be read as models are left out, with the reason beside them.
    """
    from st_codegen.errors import InputError
    from st_codegen.files.made_by import command_line
    from st_codegen.files.text import file_sha256, write_text
    from st_codegen.project.configuration import CONFIGURATION_FILE
    from st_codegen.project.initial import initial_configuration
    from st_codegen.proof.predict import read_table

    path = models / CONFIGURATION_FILE
    if path.exists() and not force:
        raise InputError(f"{path} is there already; --force replaces it")
    table = None if training_data is None else partial(read_table, training_data)
    digest = "" if training_data is None else file_sha256(training_data)
    text = initial_configuration(models, table, digest, trust_pickle=trust_pickle)
    write_text(path, text)
    if not quiet:
        if left_out := tomllib.loads(text)["project"].get("leave_out"):
            say(f"left out, with the reason beside each in {path}: {', '.join(left_out)}")
        following = command_line("st-codegen", "generate", models, *reading_words(trust_pickle=trust_pickle))
        say(f"{path}: complete names, units and ranges, then {following}")
