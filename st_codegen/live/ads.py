"""ADS over TCP for the soft PLC.

Packets are taken apart and put together by the server that pyads has for its own tests. Its connections take what one
`recv` of 4096 bytes gives for a packet, and its handlers keep copies of values, so that framing and handling are ours:
packets of any length, and variables that live in a machine that runs.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from st_codegen.errors import MissingExtraError
from st_codegen.live.controller import SOFT_PLC
from st_codegen.live.plc import Log, PlcState, SoftPlc
from st_codegen.live.symbols import WireVariable, type_name
from st_codegen.st.types import ArrayType, Elementary, EnumType, Kind, Type

try:
    from pyads import constants as c
    from pyads.testserver import AmsPacket, AmsResponseData
    from pyads.testserver.testserver import AdsClientConnection
except (ImportError, OSError) as missing:  # OSError: the library of the protocol is not there
    raise MissingExtraError("pyads", "live", "ADS") from missing

#: Error codes of ADS.
_NO_PORT, _NO_SERVICE, _NO_GROUP, _NO_OFFSET, _REFUSED, _WRONG_SIZE = 6, 1793, 1794, 1795, 1796, 1797
_WRONG_VALUE, _NO_SYMBOL, _WRONG_STATE, _NO_NOTIFICATION = 1798, 1808, 1810, 1812
#: Where the variables of a PLC are, as TwinCAT has it. Offsets are numbers of variables here, not addresses.
_VARIABLES = 0x4040
_LONGEST = 16 * 1024 * 1024
_STATES = {
    PlcState.RUN: c.ADSSTATE_RUN,
    PlcState.STOP: c.ADSSTATE_STOP,
    PlcState.CONFIG: c.ADSSTATE_CONFIG,
    PlcState.ERROR: c.ADSSTATE_ERROR,
}
#: Days from 1601, where the clock of Windows begins, to 1970, in units of 100 ns.
_FILETIME_1970 = 116_444_736_000_000_000


class AdsRefusalError(Exception):
    """A request is answered with an error code."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


@dataclass
class _Notification:
    """What a client is told of a variable: each time it changes, or each time some time has passed."""

    symbol: WireVariable
    on_change: bool
    cycle_s: float
    due: float = -math.inf
    last: bytes | None = None


class AdsServer:
    """Answers clients at an address; `ams_port` is the port of the runtime, 851 for the first."""

    def __init__(self, plc: SoftPlc, host: str, port: int, ams_port: int, log: Log, verbose: bool = False) -> None:
        self.plc = plc
        self.host, self.port, self.ams_port = host, port, ams_port
        self.log = log
        self.verbose = verbose
        self._server: asyncio.Server | None = None
        self._clients: set[_Client] = set()
        self._served: set[asyncio.Task[Any]] = set()
        self._by_offset: dict[int, WireVariable] = {}
        self._offsets: dict[str, int] = {}

    async def start(self) -> None:
        """Listen; `port` is then the one that was given, or the free one that was found for 0."""
        self._server = await asyncio.start_server(self._serve, self.host, self.port)
        self.port = self._server.sockets[0].getsockname()[1]

    async def stop(self) -> None:
        """Close all connections."""
        if self._server is not None:
            self._server.close()
        for client in list(self._clients):
            client.writer.close()
        await asyncio.gather(*self._served, return_exceptions=True)

    def notify(self) -> None:
        """Tell clients what has changed."""
        for client in list(self._clients):
            client.notify()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        client = _Client(self, writer)
        self._clients.add(client)
        task = asyncio.current_task()
        assert task is not None
        self._served.add(task)
        task.add_done_callback(self._served.discard)
        self.log(f"ADS {client.name}: connected")
        try:
            while True:
                header = await reader.readexactly(6)
                length = struct.unpack("<I", header[2:])[0]
                if not 32 <= length <= _LONGEST:
                    self.log(f"ADS {client.name}: a packet of {length} bytes is none; closed")
                    break
                request = AdsClientConnection.construct_request(header + await reader.readexactly(length))
                answer = client.answer(request)
                writer.write(AdsClientConnection.construct_response(answer, request))
                await writer.drain()
        except (asyncio.IncompleteReadError, ConnectionError):
            pass
        finally:
            self._clients.discard(client)
            writer.close()
            with contextlib.suppress(ConnectionError):
                await writer.wait_closed()
            self.log(f"ADS {client.name}: gone")

    def symbol(self, name: bytes) -> WireVariable:
        """A variable by the name that a client sent."""
        try:
            return self.plc.symbols[name.partition(b"\0")[0].decode("cp1252")]
        except (KeyError, UnicodeDecodeError):
            raise AdsRefusalError(_NO_SYMBOL) from None

    def offset_of(self, symbol: WireVariable) -> int:
        """The number by which a client may address a variable."""
        key = symbol.name.upper()
        if key not in self._offsets:
            self._offsets[key] = len(self._offsets) + 1
            self._by_offset[self._offsets[key]] = symbol
        return self._offsets[key]

    def by_offset(self, offset: int) -> WireVariable:
        """The variable of a number."""
        if offset not in self._by_offset:
            raise AdsRefusalError(_NO_OFFSET)
        return self._by_offset[offset]


class _Client:
    """One connection: its handles, its notifications."""

    def __init__(self, server: AdsServer, writer: asyncio.StreamWriter) -> None:
        self.server = server
        self.writer = writer
        self.name = "{}:{}".format(*writer.get_extra_info("peername")[:2])
        self._handles: dict[int, WireVariable] = {}
        self._notifications: dict[int, _Notification] = {}
        self._last_handle = 0
        self._request: Any = None

    def answer(self, request: AmsPacket) -> AmsResponseData:
        """The response to a packet."""
        head = request.ams_header
        flags = struct.pack("<H", struct.unpack("<H", head.state_flags)[0] | 1)
        if struct.unpack("<H", head.target_port)[0] != self.server.ams_port:
            return AmsResponseData(flags, struct.pack("<I", _NO_PORT), b"")
        command = struct.unpack("<H", head.command_id)[0]
        self._request = request
        try:
            service = _SERVICES.get(command)
            if service is None:
                raise AdsRefusalError(_NO_SERVICE)
            if self.server.plc.state is PlcState.CONFIG and command not in _IN_CONFIG:
                raise AdsRefusalError(_WRONG_STATE)
            content, code = service(self, head.data), 0
        except struct.error:
            content, code = b"", _WRONG_SIZE
        except AdsRefusalError as refusal:
            content, code = b"", refusal.code
        if code and command in (c.ADSCOMMAND_READ, c.ADSCOMMAND_READWRITE):
            content = struct.pack("<I", 0)
        return AmsResponseData(flags, struct.pack("<I", 0), struct.pack("<I", code) + content)

    # --- services ---

    def device_info(self, _: bytes) -> bytes:
        """Version and name of the runtime."""
        return struct.pack("<BBH16s", 3, 1, 0, SOFT_PLC.encode())

    def state(self, _: bytes) -> bytes:
        """What the controller does."""
        return struct.pack("<HH", _STATES[self.server.plc.state], 0)

    def control(self, data: bytes) -> bytes:
        """Start and stop."""
        wanted = struct.unpack_from("<H", data)[0]
        for state in (PlcState.RUN, PlcState.STOP, PlcState.CONFIG):
            if _STATES[state] == wanted and self.server.plc.state is not PlcState.ERROR:
                self.server.log(f"ADS {self.name}: asks for {state.value}")
                self.server.plc.set_state(state)
                return b""
        raise AdsRefusalError(_WRONG_STATE)

    def read(self, data: bytes) -> bytes:
        """Read by group and offset."""
        group, offset, length = struct.unpack_from("<III", data)
        found = self._read(group, offset, length)
        return struct.pack("<I", len(found)) + found

    def write(self, data: bytes) -> bytes:
        """Write by group and offset, or give a handle back."""
        group, offset, length = struct.unpack_from("<III", data)
        content = data[12 : 12 + length]
        if group == c.ADSIGRP_SYM_RELEASEHND:
            self._handles.pop(struct.unpack("<I", content)[0], None)
        else:
            self._write(group, offset, content)
        return b""

    def read_write(self, data: bytes) -> bytes:
        """Handles, descriptions of variables, and lists of reads and writes."""
        group, offset, length, _ = struct.unpack_from("<IIII", data)
        given = data[16:]
        if group == c.ADSIGRP_SYM_HNDBYNAME:
            self._last_handle += 1
            self._handles[self._last_handle] = self.server.symbol(given)
            found = struct.pack("<I", self._last_handle)
        elif group == c.ADSIGRP_SYM_INFOBYNAMEEX:
            found = self._entry(self.server.symbol(given))
        elif group == c.ADSIGRP_SYM_VALBYNAME:
            found = self.server.symbol(given).read()[:length]
        elif group == c.ADSIGRP_SUMUP_READ:
            found = self._read_list(given, offset)
        elif group == c.ADSIGRP_SUMUP_WRITE:
            found = self._write_list(given, offset)
        else:
            raise AdsRefusalError(_NO_GROUP)
        return struct.pack("<I", len(found)) + found

    def add_notification(self, data: bytes) -> bytes:
        """Tell the client of a variable from now on."""
        group, offset, _, mode, _, cycle = struct.unpack_from("<IIIIII", data)
        symbol = self._symbol_at(group, offset)
        if mode not in (c.ADSTRANS_SERVERONCHA, c.ADSTRANS_SERVERCYCLE):
            raise AdsRefusalError(_WRONG_VALUE)
        self._last_handle += 1
        on_change = mode == c.ADSTRANS_SERVERONCHA
        self._notifications[self._last_handle] = _Notification(symbol, on_change, cycle * 1e-7)
        return struct.pack("<I", self._last_handle)

    def delete_notification(self, data: bytes) -> bytes:
        """Stop telling a client of changes of a variable; the handle is that of `add_notification`."""
        if self._notifications.pop(struct.unpack_from("<I", data)[0], None) is None:
            raise AdsRefusalError(_NO_NOTIFICATION)
        return b""

    # --- variables ---

    def _symbol_at(self, group: int, offset: int) -> WireVariable:
        if group == c.ADSIGRP_SYM_VALBYHND:
            if offset not in self._handles:
                raise AdsRefusalError(_NO_SYMBOL)
            return self._handles[offset]
        if group == _VARIABLES:
            return self.server.by_offset(offset)
        raise AdsRefusalError(_NO_GROUP)

    def _read(self, group: int, offset: int, length: int) -> bytes:
        if length > _LONGEST:
            raise AdsRefusalError(_WRONG_SIZE)
        if group in (c.ADSIGRP_SYM_UPLOADINFO, c.ADSIGRP_SYM_UPLOADINFO2):
            entries = self._entries()
            return struct.pack("<II", len(entries), sum(map(len, entries))).ljust(length, b"\0")[:length]
        if group == c.ADSIGRP_SYM_UPLOAD:
            return b"".join(self._entries())[:length]
        return self._symbol_at(group, offset).read()[:length]

    def _write(self, group: int, offset: int, content: bytes) -> None:
        symbol = self._symbol_at(group, offset)
        if not symbol.is_input:
            self.server.log(f"ADS {self.name}: may not write {symbol.name}, which is no input")
            raise AdsRefusalError(_REFUSED)
        try:
            symbol.write(content)
        except ValueError as error:
            self.server.log(f"ADS {self.name}: {error}")
            raise AdsRefusalError(_WRONG_SIZE) from None
        if self.server.verbose:
            self.server.log(f"ADS {self.name}: {symbol.name} := {content[:16].hex()}{'..' * (len(content) > 16)}")

    def _read_list(self, given: bytes, count: int) -> bytes:
        codes, values = [], []
        wanted = list(struct.iter_unpack("<III", given[: 12 * count]))
        if sum(length for _, _, length in wanted) > _LONGEST:
            raise AdsRefusalError(_WRONG_SIZE)
        for group, offset, length in wanted:
            try:
                values.append(self._read(group, offset, length).ljust(length, b"\0"))
                codes.append(0)
            except AdsRefusalError as refusal:
                values.append(bytes(length))
                codes.append(refusal.code)
        return struct.pack(f"<{len(codes)}I", *codes) + b"".join(values)

    def _write_list(self, given: bytes, count: int) -> bytes:
        codes, at = [], 12 * count
        for group, offset, length in struct.iter_unpack("<III", given[:at]):
            try:
                self._write(group, offset, given[at : at + length])
                codes.append(0)
            except AdsRefusalError as refusal:
                codes.append(refusal.code)
            at += length
        return struct.pack(f"<{len(codes)}I", *codes)

    def _entries(self) -> list[bytes]:
        symbols = self.server.plc.symbols
        return [self._entry(symbols[name]) for name in symbols.names()]

    def _entry(self, symbol: WireVariable) -> bytes:
        """The description of a variable, as SAdsSymbolEntry has it."""
        name, kind = symbol.name.encode("cp1252"), type_name(symbol.type).encode("cp1252")
        texts = name + b"\0" + kind + b"\0\0"
        numbers = (_VARIABLES, self.server.offset_of(symbol), symbol.size, _data_type(symbol.type), 8)
        return struct.pack("<IIIIIIHHH", 30 + len(texts), *numbers, len(name), len(kind), 0) + texts

    # --- notifications ---

    def notify(self) -> None:
        """Send what is due."""
        now = time.monotonic()
        for handle, note in list(self._notifications.items()):
            if now < note.due:
                continue
            note.due = now + note.cycle_s
            value = note.symbol.read()
            if note.on_change and value == note.last:
                continue
            note.last = value
            stamp = time.time_ns() // 100 + _FILETIME_1970
            sample = struct.pack("<II", handle, len(value)) + value
            body = struct.pack("<IQI", 1, stamp, 1) + sample
            content = struct.pack("<I", len(body)) + body
            head = self._request.ams_header._replace(
                command_id=struct.pack("<H", c.ADSCOMMAND_DEVICENOTE), invoke_id=bytes(4)
            )
            packet = AmsResponseData(struct.pack("<H", 4), bytes(4), content)
            self.writer.write(AdsClientConnection.construct_response(packet, self._request._replace(ams_header=head)))


_Service = Callable[[_Client, bytes], bytes]
_SERVICES: dict[int, _Service] = {
    c.ADSCOMMAND_READDEVICEINFO: _Client.device_info,
    c.ADSCOMMAND_READSTATE: _Client.state,
    c.ADSCOMMAND_WRITECTRL: _Client.control,
    c.ADSCOMMAND_READ: _Client.read,
    c.ADSCOMMAND_WRITE: _Client.write,
    c.ADSCOMMAND_READWRITE: _Client.read_write,
    c.ADSCOMMAND_ADDDEVICENOTE: _Client.add_notification,
    c.ADSCOMMAND_DELDEVICENOTE: _Client.delete_notification,
}
_IN_CONFIG = {c.ADSCOMMAND_READDEVICEINFO, c.ADSCOMMAND_READSTATE, c.ADSCOMMAND_WRITECTRL}
_DATA_TYPES = {
    "BOOL": c.ADST_BIT,
    "REAL": c.ADST_REAL32,
    "LREAL": c.ADST_REAL64,
    **dict.fromkeys(("BYTE", "USINT"), c.ADST_UINT8),
    **dict.fromkeys(("WORD", "UINT"), c.ADST_UINT16),
    **dict.fromkeys(("DWORD", "UDINT", "TIME"), c.ADST_UINT32),
    **dict.fromkeys(("LWORD", "ULINT", "LTIME"), c.ADST_UINT64),
    "SINT": c.ADST_INT8,
    "INT": c.ADST_INT16,
    "DINT": c.ADST_INT32,
    "LINT": c.ADST_INT64,
}


def _data_type(type_: Type) -> int:
    """The number of a type; of an array, that of its elements."""
    while isinstance(type_, ArrayType):
        type_ = type_.element
    if isinstance(type_, EnumType):
        type_ = type_.base
    if isinstance(type_, Elementary):
        known = c.ADST_STRING if type_.kind is Kind.STRING else _DATA_TYPES.get(type_.name, c.ADST_BIGTYPE)
        return int(known)
    return int(c.ADST_BIGTYPE)
