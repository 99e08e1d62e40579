"""The budget, the explanation and the calibration on the command line."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from st_codegen.cli.costs import magnitude_text
from st_codegen.cli.main import main
from st_codegen.cost.profile import load_profile
from st_codegen.driver import generate
from st_codegen.emit.targets import TARGETS
from st_codegen.passes.choose import Options
from st_codegen.passes.pipeline import compile_models
from st_codegen.project.bundle import load
from st_codegen.proof.explain import InputLimit, Pricing
from st_codegen.proof.runner import GeneratedCode
from st_codegen.proof.verify import cycle_cost


def run(*arguments):
    with pytest.raises(SystemExit) as caught:
        main([str(argument) for argument in arguments])
    return caught.value.code


@pytest.fixture
def generated(generated_once):
    return generated_once("bundle", ("twincat",))


def test_explain_lists_the_inputs_that_are_refused(bundle_folder, tmp_path, capsys):
    models = Path(__file__).resolve().parents[2] / "golden" / "lone" / "models"
    for name, shown in (("svr.skops", "1e+"), ("random_forest.skops", "3.40282356"), ("lightgbm_gbdt.txt", None)):
        assert run(models / name, "--target", "iec", "--out", tmp_path, "--explain") == 0
        text = capsys.readouterr().err
        if shown is None:
            assert "no model refuses an input for its magnitude" in text
        else:
            assert re.search(rf"inputs that are refused: .*{name.split('.')[0]} .*f0 .*{re.escape(shown)}", text, re.S)


def _times_said(capsys):
    """The worst case and the budget of the verdict."""
    text = " ".join(capsys.readouterr().err.split())
    found = re.search(r"([\d.]+) us with cold ones on .*, budget ([\d.]+) us", text)
    return float(found[1]), float(found[2])


def test_verify_fails_with_a_table_when_a_cycle_does_not_fit(bundle_folder, generated, tmp_path, capsys):
    verify = ["verify", bundle_folder, "--generated", generated, "--rows", 50]
    report = tmp_path / "report.json"
    assert run(*verify, "--cycle-us", 250, "--json", report) == 0
    assert "fits" in capsys.readouterr().err
    content = json.loads(report.read_text())["costs"]["twincat"]
    assert content["fits"] is True
    assert content["entries"] == ["PRG_Experiment", "PRG_Main"]
    assert {"FB_Compensator", "FB_TEPredict"} < content["blocks"].keys()
    block = content["blocks"]["FB_TEPredict"]
    assert 0.0 < block["warm_us"] < block["cold_us"] < content["cold_us"]
    assert block["operations"]["load"] > 10
    assert block["table_bytes"] > 0

    assert run(*verify, "--cycle-us", 1, "--profile", "cx5140", "-q", "--json", report) == 1
    shown = capsys.readouterr().err
    assert "DOES NOT FIT" in shown
    assert "FB_TEPredict" in shown
    content = json.loads(report.read_text())
    assert content["passed"] is False
    assert content["costs"]["twincat"]["cycle_us"] == 1
    assert all(model["passed"] for model in content["models"].values())
    # one block alone; a time that is over its budget was shown as the budget itself
    assert run(*verify, "--cycle-us", block["cold_us"] + 0.01, "--entry", "FB_TEPredict") == 0
    cold, budget = _times_said(capsys)
    assert block["cold_us"] <= cold <= budget == block["cold_us"] + 0.01
    assert run(*verify, "--cycle-us", block["cold_us"] - 0.01, "--entry", "FB_TEPredict") == 1
    cold, budget = _times_said(capsys)
    assert cold >= block["cold_us"] > budget
    # without a budget nothing can be exceeded
    assert run(*verify) == 0


@pytest.mark.parametrize("wish", ["with_comparison", "with_tests"])
def test_programs_that_do_not_run_in_operation_are_no_cycle(lone_folder, tmp_path, wish):
    """A project of blocks that nobody calls yet has no other programs than these."""
    bundle = load(lone_folder)
    folders = [generate(bundle, "twincat", tmp_path / "a"), generate(bundle, "twincat", tmp_path / "b", **{wish: True})]
    plain, more = (cycle_cost(GeneratedCode(made.folder), load_profile()) for made in folders)
    assert plain.entries == more.entries == ("FB_Te",)
    assert more.cold_us == plain.cold_us > 0.0


def test_a_runtime_of_which_no_time_is_known_fits_no_budget(lone_folder, tmp_path, capsys):
    page = tmp_path / "page.html"
    explained = ("--target", "beckhoff-ml", "--out", tmp_path / "out", "--explain", "--html", page)
    assert run(lone_folder, *explained) == 0
    assert "beckhoff-ml: no bound is known." in page.read_text(encoding="utf-8")
    assert "This is no bound; what has none was counted once: FB_M" in page.read_text(encoding="utf-8")
    assert run("verify", lone_folder, "--generated", tmp_path / "out", "--rows", 50, "--cycle-us", 1000) == 1
    shown = capsys.readouterr().err
    assert "Predict: a block of a library, whose time is not known" in shown
    assert "beckhoff-ml: no bound; what has none counted once: " in shown


def test_wrong_options_exit_with_2(bundle_folder, generated, capsys):
    verify = ["verify", bundle_folder, "--generated", generated, "--rows", 50]
    assert run(*verify, "--profile", "abacus") == 2
    assert "no profile 'abacus': use one of" in capsys.readouterr().err
    assert run(*verify, "--cycle-us", 0) == 2
    assert run(*verify, "--entry", "FB_None") == 2
    assert "no block FB_None" in capsys.readouterr().err


@pytest.mark.parametrize(("magnitude", "shown"), [(1e304, "1e+304"), (0.1, "0.1"), (float("inf"), "infinite")])
def test_limits_have_the_digits_that_headers_have(magnitude, shown):
    assert magnitude_text(InputLimit("te", "speed", np.float64(magnitude))) == shown


def test_explain_shows_the_layouts_and_what_the_text_costs(bundle_folder, tmp_path, capsys):
    assert run(bundle_folder, "--out", tmp_path / "out", "--explain", "-q") == 0
    shown = capsys.readouterr().err
    assert "FB_TEPredict" in shown
    assert "us with cold ones on cx5140" in shown
    assert "trees" in shown
    # chosen by the emitted text: the first layout of a model is the cheapest one
    assert run(bundle_folder, "--out", tmp_path / "other", "--profile", "cx5140", "--explain", "-q") == 0
    assert "layouts, a block alone on cx5140" in capsys.readouterr().err
    assert run(bundle_folder, "--profile", "abacus") == 2


def test_layouts_are_chosen_by_the_worst_case_of_their_text(bundle_folder):
    bundle = load(bundle_folder)
    target = TARGETS["twincat"]
    pricing = Pricing(target, target.limits, load_profile())
    compiled = compile_models(bundle.irs, Options(), pricing)
    for decision in compiled.decisions:
        costs = [candidate.cost.cold_us for candidate in decision.candidates]
        assert costs == sorted(costs)
        assert pricing(decision.candidates[0].model).cold_us == costs[0]
        assert pricing.block(decision.candidates[0].model).is_bounded


def test_a_layout_that_cannot_be_printed_is_passed_over(tmp_path, capsys):
    """With --profile it was refused though a table fits, and --explain ended with an error behind what was written."""
    lightgbm = pytest.importorskip("lightgbm")
    x = np.repeat(np.array([[i, j] for i in range(3) for j in range(3)], np.float64), 10, axis=0)
    settings = {"num_leaves": 9, "min_data_in_leaf": 1, "verbose": -1, "num_threads": 1}
    made = lightgbm.train(settings, lightgbm.Dataset(x, np.repeat(np.random.default_rng(1).normal(size=9), 10)), 30)
    made.save_model(tmp_path / "grid.txt")
    options = ("--target", "iec", "--max-array", 10, "-q")
    assert run(tmp_path / "grid.txt", "--out", tmp_path / "plain", "--explain", *options) == 0
    assert "as trained" not in capsys.readouterr().err
    assert run(tmp_path / "grid.txt", "--out", tmp_path / "priced", "--profile", "cx5140", *options) == 0


def test_calibrate_writes_a_profile_that_verify_takes(bundle_folder, generated, tmp_path, capsys):
    report, times, mine = tmp_path / "report.json", tmp_path / "times.csv", tmp_path / "deep" / "mine.toml"
    verify = ["verify", bundle_folder, "--generated", generated, "--rows", 50, "-q", "--json", report]
    assert run(*verify) == 0
    blocks = json.loads(report.read_text())["costs"]["twincat"]["blocks"]
    with times.open("w", newline="") as file:
        rows = [("block", "caches", "us")]
        rows += [
            (name, side, blocks[name][f"{side}_us"] / 2)
            for name in ("FB_Compensator", "FB_TEPredict")
            for side in ("warm", "cold")
        ]
        csv.writer(file).writerows(rows)
    assert run("calibrate", generated, "--measured", times, "--out", mine) == 0
    assert "compute x 0.5" in capsys.readouterr().err
    assert not list(mine.parent.glob("*.partial"))
    assert run(*verify, "--profile", mine) == 0
    after = json.loads(report.read_text())["costs"]["twincat"]["blocks"]
    assert after["FB_TEPredict"]["cold_us"] == pytest.approx(blocks["FB_TEPredict"]["cold_us"] / 2, rel=1e-4)
    times.write_text("block,caches,us\nFB_None,warm,1\n")
    mine.unlink()
    assert run("calibrate", generated, "--measured", times, "--out", mine) == 2
    assert "no block 'FB_None'" in capsys.readouterr().err
    assert not mine.exists()
    assert run("calibrate", generated, "--measured", times, "--out", tmp_path / "mine.txt") == 2
