"""`st-codegen train` and `st-codegen tables` as a user calls them."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from st_codegen.campaign.harmonic_table import joined, read_table, write_table
from st_codegen.cli import train
from st_codegen.cli.main import cli, main
from st_codegen.cli.tables import ERRORS, PREDICTIONS, TABLE
from st_codegen.emit.blocks.model import input_variables
from st_codegen.emit.targets import TARGETS
from st_codegen.project.bundle import load
from st_codegen.st import Machine, load_project
from st_codegen.training import paper
from st_codegen.training.export import FEATURES
from st_codegen.training.study import study
from st_codegen.training.tables import COLUMNS
from st_codegen.training.targets import Coordinates
from tests import browser
from tests.training.conftest import ORDERS, a_table, write_campaign

FAST = ["--families", "DT,ET", "--folds", "2", "--jobs", "1"]


def run(*arguments):
    result = CliRunner().invoke(cli, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result


def refused(capsys, *arguments):
    with pytest.raises(SystemExit) as error:
        main([str(a) for a in arguments])
    assert error.value.code == 2
    return capsys.readouterr().err


@pytest.mark.thorough
def test_a_table_becomes_a_bundle_that_compiles(tmp_path):
    write_table(joined([a_table(), a_table(backward=True)]).only([0, 39]), tmp_path / "t.csv")
    arguments = ["train", tmp_path / "t.csv", "--out", tmp_path / "m", "--json", "--work", tmp_path / "fits.sqlite"]
    result = run(*arguments, "--report", tmp_path / "report.html", *FAST)
    facts = json.loads(result.stdout)
    assert [fact["direction"] for fact in facts] == ["forward", "backward"]
    assert [order["order"] for order in facts[0]["orders"]] == [0, 39]
    assert "Models, backward" in (tmp_path / "report.html").read_text()
    first = {path.name: path.read_bytes() for path in (tmp_path / "m").iterdir()}
    run("generate", tmp_path / "m", "--target", "iec", "--out", tmp_path / "plc")
    assert (tmp_path / "plc" / "iec").is_dir()
    # the same seed gives the same bits, from finished fits and without
    for work in ("fits.sqlite", "other.sqlite"):
        arguments[-1] = tmp_path / work
        run(*arguments, *FAST)
        text = (tmp_path / "m" / "bundle.toml").read_bytes()
        assert text == first["bundle.toml"]
        again = load(tmp_path / "m")
        x = a_table().conditions
        (tmp_path / "old").mkdir(exist_ok=True)
        for name, content in first.items():
            (tmp_path / "old" / name).write_bytes(content)
        for one, other in zip(load(tmp_path / "old").models, again.models, strict=True):
            assert np.array_equal(one.predict(x), other.predict(x))


def test_a_campaign_of_too_few_runs_is_refused_by_its_own_name(tmp_path, capsys):
    """A folder of curves was called a harmonic table."""
    write_campaign(tmp_path / "c", [a_table(speeds=3, torques=2)])
    message = refused(capsys, "train", tmp_path / "c", "--out", tmp_path / "m", "--cache", tmp_path / "p", *FAST)
    assert message.startswith(f"error: {tmp_path / 'c'}: 12 operating points in one direction, forward: at least 20")


@pytest.mark.thorough
def test_a_campaign_becomes_a_bundle(tmp_path):
    write_campaign(tmp_path / "c", [a_table(speeds=5, torques=5)])
    (tmp_path / "c" / "broken.csv").write_text("1,2")
    result = run(
        "train", tmp_path / "c", "--out", tmp_path / "m", "--skip-bad", "--table", tmp_path / "t.csv",
        "--cache", tmp_path / "c.parquet", "--work", tmp_path / "f.sqlite", "--report", tmp_path / "r.html", *FAST,
    )  # fmt: skip
    assert "left out" in result.stderr
    table = read_table(tmp_path / "t.csv")
    assert table.orders == ORDERS
    assert len(table) == 50
    page = (tmp_path / "r.html").read_text()
    assert "of the strongest" in page
    mean, *_ = re.findall(r'<tr><td class="number">0</td><td>yes</td>.*?</tr>', page)
    assert "%" not in mean  # it has no part in the shares
    assert "broken.csv" in page
    assert "repeated splits" not in page  # none were asked for: no empty column
    for width in (400, 1200):
        count, found = browser.faults(page, width, tmp_path)
        assert count > 20
        assert found == []
    assert load(tmp_path / "m").purpose.te.orders == ORDERS


@pytest.mark.parametrize(
    ("feature", "value", "table"),
    [
        ("speed_rpm", 100.0, {"speeds": 1, "torques": 11}),
        ("torque_Nm", 0.0, {"speeds": 11, "torques": 1}),
        ("temperature_C", 25.0, {"speeds": 6, "torques": 5}),
    ],
)
def test_a_condition_that_never_varied_is_one_known_value(tmp_path, monkeypatch, feature, value, table):
    monkeypatch.chdir(tmp_path)
    column = [name for name, _ in FEATURES].index(feature)
    known = a_table(**table)
    write_table(known.rows(np.flatnonzero(known.conditions[:, column] == value)), tmp_path / "t.csv")
    said = run("train", "t.csv", "--out", "m", "--orders", "0", "--families", "DT", *FAST[2:]).stderr
    assert f"{feature} was {value:g} in all runs" in " ".join(said.split())
    assert said.count("in all runs") == 1
    te = load(tmp_path / "m").purpose.te
    assert [f.name for f in te.features if f.lower == f.upper] == [feature]
    if feature == "temperature_C":  # what follows takes longer
        run("generate", "m", "--target", "iec", "--out", "plc", "--quiet")
        text = (tmp_path / "plc" / "iec" / "reducer.st").read_text()
        assert re.search(rf"Input {column + 1}: {feature}, .*limited to {value} only", text)
        run("verify", "m", "--generated", "plc", "--rows", "200", "--quiet")
        _only_flagged_beside(tmp_path / "plc" / "iec", te, column)


def _only_flagged_beside(folder, te, column):
    """FB_TEPredict gives the same numbers beside a feature's one value, and says that they are of another."""
    block = Machine(load_project([folder], TARGETS["iec"].dialect)).instance("FB_TEPredict")
    names = [variable.name for variable in input_variables(te.features)]
    inside = None
    for beside in (0.0, -1.0, 1.0):
        for number, (name, known) in enumerate(zip(names, te.features, strict=True)):
            block[name] = known.lower + beside * (number == column)
        block()
        inside = inside or block["aAmplitudeFw[0]"]
        assert (block["bValid"], block["bInRange"]) == (True, beside == 0.0)
        assert block["aAmplitudeFw[0]"] == inside != 0.0


def test_what_train_keeps_for_itself_stands_where_docs_and_options_say(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_campaign(tmp_path / "c", [a_table(speeds=4, torques=4)])
    names = {"--work": "build/fits.sqlite", "--cache": "build/curves.parquet"}
    page = (Path(__file__).parents[2] / "docs" / "training.md").read_text(encoding="utf-8")
    assert all(f"`{name}`" in page and f"`{option} FILE`" in page for option, name in names.items())
    given = [part for option in names for part in (option, tmp_path / "mine" / option.strip("-"))]
    run("train", "c", "--orders", "0,1", *FAST, *given)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c", "mine", "models"]
    run("train", "c", "--orders", "0,1", *FAST)
    kept = {path.relative_to(tmp_path).as_posix() for path in (tmp_path / "build").iterdir()}
    assert kept >= set(names.values()) and all(name.startswith(tuple(names.values())) for name in kept)


def test_the_page_says_which_orders_were_asked_for(tmp_path):
    write_campaign(tmp_path / "c", [a_table(speeds=4, torques=4)])
    run("train", tmp_path / "c", "--out", tmp_path / "m", "--orders", "0,1", "--report", tmp_path / "r.html", *FAST)
    page = (tmp_path / "r.html").read_text()
    rows = re.findall(r'<tr><td class="number">(\d+)</td><td>(yes|no)</td>.*?<td>([^<]*)</td></tr>', page)
    assert {int(order) for order, _, _ in rows} >= set(ORDERS)
    assert sorted(int(order) for order, chosen, _ in rows if chosen == "yes") == [0, 1]
    for _, chosen, reason in rows:
        assert reason.startswith("asked for; above" if chosen == "yes" else "not asked for; ")


def test_bad_files_stop_it_and_nothing_is_written(tmp_path, capsys):
    write_campaign(tmp_path / "c", [a_table(speeds=2, torques=2)])
    for path in list((tmp_path / "c").rglob("*.csv"))[:2]:
        path.write_text("1,2")
    cache = ["--cache", tmp_path / "c.parquet", "--work", tmp_path / "f.sqlite"]
    message = refused(capsys, "train", tmp_path / "c", "--out", tmp_path / "m", *cache, *FAST)
    assert "2 problems" in message.replace("\n", " ")
    assert "--skip-bad" in message
    assert not (tmp_path / "m").exists()


def test_warnings_are_said_with_quiet_too(tmp_path):
    """The help promises errors and warnings; files that --skip-bad left out went without a word, and TE in arcsec."""
    write_campaign(
        tmp_path / "c", [replace(one, coefficients=3600.0 * one.coefficients) for one in [a_table(speeds=5)]]
    )
    min((tmp_path / "c").rglob("*.csv")).write_text("1,2")
    places = ["--out", tmp_path / "m", "--cache", tmp_path / "c.parquet", "--work", tmp_path / "f.sqlite"]
    said = run("train", tmp_path / "c", *places, "--orders", "0,1", "--skip-bad", "-q", *FAST).stderr
    assert "left out: " in said
    assert "is TE in deg?" in said
    assert "complex MAE" not in said
    assert "next:" not in said


def test_how_many_orders_there_may_be_says_nothing_where_they_are_given(tmp_path, capsys):
    (tmp_path / "c").mkdir()
    said = refused(capsys, "train", tmp_path / "c", "--orders", "1,39", "--most-orders", "1")
    assert "--most-orders: without effect where --orders are given" in " ".join(said.split())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--skip-bad", "--cache", "x", "--most-orders", "3"], "--skip-bad, --cache: without effect on a"),
        (["--backend", "dask", "--scheduler", "tcp://x:1", "--jobs", "2"], "--jobs: without effect on a Dask cluster"),
        (["--orders", "1,x"], "give whole numbers"),
        (["--orders", "1,7"], "order 7 is not in the harmonic table"),
        (["--families", "KNN"], "unknown family 'KNN'"),
        (["--families", ","], "--families is empty"),
        (["--backend", "dask"], "go together"),
        (["--reduction-ratio", "0"], "is not in the range 1e-06<=x"),
        (["--reduction-ratio", "1e9"], "is not in the range 1e-06<=x"),  # a bundle.toml takes no more
        (["--name", "größe"], "use printable ASCII"),
        (["--seed", "-1"], "is not in the range 0<=x"),
        (["--format", "onnx", "--families", "LGBM"], "none of these families can be saved as onnx"),
        (["--limit-us", "0.01"], "model fewer orders"),
    ],
)
def test_refusals(tmp_path, capsys, arguments, message):
    write_table(a_table(), tmp_path / "t.csv")
    fast = {"--families": "DT", "--folds": "2", "--jobs": "1", "--work": tmp_path / "f.sqlite"}
    rest = [part for key, value in fast.items() if key not in arguments for part in (key, value)]
    written = [tmp_path / "m", tmp_path / "table.csv"]
    given = refused(capsys, "train", tmp_path / "t.csv", "--out", written[0], "--table", written[1], *arguments, *rest)
    assert message in " ".join(given.split())
    assert not any(path.exists() for path in written)


def test_the_measured_table_is_not_written_over(tmp_path, capsys):
    """With --orders 0 it lost all other orders."""
    table = tmp_path / "t.csv"
    write_table(a_table(), table)
    before = table.read_bytes()
    said = refused(capsys, "train", table, "--orders", "0", "--table", table, "--out", tmp_path / "m", *FAST)
    assert f"is the measured table {table}; give another file" in said
    said = refused(capsys, "train", table, "--orders", "0", "--report", table, "--out", tmp_path / "m", *FAST)
    assert f"is the measured table {table}; give another file" in said
    assert table.read_bytes() == before


@pytest.mark.parametrize("option", ["--table", "--report"])
def test_nothing_is_written_among_measured_curves(tmp_path, capsys, option):
    """The harmonic table stood there as a curve without conditions, and the next training was refused."""
    campaign = tmp_path / "campaign"
    campaign.mkdir()
    said = refused(capsys, "train", campaign, option, campaign / "deeper" / "h.csv", "--out", tmp_path / "m", *FAST)
    assert "lies among the curves of" in said
    assert not any(campaign.iterdir())


def test_tables_without_the_measured_data(tmp_path, capsys):
    message = " ".join(refused(capsys, "tables", tmp_path).split())
    assert "not part of this project" in message
    assert "make tables DATA=FOLDER" in message


@pytest.mark.thorough
def test_tables_of_made_up_data(tmp_path, monkeypatch):
    searched = []

    def watched(train, test, settings, *rest, **more):
        searched.append((settings.turned, settings.kinds))
        return study(train, test, settings, *rest, **more)

    monkeypatch.setattr(paper, "study", watched)
    table = a_table(noise=1e-6)
    write_table(table, tmp_path / TABLE)
    test = table.rows(np.arange(0, len(table), 5))
    write_table(test, tmp_path / PREDICTIONS)
    rows = ["method,quantity,harmonic,MAE,RMSE"]
    rows += [f"{f},{q},{k},1.0,2.0" for f in ("DT", "HGBM", "unnamed") for q in ("ampl", "phase") for k in ORDERS]
    (tmp_path / ERRORS).write_text("\n".join(rows) + "\n")
    run("tables", tmp_path, "--out", tmp_path / "o", "--repeats", "1", "--work", tmp_path / "f.sqlite", *FAST)
    with (tmp_path / "o" / "errors.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert tuple(lines[0]) == COLUMNS
    keys = {(int(line["order"]), line["quantity"], line["family"]) for line in lines}
    assert keys == {(k, q, f) for k in ORDERS for q in ("ampl", "phase", "complex") for f in ("DT", "ET", "chosen")} - {
        (0, "phase", f) for f in ("DT", "ET", "chosen")
    }
    dt = next(line for line in lines if line["family"] == "DT" and line["quantity"] == "ampl")
    assert (dt["paper_mae"], dt["paper_rmse"]) == ("1", "2")
    assert all(0 <= float(line["ours_mae"]) < 1 for line in lines)
    # their predictions are the truth here
    complex_error = next(line for line in lines if line["family"] == "chosen" and line["quantity"] == "complex")
    assert float(complex_error["paper_mae"]) < 1e-12
    written = (tmp_path / "o" / "tables.md").read_text()
    assert "Table 6" in written and "as train chooses them" in written and "bundle" not in written  # none is written
    html = (tmp_path / "o" / "tables.html").read_text()
    assert html.count("<svg") == len(ORDERS)
    # the authors learned amplitudes, and phases as they were measured
    assert searched == [(True, tuple(Coordinates)), (False, (Coordinates.POLAR,))]


@pytest.mark.parametrize(
    ("faulty", "not_judged", "text"),
    [
        ((True, False), "", "1 faulty run kept;"),
        ((True, True), "and others look so", "2 faulty runs kept;"),
        ((False, False), "none was looked for", "faulty runs not looked for;"),
    ],
)
def test_faulty_runs_are_said_to_be_kept_or_not_to_have_been_looked_for(faulty, not_judged, text):
    lesson = SimpleNamespace(
        direction="forward",
        cost_us=1.0,
        faulty=SimpleNamespace(rows=np.array(faulty), not_judged=not_judged),
        study=SimpleNamespace(test=[0]),
        choice=SimpleNamespace(solutions=()),
    )
    assert text in train._summary(lesson, "kept").title
