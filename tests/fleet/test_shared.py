"""Models of a type: who takes them, what is written, and that it is the same wherever it is done."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from st_codegen.campaign.harmonic_table import read_table, write_table
from st_codegen.errors import InputError
from st_codegen.fleet import shared, stages
from st_codegen.fleet.axes import read_fleet
from st_codegen.fleet.output import FleetReport
from st_codegen.fleet.run import run_fleet
from st_codegen.fleet.shared import PLACE, with_shared
from st_codegen.fleet.stages import TRAIN
from st_codegen.project.bundle import load
from st_codegen.te.check import harmonics
from st_codegen.te.harmonics import Direction
from st_codegen.training.search import Backend
from tests.cli.helpers import snapshot
from tests.fleet.conftest import DEFAULTS, fleet_file, write_campaign

SIZES = {"few": 1.05, "like": 0.95, "third": 1.0}


FACTS = {
    "measured": "",
    "verdict": "explained",
    "effects": [],
    "gap": {},
    "cannot_show": [],
    "not_looked_at": [],
    "estimates": [],
}


def axes_text(*names):
    axes = "".join(f'[[axis]]\nname = "{name}"\ncampaign = "{name}.csv"\n' for name in names)
    return f"{DEFAULTS}share = true\norders = [0, 1]\n{axes}"


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """Three axes whose shafts stand at another angle each; one has 6 runs a direction."""
    folder = tmp_path_factory.mktemp("shared")
    for number, (name, size) in enumerate(SIZES.items()):
        write_campaign(folder / f"{name}.csv", number, amplitude_deg=0.017 * size, phase_rad=2.0 * number)
    table = read_table(folder / "few.csv")
    write_table(table.rows(np.arange(len(table)) // 2 % 4 == 3), folder / "few.csv")
    return fleet_file(folder, axes_text(*SIZES))


@pytest.fixture(scope="module")
def done(inputs):
    """The folder of results and what came of the axes; nothing is reconciled."""
    out = inputs.parent / "out"
    axes = read_fleet(inputs)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stages._Stages, "_reconcile", lambda *_: FACTS)
        results = run_fleet(axes, out, Backend(1))
    FleetReport.of(axes, results).write(out)
    return out, results


def trained(axes, out):
    """What the training of each axis says."""
    return {a.name: stages._Stages(a, out / a.name, out)._train() for a in with_shared(axes, out, Backend(1))}


def test_the_models_of_the_type_are_taken_where_they_are_no_worse(done):
    out, results = done
    decided = {name: result.facts[TRAIN]["shared"] for name, result in results.items()}
    assert [own["taken"] for own in decided.values()] == [
        own["rms_deg"] <= own["own_rms_deg"] for own in decided.values()
    ]
    assert decided["few"]["taken"]
    assert decided["few"]["own"] == "average of its training runs"
    assert decided["like"]["own"] == "own models"
    taken = sum(own["taken"] for own in decided.values())
    assert f"Models of the type: taken by {taken} of 3 axes" in (out / "fleet.html").read_text()
    assert all(result.facts["check"]["passed"] for result in results.values())


def test_an_axis_has_its_size_and_its_phase_of_the_models(done):
    """What the bundle with the factor and the turn of an axis predicts is what that axis has."""
    out, _ = done
    bundle = load(out / "few" / "models")
    x = np.array([[1400.0, 720.0, 35.0]])
    found = harmonics([m.ir for m in bundle.models], bundle.purpose.te, Direction.FORWARD, x)
    assert found.amplitude[0, 1] == pytest.approx(0.017 * SIZES["few"], rel=0.02)
    away = np.angle(np.exp(1j * found.phase[0, 1]))
    assert abs(away) < 0.02
    assert "times the amplitude, phase plus" in (out / "few/plc/iec/few.st").read_text()


def test_the_blocks_of_the_models_are_the_same_for_all_that_take_them(done):
    out, results = done
    taken = [name for name, result in results.items() if result.facts[TRAIN]["shared"]["taken"]]
    tables = {name: [m.ir.ops for m in load(out / name / "models").models] for name in taken}
    blocks = set()
    for name in taken:
        text = (out / name / "plc/iec" / f"{name}.st").read_text()
        blocks.add(text[text.index("FUNCTION_BLOCK FB_Tables") :].split("END_FUNCTION_BLOCK")[0])
        assert repr(tables[name]) == repr(tables[taken[0]])
    assert len(taken) == 2
    assert len(blocks) == 1


@pytest.mark.thorough
def test_the_same_with_two_processes_and_not_learned_again(done, inputs, tmp_path):
    out, _ = done
    axes = read_fleet(inputs)
    before = snapshot(out / PLACE)
    with_shared(axes, out, Backend(1))
    assert snapshot(out / PLACE) == before
    (one,) = with_shared(axes, out, Backend(1))[:1]
    with_shared(axes, tmp_path, Backend(2))
    both = [json.loads((root / one.shared / "shared.json").read_text()) for root in (out, tmp_path)]
    for key in ("key", "points", "axes"):
        assert both[0][key] == both[1][key]


def test_a_defect_of_ours_in_what_is_shared_is_told_as_one_and_tried_again(inputs, tmp_path, monkeypatch):
    """The axes have models of their own then, and the command does not end as if all were well."""
    monkeypatch.setattr(shared, "_learned", lambda *_: 1 / 0)
    for name in ("_train", "_compile", "_check"):
        monkeypatch.setattr(stages._Stages, name, lambda self: {})
    monkeypatch.setattr(stages._Stages, "_reconcile", lambda self, *_: {})
    axes = with_shared(read_fleet(inputs), tmp_path, Backend(1))
    results = [stages.do_axis((axis, tmp_path)) for axis in axes]
    assert [(result.errors, result.defect) for result in results] == [({}, True)] * 3
    monkeypatch.setattr(shared, "_learned", lambda *_: {})
    again = with_shared(axes, tmp_path, Backend(1))
    for axis in again:
        result = stages.do_axis((axis, tmp_path))
        assert not result.defect
        assert TRAIN in result.done_now


@pytest.mark.thorough
def test_an_axis_of_other_physics_keeps_its_own_and_one_that_cannot_be_read_stops_none(inputs, tmp_path):
    for name in ("like", "third"):
        shutil.copy(inputs.parent / f"{name}.csv", tmp_path)
    other = read_table(write_campaign(tmp_path / "other.csv", 9))
    bent = other.coefficients * np.exp(3e-3j * other.torque_Nm)[:, None] ** np.array(other.orders)
    write_table(replace(other, coefficients=bent), tmp_path / "other.csv")
    (tmp_path / "bad.csv").write_text("direction,speed_rpm\nforward,1\n")
    axes = read_fleet(fleet_file(tmp_path, axes_text("like", "third", "other", "bad")))
    with pytest.raises(InputError, match=r"bad\.csv"):
        trained(axes, tmp_path / "out")
    found = trained(axes[:3], tmp_path / "out")
    assert not found["other"]["shared"]["taken"]
    assert found["other"]["test_complex_mae_deg"]  # models of its own
    assert "factor" not in (tmp_path / "out/other/models/bundle.toml").read_text()


def test_sharing_wants_the_same_orders(inputs):
    path = inputs.with_name("auto.toml")
    path.write_text(inputs.read_text().replace("orders = [0, 1]\n", ""))
    with pytest.raises(InputError, match="axes share models of the same orders only"):
        read_fleet(path)
