"""Effects as formulas: the same numbers as the effects themselves, in NumPy, in onnxruntime and in the compiler."""

import numpy as np
import pytest

from st_codegen.reconcile.models.formula import (
    QUANTITIES,
    Graph,
    NoFormulaError,
    addends,
    evaluate,
    operating_point,
    write_onnx,
)
from st_codegen.rig.effects import Conditions, Effect, Scalar, Stage, catalogue
from st_codegen.rig.model import parse_rig

from .blind import effects as blind_effects
from .blind import hidden, write


def rig_of(folder, seed, kept=lambda name: True):
    """A rig with effects of random sizes, as the blind generator makes them."""
    rng = np.random.default_rng(seed)
    names = [name for name in blind_effects.NAMES if name not in blind_effects.IN_TIME and kept(name)]
    ones = [hidden.MAKERS[name](rng) for name in names]
    known = hidden.healthy(rng, ones, ())
    tables = [*known.true, *(one.table for one in ones)]
    delays = [table for table in tables if table["name"] == blind_effects.DELAY]
    write.rig(folder / "rig.toml", {"rig": known.head}, [table for table in tables if table not in delays[:-1]])
    return parse_rig((folder / "rig.toml").read_text())


def points(count=40):
    rng = np.random.default_rng(1)
    sign = np.where(np.arange(count) % 2 == 0, 1.0, -1.0)
    return Conditions(sign, rng.uniform(100, 1800, count), rng.uniform(0, 1800, count), rng.uniform(20, 40, count))


def formulas(rig, sign):
    """Real and imaginary part of every order, as nodes."""
    graph, nodes = Graph(), []
    at = operating_point(graph, sign)
    for order in rig.orders():
        total = sum((symbol for _, symbol in addends(rig, order, at, graph)), 0.0)
        nodes += [total.real, total.imag]
    return nodes


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_formulas_are_the_effects(seed, tmp_path):
    """Of all effects at once. What the measuring chain adds is no error of the machine, and no part of a formula."""
    rig = rig_of(tmp_path, seed)
    assert {effect.name for effect in rig.effects} >= {"structural_resonance", "carrier_modulation", "wear"}
    machine = rig.with_effects(effect for effect in rig.effects if effect.stage is not Stage.MEASURING)
    for sign in (1.0, -1.0):
        at = points().rows(points().sign == sign)
        got = evaluate(formulas(rig, sign), {name: getattr(at, name) for name in QUANTITIES})
        expected = machine.coefficients(at, rig.orders())
        size = np.abs(expected).max()
        assert got[:, 0::2] == pytest.approx(expected.real, abs=1e-13 * size)
        assert got[:, 1::2] == pytest.approx(expected.imag, abs=1e-13 * size)


def test_friction_that_falls_is_a_formula_with_any_exponent():
    head = "[rig]\nname = 't'\nreduction_ratio = 81\ncycloid_teeth = 39\npins = 40\ncranks = 3\n"
    friction = '[[effect]]\nname = "friction_windup"\ncoulomb_arcmin = 0.2\nstribeck_arcmin = 0.5\n'
    at = points().rows(points().sign > 0)
    for exponent in (1, 1.5, 2):
        rig = parse_rig(head + friction + f"stribeck_exponent = {exponent}\n")
        got = evaluate(formulas(rig, 1.0), {name: getattr(at, name) for name in QUANTITIES})
        assert got[:, :1] == pytest.approx(rig.coefficients(at, [0]).real, abs=1e-15)


def test_symbols_know_the_arithmetic_of_arrays_and_refuse_to_be_compared():
    """A comparison has no answer before the operating point is known: it is refused, not answered with no."""
    torque = operating_point(Graph(), 1.0).torque_Nm
    value = 2.0 - abs(-torque) / 4.0 + (1.0 + torque) ** 2 + torque**1 + 3.0 * torque ** (2 / 3)
    assert evaluate([value.real], {"torque_Nm": np.array([8.0])}) == pytest.approx(np.array([[101.0]]))
    powers = (lambda: 2.0**torque, lambda: torque**-1, lambda: torque**torque)
    for refused in (lambda: torque == 1.0, lambda: torque < 1.0, *powers):
        with pytest.raises(NoFormulaError):
            refused()


def test_constant_sidebands_and_all_parts_of_a_resonance_are_formulas():
    tables = (
        '[[effect]]\nname = "cycloid_tooth_error"\norder = 39\namplitude_deg = 1e-3\n',
        '[[effect]]\nname = "carrier_modulation"\norder = 39\nlower_ratio = 0.2\nlower_deg = 2e-4\n'
        "lower_deg_phase_rad = 0.5\nupper_deg = 1e-4\n",
        '[[effect]]\nname = "structural_resonance"\nfrequency_Hz = 50\ndamping_ratio = 0.03\norders = [156]\n'
        "amplitude_deg = [5e-3]\nstatic_share = 1\nabove_C = 27.5\nfrequency_per_kNm = 0.2\nlevels_off_per_kNm = 0.5\n"
        "slope_deg_per_kNm = [3e-3]\nslope_phase_rad = [0.7]\n",
    )
    head = "[rig]\nname = 't'\nreduction_ratio = 81\ncycloid_teeth = 39\npins = 40\ncranks = 3\n"
    rig = parse_rig(head + "".join(tables))
    at = points().rows(points().sign > 0)
    got = evaluate(formulas(rig, 1.0), {name: getattr(at, name) for name in QUANTITIES})
    expected = rig.coefficients(at, rig.orders())
    assert {36, 42, 156} <= set(rig.orders())
    assert got[:, 0::2] + 1j * got[:, 1::2] == pytest.approx(expected, abs=1e-15)
    cold = at.temperature_C < 27
    assert cold.any() and not expected[cold][:, list(rig.orders()).index(156)].any()


def test_the_model_file_has_the_same_numbers(tmp_path):
    """Features in another order. To the last bit where there is neither exp, tanh nor a power."""
    pytest.importorskip("onnxruntime")
    from st_codegen.ir import reference
    from st_codegen.walkers.files import load_model

    rig = rig_of(tmp_path, 3)
    at = points()
    nodes = formulas(rig, 1.0)
    write_onnx(tmp_path / "all.onnx", nodes, ("temperature_C", "speed_rpm", "torque_Nm"), "test")
    model = load_model(tmp_path / "all.onnx", "all")
    x = np.column_stack([at.temperature_C, at.speed_rpm, at.torque_Nm])
    own = evaluate(nodes, {name: getattr(at, name) for name in QUANTITIES})
    free = np.array([not any(n in ("Exp", "Pow", "Tanh") for n in operators(node)) for node in nodes])
    assert free.sum() > 20
    for got in (model.predict(x), reference.evaluate(model.ir, x)):
        np.testing.assert_array_equal(got[:, free], own[:, free])
        assert got == pytest.approx(own, rel=1e-14)


def test_a_mesh_order_that_grows_with_a_power_of_the_load_is_a_model(tmp_path):
    """Without load there is none of it, which a logarithm of the torque would not say."""
    pytest.importorskip("onnxruntime")
    from st_codegen.ir import reference
    from st_codegen.walkers.files import load_model

    head = "[rig]\nname = 't'\nreduction_ratio = 81\ncycloid_teeth = 39\npins = 40\ncranks = 3\n"
    mesh = '[[effect]]\nname = "load_dependent_mesh"\norder = 78\nslope_deg_per_kNm = 1e-3\nphase_rad = 0.7\n'
    rig = parse_rig(f"{head}{mesh}exponent = {2 / 3!r}\n")
    write_onnx(tmp_path / "mesh.onnx", formulas(rig, 1.0), QUANTITIES, "test")
    model = load_model(tmp_path / "mesh.onnx", "mesh")
    torque = np.array([0.0, 1e-6, 500.0, 1000.0, 1600.0])
    x = np.column_stack([np.full(5, 900.0), torque, np.full(5, 30.0)])
    expected = 1e-3 * np.exp(0.7j) * (torque / 1000.0) ** (2 / 3)
    for got in (model.predict(x), reference.evaluate(model.ir, x)):
        column = list(rig.orders()).index(78)
        assert got[:, 2 * column] + 1j * got[:, 2 * column + 1] == pytest.approx(expected, rel=1e-14)


def operators(node):
    from st_codegen.reconcile.models.formula import in_order

    return [one.operator for one in in_order([node])]


class Steps(Effect):
    """An effect that is no formula."""

    name = "steps"
    title = "steps"
    scalars = (Scalar("size_deg", "deg", 0, 1, "size", None),)

    def touched_orders(self):
        return (0,)

    def coefficient(self, at, order):
        return np.where(at.speed_rpm > 500, self.scalar("size_deg"), 0.0)


def test_what_is_no_formula_is_refused(tmp_path):
    known = {**catalogue(), "steps": Steps}
    text = '[rig]\nreduction_ratio = 81.0\n[[effect]]\nname = "steps"\nsize_deg = 0.1\n'
    rig = parse_rig(text, known=known)
    graph = Graph()
    with pytest.raises(NoFormulaError, match="steps"):
        addends(rig, 0, operating_point(graph, 1.0), graph)


def test_an_own_effect_that_adds_to_all_orders_at_once_is_no_formula(tmp_path):
    """Called with symbols its method fails: that is no mistake in the file, and the other orders are updated."""
    (tmp_path / "own.py").write_text(
        "import numpy as np\n"
        "from st_codegen.rig.effects import Effect\n"
        "class Own(Effect):\n"
        "    name = 'own'\n"
        "    def touched_orders(self): return (2,)\n"
        "    def contribution(self, at, orders):\n"
        "        found = np.zeros((len(at), len(orders)), complex)\n"
        "        found[:, orders == 2] = at.torque_Nm[:, None]\n"
        "        return found\n"
    )
    known = catalogue([tmp_path / "own.py"])
    rig = parse_rig('[rig]\nreduction_ratio = 81.0\n[[effect]]\nname = "own"\n', known=known)
    graph = Graph()
    with pytest.raises(NoFormulaError, match="own is no formula"):
        addends(rig, 2, operating_point(graph, 1.0), graph)
