"""A rig with a measured harmonic table: the table's values at its points, linear between, constant beyond."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from st_codegen.campaign.conditions import Conditions
from st_codegen.campaign.harmonic_table import HarmonicTable, joined, write_table
from st_codegen.errors import InputError
from st_codegen.reconcile.run import reconcile_files
from st_codegen.rig.campaign import Measuring, simulate_campaign
from st_codegen.rig.effects import catalogue
from st_codegen.rig.machine import RigHarmonics, another_specimen
from st_codegen.rig.model import parse_rig, read_rig
from tests.rig.conftest import LINEAR_RIG

ORDERS = (0, 1, 39)
LEVELS = ((100.0, 400.0, 1000.0), (0.0, 500.0), (25.0, 35.0))
HEAD = '[rig]\nreduction_ratio = 81.0\n\n[measured]\ntable = "data/table.csv"\n'
TABLE = "direction,speed_rpm,torque_Nm,temperature_C,A0,A1,phi1\n"


def grid(levels=LEVELS, seed=3):
    """A table of random coefficients on a grid, both directions, rows in random order."""
    random = np.random.default_rng(seed)
    points = np.array([*itertools.product((0, 1), *levels)])
    random.shuffle(points)
    values = random.normal(size=(len(points), 3)) + 1j * random.normal(size=(len(points), 3))
    values[:, 0] = values[:, 0].real
    return HarmonicTable(points[:, 0] == 1, *points[:, 1:].T, ORDERS, 1e-3 * values)


def rig_with(folder: Path, table, text=HEAD):
    (folder / "data").mkdir(exist_ok=True)
    write_table(table, folder / "data" / "table.csv")
    (folder / "rig.toml").write_text(text)
    return read_rig(folder / "rig.toml")


def test_at_its_points_a_rig_has_the_measured_values(tmp_path):
    table = grid()
    rig = rig_with(tmp_path, table)
    assert rig.orders() == ORDERS
    found = rig.coefficients(table.at, (0, 1, 5, 39))
    np.testing.assert_allclose(found[:, [0, 1, 3]], table.coefficients, atol=1e-15)
    assert not found[:, 2].any()


def test_between_the_points_it_is_linear_in_each_condition_and_beyond_them_constant(tmp_path):
    table = grid()
    rig = rig_with(tmp_path, table)

    def at(sign, *point):
        return rig.coefficients(Conditions.of(sign, *point), ORDERS)[0]

    for sign in (1.0, -1.0):
        between = at(sign, 475.0, 125.0, 30.0)
        corners = [
            (speed, torque, temperature)
            for speed, torque, temperature in itertools.product((400.0, 1000.0), (0.0, 500.0), (25.0, 35.0))
        ]
        shares = [
            (1 - abs(475 - speed) / 600) * (1 - abs(125 - torque) / 500) * (1 - abs(30 - temperature) / 10)
            for speed, torque, temperature in corners
        ]
        np.testing.assert_allclose(
            between, sum(share * at(sign, *c) for share, c in zip(shares, corners, strict=True)), atol=1e-15
        )
        np.testing.assert_array_equal(at(sign, 0.0, -200.0, 90.0), at(sign, 100.0, 0.0, 35.0))
        np.testing.assert_array_equal(at(sign, 5000.0, 800.0, -5.0), at(sign, 1000.0, 500.0, 25.0))
    assert not np.allclose(at(1.0, 475.0, 125.0, 30.0), at(-1.0, 475.0, 125.0, 30.0))


def test_a_condition_with_one_level_changes_nothing_and_repeated_runs_count_as_their_mean(tmp_path):
    table = grid(((300.0,), (0.0, 100.0), (30.0,)))
    shifted = replace(table, coefficients=table.coefficients + 2e-4)
    rig = rig_with(tmp_path, joined([table, shifted]))
    found = rig.coefficients(Conditions.of(table.at.sign, 77.0, table.torque_Nm, 12.0), ORDERS)
    np.testing.assert_allclose(found, table.coefficients + 1e-4, atol=1e-15)
    single = rig_with(tmp_path, grid(((300.0,), (50.0,), (30.0,))))
    np.testing.assert_array_equal(
        single.coefficients(Conditions.of([1, 1], [1, 2], 3, 4), ORDERS),
        single.coefficients(Conditions.of([1, 1], 300, 50, 30), ORDERS),
    )


def test_effects_and_the_zero_add_to_the_table(tmp_path):
    table = grid()
    plain = rig_with(tmp_path, table)
    effects = LINEAR_RIG.partition("[axis.load]")[0] + "[[effect]]" + LINEAR_RIG.partition("[[effect]]")[2]
    with_effects = rig_with(tmp_path, table, HEAD.partition("[measured]")[1] + '\ntable = "data/table.csv"\n' + effects)
    alone = replace(with_effects, measured=None)
    at = Conditions.of([1.0, -1.0], [150.0, 640.0], [20.0, 444.0], 31.0)
    np.testing.assert_allclose(
        with_effects.coefficients(at, ORDERS),
        plain.coefficients(at, ORDERS) + alone.coefficients(at, ORDERS),
        atol=1e-15,
    )
    assert alone.zero_offset_deg and alone.effects


def test_a_rig_file_that_is_written_elsewhere_finds_its_table(tmp_path):
    rig = rig_with(tmp_path, grid())
    (tmp_path / "deep" / "er").mkdir(parents=True)
    rig.write(tmp_path / "deep" / "er" / "new.toml")
    assert 'table = "../../data/table.csv"' in (tmp_path / "deep" / "er" / "new.toml").read_text()
    again = read_rig(tmp_path / "deep" / "er" / "new.toml")
    at = Conditions.of(1.0, 333.0, 222.0, 27.0)
    np.testing.assert_array_equal(again.coefficients(at, ORDERS), rig.coefficients(at, ORDERS))
    assert str(tmp_path / "data" / "table.csv") in rig.text()


def test_a_machine_and_its_specimens_move_with_the_table(tmp_path):
    rig = rig_with(tmp_path, grid())
    for model in (rig, another_specimen(rig, catalogue(()), 0.02, 1)):
        orders, backward = RigHarmonics(model).harmonics(True, *(np.array([value]) for value in (400.0, 0.0, 25.0)))
        assert orders.tolist() == list(ORDERS)
        np.testing.assert_array_equal(backward, rig.coefficients(Conditions.of(-1.0, 400.0, 0.0, 25.0), ORDERS))


def test_a_simulated_campaign_measures_the_table(tmp_path):
    from st_codegen.campaign.conditions import OperatingPoint
    from st_codegen.campaign.reader import read_campaign

    rig = rig_with(tmp_path, grid())
    simulate_campaign(rig, [OperatingPoint(400.0, 500.0, 25.0)], tmp_path / "campaign", Measuring(256, 0.0))
    campaign = read_campaign(tmp_path / "campaign")
    found = campaign.table(campaign.fits(ORDERS))
    np.testing.assert_allclose(found.coefficients, rig.coefficients(found.at, ORDERS), atol=1e-10)
    with pytest.raises(InputError, match=r"contains a measured table \(table.csv\), of which nothing has a name"):
        reconcile_files(rig, tmp_path / "campaign", catalogue(()))


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("forward,100,0,25,0,1,0\n", "has no row of direction backward; a rig needs both"),
        (
            "".join(f"{way},{point},25,0,1,0\n" for way in ("forward", "backward") for point in ("100,0", "200,10"))
            + "forward,100,10,25,0,1,0\n",
            "forward, the grid of speeds, torques and temperatures lacks 1 of its 4 points, the first of them "
            "200 rpm, 0 N m, 25 degC; measure them, or leave their levels out",
        ),
        ("forward,100,0,25,0,x,0\n", "A1"),
        ("", "no rows"),
    ],
)
def test_a_table_that_is_no_grid_in_both_directions_is_refused(tmp_path, rows, message):
    (tmp_path / "table.csv").write_text(TABLE + rows)
    with pytest.raises(InputError) as caught:
        parse_rig(HEAD.replace("data/", ""), folder=tmp_path)
    assert message in str(caught.value) and "table.csv" in str(caught.value)


def test_what_is_wrong_in_the_table_of_the_rig_file_is_said_with_all_else(tmp_path):
    text = '[rig]\nreduction_ratio = 0.0\n\n[measured]\ntable = "nowhere.csv"\nfile = 3\n'
    with pytest.raises(InputError) as caught:
        parse_rig(text, folder=tmp_path)
    for part in ("reduction_ratio", "[measured]", "nowhere.csv", "unknown key 'file'"):
        assert part in str(caught.value)
    with pytest.raises(InputError, match=r"\[measured\]: table = 3 is not a text"):
        parse_rig("[rig]\nreduction_ratio = 81\n\n[measured]\ntable = 3\n", folder=tmp_path)
    with pytest.raises(InputError, match=r"\[measured\]: .*'table'"):
        parse_rig("[rig]\nreduction_ratio = 81\n\n[measured]\n", folder=tmp_path)


def test_conditions_that_are_no_levels_make_no_grid_in_memory(tmp_path):
    """2,000 runs, no number of which is there twice: a grid of them would have 8e9 points."""
    count = 2000
    points = np.arange(count, dtype=np.float64)
    table = HarmonicTable(np.arange(count) % 2 == 1, points, points, points, (0,), np.zeros((count, 1)))
    with pytest.raises(InputError, match=r"lacks 999999000 of its 1000000000 points, .* them 0 rpm, 0 N m, 2 degC"):
        rig_with(tmp_path, table)
