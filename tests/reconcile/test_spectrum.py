"""An order spectrum, sizes without phases, against a rig: orders that it lacks, named by kinematics."""

import json
import re

import numpy as np
import pytest

from st_codegen.errors import InputError
from st_codegen.reconcile.spectrum import read_spectrum, reconcile_spectrum, spectrum_report, spectrum_summary
from st_codegen.rig.model import parse_rig

from .blind import run, write
from .test_real_data import SPECTRUM, constant_harmonics, needs_data

RIG = """
[rig]
reduction_ratio = 81.0
[[effect]]
name = "output_shaft_eccentricity"
amplitude_deg = 0.0172
phase_rad = 0.0
[[effect]]
name = "cycloid_tooth_error"
order = 39
amplitude_deg = 0.001
phase_rad = 0.0
[[effect]]
name = "pin_error"
order = 40
amplitude_deg = 0.0008
phase_rad = 1.0
"""


def spectrum(folder, louder, quiet=60, directions=("Fw", "Bw"), factor=1.0):
    """The rig's orders, louder ones, and the floor of about 2e-5 on orders between."""
    rng = np.random.default_rng(0)
    size = {1: 0.0172, 39: 0.001, 40: 0.0008} | louder
    size |= {k: 2e-5 * rng.uniform(0.9, 1.1) for k in range(3, 3 + 5 * quiet, 5) if k not in size}
    lines = ["direction,order,median_deg,p95_deg,max_deg"]
    lines += [f"{d},{k},{factor * x:.6g},0,0" for d in directions for k, x in sorted(size.items())]
    (folder / "s.csv").write_text("\n".join(lines) + "\n")
    return read_spectrum(folder / "s.csv")


def test_kinematic_names(tmp_path):
    found = reconcile_spectrum(parse_rig(RIG), spectrum(tmp_path, {2: 3e-4, 42: 2e-4, 80: 2.5e-4, 47: 1.5e-4}))
    report = spectrum_report(found)
    named = {effect["name"]: effect for effect in report["effects"]}
    assert set(named) == {"output_shaft_ovality", "carrier_modulation", "pin_error"}
    assert named["carrier_modulation"]["orders"] == [39]
    assert named["carrier_modulation"]["parameters"]["upper_ratio[39]"]["value"] == pytest.approx(0.2)
    assert named["pin_error"]["orders"] == [80]
    assert [entry["order"] for entry in report["unexplained"]] == [47]
    gap = report["gap"]["fitted"]
    assert gap["before"] > gap["after"] > gap["noise_floor"] > 0
    # of a wave the RMS is its size by the root of 2; the floor is made 2e-5 within a tenth, and stands in all orders
    assert gap["noise_floor"] == pytest.approx(2e-5 * np.sqrt(len(found.spectrum.orders) / 2), rel=0.1)
    assert gap["after"] ** 2 - gap["noise_floor"] ** 2 == pytest.approx(1.5e-4**2 / 2)


def test_nothing_missing(tmp_path):
    found = reconcile_spectrum(parse_rig(RIG), spectrum(tmp_path, {}))
    assert found.verdict == "nothing_missing"
    assert spectrum_report(found)["effects"] == []


@pytest.mark.parametrize("runs", [1, 5])
@pytest.mark.parametrize("directions", [("Fw",), ("Fw", "Bw")], ids=len)
def test_noise_of_few_runs_is_no_order(tmp_path, directions, runs):
    """Rayleigh's distribution has a third of its sizes above three times the median of the quietest quarter."""
    random = np.random.default_rng(7)
    lines = ["direction,order,median_deg"]
    for direction in directions:
        noise = np.median(np.hypot(*random.normal(0, 2e-6, (2, runs, 300))), axis=0)
        louder = {1: 0.0172, 39: 0.001, 40: 0.0008, 47: 2e-5}
        lines += [f"{direction},{k},{np.hypot(louder.get(k, 0.0), noise[k]):.6g}" for k in range(1, 300)]
    (tmp_path / "s.csv").write_text("\n".join(lines) + "\n")
    found = reconcile_spectrum(parse_rig(RIG), read_spectrum(tmp_path / "s.csv"))
    assert (found.named, found.unexplained) == ((), (47,))
    if runs == 1:
        # 300 sizes tell their quartile to 6 %, and by how much they scatter makes 5 % of it: three of these
        assert found.floor[1.0] == pytest.approx(2e-6 * np.sqrt(2), rel=0.24)


def test_coincidences_get_no_name(tmp_path):
    """Loud orders all over the spectrum: that one of them lies 3 beside the teeth says nothing."""
    rng = np.random.default_rng(3)
    loud = {int(k): 2e-4 * rng.uniform(0.5, 2) for k in rng.choice(np.arange(43, 300), 40, replace=False)}
    found = reconcile_spectrum(parse_rig(RIG), spectrum(tmp_path, loud | {42: 1e-4}))
    assert 42 in found.unexplained
    assert len(found.named) <= 2, "a tenth of what is named may be coincidence"


@pytest.mark.parametrize(("factor", "word"), [(np.pi / 180, "57.3"), (81.0, "81")])
def test_other_units_are_asked_about(tmp_path, factor, word):
    with pytest.raises(InputError, match=word):
        reconcile_spectrum(parse_rig(RIG), spectrum(tmp_path, {}, factor=factor))


def test_all_that_is_wrong_with_a_file(tmp_path):
    (tmp_path / "s.csv").write_text("direction,order,median_deg\nFw,1,0.1\nup,2,0.1\nFw,1,0.2\nFw,4,-1\nFw,x,1\n")
    with pytest.raises(InputError, match="4 problems") as caught:
        read_spectrum(tmp_path / "s.csv")
    assert all(f"line {line}" in str(caught.value) for line in (3, 4, 5, 6))


def table(folder, sizes, digits=12):
    """A spectrum of sizes by direction and order."""
    lines = [f"{direction},{k},{x:.{digits}f}" for direction, own in sizes.items() for k, x in own.items()]
    (folder / "s.csv").write_text("\n".join(["direction,order,median_deg", *lines]) + "\n")
    return read_spectrum(folder / "s.csv")


def quiet(orders, sigma=2e-6):
    """Noise of one run and, where they are listed, the rig's orders with a loud one that it lacks."""
    random = np.random.default_rng(11)
    louder = {1: 0.0172, 39: 0.001, 40: 0.0008, 47: 1e-4, 48: 1e-4}
    return {k: float(np.hypot(louder.get(k, 0.0), np.hypot(*random.normal(0, sigma, 2)))) for k in orders}


@pytest.mark.parametrize(
    ("backward", "said"),
    [
        ({0: 0.01}, r"backward: too few orders above 0 for a floor \(0\)"),
        ({0: 0.01, 1: 0.0172}, r"backward: too few orders above 0 for a floor \(1\)"),
        (dict.fromkeys(range(1, 20), 0.0), "backward: sizes that are all 0 are too small"),
    ],
)
def test_a_direction_that_tells_no_floor_is_refused(tmp_path, backward, said):
    """A floor was made of what the other direction lists, or a quantile of nothing: the program ended in an error."""
    with pytest.raises(InputError, match=said):
        table(tmp_path, {"Fw": quiet(range(1, 100)), "Bw": backward})


def test_directions_without_an_order_in_common(tmp_path):
    both = {"Fw": quiet(range(1, 300, 2)), "Bw": quiet(range(2, 300, 2))}
    found = reconcile_spectrum(parse_rig(RIG), table(tmp_path, both))
    assert (found.named, found.unexplained) == ((), (47, 48))
    # each order has one direction alone to be known by, as in a spectrum of one direction with all of them
    one = reconcile_spectrum(parse_rig(RIG), table(tmp_path, {"Fw": quiet(range(1, 300))}))
    assert found.least[1.0] == pytest.approx(one.least[1.0], rel=0.3)
    assert found.least[1.0] > 2e-6 * np.sqrt(2 * np.log(300 / 0.01))


def test_sizes_that_are_rounded_to_nothing_are_no_orders(tmp_path):
    """They were as large as the least that is an order, which was nothing too."""
    sizes = {direction: quiet(range(1, 300)) for direction in ("Fw", "Bw")}
    found = reconcile_spectrum(parse_rig(RIG), table(tmp_path, sizes, digits=5))
    assert not min(found.spectrum.size.values())
    assert (found.named, found.unexplained) == ((), (47, 48))
    assert min(found.floor.values()) > 2e-6 * np.sqrt(2)
    assert spectrum_report(found)["verdict"] == "unexplained"
    said = re.search(r"larger than (.*) deg forward and (.*) deg backward, ", spectrum_summary(found)).groups()
    for size, least in zip(said, found.least.values(), strict=True):
        # rounded down it was a size that noise reaches more often
        assert least <= float(size) <= 1.1 * least
    assert "reaches in at most one of 100 spectra:\n-" in spectrum_summary(found)


def test_a_list_of_nothing_says_so(tmp_path):
    """It ended with a colon."""
    found = reconcile_spectrum(parse_rig(RIG), spectrum(tmp_path, {}))
    assert (found.named, found.unexplained) == ((), ())
    assert "in at most one of 100 spectra: none\n" in spectrum_summary(found)


@pytest.mark.thorough
@needs_data
def test_what_the_ten_orders_of_the_paper_lack(tmp_path):
    """On the measured spectrum itself: sidebands of +-3, harmonics of the pins, the output shaft's second."""
    write.rig(tmp_path / "rig.toml", *constant_harmonics())
    done = run.reconcile(tmp_path / "rig.toml", SPECTRUM, tmp_path / "out")
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert (tmp_path / "out" / "report.html").is_file()
    named = {effect["name"]: effect["touched_orders"] for effect in report["effects"]}
    assert set(named) == {"carrier_modulation", "pin_error", "output_shaft_ovality"}
    assert set(named["carrier_modulation"]) >= {36, 42, 159, 237}
    assert named["pin_error"] == [80, 120, 160]
    assert {158, 16, 79} <= {entry["order"] for entry in report["unexplained"]}, "no part of the machine has them"
