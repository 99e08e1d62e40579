"""Curve files: every layout that is met, and a reason and a line for each that is not usable."""

import contextlib
import pickle

import numpy as np
import pytest

pytest.importorskip("polars")

from st_codegen.campaign.conditions import OperatingPoint
from st_codegen.campaign.curves import (
    BadFileError,
    Curve,
    Run,
    conditions_from_name,
    read_run,
    scan,
    write_run,
)
from st_codegen.errors import InputError
from st_codegen.te.harmonics import Direction

CONDITIONS = OperatingPoint(1000.0, 1100.0, 25.0)


def a_run(samples=1000, shorter=5):
    angle = np.linspace(0, 360, samples)
    te = 0.01 * np.cos(np.deg2rad(angle))
    back = slice(None, samples - shorter)
    return Run(
        CONDITIONS,
        {Direction.FORWARD: Curve(angle, te), Direction.BACKWARD: Curve(angle[::-1][back], te[::-1][back])},
    )


@pytest.fixture
def text(tmp_path):
    write_run(a_run(), tmp_path / "run.csv")
    return (tmp_path / "run.csv").read_text()


def equal(one, other):
    return one.curves.keys() == other.curves.keys() and all(
        np.array_equal(one.curves[d].angle_deg, other.curves[d].angle_deg)
        and np.array_equal(one.curves[d].te_deg, other.curves[d].te_deg)
        for d in one.curves
    )


def quoted(text):
    head, *lines = text.splitlines()
    return "\n".join([head, *(",".join(f'"{cell.replace(".", ",")}"' for cell in line.split(",")) for line in lines)])


LAYOUTS = {
    "the rig's own": lambda text: text,
    "corrected header": lambda text: text.replace("Poisition", "Position"),
    "no header": lambda text: text.split("\n", 1)[1],
    "semicolons": lambda text: text.replace(",", ";"),
    "semicolons and decimal commas": lambda text: text.replace(",", ";").replace(".", ","),
    "decimal commas without header": lambda text: text.replace(",", ";").replace(".", ",").split("\n", 1)[1],
    "tabs": lambda text: text.replace(",", "\t"),
    "a line for Excel": lambda text: "sep=;\n" + text.replace(",", ";"),
    "tabs and decimal commas": lambda text: text.replace(",", "\t").replace(".", ","),
    "quoted decimal commas": quoted,
    "line ends of Windows": lambda text: text.replace("\n", "\r\n"),
    "byte order mark": lambda text: "\ufeff" + text,
    "blanks": lambda text: text.replace(",", ", "),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_same_bits(tmp_path, text, layout):
    path = tmp_path / "odd [name]*.csv"
    path.write_bytes(LAYOUTS[layout](text).encode())
    assert equal(read_run(path, CONDITIONS), a_run())


def test_columns_are_found_by_their_names(tmp_path, text):
    lines = [line.split(",") for line in text.splitlines()]
    (tmp_path / "one.csv").write_text("\n".join(",".join([*line[2:], *line[:2]]) for line in lines))
    assert equal(read_run(tmp_path / "one.csv", CONDITIONS), a_run())
    (tmp_path / "two.csv").write_text("\n".join(",".join(line[:2]) for line in lines))
    assert list(read_run(tmp_path / "two.csv", CONDITIONS).curves) == [Direction.FORWARD]
    for separator in ",\t":
        rows = [separator.join([*line[:2], "", ""]) for line in lines[1:]]
        (tmp_path / "bare.csv").write_text("\n".join(rows))
        assert list(read_run(tmp_path / "bare.csv", CONDITIONS).curves) == [Direction.FORWARD]


def line_500(new):
    def change(text):
        lines = text.splitlines()
        lines[499] = new
        return "\n".join(lines)

    return change


def columns_exchanged(text):
    head, *lines = text.splitlines()
    return "\n".join([head, *(",".join([*line.split(",")[2:], *line.split(",")[:2]]) for line in lines[:990])])


FAULTS = {
    "text": (line_500("1,abc,3,4"), 500, "'abc' is not a number"),
    "too few": (line_500("1,2,3"), 500, "backward: an empty cell"),
    "too many": (line_500("1,2,3,4,5"), 500, "5 values, 4 are expected"),
    "nan": (line_500("1,nan,3,4"), 500, "forward: an empty cell"),
    "infinite": (line_500("1,2,3,-inf"), 500, "backward: an empty cell"),
    "empty cell": (line_500("1,,3,4"), 500, "forward: an empty cell"),
    "empty line": (line_500(""), 500, "forward: an empty cell"),
    "an end without an angle": (lambda text: text + ",1,2,3\n", None, "forward: an empty cell beside a value"),
    "no values": (lambda text: text.splitlines()[0] + "\n,,,\n,,,\n", 2, "no values in any column"),
    "cut off": (lambda text: text[: len(text) // 2], None, "deg of 360"),
    "empty": (lambda text: "", 1, "the file is empty"),
    "line ends of old": (lambda text: text.replace("\n", "\r"), None, "lines end in CR alone"),
    "header only": (lambda text: text.splitlines()[0], 1, "only 0 samples"),
    "unknown column": (lambda text: text.replace("Error_Fw", "Error"), 1, "unknown column 'transmission_error'"),
    "half a direction": (lambda text: "Transmission_Error_Fw\n1\n", 1, "only one of"),
    "column twice": (lambda text: text.replace("_Bw", "_Fw"), 1, "is there twice"),
    "three columns": (lambda text: "1,2,3\n1,2,3\n", 1, "3 columns and no header"),
    "samples lost": (lambda text: "".join(text.splitlines(True)[:300] + text.splitlines(True)[400:]), 901, "lost?"),
    "exchanged": (columns_exchanged, 2, "are the directions exchanged"),
}


@pytest.mark.parametrize("start", [100.0, 0.5, 0.0])
def test_a_turn_that_starts_anywhere_is_read_on(tmp_path, start):
    """Its angle begins anew at 360 deg, which was "the angle runs down; are the directions exchanged?"."""
    up = (np.arange(720) * 0.5 + start) % 360.0
    path = tmp_path / "run.csv"
    path.write_text("".join(f"{a},0.1,{b},0.2\n" for a, b in zip(up, up[::-1], strict=True)))
    curves = read_run(path, CONDITIONS).curves
    for curve, step in zip((curves[Direction.FORWARD], curves[Direction.BACKWARD]), (0.5, -0.5), strict=True):
        assert np.allclose(np.diff(curve.angle_deg), step)


@pytest.mark.parametrize("fault", FAULTS)
def test_a_bad_file_has_a_line_and_a_reason(tmp_path, text, fault):
    change, line, reason = FAULTS[fault]
    path = tmp_path / "bad.csv"
    path.write_text(change(text))
    with pytest.raises(BadFileError) as error:
        read_run(path, CONDITIONS)
    assert reason in error.value.reason
    assert line is None or error.value.line == line
    assert str(path) in str(error.value)
    # the worker processes hand it back whole
    again = pickle.loads(pickle.dumps(error.value))
    assert (again.path, again.line, again.reason) == (path, error.value.line, error.value.reason)


@pytest.mark.parametrize(("step_deg", "is_whole"), [(3.5, True), (3.49, False)])
def test_a_curve_needs_350_deg_of_a_turn(step_deg, is_whole, tmp_path):
    lines = [f"{step_deg * n},0.001" for n in range(101)]
    (tmp_path / "run.csv").write_text("\n".join(["Poisition_Output_Reducer_Fw,Transmission_Error_Fw", *lines]))
    refused = contextlib.nullcontext() if is_whole else pytest.raises(BadFileError, match="covers 349 deg of 360")
    with refused:
        assert len(read_run(tmp_path / "run.csv", CONDITIONS).curves[Direction.FORWARD].te_deg) == 101


def test_not_text(tmp_path):
    (tmp_path / "bad.csv").write_bytes(b"\x00\xff\xfe" * 1000)
    with pytest.raises(BadFileError, match="the text is not UTF-8"):
        read_run(tmp_path / "bad.csv", CONDITIONS)


def test_radians_are_recognised(tmp_path):
    angle = np.linspace(0, 2 * np.pi, 1000)
    write_run(Run(CONDITIONS, {Direction.FORWARD: Curve(angle, angle)}), tmp_path / "r.csv")
    with pytest.raises(BadFileError, match="looks like rad"):
        read_run(tmp_path / "r.csv", CONDITIONS)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("1000.0rpm1100.0Nm25.0deg.csv", CONDITIONS),
        ("1000rpm1100Nm25deg.csv", CONDITIONS),
        ("1000,0rpm1100,0Nm25,0deg.csv", CONDITIONS),
        ("1000rpm_-50.5Nm_25degC_second.csv", OperatingPoint(1000.0, -50.5, 25.0)),
        ("run7.csv", None),
    ],
)
def test_conditions_in_the_name(tmp_path, name, expected):
    assert conditions_from_name(tmp_path / name) == expected


def test_the_rigs_own_folders(tmp_path):
    path = tmp_path / CONDITIONS.rig_path()
    assert path.relative_to(tmp_path).as_posix() == "Test_25degree/1000rpm/1000.0rpm1100.0Nm25.0deg.csv"
    write_run(a_run(), path)
    ((file,), bad) = scan(tmp_path)
    assert not bad
    assert (file.path, file.conditions) == (path, CONDITIONS)


def test_conditions_file_comes_first(tmp_path):
    for name in ("a.csv", "1000rpm100Nm25deg.csv", "2000rpm100Nm25deg.csv"):
        write_run(a_run(), tmp_path / name)
    (tmp_path / "conditions.csv").write_text(
        "file,speed_rpm,torque_Nm,temperature_C\na.csv,500,0,30\n1000rpm100Nm25deg.csv,900,100,25\n"
    )
    files, bad = scan(tmp_path)
    assert [file.conditions.speed_rpm for file in files] == [500.0, 900.0, 2000.0] and not bad


def test_all_faults_of_a_folder_at_once(tmp_path):
    write_run(a_run(), tmp_path / "good.csv")
    write_run(a_run(), tmp_path / "unknown.csv")
    (tmp_path / "conditions.csv").write_text(
        "file;speed_rpm;torque_Nm;temperature_C\ngood.csv;500,5;0;30\nabsent.csv;1;2;3\ngood.csv;1;2;3\nx.csv;1;2\n"
    )
    files, bad = scan(tmp_path)
    assert [file.conditions for file in files] == [OperatingPoint(500.5, 0.0, 30.0)]
    assert sorted(error.line or 0 for error in bad) == [0, 3, 4, 5]
    assert any("unknown.csv: no conditions" in str(error) for error in bad)


def test_no_folder_and_no_files(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        scan(tmp_path / "absent")
    with pytest.raises(InputError, match="no curve files"):
        scan(tmp_path)


def test_rounded_on_request(tmp_path):
    write_run(a_run(), tmp_path / "run.csv", digits=6)
    run = read_run(tmp_path / "run.csv", CONDITIONS)
    assert (
        np.abs(run.curves[Direction.FORWARD].te_deg - a_run().curves[Direction.FORWARD].te_deg).max() <= 0.5e-6 + 1e-16
    )
