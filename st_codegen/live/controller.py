"""A controller as a client sees it: its state, and its variables by name, over ADS or OPC UA.

Whatever goes wrong on the way is a `ControllerError` that says what to look at.
"""

from __future__ import annotations

import contextlib
import ctypes
import logging
import re
import socket
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from st_codegen.emit.blocks.comparison import LIST
from st_codegen.errors import InputError, MissingExtraError, counted
from st_codegen.live.failures import (
    ControllerError,
    NoPlcError,
    NotRunningError,
    NotWritableError,
    OtherProjectError,
    SilentError,
    UnknownVariableError,
    UnreachableError,
)

#: The state of a controller whose server does not tell it.
UNKNOWN = "UNKNOWN"
#: What `serve` calls itself.
SOFT_PLC = "st-codegen serve"
#: The variable of the soft PLC, over OPC UA, that says what it does.
STATE = "PLC.State"
#: Seconds in which a controller must answer.
TIMEOUT_S = 5.0
_ADS_TCP_PORT = 48898
#: Error codes of ADS for a variable that is not there.
_NO_SYMBOL = (1808, 1809)
_ADDRESS = re.compile(r"(\d+(?:\.\d+){5}):(\d+)(?:@([^:@\s]+)(?::(\d+))?)?")


@dataclass(frozen=True)
class Signal:
    """A variable: its name, the type of its elements, and their number (None: it is no array)."""

    name: str
    dtype: str = "<f8"
    length: int | None = None


class Controller(AbstractContextManager["Controller"], Protocol):
    """What `compare` and `record` ask of a controller."""

    #: For messages and records.
    address: str
    #: What it calls itself; empty where it does not say.
    device: str = ""
    #: Longest that an answer may take, s.
    timeout_s: float

    def state(self) -> str:
        """What it does: RUN, STOP, CONFIG, .."""

    def read_all(self, signals: Sequence[Signal]) -> list[Any]:
        """Several variables in one request."""

    def write_all(self, values: Sequence[tuple[Signal, Any]]) -> None:
        """Set several variables in one request, in this order."""

    def read(self, signal: Signal) -> Any:
        """A number, or an array of them."""
        return self.read_all([signal])[0]

    def write(self, signal: Signal, value: Any) -> None:
        """Set a variable."""
        self.write_all([(signal, value)])


class AdsController(Controller):
    """Over ADS, `NETID:PORT`, or `NETID:PORT@HOST[:TCPPORT]` where the host is not the first part of the net id."""

    def __init__(self, address: str, timeout_s: float) -> None:
        found = _ADDRESS.fullmatch(address)
        if found is None:
            raise InputError(
                f"--ads {address}: give NETID:PORT, such as 192.168.0.5.1.1:851, or NETID:PORT@HOST, or "
                f"NETID:PORT@HOST:TCPPORT where its ADS is not at TCP port {_ADS_TCP_PORT}"
            )
        self.address = f"ads {address}"
        net_id, ams_port, host, tcp_port = found.groups()
        if max(map(int, net_id.split("."))) > 255 or max(int(ams_port), int(tcp_port or 0)) > 65535:
            raise InputError(f"--ads {address}: the parts of a net id go up to 255, ports up to 65535")
        host = host or ".".join(net_id.split(".")[:4])
        self._ams_port = int(ams_port)
        self.timeout_s = timeout_s
        self._pyads = _pyads()
        _must_listen(self.address, host, int(tcp_port or _ADS_TCP_PORT), timeout_s)
        self._connection = self._pyads.Connection(net_id, self._ams_port, f"{host}:{tcp_port}" if tcp_port else host)
        try:
            with self._explained(""):
                self._connection.open()
                self._connection.set_timeout(round(timeout_s * 1000))
            with contextlib.suppress(self._pyads.ADSError):
                self.device = str(self._connection.read_device_info()[0]).strip()
        except BaseException:
            self.__exit__()
            raise

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(Exception):
            self._connection.close()

    def state(self) -> str:
        with self._explained(""):
            number, _ = self._connection.read_state()
        names = {getattr(self._pyads, name): name[9:] for name in dir(self._pyads) if name.startswith("ADSSTATE_")}
        return names.get(number, str(number))

    def read_all(self, signals: Sequence[Signal]) -> list[Any]:
        names = [signal.name for signal in signals]
        with self._explained(", ".join(names)):
            found = self._connection.read_list_by_name(names)
        for name in names:
            if isinstance(found[name], str):  # pyads puts the message of an error in the place of a number
                raise self._named(name, found[name])
        return [_as_declared(self.address, signal, found[signal.name]) for signal in signals]

    def write_all(self, values: Sequence[tuple[Signal, Any]]) -> None:
        plain = {signal.name: np.asarray(value, signal.dtype).tolist() for signal, value in values}
        with self._explained(", ".join(plain)):
            answers = self._connection.write_list_by_name(plain)
        for name, answer in answers.items():
            if answer != "no error":
                raise self._named(name, answer)

    @contextlib.contextmanager
    def _explained(self, name: str) -> Iterator[None]:
        try:
            yield
        except self._pyads.ADSError as error:
            code = getattr(error, "err_code", None)
            raise self._error(code, self._missing(name) if code in _NO_SYMBOL else name, str(error)) from None
        except RuntimeError as error:
            raise UnknownVariableError(f"{self.address}: {name}: {error}; another project runs there") from None

    def _missing(self, names: str) -> str:
        """The names, of some in one text, that the controller does not have; all of them where it does not tell."""
        found = []
        for name in names.split(", "):
            try:
                self._connection.release_handle(self._connection.get_handle(name))
            except self._pyads.ADSError:
                found.append(name)
        return ", ".join(found) or names

    def _named(self, name: str, text: str) -> ControllerError:
        """The error of one variable in a list, of which pyads tells the text only."""
        codes = self._pyads.errorcodes.ERROR_CODES
        return self._error(next((code for code, known in codes.items() if known == text), None), name, text)

    def _error(self, code: int | None, name: str, text: str) -> ControllerError:
        if code in (6, 7):
            kind: type[ControllerError] = NoPlcError
            reason = (
                f"no PLC at AMS port {self._ams_port} (error {code}): the runtime is not started (CONFIG), "
                "the port is another one, or no route leads back to this machine"
            )
        elif code in _NO_SYMBOL:
            kind = UnknownVariableError
            reason = f"no variable {name}: another project runs there, or one generated without --with-comparison"
        elif code == 1796:
            kind, reason = NotWritableError, f"{name} may not be written"
        elif code == 1810:
            kind, reason = NotRunningError, "the PLC is not in RUN"
        elif code == 1861:
            kind = SilentError
            reason = f"no answer within {self.timeout_s:g} s: the connection is lost, or the controller too busy"
        else:
            kind, reason = ControllerError, f"{name}: {text}".removeprefix(": ")
        return kind(f"{self.address}: {reason}")


def _pyads() -> Any:
    try:
        import pyads
    except ImportError as error:
        raise MissingExtraError("pyads", "live", "ADS") from error
    # its library writes to standard error by itself; what matters is in the error
    with contextlib.suppress(ValueError, AttributeError):
        library = pyads.pyads_ex._adsDLL
        ctypes.c_size_t.in_dll(library, "_ZN6Logger8logLevelE").value = 9
    return pyads


#: Kinds of values that answer for a kind of variable: whole numbers stand for reals and truth values, too.
_ANSWERS = {"f": "fiu", "i": "iu", "u": "iu", "b": "biu", "U": "Ubiuf"}


def _as_declared(address: str, signal: Signal, value: Any) -> Any:
    """What was read of a variable: a number, or an array. Raises UnknownVariableError for another type or length."""
    wanted, dtype = () if signal.length is None else (signal.length,), np.dtype(signal.dtype)
    try:
        given, found = np.asarray(value), np.asarray(value, dtype)
    except (ValueError, TypeError, OverflowError):
        given = found = np.zeros(0)
    is_kind = given.dtype.kind in _ANSWERS[dtype.kind] and (dtype.kind != "b" or bool(np.isin(given, (0, 1)).all()))
    if not is_kind or found.shape != wanted:
        kind = "one number" if signal.length is None else f"an array of {counted(signal.length, 'number')}"
        raise UnknownVariableError(f"{address}: {signal.name} is not {kind} there: another project runs there")
    return found.item() if signal.length is None else found


def _must_listen(address: str, host: str, port: int, timeout_s: float) -> None:
    try:
        socket.create_connection((host, port), timeout_s).close()
    except OSError as error:
        raise UnreachableError(
            f"{address}: {host}:{port} cannot be reached ({error.strerror or error}); is the address right and the "
            "controller on?"
        ) from None


class OpcUaController(Controller):
    """Over OPC UA; variables are nodes whose identifier is their name, in whatever namespace."""

    def __init__(self, url: str, timeout_s: float) -> None:
        try:
            from asyncua import ua
            from asyncua.sync import Client
        except ImportError as error:
            raise MissingExtraError("asyncua", "live", "OPC UA") from error
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)
        found = re.fullmatch(r"opc\.tcp://(\[[^\]\s]+\]|[^:/\[\s]+):(\d{1,5})(/.*)?", url)
        if found is None or int(found[2]) > 65535:
            raise InputError(f"--opcua {url}: give opc.tcp://HOST:PORT/")
        self.address = f"opcua {url}"
        self.timeout_s = timeout_s
        self._ua = ua
        self._nodes: dict[str, Any] = {}
        _must_listen(self.address, found[1].strip("[]"), int(found[2]), timeout_s)
        self._client = Client(url, timeout=timeout_s)
        try:
            self._client.connect()
        except Exception as error:
            with contextlib.suppress(Exception):
                self._client.disconnect()
            reason = str(error) or f"no answer within {timeout_s:g} s"
            raise SilentError(f"{self.address}: {reason}: is it an OPC UA server?") from None
        with contextlib.suppress(Exception):  # what cannot be had is not said
            self.device = str(self._client.get_endpoints()[0].Server.ApplicationName.Text or "").strip()

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(Exception):
            self._client.disconnect()

    def state(self) -> str:
        """What the server says; UNKNOWN where it does not: servers of controllers have no common name for it."""
        try:
            return str(self.read(Signal(STATE, "U")))
        except UnknownVariableError:
            return UNKNOWN

    def read_all(self, signals: Sequence[Signal]) -> list[Any]:
        nodes = [self._node(signal.name) for signal in signals]
        with self._explained(", ".join(signal.name for signal in signals)):
            answers = self._client.read_attributes(nodes, self._ua.AttributeIds.Value)
        return [self._good(signal, answer) for signal, answer in zip(signals, answers, strict=True)]

    def _good(self, signal: Signal, answer: Any) -> Any:
        """A value that the server vouches for: one with another status may be an old one."""
        with self._explained(signal.name):
            if answer.StatusCode is not None:
                answer.StatusCode.check()
        return _as_declared(self.address, signal, None if answer.Value is None else answer.Value.Value)

    def write_all(self, values: Sequence[tuple[Signal, Any]]) -> None:
        nodes = [self._node(signal.name) for signal, _ in values]
        names = ", ".join(signal.name for signal, _ in values)
        refusals = (self._ua.uaerrors.BadUserAccessDenied, self._ua.uaerrors.BadNotWritable)
        with self._explained(names):
            try:
                self._client.write_values(nodes, [self._variant(signal, value) for signal, value in values])
            except refusals:
                raise NotWritableError(f"{self.address}: {names} may not be written") from None

    def _variant(self, signal: Signal, value: Any) -> Any:
        kinds = {"f8": "Double", "i4": "Int32", "u4": "UInt32", "u8": "UInt64", "b1": "Boolean"}
        kind = self._ua.VariantType[kinds[signal.dtype.lstrip("<|")]]
        return self._ua.DataValue(self._ua.Variant(np.asarray(value, signal.dtype).tolist(), kind))

    def _node(self, name: str) -> Any:
        if name not in self._nodes:
            with self._explained(name):
                self._nodes[name] = self._found(name)
        return self._nodes[name]

    def _found(self, name: str) -> Any:
        for space in range(1, len(self._client.get_namespace_array())):
            node = self._client.get_node(f"ns={space};s={name}")
            with contextlib.suppress(self._ua.uaerrors.BadNodeIdUnknown):
                node.read_value()
                return node
        raise UnknownVariableError(
            f"{self.address}: no variable {name}: another project runs there, one generated without "
            "--with-comparison, or its variables are not published"
        )

    @contextlib.contextmanager
    def _explained(self, name: str) -> Iterator[None]:
        try:
            yield
        except ControllerError:
            raise
        except self._ua.UaError as error:
            raise ControllerError(f"{self.address}: {name}: {error}") from None
        except (OSError, TimeoutError, RuntimeError) as error:
            reason = str(error) or "no answer in time: the connection is lost, or the controller too busy"
            raise SilentError(f"{self.address}: {reason}") from None


def connected(ads: str | None, opcua: str | None, timeout_s: float = TIMEOUT_S) -> Controller:
    """The controller at one of two addresses. Raises InputError unless there is exactly one."""
    if (ads is None) == (opcua is None):
        why = "name the controller" if ads is None else "name one controller, not two"
        raise InputError(f"{why}: --ads NETID:PORT or --opcua URL")
    return AdsController(ads, timeout_s) if ads is not None else OpcUaController(str(opcua), timeout_s)


def must_run(controller: Controller) -> None:
    """Raises ControllerError for a controller that says that its tasks do not run."""
    state = controller.state()
    if state not in ("RUN", UNKNOWN):
        raise NotRunningError(f"{controller.address}: the PLC is in {state}, not in RUN: start it first")


def must_be_of(controller: Controller, fingerprint: int, generated: str) -> None:
    """Raises ControllerError for a controller whose tasks do not run, or which runs another project."""
    must_run(controller)
    found = int(controller.read(Signal(f"{LIST}.nFingerprint", "<u8")))
    if found != fingerprint:
        raise OtherProjectError(
            f"{controller.address}: the project there has the fingerprint {found:016x}, {generated} has "
            f"{fingerprint:016x}: download it, or name the folder that is running"
        )
