"""`st-codegen latency`: from encoder to correction for given tasks."""

from __future__ import annotations

import json
import math
from dataclasses import asdict

import click

from st_codegen.cli.choices import EXCHANGES
from st_codegen.cli.console import Number, Whole
from st_codegen.errors import Problems


@click.command(
    "latency",
    epilog="""\b
Examples:
  st-codegen latency --fast 250 --slow 500 --output 75.3      the paper's controller: 1325.3 us, 754.5 Hz
  st-codegen latency --fast 250 --output 75.3                 all in one task, or the sum in the fast one
  st-codegen latency --fast 250 --slow 500 --order 240 --json""",
)
@click.option(
    "--fast", type=Number(min=0.1), required=True, metavar="US", help="Cycle time of the task with encoder and axes."
)
@click.option(
    "--slow", type=Number(min=0.1), metavar="US", help="Cycle time of a slower task between reading and correcting."
)
@click.option("--slow-offset", type=Number(), default=0.0, metavar="US", help="Start of its first cycle.")
@click.option("--fast-run", type=Number(), default=0.0, metavar="US", help="Time of one run, for --exchange end.")
@click.option("--slow-run", type=Number(), default=0.0, metavar="US", help="Time of one run, for --exchange end.")
@click.option(
    "--bus",
    type=Number(min=0),
    metavar="US",
    help="Cycle of the bus that latches the encoder. Default: that of --fast; 0: the task reads the encoder itself.",
)
@click.option(
    "--output", "output_us", type=Number(), default=0.0, metavar="US", help="From the last exchange to the axis."
)
@click.option(
    "--exchange",
    type=click.Choice(EXCHANGES),
    default=EXCHANGES[0],
    help="When a task hands its results over: at the start of its next cycle, or at the end of its run.",
)
@click.option("--order", type=Whole(min=1), default=240, help="Highest order to correct.")
@click.option("--json", "as_json", is_flag=True, help="Print the numbers as JSON.")
def command(
    fast: float,
    slow: float | None,
    slow_offset: float,
    fast_run: float,
    slow_run: float,
    bus: float | None,
    output_us: float,
    exchange: str,
    order: int,
    as_json: bool,
) -> None:
    """Age of an angle when the correction made from it arrives: of a new one, and of those in use.

    Without --slow everything is done in one task. With FB_CompensatorFast only coefficients come from the slow task:
    its angle takes the way of one task. The mean age is what fLead_s of the compensator should be, if the drive adds
    nothing.
    """
    from st_codegen.te.latency import LONGEST_LEAD_S, Exchange, TaskTiming, latency

    problems = Problems("latency")
    if slow is None and (slow_offset or slow_run):
        problems.add("--slow-offset and --slow-run are of the slow task: give --slow")
    if exchange == Exchange.AT_START and (fast_run or slow_run):
        problems.add("--fast-run and --slow-run have no part in an exchange at the start: give --exchange end")
    if slow is not None and slow < fast:
        problems.add(f"--slow {slow:g} is less than --fast {fast:g}: the slow task has the longer cycle")
    problems.raise_if_any()
    first = TaskTiming("fast", fast, run_us=fast_run)
    chain = [first] if slow is None else [first, TaskTiming("slow", slow, slow_offset, slow_run), first]
    if bus != 0:
        # the bus delivers what it latched when its next cycle begins, whatever the tasks do
        cycle = fast if bus is None else bus
        chain = [TaskTiming("bus", cycle, run_us=cycle), *chain]
    found = latency(chain, output_us=output_us, exchange=Exchange(exchange))
    if as_json:
        more = {
            "frequency_hz": found.frequency_hz,
            "order": order,
            "output_speed_rpm": found.output_speed_rpm(order),
            "lead_s": found.mean_us * 1e-6,
        }
        click.echo(json.dumps({**asdict(found), **more}, indent=1))
        return
    new = f"{found.best_us:.10g} to " if found.best_us < found.slowest_us else ""
    times = (found.slowest_us, found.mean_us, found.worst_us)
    click.echo(f"delay: {new}" + "{:.10g} us of a new value, {:.7g} us in the mean, {:.10g} us at most".format(*times))
    click.echo(f"upper limit of the correction: {_down(found.frequency_hz)} Hz")
    click.echo(f"order {order} up to {_down(found.output_speed_rpm(order))} rpm at the output shaft")
    lead_s = found.mean_us * 1e-6
    takes = "" if lead_s <= LONGEST_LEAD_S else f", which it refuses: it takes {LONGEST_LEAD_S} at most"
    click.echo(f"lead time for the compensator: fLead_s := {lead_s:.7f}{takes}")


def _down(limit: float) -> str:
    """A limit rounded down: what is printed can be reached."""
    return f"{math.floor(round(10.0 * limit, 6)) / 10.0:.1f}"
