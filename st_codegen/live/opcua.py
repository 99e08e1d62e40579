"""OPC UA for the soft PLC, by asyncua: an object for each list of globals and each program, a node for each variable.

Values are read where they are when a client asks, and ten times a second where one has subscribed. Structures are data
types of the server with a field for each member; they can be read, not written.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from functools import partial
from typing import Any

import numpy as np

from st_codegen.errors import MissingExtraError
from st_codegen.live.controller import SOFT_PLC, STATE
from st_codegen.live.plc import Log, SoftPlc, host_and_port
from st_codegen.live.symbols import WireVariable, wire_dtype
from st_codegen.st.types import ArrayType, Elementary, EnumType, Kind, StructType, Type

try:
    from asyncua import Server, ua
    from asyncua.common.structures104 import new_struct, new_struct_field
    from asyncua.crypto.permission_rules import User, UserRole
    from asyncua.server.user_managers import UserManager
except ImportError as missing:
    if missing.name != "asyncua":
        raise
    raise MissingExtraError("asyncua", "live", "OPC UA") from missing

NAMESPACE = "urn:st-codegen:plc"
#: Seconds between two looks at what clients have subscribed to.
_LOOK_EVERY = 0.1


class _Everybody(UserManager):  # type: ignore[misc]
    """Whoever connects may read all variables and write inputs."""

    def get_user(self, *_: Any, **__: Any) -> User:
        return User(role=UserRole.User)


class OpcUaServer:
    """Answers clients at `opc.tcp://host:port/`."""

    def __init__(self, plc: SoftPlc, host: str, port: int, log: Log) -> None:
        self.plc = plc
        self.host, self.port = host, port
        self.log = log
        self._server = Server(user_manager=_Everybody())
        self._told: dict[Any, str] = {}
        self._telling: asyncio.Task[None] | None = None

    @property
    def url(self) -> str:
        """Where clients connect."""
        return f"opc.tcp://{host_and_port(self.host, self.port)}/"

    async def start(self) -> None:
        """Listen, with a node for each variable."""
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)
        server = self._server
        await server.init()
        server.set_endpoint(self.url)
        server.set_server_name(SOFT_PLC)
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        space = await server.register_namespace(NAMESPACE)
        structures = await self._structures(space)
        parents: dict[str, Any] = {}
        for name in self.plc.symbols.names():
            symbol = self.plc.symbols[name]
            kind = variant_type(symbol.type)
            parent = name.split(".")[0]
            known = isinstance(symbol.type, StructType) and symbol.type.name in structures
            if (kind is None and not known) or name.count(".") != 1:
                continue
            if parent not in parents:
                parents[parent] = await server.nodes.objects.add_object(ua.NodeId(parent, space), parent)
            if kind is not None:
                await self._add(parents[parent], space, symbol, kind)
            else:
                await self._add_structure(parents[parent], space, symbol, structures[str(symbol.type)])
        plc = await server.nodes.objects.add_object(ua.NodeId("PLC", space), "PLC")
        state = await plc.add_variable(ua.NodeId(STATE, space), "State", "")
        self._answer(state, lambda *_: ua.DataValue(ua.Variant(self.plc.state.value, ua.VariantType.String)))
        await server.start()
        self._telling = asyncio.create_task(self._tell())

    async def stop(self) -> None:
        """Close all connections."""
        if self._telling is not None:
            self._telling.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._telling
        await self._server.stop()

    async def _tell(self) -> None:
        """Tell clients what has changed of the variables that they subscribed to: asyncua sees its own writes only."""
        aspace, attribute = self._server.iserver.aspace, ua.AttributeIds.Value
        while True:
            await asyncio.sleep(_LOOK_EVERY)
            for node in self._told:
                callbacks = dict(aspace[node].attributes[attribute].datachange_callbacks)
                value = aspace.read_attribute_value(node, attribute) if callbacks else None
                shown = "" if value is None else repr(value.Value)  # NaN is no other value than NaN
                if shown not in ("", self._told[node]):
                    for handle, callback in callbacks.items():
                        await callback(handle, value)
                self._told[node] = shown

    async def _add(self, parent: Any, space: int, symbol: WireVariable, kind: ua.VariantType) -> None:
        short = symbol.name.split(".", 1)[1]
        node = await parent.add_variable(ua.NodeId(symbol.name, space), short, self._value(symbol, kind).Value)
        self._answer(node, lambda *_: self._value(symbol, kind))
        if symbol.is_input:
            await node.set_writable()
            aspace = self._server.iserver.aspace
            aspace.set_attribute_value_setter(node.nodeid, ua.AttributeIds.Value, partial(self._set, symbol, kind))

    async def _structures(self, space: int) -> dict[str, Any]:
        """A data type for each structure of the project whose fields all have one, by name."""
        found: dict[str, Any] = {}
        types = [item for item in self.plc.code.project.types.values() if isinstance(item, StructType)]
        todo = [item for item in types if not item.is_union]
        while ready := [item for item in todo if all(_field_type(entry.type, found) for entry in item.fields)]:
            for item in ready:
                fields = [
                    new_struct_field(
                        entry.name, _field_type(entry.type, found), array=isinstance(entry.type, ArrayType)
                    )
                    for entry in item.fields
                ]
                found[item.name], _ = await new_struct(self._server, space, item.name, fields)
                todo.remove(item)
        if found:
            await self._server.load_data_type_definitions()
        return found

    async def _add_structure(self, parent: Any, space: int, symbol: WireVariable, data_type: Any) -> None:
        short = symbol.name.split(".", 1)[1]
        value = _content(symbol)
        node = await parent.add_variable(ua.NodeId(symbol.name, space), short, value, datatype=data_type.nodeid)
        self._answer(node, lambda *_: ua.DataValue(ua.Variant(_content(symbol))))

    def _answer(self, node: Any, callback: Any) -> None:
        self._server.iserver.aspace.set_attribute_value_callback(node.nodeid, ua.AttributeIds.Value, callback)
        self._told[node.nodeid] = ""

    def _value(self, symbol: WireVariable, kind: ua.VariantType) -> ua.DataValue:
        return ua.DataValue(ua.Variant(_content(symbol), kind))

    def _set(
        self, symbol: WireVariable, kind: ua.VariantType, _node: Any, _attribute: Any, value: ua.DataValue
    ) -> None:
        given = value.Value
        if given is None or given.VariantType != kind:
            raise ua.uaerrors.BadTypeMismatch
        try:
            symbol.write(np.asarray(given.Value, wire_dtype(symbol.type).base).tobytes())
        except (ValueError, OverflowError) as error:
            self.log(f"OPC UA: {error}")
            raise ua.uaerrors.BadOutOfRange from None


def _field_type(type_: Type, known: dict[str, Any]) -> Any:
    """The type of a field: one of the elementary ones, or a structure that is known already; None: neither."""
    inner = type_.element if isinstance(type_, ArrayType) else type_
    return known.get(inner.name) if isinstance(inner, StructType) else variant_type(inner)


def _content(symbol: WireVariable) -> Any:
    """The present value of a variable."""
    return _told(symbol.type, np.frombuffer(symbol.read(), wire_dtype(symbol.type))[0])


def _told(type_: Type, value: Any) -> Any:
    """A value as clients know it."""
    if isinstance(type_, StructType):
        return getattr(ua, type_.name)(**{entry.name: _told(entry.type, value[entry.name]) for entry in type_.fields})
    if isinstance(type_, ArrayType) and isinstance(type_.element, StructType):
        return [_told(type_.element, part) for part in value]
    return value.tolist()


_KINDS = {
    "BOOL": "Boolean",
    "SINT": "SByte",
    "INT": "Int16",
    "DINT": "Int32",
    "LINT": "Int64",
    "BYTE": "Byte",
    "USINT": "Byte",
    "WORD": "UInt16",
    "UINT": "UInt16",
    "DWORD": "UInt32",
    "UDINT": "UInt32",
    "LWORD": "UInt64",
    "ULINT": "UInt64",
    "REAL": "Float",
    "LREAL": "Double",
}


def variant_type(type_: Type) -> ua.VariantType | None:
    """The type of a node; None for what is not offered."""
    inner = type_.element if isinstance(type_, ArrayType) else type_
    if isinstance(inner, EnumType):
        inner = inner.base
    if not isinstance(inner, Elementary) or inner.kind is Kind.STRING or inner.name not in _KINDS:
        return None
    return ua.VariantType[_KINDS[inner.name]]
