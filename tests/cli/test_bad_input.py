"""Whatever a user brings: one message, exit code 2, nothing written. A defect of ours: exit code 70."""

import importlib
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from st_codegen.cli.main import main
from st_codegen.emit import render
from st_codegen.errors import InputError
from tests.cli.helpers import run, snapshot
from tests.examples import examples

pytest.importorskip("polars")
pytest.importorskip("scipy")

RIG = Path(__file__).parents[2] / "examples" / "rv160n" / "rig.toml"
CONDITIONS = "speed_rpm,torque_Nm,temperature_C\n1000,900,30\n"
PROFILE = "t,theta_out,torque_Nm\n0,0,0\n1,1,0\n2,2,0\n3,3,0\n"
TABLE = "direction,speed_rpm,torque_Nm,temperature_C,A0,A1,phi1\nforward,1,2,3,4,5,6\n"
MANY = TABLE + "".join(f"forward,{speed},2,3,4,5,6\n" for speed in range(2, 40))
TIMES = "block,caches,us\nFB_Te,warm,1.5\n"
LONG = "x" * 140_000
DEEP = "[" * 100_000


class Place:
    """Good inputs of every command, to be spoilt."""

    def __init__(self, folder, models, lone):
        self.folder, self.models, self.lone = folder, models, lone
        self.bundle = models / "bundle.toml"
        self.rig = self.file("rig.toml", RIG.read_text(encoding="utf-8"))
        self.out = folder / "out"

    def file(self, name, content):
        path = self.folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    def in_bundle(self, old, new):
        text = self.bundle.read_text(encoding="utf-8")
        assert old in text
        self.bundle.write_text(text.replace(old, new, 1), encoding="utf-8")
        return [self.models, "--out", self.out]

    def bundle_bytes(self, content):
        self.bundle.write_bytes(content)
        return [self.models, "--out", self.out]

    def predict(self, content="f0,f1,f2\n1,2,3\n", output="y.csv"):
        return ["predict", self.lone, "-e", "reference", "-i", self.file("x.csv", content), "-o", self.folder / output]

    def campaign(self, conditions=CONDITIONS, *more):
        path = self.file("C.csv", conditions)
        return ["simulate", "campaign", "--rig", self.rig, "--conditions", path, "--out", self.out, *more]

    def with_rig(self, text):
        self.rig = self.file("rig.toml", text)
        return self.campaign()

    def motion(self, profile=PROFILE, *more):
        path = self.file("p.csv", profile)
        required = ["--models", self.models, "--rig", self.rig, "--profile", path, "--out", self.out]
        return ["simulate", "motion", *required, *more]

    def train(self, table=TABLE, *more):
        return ["train", self.file("t.csv", table), "--work", self.folder / "fits", "--out", self.out, *more]

    def reconcile(self, measured=TABLE, *more):
        path = self.file("m.csv", measured)
        return ["reconcile", "--rig", self.rig, "--measured", path, "--out", self.out, *more]

    def generated(self, manifest=None):
        assert run(self.lone, "--out", self.folder / "generated", "-q", "--layout", "trees") == 0
        if manifest is not None:
            self.file("generated/twincat/st-codegen.json", manifest)
        return self.folder / "generated"

    def calibrate(self, times=TIMES, out="mine.toml"):
        return ["calibrate", self.generated(), "-m", self.file("times.csv", times), "-o", self.folder / out]


@pytest.fixture
def place(tmp_path, bundle_folder, lone_folder):
    return Place(tmp_path, bundle_folder, lone_folder)


def odd_name(place):
    shutil.copy(place.lone / "te.txt", os.fsencode(place.lone) + b"/\xff.txt")
    return [place.lone, "--out", place.out]


def out_link(place):
    (place.out / "x").mkdir(parents=True)
    (place.out / "twincat").symlink_to("x")
    return [place.lone, "--out", place.out]


def instead_of_bundle(place, make):
    place.bundle.unlink()
    make(place.bundle)
    return [place.models, "--out", place.out]


def in_another_case(place):
    shutil.copy(place.lone / "te.txt", place.lone / "TE.txt")
    return [place.lone, "--out", place.out]


def effects_file(place, text):
    return place.campaign(CONDITIONS, "--effects", place.file("own.py", text))


RIG_HEAD = "[rig]\nreduction_ratio = 81.0\n"
RESONANCE = (
    '[[effect]]\nname = "structural_resonance"\nfrequency_Hz = 54\ndamping_ratio = 0.02\namplitude_deg = [0.1]\n'
)
#: name -> (what is given, part of the message)
CASES = {
    "no such folder": (lambda p: [p.folder / "none"], "no such file or folder"),
    "an unknown target": (lambda p: [p.models, "-t", "s7"], "no target 's7'"),
    "an unknown option": (lambda p: [p.models, "--tarket", "iec"], "No such option"),
    "out is a file": (lambda p: [p.lone, "--out", p.file("out", "")], "is a file"),
    "out below a file": (lambda p: [p.lone, "--out", p.file("f", "") / "out"], "Not a directory"),
    "out below a device": (lambda p: [p.lone, "--out", "/dev/null/out"], "Not a directory"),
    "a file's name is not UTF-8": (odd_name, "model name"),
    "out is a link": (out_link, "is a symbolic link"),
    "a folder for a bundle": (lambda p: instead_of_bundle(p, Path.mkdir), "is a folder; a file is wanted"),
    "a pipe for a bundle": (lambda p: instead_of_bundle(p, os.mkfifo), "no ordinary file; a file is wanted"),
    "a dead link for a bundle": (lambda p: instead_of_bundle(p, lambda path: path.symlink_to("x")), "no such file"),
    "a pipe for a model": (lambda p: [os.mkfifo(p.lone / "a.txt") or p.lone], "a.txt: no ordinary file"),
    "a folder for a model": (lambda p: [(p.lone / "a.txt").mkdir() or p.lone], "a.txt: a folder"),
    "a pipe for a configuration": (lambda p: [os.mkfifo(p.lone / "st-codegen.toml") or p.lone], "no ordinary file"),
    "models that differ in case only": (in_another_case, "two models would be called"),
    "bundle twice": (lambda p: p.in_bundle("[bundle]", "[[bundle]]"), "write [bundle]"),
    "bundle with a misspelt table": (lambda p: p.in_bundle("[bundle]", "[bundel]"), "did you mean 'bundle'"),
    "orders of other types": (lambda p: p.in_bundle("[0, 1]", '["a", {}]'), "orders = {} is not a whole number"),
    "a misspelt output": (lambda p: p.in_bundle("output = 0", "ouput = 0"), "did you mean 'output'"),
    "a feature's name is a list": (lambda p: p.in_bundle('"torque_Nm"', '["torque_Nm"]'), "name = ['torque_Nm'] is"),
    "a number of 400 digits": (lambda p: p.in_bundle("1800.0", "9" * 400), "a number of about 400 digits"),
    "a number of 5000 digits": (lambda p: p.in_bundle("1800.0", "9" * 5000), "not readable as TOML"),
    "deep nesting in a bundle": (lambda p: p.in_bundle("[0, 1]", DEEP), "nested too deeply"),
    "a bundle in Latin-1": (lambda p: p.bundle_bytes(b"[bundle]\nname = '\xe4'"), "save it as UTF-8"),
    "a bundle in UTF-16": (lambda p: p.bundle_bytes("[bundle]".encode("utf-16")), "is UTF-16"),
    "a bundle with NUL": (lambda p: p.bundle_bytes(b"[bundle]\n\0"), "not readable as TOML"),
    "markup in a bundle's keys": (lambda p: p.in_bundle("[bundle]", '[bundle]\n"[nan]" = 1'), "unknown key '[nan]'"),
    "escape sequences in a key": (
        lambda p: p.in_bundle("[bundle]", '[bundle]\n"\\u001b[2J" = 1'),
        r"unknown key '\x1b[2J'",
    ),
    "predict into a folder": (lambda p: p.predict(output="models"), "is a directory"),
    "predict below a file": (lambda p: p.predict(output="x.csv/y.csv"), "is a file; a folder is wanted"),
    "predict onto a full disk": (lambda p: [*p.predict()[:-1], "/dev/full"], "/dev/full: No space left"),
    "predict from Latin-1": (lambda p: p.predict(b"\xe4,f1,f2\n1,2,3\n"), "save it as UTF-8"),
    "predict from UTF-16": (lambda p: p.predict("f0,f1,f2\n1,2,3\n".encode("utf-16")), "is UTF-16"),
    "predict from a long field": (lambda p: p.predict(f"f0,f1,f2\n{LONG},2,3\n"), "field larger than field limit"),
    "predict from Python's digits": (lambda p: p.predict("f0,f1,f2\n1_0,2,3\n"), "'1_0' is not a number"),
    "predict from Arabic digits": (lambda p: p.predict("f0,f1,f2\n\u0661,2,3\n"), "is not a number"),
    "predict from NUL": (lambda p: p.predict("f0,f1,f2\n1\0,2,3\n"), "is not a number"),
    "predict from a huge number": (lambda p: p.predict(f"f0,f1,f2\n{'9' * 400},2,3\n"), "a 64-bit number"),
    "predict without a column": (lambda p: p.predict("[nan],f1,f2\n1,2,3\n"), "the header has [nan], f1, f2"),
    "predict from nothing": (lambda p: p.predict(""), "the file is empty"),
    "predict from a folder": (lambda p: [*p.predict()[:5], p.models, *p.predict()[6:]], "is a folder"),
    "verify what is not there": (lambda p: ["verify", p.lone, "--generated", p.out], "out"),
    "verify into a folder": (
        lambda p: ["verify", p.lone, "--generated", p.generated(), "--json", p.models],
        "director",
    ),
    "verify onto a full disk": (
        lambda p: ["verify", p.lone, "--generated", p.generated(), "--rows", 100, "--json", "/dev/full"],
        "No space left",
    ),
    "verify with odd rows": (lambda p: ["verify", p.lone, "--rows", "1_0"], "'1_0' is not a whole number"),
    "verify with no budget": (lambda p: ["verify", p.lone, "--cycle-us", "nan"], "'nan' is not finite"),
    "a deep manifest": (lambda p: ["verify", p.lone, "--generated", p.generated(DEEP)], "nested too deeply"),
    "a manifest in Latin-1": (lambda p: ["verify", p.lone, "--generated", p.generated(b"\xe4")], "st-codegen.json"),
    "a profile of another kind": (lambda p: [p.lone, "--profile", p.bundle], "unknown table [bundle]"),
    "diff of nothing": (lambda p: ["diff", p.out, p.out], "out"),
    "diff into a folder": (lambda p: ["diff", p.generated(), p.generated(), "--json", p.models], "is a folder"),
    "calibrate from Latin-1": (lambda p: p.calibrate(b"block,caches,us\n\xe4,warm,1\n"), "save it as UTF-8"),
    "calibrate from a long field": (lambda p: p.calibrate(f"block,caches,us\n{LONG},warm,1\n"), "field larger"),
    "calibrate from words": (lambda p: p.calibrate("block,caches,us\nFB_Te,warm,1_0\n"), "'1_0' is not a number"),
    "calibrate into a folder": (lambda p: p.calibrate(out="models"), "is a directory"),
    "conditions in Latin-1": (lambda p: p.campaign(CONDITIONS.encode() + b"\xe4"), "save it as UTF-8"),
    "conditions with a long field": (lambda p: p.campaign(CONDITIONS + LONG), "field larger"),
    "conditions without a column": (
        lambda p: p.campaign("speed_rpm\n1\n"),
        "the columns 'torque_Nm', 'temperature_C' are missing",
    ),
    "conditions at standstill": (lambda p: p.campaign(CONDITIONS + "0,1,2\n"), "speed_rpm: 0 is not positive"),
    "noise that is no number": (lambda p: p.campaign(CONDITIONS, "--noise", "nan"), "'nan' is not finite"),
    "a campaign below a file": (lambda p: [*p.campaign(), "--out", p.file("f", "") / "out"], "is a file; a folder"),
    "rig twice": (lambda p: p.with_rig("[[rig]]\nreduction_ratio = 81.0\n"), "write [rig]"),
    "a rig without anything": (lambda p: p.with_rig(""), "'rig' is missing"),
    "a rig with a misspelt axis": (lambda p: p.with_rig(RIG_HEAD + "[axsi]\n"), "did you mean 'axis'"),
    "a rig with a misspelt motor": (lambda p: p.with_rig(RIG_HEAD + "[axis.motr]\n"), "did you mean 'motor'"),
    "a rig with orders of other types": (
        lambda p: p.with_rig(RIG_HEAD + RESONANCE + 'orders = ["a", {}]\n'),
        "orders = {} is not a whole number",
    ),
    "a rig with an effect's list": (lambda p: p.with_rig(RIG_HEAD + "[effect]\n"), "write [[effect]] above each"),
    "a rig with a number of 400 digits": (lambda p: p.with_rig(f"[rig]\nreduction_ratio = {'9' * 400}"), "400 digits"),
    "a rig with deep nesting": (lambda p: p.with_rig(f"a = {DEEP}"), "nested too deeply"),
    "a rig in UTF-16": (lambda p: p.with_rig("[rig]".encode("utf-16")), "is UTF-16"),
    "effects that are no Python": (lambda p: effects_file(p, "class"), "cannot be loaded (SyntaxError"),
    "effects that leave": (lambda p: effects_file(p, "raise SystemExit(0)"), "cannot be loaded (SystemExit"),
    "a profile in Latin-1": (lambda p: p.motion(PROFILE.encode() + b"\xe4"), "save it as UTF-8"),
    "a profile with words": (lambda p: p.motion(PROFILE + "4,4,\u0664\n"), "is not a number"),
    "odd orders": (lambda p: p.motion(PROFILE, "--orders", "0,1_0"), "orders '0,1_0' are not whole numbers"),
    "a lead that is no number": (lambda p: p.motion(PROFILE, "--lead", "nan"), "lead 'nan'"),
    "an input that is no number": (lambda p: p.motion(PROFILE, "--set", "fBlendTime_s=1_0"), "give an input of"),
    "a table in Latin-1": (lambda p: p.train(TABLE.encode() + b"\xe4"), "save it as UTF-8"),
    "a table with a long field": (lambda p: p.train(TABLE + LONG), "field larger"),
    "a table with odd digits": (lambda p: p.train(TABLE + "forward,1_0,2,3,4,5,6\n"), "'1_0' is not a number"),
    "a table with two rows": (lambda p: p.train(TABLE), "at least"),
    "odd orders to train": (lambda p: p.train(TABLE, "--orders", "0,1_0"), "--orders 0,1_0"),
    "no ratio": (lambda p: p.train(TABLE, "--reduction-ratio", "nan"), "'nan' is not finite"),
    "fits in a folder": (lambda p: p.train(TABLE, "--work", p.models), "director"),
    "fits in another file": (lambda p: p.train(MANY, "--work", p.rig), "not a file of finished fits"),
    "tables of nothing": (lambda p: ["tables", p.folder], "not found"),
    "reconcile with Latin-1": (lambda p: p.reconcile(TABLE.encode() + b"\xe4"), "UTF-8"),
    "reconcile with a long field": (lambda p: p.reconcile(TABLE + LONG), "field larger"),
    "reconcile with nothing": (lambda p: p.reconcile(""), "empty"),
    "reconcile into a file": (lambda p: [*p.reconcile(), "--out", p.rig], "is a file"),
    "reconcile with no scale": (lambda p: p.reconcile(TABLE, "--scale", "nan"), "'nan' is not finite"),
    "reconcile with a folder of nothing": (
        lambda p: ["reconcile", "--rig", p.rig, "--measured", p.lone, "--out", p.out],
        "no curve files",
    ),
    "latency of nothing": (lambda p: ["latency", "--fast", "nan"], "'nan' is not finite"),
    "latency of a huge cycle": (lambda p: ["latency", "--fast", "1e308"], "give 0.1 .. 10000000 (10 s)"),
}


@pytest.mark.parametrize("name", CASES)
def test_one_message_and_nothing_written(name, place, capsys):
    arrange, part = CASES[name]
    arguments = arrange(place)
    before = snapshot(place.folder)
    capsys.readouterr()
    assert run(*arguments) == 2
    shown = capsys.readouterr()
    assert re.search(r"^STC(?!1000)\d{4}(, STC\d{4})*: st-codegen explain \w+ says what to do\n\Z", shown.err, re.M)
    assert part in shown.err
    assert "Traceback" not in shown.err + shown.out
    assert "defect" not in shown.err
    assert len(re.findall(r"(?im)^error:", shown.err)) == 1
    assert "\x1b[2J" not in shown.err
    assert len(shown.err) < 4000
    after = snapshot(place.folder)
    after.pop("fits", None)  # finished fits are kept for the next try
    assert after == before


def test_decimal_commas_are_read_by_predict(place):
    assert run(*place.predict("f0;f1;f2\n500,5;300;27,25\n")) == 0
    with_commas = (place.folder / "y.csv").read_text()
    assert run(*place.predict("f0,f1,f2\n500.5,300,27.25\n")) == 0
    assert (place.folder / "y.csv").read_text() == with_commas


def broken(*arguments, **options):
    raise KeyError("[nan]")


def test_a_defect_of_ours_asks_for_a_report(place, capsys, monkeypatch):
    monkeypatch.setattr("st_codegen.proof.predict.table_text", broken)
    before = snapshot(place.folder)
    arguments = place.predict()
    assert run(*arguments) == 70
    shown = capsys.readouterr().err
    assert re.search(r"error: KeyError: '\[nan\]'\n.*defect of st-codegen .*please report it; --traceback", shown)
    assert "Traceback" not in shown
    assert snapshot(place.folder).keys() - before.keys() == {"x.csv"}
    assert run(*arguments, "--traceback") == 70
    assert "Traceback" in capsys.readouterr().err
    monkeypatch.setenv("ST_CODEGEN_TRACEBACK", "1")
    assert run(*arguments) == 70
    assert "Traceback" in capsys.readouterr().err


def test_text_that_is_wrong_is_a_defect_and_leaves_the_earlier_project_whole(place, capsys, monkeypatch):
    out = place.folder / "generated"
    assert run(place.lone, "--target", "iec", "--out", out, "-q") == 0
    before = snapshot(place.folder)
    template = render.templates_folder() / "common" / "operations" / "outputs.st.j2"
    wrong = place.folder / "templates"
    shutil.copytree(render.templates_folder(), wrong)
    (wrong / "common" / "operations" / "outputs.st.j2").write_text(template.read_text() + "FOR nTwice := 0 TO 0 DO")
    monkeypatch.setattr(render, "templates_folder", lambda: wrong)
    for target in ("iec", "twincat"):
        assert run(place.lone, "--target", target, "--out", out, "-q") == 70
        shown = capsys.readouterr().err
        assert shown.count("error:") == 1
        assert "DefectError: st-codegen wrote text that it cannot read itself" in shown
        assert "Traceback" not in shown
    shutil.rmtree(wrong)
    assert snapshot(place.folder) == before


@pytest.mark.parametrize(
    ("error", "code", "part"),
    [
        (MemoryError(), 2, "not enough memory"),
        (OSError(28, "No space left on device", "/a[b]"), 2, "/a[b]: No space left on device"),
        (OSError("odd"), 2, "odd"),
        (OSError("full (os error 28)"), 2, "full (os error 28)"),
        (RecursionError(), 2, "nested too deeply"),
        (InputError("x: [red]wrong[/red]"), 2, "x: [red]wrong[/red]"),
        (KeyboardInterrupt(), 130, "stopped"),
        (ValueError("x"), 70, "ValueError: x"),
        (AssertionError(), 70, "AssertionError"),
    ],
)
def test_every_kind_of_failure_has_its_exit_code(place, capsys, monkeypatch, error, code, part):
    def fail(*arguments, **options):
        raise error

    monkeypatch.setattr("st_codegen.proof.predict.table_text", fail)
    assert run(*place.predict()) == code
    assert part in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix", reason="a limit of the size of files stands for a full disk")
@pytest.mark.parametrize(
    ("command", "named"),
    [
        (lambda p: p.predict("f0,f1,f2\n" + "1,2,3\n" * 2000), "y.csv"),
        (lambda p: [p.lone, "--target", "iec", "--out", p.out, "-q"], "out"),
        (lambda p: [*p.campaign()[:-1], p.out / "runs"], "out/runs"),
    ],
)
def test_a_disk_that_fills_is_named_and_nothing_is_left(place, capsys, command, named):
    """The system names no file in the middle of a write; nor does what writes curves, which is no Python."""
    limits = importlib.import_module("resource")
    arguments = command(place)
    place.out.mkdir()
    before = snapshot(place.folder)
    old = limits.getrlimit(limits.RLIMIT_FSIZE)
    limits.setrlimit(limits.RLIMIT_FSIZE, (2000, old[1]))
    try:
        code = run(*arguments)
    finally:
        limits.setrlimit(limits.RLIMIT_FSIZE, old)
    assert code == 2
    assert f"error: {place.folder / named}: File too large" in capsys.readouterr().err
    assert snapshot(place.folder) == before


def test_a_log_on_a_full_disk_changes_no_exit_code(place):
    """Standard output or standard error cannot be written: 1 would say that something differs."""
    with open("/dev/full", "w") as full:  # noqa: PTH123
        for streams in ({"stdout": full}, {"stderr": full}):
            command = [sys.executable, "-m", "st_codegen", "explain", "STC1002" if "stdout" in streams else "x"]
            done = subprocess.run(
                command, check=False, **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **streams}, text=True
            )
            assert done.returncode == 2, streams
            assert "stderr" in streams or "error: standard output: No space left" in done.stderr


def test_results_with_markup_are_shown_as_they_are(place, capsys):
    """A model and an output whose names look like markup."""
    shutil.copy(place.lone / "te.txt", place.lone / "te_2.txt")
    generated = place.generated()
    capsys.readouterr()
    path = generated / "twincat" / "st-codegen.json"
    path.write_text(path.read_text().replace('"te_2"', '"[bold]te_2[/bold]"'))
    shutil.copytree(generated, place.folder / "other")
    manifest = json.loads(path.read_text())
    del manifest["models"]["[bold]te_2[/bold]"]
    path.write_text(json.dumps(manifest))
    assert run("diff", generated, place.folder / "other") == 1
    assert "[bold]te_2[/bold]" in capsys.readouterr().out


MUTATED = {
    "bundle": lambda p: ([p.models, "--check", "--layout", "trees", "--out", p.out], p.bundle),
    "rig": lambda p: (p.campaign(CONDITIONS, "--samples", "500"), p.rig),
    "conditions": lambda p: (p.campaign(CONDITIONS, "--samples", "500"), p.folder / "C.csv"),
    "inputs": lambda p: (p.predict(), p.folder / "x.csv"),
    "table": lambda p: (p.reconcile(), p.folder / "m.csv"),
}
EDITS = st.lists(
    st.tuples(st.floats(0, 1), st.integers(0, 12), st.binary(max_size=6) | st.sampled_from([b"[", b"{", b'"', b"\n"])),
    min_size=1,
    max_size=4,
)


@pytest.mark.parametrize("kind", MUTATED)
@examples(25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(edits=EDITS)
def test_damaged_files_never_end_in_a_traceback(kind, place, capsys, edits):
    arguments, path = MUTATED[kind](place)
    good = path.read_bytes()
    content = bytearray(good)
    for where, length, inserted in edits:
        start = int(where * len(content))
        content[start : start + length] = inserted
    path.write_bytes(content)
    try:
        with pytest.raises(SystemExit) as caught:
            main([str(argument) for argument in arguments])
    finally:
        path.write_bytes(good)
        shutil.rmtree(place.out, ignore_errors=True)
    assert caught.value.code in (None, 0, 1, 2), capsys.readouterr().err
