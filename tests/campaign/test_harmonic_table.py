"""Harmonic tables: what is written is read again, and what is wrong is said at once."""

import numpy as np
import pytest

from st_codegen.campaign.harmonic_table import HarmonicTable, joined, read_table, write_table
from st_codegen.errors import InputError
from st_codegen.te.harmonics import Direction
from tests.families import SHARED


def a_table(rows=6, orders=(0, 1, 39)):
    random = np.random.default_rng(1)
    coefficients = random.normal(size=(rows, len(orders))) + 1j * random.normal(size=(rows, len(orders)))
    coefficients[:, 0] = coefficients[:, 0].real
    return HarmonicTable(
        np.arange(rows) % 2 == 1,
        random.uniform(100, 1800, rows),
        random.uniform(0, 1800, rows),
        random.uniform(25, 35, rows),
        orders,
        coefficients,
    )


def test_written_and_read(tmp_path):
    table = a_table()
    write_table(table, tmp_path / "new" / "table.csv")
    again = read_table(tmp_path / "new" / "table.csv")
    assert again.orders == table.orders
    assert np.array_equal(again.conditions, table.conditions)
    assert np.array_equal(again.backward, table.backward)
    # to polar coordinates and back: a rounding each of abs, angle, cos, sin and the product
    assert (
        np.abs(again.coefficients - table.coefficients).max()
        <= 8 * np.finfo(float).eps * np.abs(table.coefficients).max()
    )
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["table.csv"]


def test_curve_is_the_sum_of_cosines():
    table = a_table()
    theta = np.linspace(0, 2 * np.pi, 100)
    expected = sum(
        np.abs(table.column(k))[:, None] * np.cos(k * theta + np.angle(table.column(k))[:, None]) for k in table.orders
    )
    # 39 * 2 pi as an argument has an error of 250 * eps
    assert np.abs(table.curves(theta) - expected).max() < 1e-12


def test_choices():
    table = a_table()
    backward = table.direction(Direction.BACKWARD)
    assert len(backward) == 3
    assert backward.backward.all()
    assert np.array_equal(table.only([39, 0]).coefficients, table.coefficients[:, [0, 2]])
    both = joined([table.direction(Direction.FORWARD), backward])
    assert sorted(both.speed_rpm) == sorted(table.speed_rpm)
    with pytest.raises(InputError, match="order 40 is not"):
        table.column(40)
    with pytest.raises(InputError, match="different orders"):
        joined([table, table.only([0])])


def test_arrays_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        a_table().coefficients[0, 0] = 0


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_without_direction_all_is_forward(tmp_path, separator):
    text = "speed_rpm,torque_Nm,temperature_C,A0,A1,phi1,A0_sign\n100.0,0.5,25.0,-0.01,0.5,1.5,measured\n"
    if separator != ",":
        text = text.replace(",", separator).replace(".", ",")
    (tmp_path / "t.csv").write_text(text)
    table = read_table(tmp_path / "t.csv")
    assert not table.backward.any()
    assert table.coefficients[0, 0] == -0.01
    assert np.isclose(table.coefficients[0, 1], 0.5 * np.exp(1.5j), rtol=1e-15)


def test_all_faults_in_one_message(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(
        "direction,speed_rpm,torque_Nm,temperature_C,A0,A1,phi1\nforward,1,2,3,4,5,6\nup,1,2,warm,4,nan,6\nforward,1\n"
    )
    with pytest.raises(InputError) as error:
        read_table(path)
    for part in ("line 3: direction 'up'", "temperature_C: 'warm'", "A1: 'nan' is not finite", "line 4: 2 values"):
        assert part in str(error.value)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("speed_rpm,torque_Nm,A0", "'temperature_C' is missing"),
        ("speed_rpm,torque_Nm,temperature_C,A0,A1", "'A1' has no 'phi1'"),
        ("speed_rpm,torque_Nm,temperature_C,A0,phi1", "'phi1' has no 'A1'"),
        ("speed_rpm,torque_Nm,temperature_C,A0,phi0", "the mean has no phase: leave the column 'phi0' out"),
        ("speed_rpm,torque_Nm,temperature_C,A0,A0", "'A0' is there twice"),
        ("speed_rpm,torque_Nm,temperature_C,A0,AO", "unknown column 'AO'"),
        ("speed_rpm,torque_Nm,temperature_C", "no amplitude columns"),
    ],
)
def test_header_faults(tmp_path, header, message):
    (tmp_path / "t.csv").write_text(f"{header}\n{','.join('1' for _ in header.split(','))}\n")
    with pytest.raises(InputError, match=message):
        read_table(tmp_path / "t.csv")


@pytest.mark.parametrize("content", [b"", b"speed_rpm,torque_Nm\n", b"\xff\xfe\x00"])
def test_not_a_table(tmp_path, content):
    (tmp_path / "t.csv").write_bytes(content)
    with pytest.raises(InputError, match=r"is empty|is missing|save it as UTF-8"):
        read_table(tmp_path / "t.csv")
    with pytest.raises(InputError, match="no such file"):
        read_table(tmp_path / "absent.csv")


def test_invariants():
    one = np.ones(1)
    with pytest.raises(InputError, match="imaginary"):
        HarmonicTable(one > 0, one, one, one, (0,), np.array([[1j]]))
    with pytest.raises(InputError, match="do not rise"):
        HarmonicTable(one > 0, one, one, one, (3, 1), np.ones((1, 2)))
    with pytest.raises(InputError, match="has the shape"):
        HarmonicTable(one > 0, one, one, one, (1,), np.ones((1, 2)))


@pytest.mark.skipif(
    not SHARED.is_dir(), reason=f"the measured tables are not here ({SHARED.name}/ beside the checkout)"
)
def test_the_measured_table():
    table = read_table(SHARED / "rv160n_harmonics.csv")
    assert len(table) == 2 * 969
    assert table.backward.sum() == 969
    assert table.orders == (0, 1, 3, 39, 40, 78, 81, 156, 162, 240)
