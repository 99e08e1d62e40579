"""What was found goes back to the controller: the bundle grows, its text is proven, the rig moves more truly."""

import itertools
import json
import re
import shutil
import subprocess
import tomllib

import numpy as np
import pytest

from st_codegen.cli.main import main
from st_codegen.errors import InputError
from st_codegen.project.bundle import load
from st_codegen.reconcile.models.bundle_files import check_changeable, write_updated
from st_codegen.reconcile.models.formula import Graph, addends, evaluate, operating_point
from st_codegen.reconcile.models.terms import Decision, Part, not_worth
from st_codegen.reconcile.models.update import Wish, check_models
from st_codegen.rig.effects import Conditions, Constants, catalogue
from st_codegen.rig.model import RigModel, parse_rig
from st_codegen.te.harmonics import Direction, Quantity

for _needed in ("numba", "matplotlib", "onnx"):
    pytest.importorskip(_needed)
skops = pytest.importorskip("skops.io")
linear_model = pytest.importorskip("sklearn.linear_model")

from tests.rig.conftest import LINEAR_RIG  # noqa: E402
from tests.rig.conftest import write_bundle as write_linear  # noqa: E402

pytestmark = pytest.mark.thorough

# the orders that the resonance feeds, constant in the rig
KNOWN = "".join(
    f'\n[[effect]]\nname = "{name}"\norder = {order}\namplitude_deg = {size}\nphase_rad = {phase}\n'
    for name, order, size, phase in (("cycloid_tooth_error", 156, 1e-4, 0.3), ("pin_error", 240, 2e-4, -1.0))
)
RESONANCE = """
[[effect]]
name = "structural_resonance"
frequency_Hz = 54.0
damping_ratio = 0.05
growth_per_kNm = 0.4
orders = [156, 240]
amplitude_deg = [0.0009, 0.0012]
phase_rad = [0.5, -2.0]
"""
SIDEBANDS = """
[[effect]]
name = "carrier_modulation"
order = 39
lower_ratio = 0.4
lower_phase_rad = 1.0
upper_ratio = 0.6
upper_phase_rad = -0.5

[[effect]]
name = "pin_error"
order = 80
amplitude_deg = 0.0004
phase_rad = 0.8
"""
# up to some 1000 rpm of the motor
PROFILE = "t,theta_out,torque_Nm\n0,0,600\n0.2,3,600\n0.4,15,900\n0.9,50,900\n"
SIGMA = 1e-5
ORDERS = (0, 1, 36, 39, 42, 80, 156, 240)


def write_bundle(rig, folder):
    """Linear models of the cosine and sine parts; order 240 by amplitude and phase."""
    write_linear(rig, folder, (0, 1, 39, 156))
    text = (folder / "bundle.toml").read_text().replace("156]", "156, 240] # learned")
    x = np.array([[100.0, 0.0, 20.0], [1800.0, 900.0, 40.0], [900.0, 1800.0, 30.0], [500.0, 500.0, 35.0]])
    for direction, sign in (("forward", 1.0), ("backward", -1.0)):
        value = rig.coefficients(Conditions.of(sign, *x.T), [240])[:, 0]
        text += f'\n[[harmonic]]\ndirection = "{direction}"\norder = 240\n'
        for quantity, values in (("amplitude", np.abs(value)), ("phase", np.angle(value))):
            skops.dump(linear_model.LinearRegression().fit(x, values), folder / f"{quantity}240_{direction}.skops")
            text += f'{quantity} = "{quantity}240_{direction}.skops"\n'
    (folder / "bundle.toml").write_text(text)


def write_table(rig, path, step=200):
    """A harmonic table of a rig, with white noise."""
    grid = np.array(list(itertools.product((1, -1), range(100, 1801, step), range(0, 1801, 300), (25, 30, 35))), float)
    rng = np.random.default_rng(5)
    c = rig.coefficients(Conditions.of(*grid.T), ORDERS)
    c = c + SIGMA * (rng.standard_normal(c.shape) + 1j * rng.standard_normal(c.shape))
    head = ["direction", "speed_rpm", "torque_Nm", "temperature_C"]
    lines = [",".join([*head, *(f"A{k}" for k in ORDERS), *(f"phi{k}" for k in ORDERS if k)])]
    for point, values in zip(grid, c, strict=True):
        size = [values[0].real, *np.abs(values[1:])]
        numbers = [*point[1:], *size, *np.angle(values[1:])]
        lines.append(",".join(["forward" if point[0] > 0 else "backward", *(f"{x:.12g}" for x in numbers)]))
    path.write_text("\n".join(lines) + "\n")


def reconcile(folder, *more):
    with pytest.raises(SystemExit) as caught:
        main(["reconcile", "--rig", str(folder / "rig.toml"), "--measured", str(folder / "h.csv"), *map(str, more)])
    return caught.value.code


def prepare(folder, hidden):
    (folder / "rig.toml").write_text(LINEAR_RIG + KNOWN)
    (folder / "pick.csv").write_text(PROFILE)
    write_bundle(parse_rig(LINEAR_RIG + KNOWN), folder / "models")
    write_table(parse_rig(LINEAR_RIG + KNOWN + hidden), folder / "h.csv")


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """Sidebands, a pin order and a resonance hidden at once."""
    folder = tmp_path_factory.mktemp("both")
    prepare(folder, RESONANCE + SIDEBANDS)
    options = ["--models", folder / "models", "--update-models", "--profile", folder / "pick.csv", "-q"]
    assert reconcile(folder, "--out", folder / "out", *options) == 0
    return folder, json.loads((folder / "out" / "report.json").read_text())["models"]


def test_new_orders_and_terms_on_learned_ones(both):
    folder, models = both
    entered = {entry["order"]: entry for entry in models["orders"] if entry["entered"]}
    assert {order for order, entry in entered.items() if entry["new"]} == {36, 42, 80}
    assert {order for order, entry in entered.items() if not entry["new"]} == {156, 240}
    assert entered[42]["effects"] == ["carrier_modulation"]
    assert entered[240]["effects"] == ["structural_resonance"]
    # what is left is noise: of a complex number with SIGMA in each part
    for entry in entered.values():
        assert entry["after"] == pytest.approx(SIGMA, rel=0.15)
        assert entry["before"] > 3 * entry["after"]
    # the bundle's file keeps what it said
    old, new = ((path / "models" / "bundle.toml").read_text() for path in (folder, folder / "out"))
    assert new.replace(", 36, 42, 80]", "]").startswith(old.rstrip("\n"))
    assert len(tomllib.loads(new)["term"]) == 4


def test_the_new_bundle_predicts_what_was_hidden(both):
    """At points that were not measured, by the library's own answers."""
    folder, _ = both
    bundle = load(folder / "out" / "models")
    te = bundle.purpose.te
    truth = parse_rig(LINEAR_RIG + KNOWN + RESONANCE + SIDEBANDS)
    x = np.array([[1150.0, 450.0, 27.0], [1650.0, 1500.0, 33.0]])
    for direction, sign in zip(te.directions, (1.0, -1.0), strict=True):
        c = truth.coefficients(Conditions.of(sign, *x.T), te.orders)
        for place, order in enumerate(te.orders):
            if order in (36, 42, 80, 156):
                got = answers(bundle, te, direction, order, x)
                assert got == pytest.approx(c[:, place], abs=1.5e-5), order


def answers(bundle, te, direction, order, x):
    predict = {model.ir.name: model.predict for model in bundle.models}
    every = [*te.quantities(direction, order).values()]
    every += [output for outputs in te.terms(direction, order).values() for output in outputs]
    turn = {Quantity.COSINE: 1.0, Quantity.SINE: 1j}
    return sum(turn[o.quantity] * predict[o.model](x)[:, o.output] for o in every)


def test_the_text_is_proven(both):
    """By the code that verifies every bundle; formulas without exp and tanh to the last bit."""
    folder, models = both
    verified = models["verify"]
    assert verified["passed"]
    assert verified["models"]["structural_resonance_forward"]["exact"]
    assert verified["models"]["structural_resonance_forward"]["max_ulp"] == 0
    assert {"FB_TEPredict", "FB_Compensator"} <= {name.split()[0] for name in verified["models"]}
    text = (folder / "out" / "plc" / "twincat" / "POUs" / "FB_TEPredict.TcPOU").read_text()
    assert "+ fbStructural_resonance_forward.fOut1;" in text


def test_the_rig_moves_more_truly(both):
    """The motion of a machine that no model has seen: the old models leave what they do not know."""
    _, models = both
    none, old, new = models["motion"]["cases"]
    for size in ("full_rms", "full_max", "rms"):
        assert new[size] < old[size] < none[size], size
    assert models["motion"]["specimen"] == {"spread": 0.02, "seed": 11}


@pytest.mark.parametrize("target", ["scl", "plcopen"])
def test_a_target_without_programs_of_two_tasks_moves_in_one(target, tmp_path):
    """After everything was computed it said that such a target has no two tasks, or that it is no dialect."""
    prepare(tmp_path, SIDEBANDS)
    options = ["--models", tmp_path / "models", "--update-models", "--profile", tmp_path / "pick.csv", "-q"]
    assert reconcile(tmp_path, "--out", tmp_path / "out", "--target", target, *options) == 0
    moved = json.loads((tmp_path / "out" / "report.json").read_text())["models"]["motion"]
    assert moved["tasks"] == "one"
    assert moved["cases"][2]["full_rms"] < moved["cases"][1]["full_rms"]


def test_a_term_enters_for_a_sure_and_worthwhile_gain_only():
    """Power in noises of one coefficient: 100 rows with a wave of 0.5 or 3 noises, and a single loud row."""
    random = np.random.default_rng(0)
    noise = random.standard_normal((100, 1)) + 1j * random.standard_normal((100, 1))
    sigma, orders = np.ones((100, 1)), np.array([39])
    assert "one run scatters" in not_worth(noise + 1.0, noise, sigma, orders)
    assert not_worth(noise + 3.0, noise, sigma, orders) == ""
    # it may also be off by as much the other way, as a forest is near the ends of its data
    said = not_worth(noise, noise + 1.0, sigma, orders)
    assert "no closer" in said and "errors of its own that make up for it" in said
    single = noise.copy()
    single[0] += 40.0
    assert "chance" in not_worth(single, noise, sigma, orders)


def test_the_play_grows_by_what_the_terms_of_the_mean_add_to_it(tmp_path):
    write_bundle(parse_rig(LINEAR_RIG + KNOWN), tmp_path / "models")
    path, graph = tmp_path / "models" / "bundle.toml", Graph()
    play = '\n[play] # as in [3]\n# [m]\nangle_deg = 0.008 # measured\ntorque_feature = "torque_Nm"\n'
    path.write_text(path.read_text() + play)
    check_changeable(path)
    loaded = graph.binary("Mul", graph.input("torque_Nm"), graph.constant(1e-5))
    parts = tuple(
        Part("f", direction, 0, graph.binary("Add", graph.constant(value), loaded), graph.constant(0.0))
        for direction, value in ((Direction.FORWARD, -0.002), (Direction.BACKWARD, 0.003))
    )
    decision = Decision(0, ("f",), new=False, entered=True, reason="", parts=parts)
    write_updated(load(tmp_path / "models"), tmp_path / "models", [decision], tmp_path / "out")
    assert load(tmp_path / "out").purpose.te.play.angle_deg == pytest.approx(0.013)
    assert "# measured" in (tmp_path / "out" / "bundle.toml").read_text()


def test_a_bundle_that_cannot_be_changed_is_refused_before_anything_is_computed(tmp_path):
    write_bundle(parse_rig(LINEAR_RIG + KNOWN), tmp_path)
    path = tmp_path / "bundle.toml"
    path.write_text(path.read_text() + '\n[play]\n"angle_deg" = 0.008\ntorque_feature = "torque_Nm"\n')
    with pytest.raises(InputError, match=r"write the play as a table `\[play\]` with a line `angle_deg = ..`"):
        check_models(parse_rig(LINEAR_RIG), Wish(tmp_path))


def test_what_has_a_formula_but_no_name_enters_too():
    """The effect `empirical`, also of the mean, as nodes that give what the effect gives."""
    values = {"torque_square_deg": 3e-3, "torque_square_phase_rad": 0.4}
    values |= {"constant_deg": 1e-3, "constant_phase_rad": 2.0}
    for order in (0, 53):
        rig = RigModel(effects=(catalogue()["empirical"]({"order": order, **values}, Constants()),))
        graph = Graph()
        [(name, symbol)] = addends(rig, order, operating_point(graph, 1.0), graph)[-1:]
        at = Conditions.of(1.0, 600.0, [0.0, 500.0, 1500.0], 25.0)
        columns = {key: getattr(at, key) for key in ("speed_rpm", "torque_Nm", "temperature_C")}
        real, imag = evaluate([symbol.real, symbol.imag], columns).T
        assert name == "empirical"
        assert real + 1j * imag == pytest.approx(rig.coefficients(at, [order])[:, 0], rel=1e-12)


def test_the_page_shows_it(both):
    folder, _ = both
    page = (folder / "out" / "report.html").read_text()
    for text in ("The models for the controller", "Rehearsal with the old and the new compensator", "new order"):
        assert text in page


def test_the_page_in_a_browser(both, tmp_path):
    """No wider than the window, nothing from the network, all pictures there."""
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if browser is None:
        pytest.skip("no browser: install chromium to have the page drawn (apt-get install chromium)")
    folder, _ = both
    text = (folder / "out" / "report.html").read_text()
    assert not re.findall(r'(?:src|href)="(?!#|data:)[^"]*"', text)
    assert text.count("<svg") >= 5
    script = "<script>document.title = 'width ' + document.documentElement.scrollWidth</script></body>"
    (tmp_path / "page.html").write_text(text.replace("</body>", script))
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--window-size=1200,900", f"--user-data-dir={tmp_path}"]
    command = [browser, *options, "--dump-dom", (tmp_path / "page.html").as_uri()]
    shown = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert shown.returncode == 0, shown.stderr
    width = re.search(r"<title>width (\d+)</title>", shown.stdout)
    assert width is not None
    assert int(width[1]) <= 1200


def test_a_bundle_that_knows_the_effect_stays(tmp_path, capsys):
    """Models that were learned from the data with the resonance: nothing is added twice."""
    prepare(tmp_path, SIDEBANDS)
    shutil.rmtree(tmp_path / "models")
    truth = parse_rig(LINEAR_RIG + KNOWN + SIDEBANDS)
    write_linear(truth, tmp_path / "models", (0, 1, 36, 39, 42, 80))
    options = ["--models", tmp_path / "models", "--update-models", "--profile", "none"]
    assert reconcile(tmp_path, "--out", tmp_path / "out", *options) == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert {effect["name"] for effect in report["effects"]} == {"carrier_modulation", "pin_error"}
    assert {entry["order"] for entry in report["models"]["orders"]} == {36, 42, 80}
    assert not any(entry["entered"] for entry in report["models"]["orders"])
    assert not (tmp_path / "out" / "models").exists()
    assert "nothing to add" in capsys.readouterr().err


@pytest.mark.parametrize("fault", ["ratio", "ranges", "no bundle", "alone", "of none", "in place"])
def test_bundles_that_do_not_go_with_the_rig(fault, tmp_path, capsys):
    prepare(tmp_path, SIDEBANDS)
    path, out = tmp_path / "models" / "bundle.toml", tmp_path / "out"
    options, word = ["--models", tmp_path / "models", "--update-models"], "bundle"
    if fault == "ratio":
        path.write_text(path.read_text().replace("= 81.0", "= 101.0"))
        word = "101"
    elif fault == "ranges":
        path.write_text(path.read_text().replace("min = 20.0", "min = 39.0"))
        word = "ranges"
    elif fault == "no bundle":
        path.unlink()
    elif fault == "alone":
        options = options[:2]
        word = "--update-models"
    elif fault == "of none":
        options = ["--target", "nonsense", "--profile", "none"]
        word = "--target, --profile: without effect without --models DIR and --update-models"
    else:
        out = tmp_path
        word = "--out"
    before = sorted(tmp_path.iterdir())
    assert reconcile(tmp_path, "--out", out, *options, "-q") == 2
    assert word in capsys.readouterr().err
    assert not out.exists() or sorted(tmp_path.iterdir()) == before
