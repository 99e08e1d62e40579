"""`st-codegen compare`: the models on a running controller against their libraries."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.text import Text

from st_codegen.cli.calibrate import must_be_a_profile, write_profile
from st_codegen.cli.codes import show_codes
from st_codegen.cli.console import (
    FILE,
    GivenModels,
    console,
    controller_options,
    generated_option,
    models_options,
    progress_bar,
    reading_options,
    refuse_unused,
    rows_options,
    say,
)
from st_codegen.cli.costs import profile_option
from st_codegen.cli.verify import agreement_table
from st_codegen.files.text import write_text

if TYPE_CHECKING:
    from st_codegen.cost.profile import Profile
    from st_codegen.live.controller import Controller
    from st_codegen.live.live_report import LiveReport


@click.command(
    "compare",
    epilog="""\b
Examples:
  st-codegen models/ --target twincat --with-comparison          then download, and start
  st-codegen compare models/ --ads 192.168.0.5.1.1:851 --html commissioning.html
  st-codegen compare models/ --ads 5.12.34.56.1.1:851@192.168.0.5 --block FB_Power --rows 100000
  st-codegen compare models/ --opcua opc.tcp://192.168.0.5:4840/ --json record.json --times times.csv
  st-codegen compare models/ --ads 192.168.0.5.1.1:851 --calibrated mine.toml
  st-codegen verify models/ --cycle-us 250 --profile mine.toml""",
)
@models_options
@generated_option("Folder that `generate --with-comparison` wrote, and that the controller runs.")
@controller_options
@click.option("--block", metavar="FB_X", help="Only this block. Default: the blocks of all models.")
@rows_options(
    "Rows a block, or as many more as special values, thresholds, leaves and cells take; around models 2,000 points."
)
@click.option(
    "--same-bits",
    is_flag=True,
    help="Fail where bits are not those of the text run here, also behind EXP, SIN and their like, of which a "
    "controller may have its own. For one that has those of this machine, such as serve.",
)
@click.option("--times", type=FILE, help="Write the measured times as `calibrate` takes them.")
@click.option(
    "--calibrated",
    type=FILE,
    help="Write a profile that is fitted to the measured times, as `calibrate` does, where all agree.",
)
@profile_option
@click.option("--json", "json_file", type=FILE, help="Write the record as JSON.")
@click.option("--html", type=FILE, help="Write the record as a page.")
@reading_options
def command(
    given: GivenModels,
    generated: Path,
    connect: Callable[[], Controller],
    block: str | None,
    rows: int,
    seed: int,
    same_bits: bool,
    times: Path | None,
    calibrated: Path | None,
    profile: str,
    json_file: Path | None,
    html: Path | None,
) -> None:
    """Run rows of inputs through MODELS on a controller and compare its answers with the libraries'.

    The rows are thresholds and their neighbours where they are reached, rows for leaves and cells (of large models not
    for all, which is said), special values, and random ones. Every answer must be the library's, to the bit or within
    the derived bound. Exit code 0 when all agree, 1 when not, 2 where the controller cannot be reached, is not in RUN
    or runs another project.
    """
    from st_codegen.cost.profile import load_profile
    from st_codegen.live.compare import compare, generated_folder
    from st_codegen.live.live_report import times_csv

    if calibrated is None:
        refuse_unused("without --calibrated, which starts from it", "profile")
    else:
        must_be_a_profile(calibrated)
    base = load_profile(profile)
    folder = generated_folder(generated)
    bundle = given.load_generated(generated)
    with progress_bar("comparing", quiet=given.quiet) as progress:
        report = compare(bundle, folder, connect, rows=rows, seed=seed, block=block, progress=progress)
    report.same_bits = same_bits
    _write(report, given.models, json_file, html)
    unknown = _why_no_times(report)
    if times is not None and not unknown:
        write_text(times, times_csv(report))
    if not given.quiet:
        console.print(agreement_table(f"library and controller compared, {report.address}", report.models))
        for line in report.remarks():
            say(line)
    for name, line in report.failures():
        say(Text.assemble((name, "red"), f": {line}"))
    if times is not None and unknown:
        say(f"{times} is not written: {unknown}")
    if calibrated is not None:
        _calibrate(report, folder, base, calibrated, quiet=given.quiet)
    if not report.passed:
        show_codes(["STC2003"])
    sys.exit(0 if report.passed else 1)


def _why_no_times(report: LiveReport) -> str:
    """Why times are kept nowhere; empty where they are."""
    from st_codegen.live.live_report import known_times

    if not report.passed:
        return "the times may be those of another text"
    if not report.times:
        return "what was compared takes several calls for a row, and the time of one is not known"
    return "" if known_times(report) else "all calls were quicker than the controller's clock"


def _write(report: LiveReport, models: Path, json_file: Path | None, html: Path | None) -> None:
    """The record as JSON and as a page, where they are asked for."""
    from st_codegen.live.live_report import record_of, record_sections

    if json_file is not None:
        write_text(json_file, json.dumps(record_of(report), indent=1) + "\n")
    if html is not None:
        from st_codegen.cli.pages import write_pages

        summary, sections = record_sections(report)
        write_pages(f"Commissioning record of {models}", sections, summary, html, None)


def _calibrate(report: LiveReport, folder: Path, base: Profile, out: Path, *, quiet: bool) -> None:
    """The profile that was asked for, or why there is none."""
    from st_codegen.cost.calibrate import Measurement
    from st_codegen.live.live_report import known_times

    measured = tuple(Measurement(name, False, high_us) for name, high_us in known_times(report).items())
    if unknown := _why_no_times(report):
        say(f"{out} is not written: {unknown}")
    else:
        write_profile(folder, base, measured, out, quiet=quiet)
