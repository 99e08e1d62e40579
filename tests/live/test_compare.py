"""The live comparison: all agree, a constant off by an ulp, and everything that can be wrong with a controller."""

import json
import re
import shutil
import socket
import struct
import threading
import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import skops.io
from sklearn.ensemble import HistGradientBoostingRegressor

from st_codegen import generate, load
from st_codegen.cli.compare import _why_no_times
from st_codegen.cost.calibrate import read_measurements
from st_codegen.errors import GeneratedCodeError, InputError
from st_codegen.live import controller
from st_codegen.live.compare import LiveCode, _times, compare, compared_project
from st_codegen.live.controller import UNKNOWN, Signal, connected
from st_codegen.live.failures import ControllerError, NotRunningError
from st_codegen.live.live_report import BlockTimes, LiveReport, record_of, record_sections, times_csv
from st_codegen.live.plc import PlcState
from st_codegen.live.record import recorded_project
from st_codegen.live.rows import _around, comparison_rows
from st_codegen.passes.choose import Layout, Options
from st_codegen.proof.verify_report import ModelReport
from tests.cli.helpers import run
from tests.live.conftest import Running, soft_plc

pytest.importorskip("pyads")


@pytest.fixture(scope="module")
def models(lone):
    return load(lone[0])


def compared(models, folder, running, **settings):
    return compare(models, folder, lambda: connected(running.ads, None, 600.0), **settings)


def test_all_agree_and_the_record_says_so(models, lone, lone_plc, tmp_path):
    report = compared(models, lone[1], lone_plc, rows=1200)
    assert report.passed
    assert [(model.name, model.verdict, model.max_ulp) for model in report.models] == [("te", "equal bits", 0)]
    assert report.differs == {}
    assert report.sent >= 1200
    (rows, tried, constants) = report.rows["FB_Te"]
    assert (rows >= 1200, tried) == (True, constants)
    record = json.loads(json.dumps(record_of(report)))
    assert record["passed"]
    assert record["fingerprint"] == json.loads((lone[1] / "st-codegen.json").read_text())["comparison"]["fingerprint"]
    summary, sections = record_sections(report)
    assert summary.startswith("All agree: library and controller on a sample of")
    assert sections[1].table.rows[0][1] == report.sent
    report.times["FB_Te"].high_us = 12.5
    (tmp_path / "times.csv").write_text(times_csv(report))
    (measurement,) = read_measurements(tmp_path / "times.csv")
    assert (measurement.block, measurement.is_cold, measurement.microseconds) == ("FB_Te", False, 12.5)


def test_another_project_that_comes_while_it_is_compared_is_noticed(models, lone, lone_plc, monkeypatch):
    asked = []

    def check(live):
        asked.append(live)
        if len(asked) == 2:
            raise ControllerError("another project")
        return "RUN"

    monkeypatch.setattr(LiveCode, "check", check)
    with pytest.raises(ControllerError, match="another project"):
        compared(models, lone[1], lone_plc, rows=10)


NUMBER = re.compile(r"-?\d+\.\d+(?:E[-+]?\d+)?")


def changed_by_an_ulp(folder, table, number):
    """One number of a table of FB_Te moved to the next one."""
    path = folder / "POUs" / "FB_Te.TcPOU"
    text = read(path)
    start = text.index(f" {table} :")
    found = list(NUMBER.finditer(text, text.index("[", text.index(":=", start)), text.index("];", start)))[number]
    moved = np.nextafter(float(found[0]), np.inf)
    path.write_text(
        f"{text[: found.start()]}{float(moved)!r}{text[found.end() :]}".replace("e-", "E-"), encoding="utf-8-sig"
    )


def read(path):
    return path.read_text(encoding="utf-8-sig")


@pytest.mark.parametrize(
    ("layout", "table", "numbers"),
    [
        ("trees", "THRESHOLD_1", (0, 5)),
        ("table", "CELL_2", (2,)),
        ("table", "EDGE_1_1", (1,)),
    ],
)
def test_a_constant_that_is_off_by_one_ulp_is_found_and_named(model_text, tmp_path, layout, table, numbers):
    (tmp_path / "m").mkdir()
    (tmp_path / "m" / "te.txt").write_text(model_text)
    folder = generate(
        tmp_path / "m", "twincat", tmp_path, with_comparison=True, options=Options(layout=Layout(layout))
    ).folder
    for number in numbers:
        there = tmp_path / str(number) / "twincat"
        shutil.copytree(folder, there)
        changed_by_an_ulp(there, table, number)
        _one_is_found(tmp_path / "m", folder, there)


def test_cells_of_a_table_that_are_too_many_for_a_row_each_are_named(model_text, tmp_path, monkeypatch):
    """A number of the table that changed may then be one that no row meets: "all leaves and splits" is no answer."""
    (tmp_path / "m").mkdir()
    (tmp_path / "m" / "te.txt").write_text(model_text)
    remarks = []
    for layout, most in (("table", 20_000), ("table", 10), ("trees", 10)):
        monkeypatch.setattr("st_codegen.live.rows._MOST_CELLS", most)
        wishes = {"with_comparison": True, "options": Options(layout=Layout(layout)), "force": True}
        folder = generate(tmp_path / "m", "twincat", tmp_path / layout, **wishes).folder
        with Running(soft_plc(folder)) as running:
            remarks.append("\n".join(compared(load(tmp_path / "m"), folder, running, rows=100).remarks()))
    assert ["cells between thresholds are too many for a row each" in text for text in remarks] == [False, True, False]


def _one_is_found(models, folder, there):
    with Running(soft_plc(there)) as running:
        report = compared(load(models), folder, running, rows=500)
    assert not report.passed
    other, (name, line) = report.failures()[:2]
    assert other[0] == name == "te"
    assert re.match(r"on (?:1 row|[\d,]+ rows) the controller.s bits .* first on row \d+ at \[", other[1])
    assert re.match(r"row \d+: reference and controller differ at \[", line)
    bits = report.differs["te"]
    assert (bits.count >= 1, bits.is_open) == (True, False)
    assert "FAILED: te" in record_sections(report)[0]


@pytest.fixture(scope="module")
def around(bundle, shared_plc):
    """The blocks around the models, compared."""
    return compared(load(bundle[0]), bundle[1], shared_plc, rows=200)


def test_the_blocks_around_the_models_are_compared_with_what_the_models_say(around, tmp_path):
    assert around.passed
    found = {model.name: model for model in around.models}
    assert set(found) == {"a", "b", "FB_TEPredict", "FB_Compensator"}
    for name in ("FB_TEPredict", "FB_Compensator"):
        assert found[name].n == around.rows[name][0] == 2000
        assert found[name].max_abs_err <= found[name].bound < 1e-12
    assert around.differs == {}
    around.times["FB_Compensator"].high_us = 3.0
    (tmp_path / "times.csv").write_text(times_csv(around))
    assert "FB_Compensator" in {measured.block for measured in read_measurements(tmp_path / "times.csv")}


def test_a_compensator_that_knows_its_play_is_given_the_load_of_each_row(bundle, tmp_path):
    models = tmp_path / "models"
    shutil.copytree(bundle[0], models)
    description = models / "bundle.toml"
    play = '[play]\nangle_deg = 0.01\ntorque_feature = "torque_Nm"\n\n[[harmonic]]'
    description.write_text(description.read_text("utf-8").replace("[[harmonic]]", play, 1), "utf-8")
    made = generate(models, "twincat", tmp_path / "generated", with_comparison=True)
    with Running(soft_plc(made.folder)) as running:
        report = compared(load(models), made.folder, running, rows=200, block="fb_compensator")
    assert report.passed
    assert report.differs == {}


def changed_in(bundle, tmp_path, file, text, other):
    """The comparison of a block with a controller on which a piece of text was changed."""
    there = tmp_path / "twincat"
    shutil.copytree(bundle[1], there)
    path = there / "POUs" / f"{file}.TcPOU"
    assert text in read(path)
    path.write_text(read(path).replace(text, other), encoding="utf-8-sig")
    block = {"FB_Correction": "FB_Compensator"}.get(file, file)
    with Running(soft_plc(there)) as running:
        return compared(load(bundle[0]), bundle[1], running, rows=10, block=block.lower())


def test_an_ulp_within_the_bound_of_a_block_around_the_models_is_found_and_named(bundle, tmp_path):
    report = changed_in(bundle, tmp_path, "FB_Correction", "(1.0 - fBlend)", "(1.0000000000000002 - fBlend)")
    assert report.passed
    assert any(line.startswith("FB_Compensator: on ") for line in report.remarks())
    report.same_bits = True
    ((name, line),) = report.failures()
    assert name == "FB_Compensator"
    assert re.search(r"first on row \d+ at \[.*EXP, LN, SIN", line)
    assert "FAILED: FB_Compensator" in record_sections(report)[0]
    assert not record_of(report)["passed"]


def test_an_ulp_in_the_block_of_predictions_is_beyond_its_bound(bundle, tmp_path):
    report = changed_in(bundle, tmp_path, "FB_TEPredict", "aPhaseFw[0] := 0.0", "aPhaseFw[0] := 5.0E-324")
    assert {name for name, _ in report.failures()} == {"FB_TEPredict"}
    assert re.match(r"row \d+: models and controller differ at \[", report.failures()[0][1])


def test_every_leaf_of_every_tree_has_a_row(models):
    ir = models.irs[0]
    chosen = comparison_rows([ir], 5000)
    (op,) = (op for op in ir.ops if hasattr(op, "leaf_value"))
    reached = set()
    for row in chosen.x[np.isfinite(chosen.x).all(axis=1)]:
        for root in op.roots:
            node = int(root)
            while op.split[node] >= 0:
                value = row[op.columns[op.split[node]].column]
                node = int(op.left[node] if value <= op.threshold[node] else op.right[node])
            reached.add(node)
    assert reached == set(np.flatnonzero(op.split < 0).tolist())
    few = comparison_rows([ir], 1)
    assert few.reached == few.constants == chosen.constants


def test_splits_by_categories_are_no_rows_that_are_aimed_at_them(tmp_path):
    random = np.random.default_rng(0)
    x = np.column_stack([random.integers(0, 9, 500), random.random(500)])
    fitted = HistGradientBoostingRegressor(categorical_features=[0], max_iter=3).fit(x, x[:, 0] % 3 + x[:, 1])
    skops.io.dump(fitted, tmp_path / "te.skops")
    ir = load(tmp_path).irs[0]
    (op,) = (op for op in ir.ops if hasattr(op, "leaf_value"))
    by_category = sum(split >= 0 and op.columns[split].categorical for split in op.split)
    chosen = comparison_rows([ir], 100)
    assert by_category
    assert (chosen.constants, chosen.reached) == (op.n_nodes, op.n_nodes - by_category)


# --- what can be wrong


def test_a_project_without_the_program_or_of_other_models(models, lone, lone_plc, tmp_path, lone_folder):
    plain = generate(models, "twincat", tmp_path).folder
    with pytest.raises(GeneratedCodeError, match="without --with-comparison"):
        compared(models, plain, lone_plc)
    with pytest.raises(GeneratedCodeError, match="other models"):
        compared_project(lone[1], load(lone_folder), None)
    with pytest.raises(InputError, match="no block FB_X is compared; there are FB_Te"):
        compared_project(lone[1], models, "FB_X")


def test_a_project_with_another_fingerprint(models, lone, lone_plc, tmp_path):
    other = tmp_path / "twincat"
    shutil.copytree(lone[1], other)
    manifest = json.loads((other / "st-codegen.json").read_text())
    manifest["comparison"]["fingerprint"] = "00000000deadbeef"
    (other / "st-codegen.json").write_text(json.dumps(manifest))
    with pytest.raises(ControllerError, match=r"has the fingerprint .*00000000deadbeef"):
        compared(models, other, lone_plc)


def test_a_variable_that_is_not_there(lone_plc):
    with connected(lone_plc.ads, None, 600.0) as controller:
        with pytest.raises(ControllerError, match=r"no variable GVL_X\.n: another project runs there"):
            controller.read(Signal("GVL_X.n", "<i4"))
        with pytest.raises(ControllerError, match=r"no variable GVL_X\.n"):
            controller.read_all([Signal("GVL_X.n", "<i4")])
        with pytest.raises(ControllerError, match=r"GVL_Comparison\.nAnswer may not be written"):
            controller.write(Signal("GVL_Comparison.nAnswer", "<i4"), 1)
        with pytest.raises(ControllerError, match=r"GVL_Comparison\.nAnswer may not be written"):
            controller.write_all([(Signal("GVL_Comparison.nAnswer", "<i4"), 1)])


@pytest.mark.parametrize("state", [PlcState.CONFIG, PlcState.STOP, PlcState.ERROR])
def test_a_controller_that_does_not_run(models, lone, state):
    with Running(soft_plc(lone[1])) as running:
        running.do(lambda: running.plc.set_state(state))
        with pytest.raises(ControllerError, match=f"the PLC is in {state.value}, not in RUN"):
            compared(models, lone[1], running, rows=10)


def test_a_controller_that_a_fault_stops_in_mid_run(models, lone, tmp_path):
    there = tmp_path / "twincat"
    shutil.copytree(lone[1], there)
    path = there / "POUs" / "PRG_Comparison.TcPOU"
    text, request = read(path), "GVL_Comparison.nRequest"
    path.write_text(text.replace(f"nCurrent := {request};", f"nCurrent := 1 / ({request} - {request});"), "utf-8-sig")
    with Running(soft_plc(there)) as running:
        with pytest.raises(NotRunningError, match="the PLC is in ERROR, not in RUN"):
            compared(models, lone[1], running, rows=10)
        assert running.plc.state is PlcState.ERROR


def test_a_wrong_port_of_tcp_and_of_ams(lone_plc):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # bound, and nobody listens
        port = taken.getsockname()[1]
        with pytest.raises(ControllerError, match=f"127.0.0.1:{port} cannot be reached"):
            connected(f"5.1.2.3.1.1:851@127.0.0.1:{port}", None, 5.0)
    with (
        connected(lone_plc.ads.replace(":851", ":852"), None, 600.0) as controller,
        pytest.raises(ControllerError, match="no PLC at AMS port 852"),
    ):
        controller.state()
    for wrong in ("127.0.0.1", "1.2.3.4.5.6", "plc:851", ""):
        with pytest.raises(InputError, match="give NETID:PORT"):
            connected(wrong, None)
    for pair in ((None, None), ("1.2.3.4.1.1:851", "opc.tcp://x:1/")):
        with pytest.raises(InputError, match="--ads NETID:PORT or --opcua URL"):
            connected(*pair)


def test_a_server_that_answers_slowly_or_not_at_all():
    with socket.create_server(("127.0.0.1", 0)) as silent:
        accepted = []
        thread = threading.Thread(target=lambda: accepted.extend(silent.accept() for _ in range(2)), daemon=True)
        thread.start()
        address = f"5.9.9.9.1.1:851@127.0.0.1:{silent.getsockname()[1]}"
        with (
            connected(address, None, 0.2) as controller,
            pytest.raises(ControllerError, match=r"within 0\.2 s"),
        ):
            controller.state()
        for connection, _ in accepted:
            connection.close()


def test_a_connection_that_is_lost_on_the_way(models, lone):
    with Running(soft_plc(lone[1])) as running:

        def lose(done, rows, block):
            if done > 1000:
                running.stop()

        with pytest.raises(ControllerError):
            compare(models, lone[1], lambda: connected(running.ads, None, 1.0), rows=5000, progress=lose)


def test_a_second_client(models, lone, lone_plc):
    project = compared_project(lone[1], models, None)
    x = np.random.default_rng(0).uniform(100, 900, (600, 3))
    with connected(lone_plc.ads, None, 600.0) as first, connected(lone_plc.ads, None, 600.0) as second:

        def disturb(done, rows, block):
            second.write(Signal("GVL_Comparison.nRequest", "<i4"), 2**30 + 12345)

        live = LiveCode(first, project, disturb)
        original = first.write_all

        def write_all(values):
            original(values)
            disturb(0, 0, "")

        first.write_all = write_all
        with pytest.raises(ControllerError, match="another client compares") as caught:
            live.run_model("FB_Te", x, (0,))
        assert caught.value.codes == ("STC1709",)


class Answering:
    """A controller whose rows take 1 us each, but for some calls that another task interrupted."""

    address, timeout_s = "here", 5.0

    def __init__(self, project, interrupted):
        self.per_cycle, self._rows, self._interrupted = [], project.rows, interrupted
        self._outputs, self._times, self._requests = project.lengths[1], np.zeros(project.rows, np.uint32), 0

    def write_all(self, values):
        given = {signal.name.rpartition(".")[2]: value for signal, value in values}
        self._request = given["nRequest"]
        self.per_cycle.append(given["nPerCycle"])
        self._times[: given["nRows"]] = 10  # what lies behind stays as it was
        if self._requests in self._interrupted:
            self._times[given["nRows"] - 1] = 100_000
        self._requests += 1

    def read_all(self, signals):
        valid = np.ones(self._rows, np.bool_)
        return [self._request, self._request, np.zeros(self._outputs), valid, self._times.copy()]


def test_an_interrupted_call_does_not_slow_down_all_that_follow(models, lone):
    project = compared_project(lone[1], models, None)
    answering = Answering(project, interrupted={4})
    LiveCode(answering, project).run_model("FB_Te", np.zeros((20_000, 3)), (0,))
    assert answering.per_cycle[:5] == [1, 4, 16, 64, 256]
    assert answering.per_cycle[5] < 500
    assert set(answering.per_cycle[7:]) == {500}


@pytest.mark.parametrize(
    ("signal", "found"),
    [
        (Signal("x", length=3), [0.5, 1.0]),
        (Signal("x", length=3), [0.5] * 4),
        (Signal("x", length=3), 0.5),
        (Signal("x", length=3), ["a", "b", "c"]),
        (Signal("x", "<u8"), "abc"),
        (Signal("x", "<u8"), float("nan")),
        (Signal("x", "<u8"), -1),
        (Signal("x", "<u8"), 1.5),
        (Signal("x", "|b1"), 0.7),
        (Signal("x", "|b1"), 2),
        (Signal("x"), None),
        (Signal("x"), [0.5]),
    ],
)
def test_a_variable_of_another_type_or_length_is_that_of_another_project(lone_plc, monkeypatch, signal, found):
    """Tracebacks of NumPy, or rows that were cut off, came of it."""
    with connected(lone_plc.ads, None, 600.0) as controller:
        monkeypatch.setattr(controller._connection, "read_list_by_name", lambda names: dict.fromkeys(names, found))
        with pytest.raises(ControllerError, match=r"x is not (one number|an array of 3 numbers) there|x: abc"):
            controller.read(signal)


def test_nan_and_infinities_go_there_and_back(models, lone, lone_plc):
    project = compared_project(lone[1], models, None)
    x = np.array([[np.nan, 1.0, 2.0], [np.inf, -np.inf, np.nan], [0.0, -0.0, 5e-324]])
    with connected(lone_plc.ads, None, 600.0) as controller:
        live = LiveCode(controller, project)
        live.run_model("FB_Te", x, (0,))
        sent = controller.read(Signal("GVL_Comparison.fInputs", length=project.lengths[0]))[:9]
    assert sent.tobytes() == x.tobytes()
    assert struct.pack("d", sent[7]) == struct.pack("d", -0.0)


# --- what a user reads: one message, with the code of its kind, and exit code 2


def shown_by_compare(capsys, lone, address, *more):
    code = run("compare", str(lone[0]), "--generated", str(lone[1]), "--ads", address, "--rows", "10", *more)
    shown = capsys.readouterr().err
    assert shown.count("error:") == 1
    assert "Traceback" not in shown
    return code, shown.rsplit("\n", 2)[1].partition(":")[0]


def test_each_kind_of_failure_has_a_code(lone, lone_plc, capsys, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        found = {
            "nobody listens": shown_by_compare(capsys, lone, "5.1.2.3.1.1:851@127.0.0.1:1"),
            "another AMS port": shown_by_compare(
                capsys, lone, lone_plc.ads.replace(":851", ":852"), "--timeout", "600"
            ),
            "no answer": shown_by_compare(
                capsys, lone, f"5.9.9.8.1.1:851@127.0.0.1:{silent.getsockname()[1]}", "--timeout", "0.2"
            ),
            "no address": shown_by_compare(capsys, lone, "here"),
        }
    lone_plc.do(lambda: lone_plc.plc.set_state(PlcState.CONFIG))
    try:
        found["in CONFIG"] = shown_by_compare(capsys, lone, lone_plc.ads, "--timeout", "600")
    finally:
        lone_plc.do(lambda: lone_plc.plc.set_state(PlcState.RUN))
    other = tmp_path / "twincat"
    shutil.copytree(lone[1], other)
    text = (other / "st-codegen.json").read_text()
    known = json.loads(text)["comparison"]["fingerprint"]
    (other / "st-codegen.json").write_text(text.replace(f'"{known}"', '"1"'))
    found["another project"] = shown_by_compare(capsys, (lone[0], other), lone_plc.ads, "--timeout", "600")
    assert found == {
        "nobody listens": (2, "STC1702"),
        "another AMS port": (2, "STC1703"),
        "no answer": (2, "STC1704"),
        "no address": (2, "STC1711"),
        "in CONFIG": (2, "STC1705"),
        "another project": (2, "STC1708"),
    }
    with connected(lone_plc.ads, None, 600.0) as controller:
        for code, do in {
            "STC1706": lambda: controller.read(Signal("GVL_X.n", "<i4")),
            "STC1707": lambda: controller.write(Signal("GVL_Comparison.nAnswer", "<i4"), 1),
        }.items():
            with pytest.raises(ControllerError) as caught:
                do()
            assert caught.value.codes == (code,)


def test_as_many_calls_as_are_said_are_within_the_time_that_is_said():
    for count in (1, 3, 10, 99, 101):
        times = np.arange(count) % 7 * 10
        found = _times([times])
        assert (times / 10.0 <= found.high_us).mean() >= 0.99
        assert found.high_us in times / 10.0


def test_rows_around_a_threshold_that_float32_does_not_have():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rows = np.array(_around(np.zeros(2), 1, np.array([1e300])))
    assert {1e300, float(np.finfo(np.float32).max)} <= set(rows[:, 1])


def test_times_below_the_steps_of_the_clock_are_written_nowhere():
    """`--times` wrote a file without rows, which `calibrate` refuses, and said nothing."""
    report = LiveReport("opcua x", UNKNOWN, "0", "folder", times={"FB_A": BlockTimes(9, 0.0, 0.0)})
    assert _why_no_times(report) == "all calls were quicker than the controller's clock"
    report.times["FB_B"] = BlockTimes(9, 0.0, 0.1)
    assert not _why_no_times(report)
    report.models.append(ModelReport("worn", n=5, nothing_compared=True))
    assert _why_no_times(report) == "the times may be those of another text"
    assert _why_no_times(replace(report, models=[], times={})).startswith("what was compared takes several calls")


def test_what_was_not_compared_is_no_agreement_and_is_said():
    """A block that takes no row that was tried; rows that it refuses, labels and ranges that are open."""
    none = ModelReport("worn", n=5, nothing_compared=True)
    partly = ModelReport("te", n=9, unbounded=2, guessed=["speed"], open_rows=1)
    report = LiveReport("opcua x", UNKNOWN, "0", "folder", [none, partly])
    assert [name for name, _ in report.failures()] == ["worn"]
    assert record_sections(report)[0].startswith("FAILED: worn")
    said = "\n".join(report.remarks())
    for part in (
        "te: on 2 of 9 rows no bound is known", "te: the bound leaves the label of 1 of 9 rows open",
        "numbers (st-codegen.toml can give it): te", "opcua x does not say whether the PLC is in RUN",
    ):  # fmt: skip
        assert part in said
    summary = record_sections(replace(report, models=[partly]))[0]
    assert "9 rows, but for 2 rows without a bound, not judged and 1 row whose label rounding leaves open" in summary


@pytest.mark.parametrize(
    ("table", "key", "value"),
    [
        *(("comparison", key, None) for key in ("fingerprint", "rows", "lengths", "blocks")),
        *(("comparison", "lengths", value) for value in ([], [1, 2, 3])),
        ("transmission_error", "reduction_ratio", None),
    ],
)
def test_a_manifest_without_what_is_asked_of_it_is_of_no_such_project(bundle, tmp_path, table, key, value):
    """It was reported as a defect."""
    manifest = tmp_path / "st-codegen.json"
    content = json.loads((bundle[1] / manifest.name).read_text())
    del content[table][key]
    if value is not None:
        content[table][key] = value
    manifest.write_text(json.dumps(content))
    readers = {"compare": lambda: compared_project(tmp_path, load(bundle[0]), None)}
    readers["record"] = lambda: recorded_project(tmp_path)
    refused = {"compare"} if table == "comparison" else set()
    refused |= {"record"} if key in ("fingerprint", "reduction_ratio") or value is not None else set()
    for name, read in readers.items():
        if name in refused:
            with pytest.raises(GeneratedCodeError):
                read()
        else:
            read()


def test_a_connection_is_closed_where_the_controller_refuses_what_follows(monkeypatch):
    told = []

    class RefusedError(Exception):
        err_code = 1

    class Connection:
        def __init__(self, *_):
            pass

        def open(self):
            told.append("open")

        def set_timeout(self, _):
            raise RefusedError

        def close(self):
            told.append("close")

    monkeypatch.setattr(controller, "_pyads", lambda: SimpleNamespace(Connection=Connection, ADSError=RefusedError))
    monkeypatch.setattr(controller, "_must_listen", lambda *_: None)
    with pytest.raises(ControllerError):
        connected("1.2.3.4.1.1:851", None)
    assert told == ["open", "close"]
