"""OPC UA: an unmodified client, and the comparison over it."""

import itertools
import socket
import threading
from unittest.mock import Mock

import pytest

from st_codegen import load
from st_codegen.live.compare import compare
from st_codegen.live.controller import UNKNOWN, OpcUaController, Signal, connected, must_run
from st_codegen.live.failures import ControllerError, NotWritableError, SilentError, UnknownVariableError
from tests.live.conftest import Running, soft_plc

asyncua = pytest.importorskip("asyncua")
sync = pytest.importorskip("asyncua.sync")


def free_port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


@pytest.fixture(scope="module")
def server(bundle):
    with Running(soft_plc(bundle[1]), ads_port=None, opcua_port=free_port()) as running:
        yield running


def test_an_unmodified_client_reads_and_writes_inputs_only(server):
    ua = asyncua.ua
    with sync.Client(server.addresses["opcua"], timeout=600) as client:
        space = client.get_namespace_index("urn:st-codegen:plc")

        def node(name):
            return client.get_node(f"ns={space};s={name}")

        node("GVL_Experiment.fSpeed_rpm").write_value(432.5)
        assert node("GVL_Experiment.fSpeed_rpm").read_value() == 432.5
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            node("GVL_Experiment.bBusy").write_value(True)
        with pytest.raises(ua.uaerrors.BadTypeMismatch):
            node("GVL_Experiment.fSpeed_rpm").write_value(3, ua.VariantType.Int32)
        with pytest.raises(ua.uaerrors.BadOutOfRange):
            node("GVL_Comparison.fInputs").write_value([1.0])
        assert node("PLC.State").read_value() == "RUN"
        names = {child.read_browse_name().Name for child in client.nodes.objects.get_children()}
        assert {"GVL_Experiment", "GVL_Record", "PRG_Record"} <= names


def test_a_client_is_told_of_changes_that_others_made(server):
    """A number, NaN once, and the state; nothing is told of what stays as it is."""
    values, told, changed = server.plc.machine.globals, [], threading.Event()

    class Told:
        def datachange_notification(self, node, value, data):
            told.append(value)
            changed.set()

    def given(value):
        changed.clear()
        server.do(lambda: values.__setitem__("GVL_Experiment.fSpeed_rpm", value))
        assert changed.wait(20)

    with sync.Client(server.addresses["opcua"], timeout=600) as client:
        space = client.get_namespace_index("urn:st-codegen:plc")
        subscription = client.create_subscription(20, Told())
        subscription.subscribe_data_change(client.get_node(f"ns={space};s=GVL_Experiment.fSpeed_rpm"))
        assert changed.wait(20)
        for value in (431.0, float("nan"), 433.0):
            given(value)
        subscription.delete()
    assert [shown for shown, _ in itertools.groupby(map(repr, told))][-3:] == ["431.0", "nan", "433.0"]
    assert len(told) <= 6


def test_structures_have_their_fields(bundle, server):
    values = server.plc.machine.globals
    server.do(lambda: values.__setitem__("GVL_Machine.stExchange.stOdd.nNumber", 41))
    with sync.Client(server.addresses["opcua"], timeout=20) as client:
        client.load_data_type_definitions()
        space = client.get_namespace_index("urn:st-codegen:plc")
        node = client.get_node(f"ns={space};s=GVL_Machine.stExchange")
        found = node.read_value()
        with pytest.raises(asyncua.ua.uaerrors.BadUserAccessDenied):
            node.write_value(found)
    server.do(lambda: values.__setitem__("GVL_Machine.stExchange.stOdd.nNumber", 0))
    assert found.stOdd.nNumber == 41
    assert found.stOdd.bInRange is False
    names = [entry.name for entry in server.plc.code.project.types["ST_TEEXCHANGE"].fields]
    assert all(hasattr(found, name) for name in names)


def test_the_comparison_goes_over_it_too(bundle, server):
    report = compare(load(bundle[0]), bundle[1], lambda: connected(None, server.addresses["opcua"], 600.0), rows=600)
    assert report.passed
    assert report.sent >= 600
    assert any("st-codegen serve is a soft PLC: no controller was compared" in line for line in report.remarks())


def test_an_address_of_ipv6_is_one(lone):
    """`serve --listen ::1 --opcua` was reported as a defect, and compare refused its URL."""
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        pytest.skip("no IPv6 here")
    with Running(soft_plc(lone[1]), host="::1", ads_port=None, opcua_port=free_port()) as running:
        url = running.addresses["opcua"]
        assert url.startswith("opc.tcp://[::1]:")
        with connected(None, url, 600.0) as controller:
            assert controller.state() == "RUN"


def test_what_is_not_there(server):
    with connected(None, server.addresses["opcua"], 600.0) as controller:
        with pytest.raises(ControllerError, match=r"no variable GVL_X\.nY"):
            controller.read(Signal("GVL_X.nY"))
        with pytest.raises(ControllerError, match=r"GVL_Experiment\.bBusy may not be written"):
            controller.write(Signal("GVL_Experiment.bBusy", "|b1"), True)
    with pytest.raises(ControllerError, match="cannot be reached"):
        connected(None, "opc.tcp://127.0.0.1:1/", 1.0)


def test_a_value_that_the_server_does_not_vouch_for_is_none(monkeypatch):
    """Also where it was good when the variable was looked for; and a variable whose value cannot be read at first."""
    ua, codes = asyncua.ua, asyncua.ua.StatusCodes
    with sync.Server() as server:
        url = f"opc.tcp://127.0.0.1:{free_port()}/"
        server.set_endpoint(url)
        space = server.register_namespace("urn:other")
        node = server.nodes.objects.add_variable(ua.NodeId("GVL.fX", space), "fX", 1.5)
        server.nodes.objects.add_variable(ua.NodeId("GVL.fFixed", space), "fFixed", 1.5).set_writable(False)
        server.start()
        with connected(None, url, 60.0) as controller:
            for status in (codes.BadNoCommunication, codes.UncertainLastUsableValue):
                node.write_value(ua.DataValue(ua.Variant(1.5), ua.StatusCode(status)))
                with pytest.raises(ControllerError, match=rf"GVL\.fX: .*{ua.StatusCode(status).name}"):
                    controller.read(Signal("GVL.fX"))  # the first time this variable is looked for, then its value
                node.write_value(ua.DataValue(ua.Variant(2.5)))
                assert controller.read(Signal("GVL.fX")) == 2.5
            with pytest.raises(NotWritableError, match=r"GVL\.fFixed may not be written"):
                controller.write(Signal("GVL.fFixed"), 1.0)
            monkeypatch.setattr(controller._client, "get_namespace_array", Mock(side_effect=ConnectionError("gone")))
            with pytest.raises(SilentError, match="gone"):
                controller.read(Signal("GVL.fOther"))


def test_a_server_without_a_state_is_not_said_to_run(monkeypatch):
    controller = object.__new__(OpcUaController)
    monkeypatch.setattr(OpcUaController, "read", Mock(side_effect=UnknownVariableError("no")))
    assert controller.state() == UNKNOWN
    must_run(controller)
    monkeypatch.setattr(OpcUaController, "read", Mock(side_effect=SilentError("no")))
    with pytest.raises(SilentError):
        controller.state()
