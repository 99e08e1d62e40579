"""The default rig against the table measured on the real one, which stands beside the checkout."""

import json
import runpy
from pathlib import Path

import numpy as np
import pytest

from benchmarks import rig_sizes, rig_table
from st_codegen.rig.model import read_rig
from tests.families import SHARED

pytestmark = pytest.mark.skipif(
    not (SHARED / rig_sizes.TABLE).is_file(),
    reason=f"no measured tables ({SHARED.name}/ beside the checkout)",
)
MAKE = Path(rig_sizes.RIG).with_name("make_rig.py")


@pytest.fixture(scope="module")
def measured():
    return rig_sizes.read_table(SHARED / rig_sizes.TABLE)


@pytest.fixture(scope="module")
def sizes(measured):
    return rig_sizes.mesh_sizes(measured, read_rig(rig_sizes.RIG))


@pytest.fixture(scope="module")
def written():
    return runpy.run_path(str(MAKE), run_name="make_rig")


def rounded(value):
    """As make_rig.py has it: three digits of the size, two decimals of the phase."""
    return float(f"{abs(value):.2e}"), round(float(np.angle(value)), 2)


def test_the_sizes_of_the_mesh_are_those_of_the_table(sizes, written):
    shapes = {order: pair for name, order, *pair in written["MESH"] if name != "load_dependent_mesh"}
    slopes = {order: pair for name, order, *pair in written["MESH"] if name == "load_dependent_mesh"}
    for order in rig_sizes.MESH:
        for sign, place in ((1, 0), (-1, 1)):
            constant, slope = sizes[order, sign]
            assert shapes[order][place] == pytest.approx(rounded(constant), abs=1e-12)
            assert slopes[order][place] == pytest.approx(rounded(slope), abs=1e-12)


def test_the_sidebands_are_those_of_the_spectrum(measured, sizes, written):
    ratios = rig_sizes.sideband_ratios(SHARED / rig_sizes.SPECTRUM, sizes, measured)
    tables = {values["order"]: values for name, values in written["OTHERS"] if name == "carrier_modulation"}
    found = {order - 3: table["lower_ratio"] for order, table in tables.items()}
    found |= {order + 3: table["upper_ratio"] for order, table in tables.items() if "upper_ratio" in table}
    assert found == {side: float(f"{ratio:.2g}") for side, ratio in ratios.items()}


def test_medians_of_all_orders_are_near_those_of_the_real_rig(measured):
    """12 %: so much the real medians of order 3 differ between 25 and 35 degC, which no effect of the rig follows."""
    warm = measured.rows(measured.at.temperature_C == 30)
    rows = rig_table.compared(warm, rig_table.simulated(warm, read_rig(rig_sizes.RIG)))
    assert len(rows) == 2 * 10
    for row in rows:
        assert row["ratio"] == pytest.approx(1.0, abs=0.12), row
        if row["order"] in (0, 39, 78, 162, 240):  # those that grow or fall most with the load
            assert row["torque_correlation"] > 0.95, row
        if row["order"] in rig_table.FED:
            assert row["speed_correlation"] > 0.8, row


@pytest.mark.thorough
def test_the_picture_shows_every_order(measured, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    few = measured.rows((measured.at.temperature_C == 30) & (measured.at.torque_Nm % 600 == 0))
    monkeypatch.setattr(rig_table, "read_table", lambda path: few)
    monkeypatch.setattr("sys.argv", ["rig_table.py", "table.csv", "--out", str(tmp_path / "out")])
    rig_table.main()
    text = (tmp_path / "out" / "rig_table.svg").read_text()
    assert all(text.count(f"order {order}<") == 2 for order in few.orders)
    assert len(json.loads((tmp_path / "out" / "rig_table.json").read_text())) == 20
    assert "simulated" in (tmp_path / "out" / "rig_table.html").read_text()
