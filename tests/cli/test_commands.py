import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from st_codegen.cli.diff import _lines
from st_codegen.cli.generate import command as generate_command
from st_codegen.files.number_text import percent, plain_number
from st_codegen.project.build_options import LAYOUTS
from st_codegen.proof.review import Change, LabelChange, ModelChange, OutputChange, Review
from tests.cli.helpers import run


def test_a_folder_without_a_command_is_compiled(lone_folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(lone_folder, "--target", "twincat") == 0
    assert (tmp_path / "generated" / "twincat" / "POUs" / "FB_Te.TcPOU").is_file()
    assert run("--target", "iec", lone_folder, "--out", "plc") == 0
    assert (tmp_path / "plc" / "iec" / "FB_Te.st").is_file()


def test_a_second_target_without_a_place_leaves_the_first_unwritten(lone_folder, tmp_path):
    (tmp_path / "iec").touch()
    assert run(lone_folder, "--target", "twincat", "--target", "iec", "--out", tmp_path) == 2
    assert not (tmp_path / "twincat").exists()


@pytest.mark.thorough
def test_the_program_runs_as_a_module_and_says_its_version(lone_folder, tmp_path):
    def module(*arguments):
        return subprocess.run(
            [sys.executable, "-m", "st_codegen", *map(str, arguments)], capture_output=True, text=True, check=False
        )

    assert re.search(r"st-codegen, version \d", module("--version").stdout)
    done = module(lone_folder, "--target", "iec", "--out", tmp_path / "out")
    assert done.returncode == 0
    assert done.stdout == ""
    assert "FB_Te.st" in done.stderr
    assert "\r" not in done.stderr  # no progress bar without a terminal
    quiet = module(lone_folder, "--target", "iec", "--out", tmp_path / "out", "--quiet")
    assert (quiet.stdout, quiet.stderr) == ("", "")
    failed = module(lone_folder, "--target", "s7")
    assert failed.returncode == 2
    assert "no target 's7'; choose from" in failed.stderr
    assert "Traceback" not in failed.stderr


def test_input_errors_end_with_code_2_and_write_nothing(lone_folder, tmp_path, capsys):
    (lone_folder / "bad.json").write_text("{")
    out = tmp_path / "out"
    assert run(lone_folder, "--target", "twincat", "--out", out) == 2
    assert "bad.json" in capsys.readouterr().err
    assert not out.exists()


def test_messages_with_brackets_are_shown_as_they_are(bundle_folder, capsys):
    path = bundle_folder / "bundle.toml"
    path.write_text(path.read_text(encoding="utf-8").replace("[bundle]", "[bold]"), encoding="utf-8")
    assert run(bundle_folder) == 2
    assert "unknown table [bold]" in capsys.readouterr().err


def test_check_exits_with_1_and_a_diff(lone_folder, tmp_path, capsys):
    out = tmp_path / "out"
    assert run(lone_folder, "--check", "--out", out, "-q") == 1
    assert "+FUNCTION_BLOCK FB_Te" in capsys.readouterr().out
    assert not (out / "twincat").exists()
    assert run(lone_folder, "--out", out, "-q") == 0
    capsys.readouterr()
    assert run(lone_folder, "--check", "--out", out, "-q") == 0
    assert capsys.readouterr().out == ""


def test_verify_reports_and_exits_with_0_or_1(lone_folder, tmp_path, capsys):
    out, report = tmp_path / "out", tmp_path / "deep" / "report.json"
    run(lone_folder, "--out", out, "-q", "--layout", "trees")
    assert run("verify", lone_folder, "--generated", out, "--json", report, "--rows", 300) == 0
    assert "equal bits" in capsys.readouterr().err
    content = json.loads(report.read_text())
    assert content["passed"] is True
    assert content["models"]["te"]["n"] >= 300
    path = out / "twincat" / "POUs" / "FB_Te.TcPOU"
    path.write_text(path.read_text(encoding="utf-8").replace("fOut1 := ", "fOut1 := 0.5 * "), encoding="utf-8")
    assert run("verify", lone_folder, "--generated", out, "--json", report, "--rows", 300) == 1
    error = capsys.readouterr().err
    assert "FAILED" in error
    assert "library, reference and generated text compared (FAILED: 1)" in error  # no claim that they are equal
    assert "library = reference" not in error
    assert re.search(r"te: reference and twincat differ at \[", error)
    assert json.loads(report.read_text())["passed"] is False
    assert run("verify", lone_folder, "--generated", tmp_path / "none") == 2


@pytest.mark.parametrize("engine", ["st", "reference", "source"])
def test_predict_writes_full_precision(lone_folder, tmp_path, engine):
    (tmp_path / "x.csv").write_text("torque_Nm,speed_rpm,temperature_C\n300,500,27\nnan,1e3,inf\n")
    files = ["--input", tmp_path / "x.csv", "--output", tmp_path / "y.csv"]
    assert run("predict", lone_folder, *files, "--engine", engine) == 0
    lines = Path(tmp_path / "y.csv").read_text().splitlines()
    assert lines[0] == "te"
    assert len(lines) == 3
    assert float(lines[1]) == float(f"{float(lines[1]):.17g}")


def test_predict_does_not_write_over_its_inputs(lone_folder, tmp_path, capsys):
    table = tmp_path / "x.csv"
    table.write_text("torque_Nm,speed_rpm,temperature_C\n300,500,27\n")
    assert run("predict", lone_folder, "--input", table, "--output", tmp_path / "." / "x.csv") == 2
    assert "is the table of inputs" in capsys.readouterr().err and table.read_text().endswith("300,500,27\n")


def test_predict_writes_to_standard_output(lone_folder, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("x.csv").write_text("torque_Nm,speed_rpm,temperature_C\n300,500,27\n")
    assert run("predict", lone_folder, "--input", "x.csv", "--output", "y.csv") == 0
    capsys.readouterr()
    assert run("predict", lone_folder, "--input", "x.csv", "--output", "-") == 0
    assert capsys.readouterr().out == Path("y.csv").read_text()
    assert not Path("-").exists()


@pytest.mark.parametrize(
    ("json_file", "page", "message"),
    [
        ("a", "sub/../a", "Invalid value for '--html': 'sub/../a' is the file of --json, too."),
        ("file/x", "b", r"file is a file; a folder is wanted there."),
        ("b", "locked/x", "Invalid value for '--html': 'locked/x' may not be written by you."),
        ("/dev/null", "/dev/null", ""),
    ],
)
def test_a_file_that_will_not_be_there_at_the_end_is_refused_at_the_beginning(
    lone_folder, tmp_path, monkeypatch, capsys, json_file, page, message
):
    """It was seen when all was computed, and of two reports in one file the first was lost without a word."""
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    for folder in ("sub", "locked"):
        Path(folder).mkdir()
    monkeypatch.setattr(os, "access", lambda path, _: Path(path).name != "locked")
    code = run("verify", lone_folder, "--json", json_file, "--html", page)
    shown = capsys.readouterr().err
    assert code == 2
    assert message in shown
    assert ("Invalid value" in shown) == bool(message)


def test_an_option_for_bundles_is_refused_beside_lone_models(lone_folder, tmp_path, capsys):
    assert run(lone_folder, "--out", tmp_path, "--outputs-per-cycle", "1") == 2
    assert "--outputs-per-cycle spreads the models of a bundle" in capsys.readouterr().err


def test_the_out_folder_may_not_be_a_link_to_nothing(lone_folder, tmp_path, capsys):
    (tmp_path / "link").symlink_to("nowhere")
    assert run(lone_folder, "--out", tmp_path / "link") == 2
    assert "is a link to nothing; a folder is wanted there" in capsys.readouterr().err


def test_a_difference_of_any_target_is_one(lone_folder, tmp_path, capsys):
    for name in ("a", "b"):
        assert run(lone_folder, "--out", tmp_path / name, "--target", "iec", "--target", "twincat", "-q") == 0
    changed = tmp_path / "b" / "twincat" / "POUs" / "FB_Te.TcPOU"
    changed.write_text(changed.read_text(encoding="utf-8").replace("fOut1 := aStep2[0]", "fOut1 := 1.0"), "utf-8")
    capsys.readouterr()
    page = tmp_path / "page.html"
    assert run("diff", tmp_path / "a", tmp_path / "b", "--html", page) == 1
    assert capsys.readouterr().out == "files: 1 changed\n"
    assert "0 of 1 model changed in the target iec." in page.read_text(encoding="utf-8")
    assert "twincat/POUs/FB_Te.TcPOU" in page.read_text(encoding="utf-8")
    assert run("diff", tmp_path / "a" / "iec", tmp_path / "b" / "iec", "-q") == 0
    shutil.rmtree(tmp_path / "b" / "twincat")
    assert run("diff", tmp_path / "a", tmp_path / "b", "-q") == 1


def test_more_rows_than_were_asked_for_are_explained(lone_folder, tmp_path, capsys):
    assert run(lone_folder, "--out", tmp_path, "-q") == 0
    assert run("verify", lone_folder, "--generated", tmp_path, "--rows", 5) == 0
    assert "special values and thresholds take more than 5 rows: te" in capsys.readouterr().err
    assert run("verify", lone_folder, "--generated", tmp_path) == 0
    assert "take more than" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("share", "text"), [(0.0, "0.0%"), (0.0001, "below 0.1%"), (0.5, "50.0%"), (0.9999, "above 99.9%"), (1.0, "100.0%")]
)
def test_a_share_is_none_or_all_only_where_it_is(share, text):
    assert percent(share) == text


@pytest.mark.parametrize(("value", "text"), [(1800.0, "1800"), (0.1, "0.1"), (30.0000001, "30.0000001")])
def test_a_number_that_is_to_be_given_back_has_all_its_digits(value, text):
    assert plain_number(value) == text


def test_labels_of_a_model_file_do_not_act_on_the_terminal(tmp_path, capsys):
    tree, skops = pytest.importorskip("sklearn.tree"), pytest.importorskip("skops.io")
    labels = np.array(["low", "\x1b[31mred\x1b]0;title\x07"])
    for name, turned in (("a", False), ("b", True)):
        answers = labels[np.arange(40) % 2 if turned else np.arange(40) // 20]
        model = tree.DecisionTreeClassifier(random_state=0).fit(np.arange(40.0)[:, None], answers)
        (tmp_path / name).mkdir()
        skops.dump(model, tmp_path / name / "state.skops")
        assert run(tmp_path / name, "--target", "twincat", "--out", tmp_path / f"{name}.out", "-q") == 0
    capsys.readouterr()
    assert run("diff", tmp_path / "a.out", tmp_path / "b.out") == 1
    shown = capsys.readouterr()
    assert "\\x1b[31mred\\x1b]0;title\\x07" in shown.out
    assert not {"\x1b", "\x07"} & {*shown.out, *shown.err}


def test_diff_says_in_words_what_changed():
    def features(unit, **known):
        return [{"name": "speed_rpm", "unit": unit, **known}]

    known = {"range": [0.1, 1800.0000001], "range_from": "configuration", "limited": True}
    facts = (
        Change("trees", 1500, 5),
        Change(
            "features",
            features("rpm"),
            features("1/min", **known),
        ),
        Change("layout", "trees", "table"),
    )
    models = (
        ModelChange("te", facts, (OutputChange("y", 0.5, 0.1, {}),), 2000, 3, 1200, True, answered=797),
        ModelChange("same", (), (OutputChange("y", 0.0, 0.0, {}),), 2000, 0, 0, True, answered=2000),
        ModelChange("seldom", (), (), 2000, 0, 0, True, answered=0),
        ModelChange(
            *("labels", (), (OutputChange("class", 1.0, 0.25, {}),), 2000, 0, 0, True, ()),
            (LabelChange("a", "b", 0.25),),
            1500,
        ),
    )
    found = Review("iec", ("new",), ("old",), models, (Change("tasks", 1, 2),), {"a.st": "added", "b.st": "added"})
    assert _lines(found) == [
        "model added: new",
        "model removed: old",
        "tasks: 1 -> 2",
        "te: trees: 1,500 -> 5",
        "te: features: speed_rpm [rpm] -> speed_rpm [1/min] 0.1 .. 1800.0000001 (configuration, limited)",
        "te: layout: trees -> table",
        "te: of 2,000 operating points, 3 lost their answer, 1,200 gained one",
        "same: text changed, no output moved at 2,000 points",
        "seldom: none of 2,000 points that were tried is answered by both texts: its numbers were not compared",
        "labels: another label at 25.0% of the 1,500 of 2,000 points that both texts answer: a -> b 25.0%",
        "files: 2 added",
    ]


def test_diff_exits_with_1_on_a_difference(lone_folder, tmp_path, capsys):
    run(lone_folder, "--out", tmp_path / "a", "-q")
    run(lone_folder, "--out", tmp_path / "b", "-q")
    capsys.readouterr()
    assert run("diff", tmp_path / "a", tmp_path / "b") == 0
    assert "no difference" in capsys.readouterr().out
    path = tmp_path / "b" / "twincat" / "POUs" / "FB_Te.TcPOU"
    path.write_text(
        path.read_text(encoding="utf-8").replace("fOut1 := aStep2[0]", "fOut1 := aStep2[0] + 1.0"), encoding="utf-8"
    )
    assert run("diff", tmp_path / "a", tmp_path / "b") == 1
    shown = capsys.readouterr()
    assert "files: 1 changed" in shown.out
    assert "random points of the operating range, at which no input is missing; a larger change may" in " ".join(
        shown.err.split()
    )
    assert run("diff", tmp_path / "a", tmp_path / "b", "--json") == 1
    content = json.loads(capsys.readouterr().out)
    assert content["models"][0]["outputs"][0]["largest"] == pytest.approx(1.0)
    assert run("diff", tmp_path / "a", tmp_path / "b", "--json", tmp_path / "r.json", "-q") == 1
    assert json.loads((tmp_path / "r.json").read_text())["changed"] is True
    assert run("diff", tmp_path / "a", tmp_path / "nowhere") == 2


def test_models_is_a_command_and_a_folder_of_that_name_is_compiled(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run("models") == 0
    assert capsys.readouterr().out.startswith("| library | gives | models |")
    assert run("models", "--target", "iec") == 2
    assert "models: no such file or folder" in capsys.readouterr().err


def test_a_misspelt_command_is_named_unless_it_is_a_path(lone_folder, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run("veryfy", lone_folder) == 2
    assert "no such command, file or folder: 'veryfy'; did you mean 'verify'?" in capsys.readouterr().err
    assert run("cost", str(tmp_path)) == 2
    assert "no such command, file or folder: 'cost'.\n" in capsys.readouterr().err
    lone_folder.rename(tmp_path / "veryfy")
    assert run("veryfy", "-q") == 0


def test_a_file_that_the_configuration_leaves_out_is_not_called_unknown(lone_folder, capsys):
    (lone_folder / "st-codegen.toml").write_text('[project]\nleave_out = ["te.*"]\n')
    assert run(lone_folder / "te.txt") == 2
    assert "te.txt: left out by leave_out in st-codegen.toml" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["models"], ["--help"], ["explain"], ["doctor"]])
def test_a_closed_pipe_is_no_answer(arguments):
    """What printed to nobody ends as other programs do, and says nothing of it."""
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [sys.executable, "-m", "st_codegen", *arguments], stdout=writing, stderr=subprocess.PIPE, check=False
    )
    os.close(writing)
    assert (done.returncode, done.stderr) == (141, b"")


def test_the_files_that_were_written_are_counted_with_the_list_of_them(lone_folder, tmp_path, capsys):
    assert run(lone_folder, "--out", tmp_path, "--target", "iec") == 0
    assert "iec: 2 files and st-codegen.json, the list of what was written" in " ".join(capsys.readouterr().err.split())
    assert len(list((tmp_path / "iec").iterdir())) == 3


def test_the_help_has_every_layout():
    (option,) = [o for o in generate_command.params if o.name == "layout"]
    assert [name for name in LAYOUTS if f" {name}," not in option.help.replace("auto, and", "auto,")] == []


def test_what_is_no_longer_generated_is_said_to_be_removed(lone_folder, lightgbm_text, tmp_path, capsys):
    (lone_folder / "other.txt").write_text(lightgbm_text)
    assert run(lone_folder, "--out", tmp_path, "--target", "iec") == 0
    assert "removed" not in capsys.readouterr().err
    (lone_folder / "other.txt").unlink()
    assert run(lone_folder, "--out", tmp_path, "--target", "iec") == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "removed, since no longer generated: 1 file: FB_Other.st" in said


def test_numbers_that_are_not_compared_are_said_to_be_so(lone_folder, tmp_path, capsys):
    """A model of other inputs has no rows in common with the old one: without a word it looked as if nothing moved."""
    lightgbm = pytest.importorskip("lightgbm")
    assert run(lone_folder, "--out", tmp_path / "old", "--target", "iec", "-q") == 0
    x = np.random.default_rng(0).uniform(size=(100, 2))
    booster = lightgbm.train({"verbose": -1, "num_threads": 1}, lightgbm.Dataset(x, x.sum(axis=1)), 3)
    booster.save_model(lone_folder / "te.txt")
    assert run(lone_folder, "--out", tmp_path / "new", "--target", "iec", "-q") == 0
    capsys.readouterr()
    assert run("diff", tmp_path / "old", tmp_path / "new") == 1
    shown = capsys.readouterr().out
    assert "te: not as many inputs or outputs as before: its numbers were not compared" in shown
    assert "[]" not in shown


@pytest.mark.parametrize("command", ["verify", "prove"])
def test_text_that_was_changed_by_hand_is_said_to_be_so(lone_folder, tmp_path, capsys, command):
    assert run(lone_folder, "--out", tmp_path, "--target", "iec", "-q") == 0
    assert run(command, lone_folder, "--generated", tmp_path) == 0
    assert "not as generated" not in capsys.readouterr().err
    block = tmp_path / "iec" / "FB_Te.st"
    block.write_text(block.read_text(encoding="utf-8").replace("bValid : BOOL;", "bValid : BOOL; (* mine *)"), "utf-8")
    assert run(command, lone_folder, "--generated", tmp_path) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "iec: not as generated: FB_Te.st; what is said here is of the text as it is now" in said
