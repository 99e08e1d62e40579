"""fleet.toml: all problems at once, and no name that is more than one folder."""

import re

import pytest

from st_codegen.errors import InputError
from st_codegen.fleet.axes import TextCheck, read_fleet
from tests.fleet.conftest import DEFAULTS, fleet_file


@pytest.fixture
def folder(tmp_path):
    for name in ("a.csv", "b.csv", "old/a.csv", "robots/r1/2026.csv", "robots/r1/2025.csv", "robots/r2/2026.csv"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


def axis(name="a", campaign="a.csv", more=""):
    return f'[[axis]]\nname = "{name}"\ncampaign = "{campaign}"\n{more}\n'


def test_defaults_and_what_an_axis_says_itself(folder):
    own = 'orders = [1, 0]\ncheck = "verify"\nearlier = ["old/a.csv"]\nfamilies = ["svr"]\ntype = "big"\nlimit_us = 5.0'
    defaults = f"{DEFAULTS}orders = [2]\nskip_bad = true\n"
    one, other = read_fleet(fleet_file(folder, defaults + axis("a", "a.csv", own) + axis("b", "b.csv", "seed = 3")))
    assert (one.name, one.campaign, one.earlier) == ("a", folder / "a.csv", (folder / "old/a.csv",))
    assert (one.options.orders, one.options.check, one.options.families) == ((0, 1), TextCheck.VERIFY, ("SVM",))
    assert (one.type, other.type) == ("big", "small")  # else the rig's name
    assert (other.options.orders, other.options.seed, other.options.skip_bad) == ((2,), 3, True)
    assert (other.options.limit_us, other.options.folds, other.options.target) == (float("inf"), 2, "iec")


def test_a_star_is_an_axis_for_each_path(folder):
    (folder / "robots" / ".hidden").mkdir()
    text = '[[axis]]\ncampaign = "robots/*/2026.csv"\nearlier = ["robots/*/2025.csv"]\n'
    found = read_fleet(fleet_file(folder, DEFAULTS + text))
    assert [(one.name, [path.name for path in one.earlier]) for one in found] == [("r1", ["2025.csv"]), ("r2", [])]


@pytest.mark.parametrize(
    "name", ["../up", "/tmp/x", "a/b", "..", ".", "a.b", "CON", "lpt1", "", " a", "a\\\\b", "ä", "-a"]
)
def test_a_name_that_is_no_folder_below(folder, name):
    with pytest.raises(InputError, match="name"):
        read_fleet(fleet_file(folder, DEFAULTS + axis(name)))


def test_a_name_of_a_device_is_said_to_be_one(folder):
    with pytest.raises(InputError, match="that of a device; rename the axis"):
        read_fleet(fleet_file(folder, DEFAULTS + axis("Aux")))


BAD = {
    "campaign": (axis("a", "none"), "there is no campaign .*none"),
    "a long name": (axis("a" * 49), "at most 48"),
    "two of one name": (axis("a") + axis("a", "b.csv"), "two axes are called 'a'"),
    "case": (axis("a") + axis("A", "b.csv"), "'a' and 'A' differ in case only"),
    "one campaign twice": (axis("a") + axis("b", "../{folder}/a.csv"), "a campaign is named twice, by 'a' and 'b'"),
    "no axis": ("", "'axis' is missing"),
    "empty": ("axis = []\n", "axis is empty"),
    "not a list": ('[axis]\nname = "a"\n', r"write \[\[axis\]\]"),
    "a key": (axis(more='famlies = ["DT"]'), "unknown key 'famlies'; did you mean 'families'"),
    "a key of all axes": ("famlies = 1\n" + axis(), r"'famlies'; [^\n]*families, limit_us, check, orders, rig, type$"),
    "a table": ('[default]\nrig = "x"\n' + axis(), r"unknown table \[default\]; did you mean 'defaults'"),
    "a family": (axis(more='families = ["KNN"]'), "unknown family 'KNN'"),
    "no family": (axis(more="families = []"), "families is empty"),
    "a format": (axis(more='format = "pickle"'), "format = 'pickle'; known are native"),
    "a family of no format": (axis(more='families = ["ELM"]'), "none of these families can be saved as native"),
    "a target": (axis(more='target = "s7"'), "no target 's7'"),
    "a check": (axis(more='check = "look"'), "check = 'look'; known are prove"),
    "a flag": (axis(more="skip_bad = 1"), "skip_bad = 1 is neither true nor false"),
    "orders": (axis(more="orders = [-1]"), "orders = -1 is outside"),
    "no orders": (axis(more="orders = []"), "orders is empty"),
    "wear without a campaign": (axis(more="earlier = []"), "earlier is empty: name a campaign of before"),
    "earlier is not there": (axis(more='earlier = ["none"]'), "there is no campaign .*none"),
    "earlier is the campaign": (axis(more='earlier = ["a.csv"]'), "a campaign is named twice, by 'a'"),
    "earlier is no path": (axis(more="earlier = [3]"), "earlier: 3 is not a path"),
    "no rig": (axis(more='rig = "none.toml"'), "none.toml: no such file"),
    "a broken rig": (axis(more='rig = "a.csv"'), r"a.csv.*'rig' is missing|a.csv"),
    "nothing matches": ('[[axis]]\ncampaign = "x/*/y"\n', "nothing matches below"),
    "two stars": ('[[axis]]\ncampaign = "*/*/y"\n', "one star"),
    "a star and a name": (axis("a", "robots/*/2026.csv"), "the star in campaign gives the names"),
    "no name": ('[[axis]]\ncampaign = "a.csv"\n', "'name' is missing"),
    "no campaign": ('[[axis]]\nname = "a"\n', "'campaign' is missing"),
    "no earlier one matches": ('[[axis]]\ncampaign = "robots/*/2026.csv"\nearlier = ["*.x"]\n', "earlier: nothing"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files(folder, name):
    text, message = BAD[name]
    text = text.replace("{folder}", folder.name)
    path = fleet_file(folder, text if name == "empty" else DEFAULTS + text)
    if name == "empty":
        path.write_text(text + DEFAULTS)
    with pytest.raises(InputError, match=message):
        read_fleet(path)


def test_all_problems_at_once_and_a_key_of_one_axis_in_the_defaults(folder):
    text = DEFAULTS + 'name = "x"\n' + axis("a", "none") + axis("..", "b.csv") + axis("b", "b.csv", "folds = 1")
    with pytest.raises(InputError, match="4 problems") as error:
        read_fleet(fleet_file(folder, text))
    for part in (
        r"'name' is of one axis",
        r"\[\[axis\]\] 1: there is no",
        r"2: name = '..'",
        "3: folds = 1 is outside",
    ):
        assert re.search(part, str(error.value))


def test_without_a_rig_anywhere(folder):
    with pytest.raises(InputError, match="'rig' is missing"):
        read_fleet(fleet_file(folder, axis()))


def test_a_broken_rig_is_said_once(folder):
    with pytest.raises(InputError) as error:
        read_fleet(fleet_file(folder, DEFAULTS + axis() + axis("b", "b.csv"), rig="[rig]\n"))
    assert str(error.value).count("reduction_ratio") == 1
