"""Effects of one's own: from a file, and from a package with an entry point."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from st_codegen.errors import InputError
from st_codegen.rig.effects import Conditions, Constants, catalogue

COGGING = Path(__file__).resolve().parents[2] / "examples" / "effects" / "motor_cogging.py"


def test_a_file_adds_its_effects_behind_those_of_the_catalogue():
    assert list(catalogue([COGGING])) == [*catalogue(), "motor_cogging"]


@pytest.mark.parametrize("target", ["cogging_package", "cogging_package:MotorCogging"])
def test_a_package_adds_its_effects_through_an_entry_point(tmp_path, monkeypatch, target):
    """As an installer leaves it: a module and the metadata of its package beside it."""
    shutil.copy(COGGING, tmp_path / "cogging_package.py")
    information = tmp_path / "cogging_package-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: cogging-package\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(f"[st_codegen.effects]\ncogging = {target}\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "cogging_package", raising=False)
    found = catalogue()["motor_cogging"]
    assert found.title == "cogging of the motor"
    monkeypatch.delitem(sys.modules, "cogging_package")


def test_a_name_that_exists_is_refused(tmp_path):
    own = tmp_path / "own.py"
    own.write_text(COGGING.read_text().replace('name = "motor_cogging"', 'name = "wear"'))
    with pytest.raises(InputError, match="'wear' exists already"):
        catalogue([own])


def test_a_file_without_effects_is_refused(tmp_path):
    (tmp_path / "nothing.py").write_text("x = 1\n")
    with pytest.raises(InputError, match="no effect in it"):
        catalogue([tmp_path / "nothing.py"])


BROKEN = {
    "no coefficient": ("def coefficient", "def coeficient", "has no method `coefficient`"),
    "no orders": ("def touched_orders", "def orders_of", "neither a method `touched_orders` nor an `orders_key`"),
    "name": ('name = "motor_cogging"', "name = 5", "has the name 5; a name is a text"),
    "raises": ("return self.complex_at", "raise RuntimeError()  # ", r"fails in `contribution` \(RuntimeError: "),
    "key": ('"amplitude_deg", at', '"amplitude", at', r"fails in `contribution` \(StopIteration"),
    "shape": ("return self.complex_at", "return np.ones(3)  # ", r"fails in `contribution` \(ValueError: could not"),
    "text": ("return (round", 'return "39"  # ', "`touched_orders` gives '39', where whole numbers"),
    "negative": ("return (round", "return (-3,)  # ", r"`touched_orders` gives \(-3,\), where whole numbers"),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_an_effect_that_is_not_right_is_said_to_be_the_users_own(tmp_path, kind):
    """It was called a defect of this program, or it did nothing and no word was said."""
    before, after, words = BROKEN[kind]
    own = tmp_path / "own.py"
    own.write_text("import numpy as np\n" + COGGING.read_text().replace(before, after))
    with pytest.raises(InputError, match=rf"own\.py: .*{words}"):
        _ = _added(own)


def test_an_effect_that_is_right_adds_what_it_says():
    assert np.abs(_added(COGGING))[:, 0] == pytest.approx([0.004, 0.001])


@pytest.mark.parametrize(
    ("stage", "method"),
    [
        ("AXIS", "motor_angle(self, time_s, reference_deg): return reference_deg"),
        ("MEASURING", "passed_on(self, at, orders, coefficients): return 2 * coefficients"),
    ],
)
def test_an_effect_that_adds_to_no_order_by_itself_is_taken(stage, method, tmp_path):
    own = tmp_path / "own.py"
    lines = ["from st_codegen.rig.effects import Effect, Stage", "class Own(Effect):", f"    stage = Stage.{stage}"]
    own.write_text("\n".join([*lines, "    name = 'own'", f"    def {method}", ""]))
    assert "own" in catalogue([own])


def _added(path):
    """What the effect of a file adds to the order of cogging at 500 and 2000 rpm."""
    constants = Constants(81.0, 39, 40, 3, 30.0)
    (name,) = catalogue([path]).keys() - catalogue().keys()
    effect = catalogue([path])[name]({"amplitude_deg": 0.002, "phase_rad": 0.5}, constants)
    at = Conditions(np.ones(2), np.array([500.0, 2000.0]), np.zeros(2), np.full(2, 30.0))
    return effect.contribution(at, np.array(effect.touched_orders()))
