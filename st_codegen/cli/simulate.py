"""`st-codegen simulate`: measurements and motions of the simulated rig; one file a subcommand."""

from __future__ import annotations

import click

from st_codegen.cli.lazy import Lazy, LazyGroup

_SUBCOMMANDS = {
    "campaign": Lazy("st_codegen.cli.simulate_campaign", "Write curve files of the simulated rig."),
    "motion": Lazy("st_codegen.cli.simulate_motion", "Move the rig with the generated code in its loop."),
}


@click.group(
    "simulate",
    cls=LazyGroup,
    lazy=_SUBCOMMANDS,
    epilog="""\b
Examples:
  st-codegen simulate campaign --rig examples/rv160n/rig.toml --conditions C.csv --out campaign
  st-codegen simulate motion --models models/ --rig rig.toml --profile cycloidal --out build/motion""",
)
def command() -> None:
    """Simulate the rig: measured campaigns, and motions with the generated code in the loop."""
