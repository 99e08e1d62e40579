"""The command lines: a server that stops cleanly, the comparison against it, one message with exit code 2."""

import asyncio
import json
import re
import signal
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import pytest

from st_codegen import generate, load
from st_codegen.cost.calibrate import read_measurements
from st_codegen.cost.profile import load_profile
from st_codegen.errors import InputError
from st_codegen.live import plc
from st_codegen.live.live_report import BlockTimes, LiveReport
from st_codegen.proof.verify_report import ModelReport
from tests.cli.helpers import run
from tests.live.conftest import NET_IDS, Running, soft_plc

pytest.importorskip("pyads")


@pytest.fixture(scope="module")
def process(lone, tmp_path_factory):
    """`serve` as a process, and the address that it prints."""
    log = tmp_path_factory.mktemp("serve") / "log"
    with log.open("w") as errors:
        arguments = ["serve", "--generated", str(lone[1]), "--ads", "--ads-port", "0"]
        started = subprocess.Popen(
            [sys.executable, "-m", "st_codegen", *arguments], stdout=subprocess.PIPE, stderr=errors, text=True
        )
    line = started.stdout.readline()
    assert line.startswith("ADS 127.0.0.1:"), log.read_text()
    yield started, line.split()[1].rstrip(","), log
    started.kill()
    started.wait(600)


def test_compare_against_serve_and_serve_stops_cleanly(lone, process, tmp_path, capsys):
    started, address, log = process
    out = {name: str(tmp_path / name) for name in ("record.json", "record.html", "times.csv", "mine.toml")}
    code = run(
        *("compare", str(lone[0]), "--generated", str(lone[1]), "--ads", f"{next(NET_IDS)}:851@{address}"),
        *("--rows", "500", "--timeout", "600", "--json", out["record.json"], "--html", out["record.html"]),
        *("--times", out["times.csv"], "--calibrated", out["mine.toml"], "--same-bits"),
    )
    shown = capsys.readouterr().err
    assert code == 0, shown
    assert "library and controller compared" in shown
    if (tmp_path / "times.csv").exists():  # else the clock is too slow for it
        measured = read_measurements(tmp_path / "times.csv")
        assert load_profile(tmp_path / "mine.toml").name == "mine"
        time_us = float(re.search(r"FB_Te\W+warm\W+([\d.]+)", shown)[1])
        assert time_us == pytest.approx(measured[0].microseconds, abs=0.06)  # the file has a digit less
    else:
        assert "mine.toml is not written: all calls were quicker" in " ".join(shown.split())
    record = json.loads((tmp_path / "record.json").read_text())
    assert (record["passed"], record["models"]["te"]["exact"], record["state"]) == (True, True, "RUN")
    assert record["device"] == "st-codegen serve"
    page = (tmp_path / "record.html").read_text(encoding="utf-8")
    assert "All agree" in page and "is a soft PLC: no controller was compared" in page
    started.send_signal(signal.SIGTERM)
    assert started.wait(600) == 0
    text = log.read_text()
    assert "task ComparisonTask: 10000 us, PRG_Comparison" in text
    assert "state RUN -> STOP" in text
    assert "Traceback" not in text


def test_times_of_another_text_are_not_written(lone, tmp_path, monkeypatch, capsys):
    times, models = {"FB_Te": BlockTimes(10, 1.0, 1.0)}, [ModelReport("te", refusal="it has no answer")]
    failed = LiveReport("ads", "RUN", "0", "out", models, times=times)
    monkeypatch.setattr("st_codegen.live.compare.compare", lambda *_, **__: failed)
    wanted = ("compare", str(lone[0]), "--generated", str(lone[1]), "--ads", "1.2.3.4.5.6:851")
    assert run(*wanted, "--times", str(tmp_path / "times.csv"), "--json", str(tmp_path / "record.json")) == 1
    assert "times.csv is not written: the times may be those of" in " ".join(capsys.readouterr().err.split())
    assert [path.name for path in tmp_path.iterdir()] == ["record.json"]


def test_compare_takes_the_names_that_the_project_was_generated_with(lone, tmp_path, capsys):
    folder = generate(load(lone[0], prefix="P1_"), "twincat", tmp_path, with_comparison=True).folder
    with Running(soft_plc(folder)) as running:
        wanted = ("compare", lone[0], "--generated", folder, "--ads", running.ads, "-n", 20, "--timeout", 600, "-q")
        assert run(*wanted, "--prefix", "P1_") == 0, capsys.readouterr().err
        assert run(*wanted) == 2


def test_one_message_and_exit_code_2_where_nobody_listens(lone, tmp_path, capsys):
    code = run(
        *("compare", str(lone[0]), "--generated", str(lone[1]), "--ads", "127.0.0.1.1.1:851@127.0.0.1:1"),
        *("--json", str(tmp_path / "record.json")),
    )
    shown = capsys.readouterr().err
    assert code == 2
    assert shown.count("error:") == 1
    assert "127.0.0.1:1 cannot be reached" in shown
    assert not (tmp_path / "record.json").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["serve"], "--ads, --opcua or both"),
        (["serve", "--ads", "--generated", "nowhere"], "no generated files"),
        (["serve", "--ads", "--opcua-port", "1", "--seed", "1"], "--opcua-port, --seed: without effect without"),
        (["serve", "--ads", "-g", "{generated}", "--listen", " "], "an empty text would be all addresses"),
        (["serve", "--ads", "-g", "{generated}", "--listen", "x..y"], "is it an address of this machine?"),
        (
            ["serve", "--ads", "--generated", "{generated}", "--listen", "192.0.2.1"],
            "is it an address of this machine?",
        ),
        (["compare", "{models}", "--generated", "{generated}"], "--ads NETID:PORT or --opcua URL"),
        (["compare", "{models}", "--generated", "{generated}", "--ads", "here"], "NETID:PORT@HOST:TCPPORT"),
        (["compare", "{models}", "--generated", "{generated}", "--opcua", "here"], "give opc.tcp://"),
        (["compare", "{models}", "--ads", "1.2.3.4.5.6:851", "--calibrated", "x.csv"], "a profile is a .toml file"),
        (["compare", "{models}", "--ads", "1.2.3.4.5.6:851", "--calibrated", "x.toml", "--profile", "n"], "no profile"),
        (["compare", "{models}", "--ads", "1.2.3.4.5.6:851", "--profile", "cx5140"], "without effect without --cal"),
    ],
)
def test_wrong_use(lone, arguments, message, capsys):
    names = {"models": lone[0], "generated": lone[1]}
    code = run(*(argument.format(**names) for argument in arguments))
    shown = capsys.readouterr().err
    assert code == 2
    assert message in shown


def test_ticks_that_are_left_out_are_those_that_time_went_on_by(monkeypatch):
    """The machine stood still for ten seconds: 10,000 ticks of a millisecond, of which one is made up for."""
    times, here = iter([0.0, *[10.0] * 10]), threading.get_ident()

    def clock():
        """Soft PLCs of other tests run on in threads of their own, with the time that there is."""
        return next(times) if threading.get_ident() == here else time.perf_counter()

    monkeypatch.setattr(plc, "time", SimpleNamespace(perf_counter=clock))
    stopping = asyncio.Event()
    late = SimpleNamespace(ticks=1000, speed=1.0, tick_us=1000, late=0, after_batch=stopping.set)

    def tick():
        late.ticks += 1

    late.tick = tick
    asyncio.run(plc.SoftPlc.run(late, stopping))
    assert (late.late, late.ticks) == (10_000, 1001)


def test_a_file_of_a_task_is_read_or_refused_with_its_name(tmp_path):
    file = tmp_path / "Fast.TcTTO"
    task = "<Task><CycleTime> 500 <!-- us --></CycleTime>{}<PouCall><Name>A</Name></PouCall></Task>"
    file.write_text(task.format("<Priority>3</Priority>"))
    assert plc.plc_tasks(tmp_path) == (plc.PlcTask("Fast", 500, 3, ("A",)),)
    for content in (task.format("").encode(), b"\xff\xfe", b"<Task>"):
        file.write_bytes(content)
        with pytest.raises(InputError, match=r"Fast\.TcTTO"):
            plc.plc_tasks(tmp_path)
