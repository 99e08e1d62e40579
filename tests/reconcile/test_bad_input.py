"""Measured data that cannot be reconciled: one clear message, exit code 2, nothing written."""

import contextlib
import io
import json
from pathlib import Path

import numpy as np
import pytest

from st_codegen.threads import one_thread
from tests.cli.helpers import run

from .blind import effects, hidden, layout, noise, write

ORDERS = (0, 1, 2, 3, 39, 40, 78, 81)
SIGMA = np.array([5e-4, *[1e-5] * (len(ORDERS) - 1)])


@pytest.fixture
def rig(tmp_path):
    rng = np.random.default_rng(0)
    known = hidden.healthy(rng, [], ("structural_resonance", "carrier_modulation", "measurement_delay"))
    write.rig(tmp_path / "rig.toml", {"rig": known.head}, known.true)
    return known


def measured(path, known, runs, factor=1.0, orders=ORDERS):
    rng = np.random.default_rng(1)
    spectrum = effects.coefficients(known.head, known.true, runs)
    zero = np.zeros((2, len(runs)), dtype=complex)
    values = np.stack([spectrum.get(order, zero) for order in orders])
    values = values + noise.of_coefficients(rng, "white", SIGMA[: len(orders)], 2, len(runs))
    write.harmonic_table(path, runs, orders, values * factor)
    return path


def reconcile(folder, path):
    """Exit code and messages of the command."""
    shown = io.StringIO()
    with contextlib.redirect_stderr(shown), one_thread():
        code = run("reconcile", "--rig", folder / "rig.toml", "--measured", path, "--out", folder / "out")
    return code, shown.getvalue()


def refused(folder, path, *words):
    code, message = reconcile(folder, path)
    assert code == 2, message
    assert "Traceback" not in message
    for word in words:
        assert word in message, message
    out = folder / "out"
    assert not out.exists() or not any(out.iterdir()), "nothing is written"


def grid():
    return layout.conditions(np.random.default_rng(2), "grid", "dense")


@pytest.mark.parametrize(
    ("header", "options", "unused", "kind"),
    [
        ("t,q,dq,tau", ["--empirical", "--skip-bad", "--accept", "drift", "--scale", "2"],
         "--empirical, --skip-bad, --accept drift", "recordings of joints"),
        ("t,q,dq,tau", ["--accept", "sign", "--models", "m", "--update-models", "--trust-pickle", "--target", "iec"],
         "--models, --update-models, --target, --trust-pickle", "recordings of joints"),
        ("direction,order,median_deg", ["--accept", "as_is", "--empirical", "--skip-bad", "--profile", "none"],
         "--accept, --empirical, --skip-bad, --profile", "an order spectrum"),
        ("t,theta_in,theta_out,torque_Nm,temperature_C", ["--scale", "2", "--skip-bad", "--accept", "all"],
         "--scale, --skip-bad, --accept all", "recordings over time"),
        ("speed_rpm,torque_Nm", ["--skip-bad", "--accept", "all"], "--skip-bad", "a harmonic table"),
    ],
)  # fmt: skip
def test_options_without_effect_on_a_kind_of_data_are_all_named(header, options, unused, kind, tmp_path, rig, capsys):
    (tmp_path / "data.csv").write_text(f"{header}\n")
    given = ["--rig", tmp_path / "rig.toml", "--measured", tmp_path / "data.csv", "--out", tmp_path / "out"]
    assert run("reconcile", *given, *options) == 2
    assert f"Error: {unused}: without effect on {kind} (" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("word", "meant"), [("lowpass", "low_pass"), ("Home-Offset", "home_offset"), ("qq", "")])
def test_a_misspelt_name_of_a_mistake(word, meant, capsys):
    assert run("reconcile", "--measured", "x", "--out", "y", "--accept", "sign", "--accept", word) == 2
    shown = capsys.readouterr().err
    assert (f"'{word}' is none; did you mean '{meant}'? By" if meant else f"'{word}' is none. By") in shown
    assert "\n  single runs: block, labels\n  all: all that is asked about; as_is:" in shown


def test_effects_of_no_rig_are_without_effect(tmp_path, capsys):
    (tmp_path / "data.csv").write_text("t,q,dq,tau\n")
    own = Path(__file__).parents[2] / "examples" / "effects" / "motor_cogging.py"
    given = ["--effects", own, "--measured", tmp_path / "data.csv", "--out", tmp_path / "out"]
    assert run("reconcile", *given) == 2
    assert "--effects: without effect on recordings of joints (" in capsys.readouterr().err


@pytest.mark.thorough
def test_the_same_data_in_good_order_pass(tmp_path, rig):
    """The refusals below are about what is wrong with them, not about this rig."""
    code, message = reconcile(tmp_path, measured(tmp_path / "h.csv", rig, grid()))
    assert code == 0, message
    assert (tmp_path / "out" / "report.json").is_file()


@pytest.mark.parametrize("few", [12, None])
def test_a_table_of_the_mean_alone_is_compared(tmp_path, rig, few):
    """Ramps and resonances were looked for in no orders: "a defect of st-codegen"."""
    runs = grid()
    code, message = reconcile(
        tmp_path, measured(tmp_path / "h.csv", rig, runs.take(np.arange(few or len(runs))), orders=(0,))
    )
    assert code == 0, message
    assert json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))["orders"] == [0]


UNITS = [
    (np.pi / 180, "rad"),
    (81.0, "81"),
    pytest.param(180 / np.pi, "57.3", marks=pytest.mark.slow),
    pytest.param(1 / 81.0, "81", marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("factor", "word"), UNITS)
def test_wrong_units_are_detected(tmp_path, rig, factor, word):
    refused(tmp_path, measured(tmp_path / "h.csv", rig, grid(), factor), word)


def test_too_few_conditions(tmp_path, rig):
    runs = grid().take(np.arange(2))
    refused(tmp_path, measured(tmp_path / "h.csv", rig, runs), "condition")


def test_all_that_is_wrong_in_one_message(tmp_path, rig):
    """Few conditions and other units at once."""
    runs = grid().take(np.arange(2))
    refused(tmp_path, measured(tmp_path / "h.csv", rig, runs, 81.0), "2 problems", "condition", "81")


def test_no_overlap_of_orders(tmp_path, rig):
    """A table of orders that the model does not have at all, its numbers zero: there is nothing to compare."""
    runs = grid()
    lines = ["direction,speed_rpm,torque_Nm,temperature_C,A500,phi500"]
    for place in range(len(runs)):
        columns = (runs.speed_rpm[place], runs.torque_Nm[place], runs.temperature_C[place])
        lines.append(",".join(["forward", *(f"{value:g}" for value in columns), "0", "0"]))
    (tmp_path / "h.csv").write_text("\n".join(lines) + "\n")
    refused(tmp_path, tmp_path / "h.csv")


def test_measured_path_that_is_not_there(tmp_path, rig):
    refused(tmp_path, tmp_path / "nowhere.csv", "nowhere.csv")


def test_a_table_that_is_no_table(tmp_path, rig):
    (tmp_path / "h.csv").write_text("a,b\n1,2\n")
    refused(tmp_path, tmp_path / "h.csv", "h.csv")


def test_an_empty_folder(tmp_path, rig):
    (tmp_path / "empty").mkdir()
    refused(tmp_path, tmp_path / "empty", "empty")


def test_a_rig_with_an_unknown_effect(tmp_path, rig):
    text = (tmp_path / "rig.toml").read_text() + '\n[[effect]]\nname = "magic"\n'
    path = measured(tmp_path / "h.csv", rig, grid())
    (tmp_path / "rig.toml").write_text(text)
    refused(tmp_path, path, "magic")


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        (1, "0", "a speed of 0 rpm or less"),
        (1, "-500", "with -500 rpm"),
        (3, "-273.15", "a temperature that no oil has"),
    ],
)
def test_a_label_of_no_machine_is_refused(tmp_path, rig, column, value, said):
    """A speed of 0 ended in a division by it, one temperature of an error code in a drift that was not there."""
    path = measured(tmp_path / "h.csv", rig, grid())
    lines = path.read_text().splitlines()
    cells = lines[3].split(",")
    cells[column] = value
    lines[3] = ",".join(cells)
    path.write_text("\n".join(lines))
    refused(tmp_path, path, "1 curve with", said)


def test_a_channel_that_is_dead_is_no_column_of_another_scale(tmp_path, rig):
    """It was "1e-12 times what the other one lets expect", to be divided by that."""
    path = measured(tmp_path / "h.csv", rig, grid())
    lines = path.read_text().splitlines()
    names = lines[0].split(",")
    values = [names.index(name) for name in names if name.startswith("A")]
    for number, line in enumerate(lines[1:], 1):
        cells = line.split(",")
        if cells[names.index("direction")] == lines[1].split(",")[names.index("direction")]:
            lines[number] = ",".join("0" if at in values else cell for at, cell in enumerate(cells))
    path.write_text("\n".join(lines))
    refused(tmp_path, path, "TE is 0 in all runs: a dead channel?")


def test_a_table_of_zeros_is_not_said_to_have_other_orders(tmp_path, rig):
    """It had "no overlap with the rig", beside two lists of the same orders."""
    path = measured(tmp_path / "h.csv", rig, grid(), 0.0)
    refused(tmp_path, path, "TE is 0 in all curves")
    assert "no overlap" not in reconcile(tmp_path, path)[1]


@pytest.mark.filterwarnings("error")
def test_curves_over_the_angle_of_the_fast_shaft_are_refused(tmp_path, rig):
    """81 turns in a curve of 400 samples tell no order above the mean: "a defect of st-codegen", an IndexError."""
    campaign = tmp_path / "campaign"
    campaign.mkdir()
    up = np.arange(400) * 81 * 360 / 400
    te = np.random.default_rng(1).normal(size=400)
    text = "".join(f"{a},{x:.6f},{b},{x:.6f}\n" for a, b, x in zip(up, up[::-1], te, strict=True))
    for speed in (300, 600, 900, 1200):
        for torque in (100, 600, 1500):
            (campaign / f"{speed}.0rpm{torque}.0Nm30.0deg.csv").write_text(text)
    refused(tmp_path, campaign, "it looks like the fast shaft's")
