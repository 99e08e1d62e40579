"""The soft PLC with its servers, from start to end."""

from __future__ import annotations

import asyncio
import errno
import signal
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from st_codegen.errors import InputError
from st_codegen.live.plc import Log, PlcState, SoftPlc, host_and_port


@dataclass(frozen=True)
class Listening:
    """Where clients are answered; a protocol without a port is not spoken. Port 0: any that is free."""

    host: str = "127.0.0.1"
    ads_port: int | None = None
    ams_port: int = 851
    opcua_port: int | None = None
    verbose: bool = False


async def serve(
    plc: SoftPlc, where: Listening, stopping: asyncio.Event, log: Log, ready: Callable[[dict[str, Any]], None]
) -> None:
    """Run the tasks and answer clients until `stopping` is set.

    `ready` is told the addresses once clients may come. Raises InputError where an address cannot be had.
    """
    servers: list[Any] = []
    addresses: dict[str, Any] = {}
    try:
        if where.ads_port is not None:
            from st_codegen.live.ads import AdsServer

            ads = AdsServer(plc, where.host, where.ads_port, where.ams_port, log, where.verbose)
            await _started(ads, host_and_port(where.host, where.ads_port))
            servers.append(ads)
            plc.after_batch = ads.notify
            addresses["ads"] = (where.host, ads.port)
        if where.opcua_port is not None:
            from st_codegen.live.opcua import OpcUaServer

            opcua = OpcUaServer(plc, where.host, where.opcua_port, log)
            await _started(opcua, host_and_port(where.host, where.opcua_port))
            servers.append(opcua)
            addresses["opcua"] = opcua.url
        ready(addresses)
        await plc.run(stopping)
    finally:
        plc.set_state(PlcState.STOP if plc.state is not PlcState.ERROR else plc.state)
        for server in servers:
            await server.stop()


async def _started(server: Any, address: str) -> None:
    try:
        await server.start()
    except (OSError, UnicodeError) as error:  # the latter for a text that can be no name of a host
        number, reason = getattr(error, "errno", None), getattr(error, "strerror", None)
        where = "another server running there" if number == errno.EADDRINUSE else "it an address of this machine"
        raise InputError(f"{address}: {reason or error}; is {where}?") from None


def run_until_signal(plc: SoftPlc, where: Listening, log: Log, ready: Callable[[dict[str, Any]], None]) -> bool:
    """Serve until SIGINT or SIGTERM; whether the tasks ran to the end."""

    async def main() -> None:
        stopping = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, stopping.set)
        await serve(plc, where, stopping, log, ready)

    asyncio.run(main())
    return plc.state is not PlcState.ERROR
