"""`st-codegen serve`: a soft PLC that runs generated text and answers clients."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import click

from st_codegen.cli.console import PLACE, Number, Whole, generated_option, refuse_unused
from st_codegen.errors import InputError


@click.command(
    "serve",
    epilog="""\b
Examples:
  st-codegen serve --generated generated --ads
  st-codegen serve --generated generated --ads --opcua
  st-codegen serve --generated generated --ads --rig examples/rv160n/rig.toml --speed 0

\b
A client then finds the PLC at the AMS net id 127.0.0.1.1.1, port 851, and at opc.tcp://127.0.0.1:4840/.""",
)
@generated_option("Folder that `generate` wrote; of several targets twincat runs, else the first.")
@click.option("--ads", is_flag=True, help="Answer ADS over TCP.")
@click.option("--opcua", is_flag=True, help="Answer OPC UA.")
@click.option("--listen", default="127.0.0.1", metavar="ADDRESS", help="Address to listen at.")
@click.option("--ads-port", type=Whole(min=0, max=65535), default=48898, help="TCP port of ADS; 0: a free one.")
@click.option("--ams-port", type=Whole(min=1, max=65535), default=851, help="AMS port of the runtime.")
@click.option("--opcua-port", type=Whole(min=1, max=65535), default=4840, help="TCP port of OPC UA.")
@click.option(
    "--cycle-us",
    type=Whole(min=10, max=1_000_000),
    default=500,
    help="Cycle time of programs that no task calls; tasks have their own.",
)
@click.option(
    "--speed",
    type=Number(min=0, max=1e6),
    default=1.0,
    help="How many times as fast as the clock; 0: as fast as this machine can.",
)
@click.option("--rig", type=PLACE, help="Put this simulated rig behind the signals.")
@click.option("--seed", type=Whole(min=0), default=0, help="Seed of the rig's noise.")
@click.option("-v", "--verbose", is_flag=True, help="Log every write of a client.")
def command(
    generated: Path,
    ads: bool,
    opcua: bool,
    listen: str,
    ads_port: int,
    ams_port: int,
    opcua_port: int,
    cycle_us: int,
    speed: float,
    rig: Path | None,
    seed: int,
    verbose: bool,
) -> None:
    """Run the tasks of generated text as a controller does, and answer unmodified ADS and OPC UA clients.

    Clients may write inputs only. It ends at SIGINT or SIGTERM; exit code 1 when the tasks had stopped before that, as
    a controller stops at a division by zero.
    """
    from st_codegen.live.plc import SoftPlc, host_and_port
    from st_codegen.live.serve import Listening, run_until_signal
    from st_codegen.proof.runner import target_folders

    if not ads and not opcua:
        raise InputError("name a protocol: --ads, --opcua or both")
    if not listen.strip():
        raise InputError("--listen: an empty text would be all addresses of this machine; for them say 0.0.0.0")
    of_others = {"ads_port": ads, "ams_port": ads, "opcua_port": opcua, "seed": rig}
    refuse_unused("without the --ads, --opcua or --rig they are of", *(one for one in of_others if not of_others[one]))
    folders = target_folders(generated)
    folder = next((folder for folder in folders if folder.name == "twincat"), folders[0])
    begin = time.monotonic()

    def log(text: str) -> None:
        click.echo(f"{time.monotonic() - begin:10.3f} s  {text}", err=True)

    plc = SoftPlc(folder, cycle_us=cycle_us, speed=speed, log=log)
    for task in plc.tasks:
        log(f"task {task.name}: {task.cycle_us} us, {', '.join(task.programs)}")

    if rig is not None:
        from st_codegen.live.plant import plant_behind

        plc.connect(plant_behind(plc, rig, seed))
        log(f"{rig} behind the signals")

    def ready(addresses: dict[str, Any]) -> None:
        if "ads" in addresses:
            click.echo(f"ADS {host_and_port(*addresses['ads'])}, AMS port {ams_port}")
        if "opcua" in addresses:
            click.echo(f"OPC UA {addresses['opcua']}")
        sys.stdout.flush()

    where = Listening(listen, ads_port if ads else None, ams_port, opcua_port if opcua else None, verbose)
    went_well = run_until_signal(plc, where, log, ready)
    log(f"stopped after {plc.time_s:.3f} s of the controller's time")
    if plc.late:
        log(f"{plc.late:,} ticks were left out: this machine is too slow for --speed {speed:g}")
    sys.exit(0 if went_well else 1)
