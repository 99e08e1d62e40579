"""ADS: the soft PLC answers an unmodified client of pyads as a controller does."""

import ctypes
import struct
import time
from types import SimpleNamespace

import numpy as np
import pytest

from tests.live.conftest import NET_IDS, Running, soft_plc

pyads = pytest.importorskip("pyads")
ERROR_CODES = pytest.importorskip("pyads.errorcodes").ERROR_CODES


def connect(running, port=851):
    connection = pyads.Connection(next(NET_IDS), port, running.tcp)
    connection.open()
    connection.set_timeout(600_000)
    return connection


@pytest.fixture
def client(shared_plc):
    with connect(shared_plc) as connection:
        yield connection


def refused(code, function, *arguments):
    with pytest.raises(pyads.ADSError) as caught:
        function(*arguments)
    assert caught.value.err_code == code


def test_state_and_name(client):
    assert client.read_state() == (pyads.ADSSTATE_RUN, 0)
    assert client.read_device_info()[0] == "st-codegen serve"


@pytest.mark.parametrize("value", [900.25, float("inf"), -0.0, 5e-324])
def test_variables_by_name_whatever_its_case_by_handle_and_by_list(client, value):
    client.write_by_name("gvl_experiment.FSPEED_RPM", value, pyads.PLCTYPE_LREAL)
    handle = client.get_handle("GVL_Experiment.fSpeed_rpm")
    assert struct.pack("d", client.read_by_name("", pyads.PLCTYPE_LREAL, handle=handle)) == struct.pack("d", value)
    client.release_handle(handle)
    refused(1808, client.read_by_name, "", pyads.PLCTYPE_LREAL, False, handle)
    assert client.read_by_name("GVL_Experiment.fSpeed_rpm") == value  # the type comes from the controller
    names = ["GVL_Experiment.fSpeed_rpm", "GVL_Experiment.bBusy", "GVL_Record.nMeasurement"]
    assert client.read_list_by_name(names) == dict(zip(names, [value, False, 0], strict=True))


def test_nan_keeps_its_bits(client):
    bits = 0x7FF4DEADBEEF0001
    client.write_by_name("GVL_Record.fAliveTimeOut_s", bits, pyads.PLCTYPE_ULINT)
    assert client.read_by_name("GVL_Record.fAliveTimeOut_s", pyads.PLCTYPE_ULINT) == bits
    client.write_by_name("GVL_Record.fAliveTimeOut_s", 5.0, pyads.PLCTYPE_LREAL)


def test_what_a_broken_client_asks_for_is_refused_and_its_connection_stays(client):
    """A name that is no text of Windows-1252, and more bytes than a packet may hold."""
    name = (ctypes.c_ubyte * 2)(ord("f"), 0x81)
    refused(1808, client.read_write, 0xF003, 0, pyads.PLCTYPE_UDINT, name, type(name))
    many = ctypes.c_ubyte * (17 * 1024 * 1024)
    refused(1797, client.read, 0xF00C, 0, many)
    assert client.read_state() == (pyads.ADSSTATE_RUN, 0)


def test_arrays_longer_than_one_packet_of_a_network(client):
    values = np.random.default_rng(0).normal(size=1500)
    client.write_by_name("GVL_Comparison.fInputs", values.tolist(), pyads.PLCTYPE_LREAL * 1500)
    assert client.read_by_name("GVL_Comparison.fInputs") == values.tolist()
    assert client.read_by_name("GVL_Comparison.fInputs[3]") == values[3]
    assert len(client.read_by_name("GVL_Record.fIn_rad")) == 8192


class CoefficientSet(ctypes.Structure):
    """ST_TESet of a bundle with two orders, as a C compiler lays it out."""

    _fields_ = (
        ("nNumber", ctypes.c_int32),
        ("eError", ctypes.c_int32),
        ("bInRange", ctypes.c_bool),
        ("coefficients", ctypes.c_double * 8),
    )


def test_structures_by_name_have_the_layout_of_c(client):
    found = client.read_by_name("GVL_Machine.stExchange.stOdd", CoefficientSet, return_ctypes=True)
    assert (found.nNumber, found.eError, found.bInRange) == (0, 0, False)
    assert list(found.coefficients) == [0.0] * 8
    assert client.get_symbol("GVL_Machine.stExchange").symbol_type == "ST_TEExchange"


def test_what_is_no_input_is_refused_and_the_log_says_so(client, shared_plc):
    refused(1796, client.write_by_name, "GVL_Experiment.bBusy", True)
    refused(1796, client.write_by_name, "GVL_Comparison.nFingerprint", 1, pyads.PLCTYPE_ULINT)
    refused(1796, client.write_by_name, "PRG_Experiment.fbExperiment.fGoal", 1000.0)
    assert any("may not write GVL_Experiment.bBusy" in line for line in shared_plc.log)
    answers = client.write_list_by_name({"GVL_Experiment.fSpeed_rpm": 100.0, "GVL_Experiment.bDone": True})
    assert answers == {"GVL_Experiment.fSpeed_rpm": "no error", "GVL_Experiment.bDone": ERROR_CODES[1796]}


def test_what_is_not_there_and_what_does_not_fit(client):
    refused(1808, client.read_by_name, "GVL_Experiment.fNothing")
    refused(1808, client.read_by_name, "GVL_TE.REDUCTION_RATIO")  # a constant stands in the code
    refused(1808, client.read_by_name, "GVL_Comparison.fInputs[1500]")
    refused(1797, client.write_by_name, "GVL_Experiment.fSpeed_rpm", 1, pyads.PLCTYPE_INT)
    refused(1794, client.read, 0x1234, 0, pyads.PLCTYPE_INT)


def test_the_list_of_symbols_reads_back(client):
    symbols = {symbol.name: symbol for symbol in client.get_all_symbols()}
    assert symbols["GVL_Experiment.fSpeed_rpm"].symbol_type == "LREAL"
    assert symbols["GVL_Record.bBackward"].symbol_type == "ARRAY [0..8191] OF BOOL"
    assert symbols["PRG_Experiment.fbExperiment.fTime"].read() >= 0.0


def test_a_client_is_told_of_changes(client):
    seen = []

    @client.notification(ctypes.c_int32)
    def note(handle, name, timestamp, value):
        seen.append((name, value))

    handles = client.add_device_notification("GVL_Record.nEvery", pyads.NotificationAttrib(4), note)
    for value in (7, 8, 1):
        client.write_by_name("GVL_Record.nEvery", value)
        end = time.monotonic() + 600
        while (not seen or seen[-1][1] != value) and time.monotonic() < end:
            time.sleep(0.005)
    assert seen[-3:] == [("GVL_Record.nEvery", value) for value in (7, 8, 1)]
    client.del_device_notification(*handles)


def test_a_notification_that_nobody_asked_for_is_not_ended():
    """The library of a client knows its own ones and does not ask: another client may."""
    from st_codegen.live.ads import AdsRefusalError, _Client

    with pytest.raises(AdsRefusalError) as caught:
        _Client.delete_notification(SimpleNamespace(_notifications={}), struct.pack("<I", 7))
    assert ERROR_CODES[caught.value.code].startswith("Notification handle is invalid")


def test_a_list_of_more_bytes_than_a_packet_may_hold_is_refused():
    from st_codegen.live.ads import AdsRefusalError, _Client

    listed = struct.pack("<6I", 0xF00C, 0, 2**23, 0xF00C, 0, 2**23 + 1)
    with pytest.raises(AdsRefusalError) as caught:
        _Client._read_list(SimpleNamespace(), listed, 2)
    assert caught.value.code == 1797


def test_another_ams_port_is_not_there(shared_plc):
    with connect(shared_plc, 852) as other:
        refused(6, other.read_state)


def test_bytes_that_are_no_packet_close_one_connection_only(shared_plc, client):
    import socket

    host, port = shared_plc.addresses["ads"]
    with socket.create_connection((host, port), 600) as stranger:
        stranger.sendall(b"GET / HTTP/1.1\r\n\r\n")
        stranger.settimeout(600)
        assert stranger.recv(10) == b""
    assert client.read_state()[0] == pyads.ADSSTATE_RUN


def test_stop_and_config(lone):
    with Running(soft_plc(lone[1])) as running, connect(running) as client:
        client.write_control(pyads.ADSSTATE_STOP, 0, 0, pyads.PLCTYPE_INT)
        assert client.read_state()[0] == pyads.ADSSTATE_STOP
        ticks = running.plc.ticks
        client.write_control(pyads.ADSSTATE_CONFIG, 0, 0, pyads.PLCTYPE_INT)
        assert client.read_state()[0] == pyads.ADSSTATE_CONFIG
        refused(1810, client.read_by_name, "GVL_Comparison.nAnswer", pyads.PLCTYPE_DINT)
        client.write_control(pyads.ADSSTATE_RUN, 0, 0, pyads.PLCTYPE_INT)
        assert client.read_by_name("GVL_Comparison.nAnswer") == 0
        assert running.plc.ticks >= ticks
