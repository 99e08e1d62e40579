"""Sizes and phases by another convention than the rig's, and parts of a campaign that were written another way."""

from dataclasses import replace

import numpy as np
import pytest

from st_codegen.campaign.harmonic_table import read_table
from st_codegen.errors import InputError
from st_codegen.reconcile.mistakes.examine import examine
from st_codegen.rig.model import RigModel

from .test_measurement import ORDERS, PATH, RIG, RUNS, measured, of_curves, smoothed

pytestmark = pytest.mark.thorough

WRITTEN = {
    "with phases of sines": lambda c: 1j * c,
    "with phases 90 deg less": lambda c: -1j * c,
    "with phases of the other sign": np.conj,
    "twice as large, from peak to peak": lambda c: 2 * c,
    "half as large, one side of a spectrum": lambda c: c / 2,
    "RMS in place of amplitudes and with phases of sines": lambda c: 1j * c / np.sqrt(2),
    "in mdeg, and the mean in deg": lambda c: 1e3 * c,
    "in arcmin, and the mean in deg": lambda c: 60 * c,
    "in arcsec, and the mean in deg": lambda c: 3600 * c,
    "in rad, and the mean in deg": lambda c: np.pi / 180 * c,
    "in mrad, and the mean in deg": lambda c: 1e3 * np.pi / 180 * c,
    "in urad, and the mean in deg": lambda c: 1e6 * np.pi / 180 * c,
    "squared, as in a spectrum of power": lambda c: np.abs(c) * c,
    "with phases in turns": lambda c: np.abs(c) * np.exp(1j * np.angle(c) / (2 * np.pi)),
}


def waves(data, written):
    return replace(data, values=np.where(data.orders > 0, written(data.values), data.values))


@pytest.mark.parametrize("words", WRITTEN)
def test_waves_by_another_convention_are_asked_about_and_read_so(words):
    """Sines in place of cosines made twenty parts of the machine change their phases."""
    data, wrong = measured(), waves(measured(), WRITTEN[words])
    with pytest.raises(InputError, match=f"the waves of all orders seem to be {words}.* --accept waves") as error:
        examine(wrong, RIG, PATH)
    assert "--scale" not in str(error.value) and "taken_off" not in str(error.value)
    read = examine(wrong, RIG, PATH, accept=["waves"])
    assert read.corrected == {"waves"} and np.abs(read.data.values - data.values).max() < 1e-12


@pytest.mark.parametrize("words", WRITTEN)
def test_waves_that_noise_makes_much_of_are_read_by_their_convention(words):
    """In noise of a third of most orders sizes from peak to peak were another gain, of the mean as well."""
    with pytest.raises(InputError, match=f"the waves of all orders seem to be {words}"):
        examine(waves(measured(1e-4), WRITTEN[words]), RIG, PATH)


@pytest.mark.parametrize("words", ["with phases of sines", "RMS in place of amplitudes and with phases of sines"])
def test_orders_that_noise_hides_have_no_vote_on_a_convention(words):
    """In noise of most orders RMS of sines were sixteen changes of a machine that has none, and explained."""
    with pytest.raises(InputError, match=f"the waves of all orders seem to be {words}"):
        examine(waves(measured(6e-4), WRITTEN[words]), RIG, PATH)


@pytest.mark.parametrize("words", WRITTEN)
def test_tables_of_one_direction_may_have_another_convention_as_well(words):
    """Phases of sines were a zero of the angle of its own in every run, which no effect has."""
    data = measured()
    forward = np.flatnonzero(data.at.sign > 0)
    wrong = waves(data, WRITTEN[words]).rows(forward)
    with pytest.raises(InputError, match=f"the waves of all orders seem to be {words}.* --accept waves"):
        examine(wrong, RIG, PATH)
    read = examine(wrong, RIG, PATH, accept=["waves"])
    assert read.corrected == {"waves"} and np.abs(read.data.values - data.values[forward]).max() < 1e-12
    assert examine(data.rows(forward), RIG, PATH).mistakes == ()


@pytest.mark.parametrize(("side", "sign"), [("forward", 1.0), ("backward", -1.0)])
@pytest.mark.parametrize("words", ["with phases of sines", "with phases in turns"])
def test_phases_of_one_direction_may_be_by_another_convention(words, side, sign):
    """Those of sines in one direction were nine changes of a machine that has none."""
    data = measured()
    values = np.where(data.at.sign[:, None] == sign, waves(data, WRITTEN[words]).values, data.values)
    wrong = replace(data, values=values)
    with pytest.raises(InputError, match=f"of all orders of {side} curves seem to be {words}.* --accept waves"):
        examine(wrong, RIG, PATH)
    read = examine(wrong, RIG, PATH, accept=["waves"])
    assert read.corrected == {"waves"} and np.abs(read.data.values - data.values).max() < 1e-12


def test_te_that_was_stored_from_its_end_is_asked_about_and_read_so():
    """Backward, and a sample off, it was 15 changed numbers of the rig, which was then as wrong as before."""
    data = replace(of_curves(), samples=1024)
    turn = np.exp(-2j * np.pi * data.orders / 1024)
    wrong = replace(data, values=np.where(data.at.sign[:, None] < 0, data.values.conj() * turn, data.values))
    with pytest.raises(InputError, match=r"of backward curves seem to be stored from their end.* --accept waves"):
        examine(wrong, RIG, PATH)
    read = examine(wrong, RIG, PATH, accept=["waves"])
    assert read.corrected == {"waves"} and np.abs(read.data.values - data.values).max() < 1e-12
    alone = wrong.rows(np.flatnonzero(data.at.sign < 0))
    with pytest.raises(InputError, match=r"of backward curves seem to be stored from their end.* --accept waves"):
        examine(alone, RIG, PATH)


@pytest.mark.parametrize("seed", [4, 5])
def test_noise_that_hides_most_orders_is_no_convention(seed):
    """In noise of twice their size, which is in every size, waves may be as large as those from peak to peak."""
    assert examine(measured(2e-3, seed).rows(slice(None, None, 5)), RIG, PATH).mistakes == ()


def test_what_differs_from_run_to_run_is_no_convention_of_all():
    """Half of the runs are three times as large: all together are twice, and none is."""
    data = measured(1e-4)
    times = np.tile(np.where(np.random.default_rng(1).permutation(RUNS) % 2, 3.0, 1.0), 2)[:, None]
    wrong = replace(data, values=np.where(data.orders > 0, times, 1.0) * data.values)
    try:
        said = [mistake.text for mistake in examine(wrong, RIG, PATH).mistakes]
    except InputError as error:
        said = [str(error)]
    assert not any("the waves of all orders" in text for text in said)


@pytest.mark.slow
@pytest.mark.parametrize(("side", "sign"), [("forward", 1.0), ("backward", -1.0)])
def test_one_direction_may_count_its_angle_the_other_way_or_have_the_other_sign(side, sign):
    """Backward curves from where that motion begins were a dozen changes of the rig; those of the other sign, too."""
    data = measured(1e-4)
    rows = (data.at.sign == sign)[:, None]
    counted = replace(data, values=np.where(rows & (data.orders > 0), data.values.conj(), data.values))
    for wrong, said, name in (
        (counted, f"all orders of {side} curves seem to be with phases of the other sign", "waves"),
        (
            replace(data, values=np.where(rows, -1.0, 1.0) * data.values),
            f"TE of {side} curves seems to have the opposite",
            "sign",
        ),
    ):
        with pytest.raises(InputError, match=f"{said}.* --accept {name}"):
            examine(wrong, RIG, PATH)
        assert np.abs(examine(wrong, RIG, PATH, accept=[name]).data.values - data.values).max() < 1e-12


def test_exchanged_directions_of_a_third_are_no_torques_of_the_other_sign():
    """Their mean turns as with torques of the other sign: those of 71 of 210 runs were to be read so."""
    data = measured(3e-4)
    values, wrong = data.values.copy(), set[int]()
    for run in np.random.default_rng(0).permutation(RUNS)[: 2 * RUNS // 5]:
        rows = data.runs[run]
        values[rows] = data.values[rows[::-1]]
        wrong |= set(rows)
    (found,) = examine(replace(data, values=values), RIG, PATH).mistakes
    assert found.name == "direction" and set(found.rows) <= wrong


@pytest.mark.parametrize("step", [1, -1])
def test_names_of_columns_that_slip_by_one_are_asked_about(step):
    """The column of order 39 held order 40: fifteen changes of the rig, and nine orders unexplained."""
    data = measured(1e-4)
    wrong = replace(data, values=np.append(data.values[:, :1], np.roll(data.values[:, 1:], step, axis=1), axis=1))
    with pytest.raises(InputError, match=f"listed {'before' if step == 1 else 'behind'} its own.* --accept shifted"):
        examine(wrong, RIG, PATH)
    read = examine(wrong, RIG, PATH, accept=["shifted"]).data
    assert np.array_equal(read.values, data.of_orders(np.isin(data.orders, read.orders), "").values)
    assert len(read.orders) == len(data.orders) - 1


@pytest.mark.parametrize("factor", [0.6, 0.75, 1.8, 2.2])
def test_a_factor_that_no_convention_has_is_none(factor):
    """Waves of 0.75 times the rig's were "RMS in place of amplitudes"."""
    for wrong in (measured().scaled(factor), waves(measured(), lambda c: factor * c)):
        with pytest.raises(InputError) as error:
            examine(wrong, RIG, PATH)
        assert "the waves of all orders" not in str(error.value)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_factor_that_the_mean_has_as_well_is_no_convention_of_waves(factor):
    with pytest.raises(InputError) as error:
        examine(measured().scaled(factor), RIG, PATH)
    assert "the waves of all orders" not in str(error.value)


def test_a_missing_effect_is_no_convention_and_hides_none():
    poor = RigModel(
        constants=RIG.constants,
        effects=tuple(e for e in RIG.effects if e.name != "structural_resonance"),
        noise=RIG.noise,
        zero_offset_deg=RIG.zero_offset_deg,
    )
    assert not examine(measured(), poor, PATH).mistakes
    with pytest.raises(InputError, match="twice as large"):
        examine(waves(measured(), lambda c: 2 * c), poor, PATH)


@pytest.mark.parametrize(("factor", "share"), [(-1.0, 0.3), (60.0, 0.5), (-1.0, 0.6)])
def test_runs_in_another_unit_or_of_the_other_sign_are_a_block_whatever_their_share(factor, share):
    """A factor of -1 was the logarithm of a negative number, and half of the runs were a law of the temperature."""
    data, first = measured(), int(RUNS * (1 - share))
    late = np.tile(np.arange(RUNS) >= first, 2)
    found = examine(replace(data, values=data.values * np.where(late, factor, 1.0)[:, None]), RIG, PATH)
    (one,) = found.mistakes
    assert one.name == "block" and f"is {factor:.3g} times as large" in one.text and "run to" not in one.text
    assert set(found.left_out) == set(np.flatnonzero(late))


@pytest.mark.parametrize(
    ("key", "wrong", "words"),
    [
        (
            "temperature_C",
            lambda column: 1.8 * column + 32.0,
            "the temperatures of run 13. to run 2.. seem to be in degF",
        ),
        ("torque_Nm", lambda column: 1e-3 * column, "the torques of run 13. to run 2.. seem to be in kN m"),
        ("torque_Nm", lambda column: 1e3 * column, "the torques of run 13. to run 2.. seem to be in N mm"),
    ],
)
def test_conditions_of_some_runs_in_another_unit_are_asked_about(key, wrong, words):
    """A logger that was set otherwise from a run on made an effect of the rig one of which the data show nothing."""
    data = of_curves()
    late = data.number_of_run >= 130
    column = np.where(late, wrong(getattr(data.at, key)), getattr(data.at, key))
    made = replace(data, at=replace(data.at, **{key: column}))
    with pytest.raises(InputError, match=words):
        examine(made, RIG, PATH)
    read = examine(made, RIG, PATH, accept=["conditions"]).data
    # a run without a load, first or last of these, says nothing of it and is what it was
    assert getattr(read.at, key) == pytest.approx(getattr(data.at, key))


@pytest.mark.parametrize("first", [20, 100])
def test_most_runs_may_have_conditions_in_another_unit(first):
    """From 45 % of the runs on nothing was asked, and the drift with the oil was a fifth of what it was."""
    data = of_curves()
    read_C = data.at.temperature_C
    column = np.where(data.number_of_run >= first, 1.8 * read_C + 32.0, read_C)
    made = replace(data, at=replace(data.at, temperature_C=column))
    with pytest.raises(InputError, match=r"the temperatures of run \d+ to run \d+ seem to be in degF"):
        examine(made, RIG, PATH)
    assert examine(made, RIG, PATH, accept=["conditions"]).data.at.temperature_C == pytest.approx(read_C)


def test_speeds_in_another_unit_are_told_beside_a_mean_that_scatters_from_run_to_run():
    """The noise within curves says nothing of it: slow runs, which tell no speed, seemed to be right or wrong by it."""
    data = of_curves()
    late, random = data.number_of_run >= 80, np.random.default_rng(3)
    moved = 1e-4 * random.standard_normal(len(data))[:, None] * (ORDERS == 0)
    speed = np.where(late, data.at.speed_rpm / 60.0, data.at.speed_rpm)
    made = replace(data, at=replace(data.at, speed_rpm=speed), values=data.values + moved)
    with pytest.raises(InputError, match=r"the speeds of run \d+ to run \d+ seem to be in turns a second"):
        examine(made, RIG, PATH)
    assert examine(made, RIG, PATH, accept=["conditions"]).data.at.speed_rpm == pytest.approx(data.at.speed_rpm)


def test_most_curves_in_another_unit_are_a_block_and_no_gain_of_all():
    """Their noise is in that unit as well: all were to be divided by 36, the mean of 1 and 60, which no run has."""
    data = of_curves()
    factor = np.where(data.number_of_run >= 0.4 * (data.number_of_run.max() + 1), 60.0, 1.0)[:, None]
    found = examine(replace(data, values=factor * data.values, spectral_deg=factor * data.spectral_deg), RIG, PATH)
    (one,) = found.mistakes
    assert one.name == "block" and "is 60 times as large" in one.text
    assert set(found.left_out) == set(np.flatnonzero(factor[:, 0] > 1.0))


@pytest.mark.parametrize("first", [60, 130])
def test_a_zero_that_moved_in_mid_campaign_is_no_other_unit_of_the_runs_behind_it(first):
    """A mean that moved as far as drift by 29 K is what 25 degC, read in degF, makes; but earlier runs read 25 too."""
    data = of_curves()
    colder = replace(data.at, temperature_C=(data.at.temperature_C - 32.0) / 1.8)
    step = (RIG.coefficients(colder, ORDERS.tolist()) - RIG.coefficients(data.at, ORDERS.tolist()))[:, :1].real
    late = data.number_of_run >= first
    made = replace(data, values=data.values + step * late[:, None] * (ORDERS == 0))
    assert step.any() and not examine(made, RIG, PATH).mistakes


@pytest.mark.parametrize("turned_deg", [180.0, 0.0])
def test_odd_orders_that_another_zero_turns_are_no_other_sign(turned_deg):
    """Of a run that was homed at 180 deg all odd orders have the other sign, the mean has its own."""
    rig = RigModel(effects=[one for one in RIG.effects if not any(k and k % 2 == 0 for k in one.touched_orders())])
    data = of_curves()
    rows, orders = data.number_of_run == 7, data.orders
    turn = np.exp(1j * np.radians(turned_deg) * orders) if turned_deg else -1.0
    values = rig.coefficients(data.at, orders.tolist()) + data.values - RIG.coefficients(data.at, orders.tolist())
    made = replace(data, values=np.where(rows[:, None], turn * values, values))
    said = any("opposite sign" in mistake.text for mistake in examine(made, rig, PATH).mistakes)
    assert said is not bool(turned_deg)


def test_half_of_the_runs_with_a_factor_that_an_effect_may_make_are_no_block():
    data = measured()
    late = np.tile(np.arange(RUNS) >= RUNS // 2, 2)
    found = examine(replace(data, values=data.values * np.where(late, 1.5, 1.0)[:, None]), RIG, PATH)
    assert all(mistake.name != "block" for mistake in found.mistakes)


@pytest.mark.parametrize(("sign", "words"), [(1.0, "TE forward"), (-1.0, "TE backward")])
def test_one_column_that_was_smoothed_alone_is_asked_about(sign, words):
    """Backward curves that are means over 3 deg made ten parts of the machine smaller backward."""
    data = measured()
    one = data.at.sign == sign
    wrong = replace(data, values=np.where(one[:, None], smoothed(data, 1.5).values, data.values))
    with pytest.raises(InputError, match=f"{words} seems to be a mean over 1.5 deg of the angle"):
        examine(wrong, RIG, PATH)
    read = examine(wrong, RIG, PATH, accept=["smoothing"]).data
    kept = np.isin(ORDERS, read.orders)
    assert np.abs(read.values - data.values[:, kept]).max() < 1e-3 * np.abs(data.values).max()


def table(tmp_path, phases, sizes=(0.001, 0.002)):
    rows = [f"{speed},{torque},30,0.01,{','.join(f'{a},{phi}' for a, phi in zip(sizes, row, strict=True))}"
            for (speed, torque), row in zip(((300, 0), (600, 500), (900, 900)), phases, strict=True)]  # fmt: skip
    path = tmp_path / "table.csv"
    path.write_text("\n".join(["speed_rpm,torque_Nm,temperature_C,A0,A1,phi1,A39,phi39", *rows]) + "\n")
    return path


def test_phases_in_degrees_are_refused_and_unwrapped_ones_are_read(tmp_path):
    """They were read as rad: the resonance moved by 1 Hz, and six runs were called bad."""
    with pytest.raises(InputError, match=r"line 2: 5 of 6 phases beyond 2\*pi, up to 170: they look like degrees"):
        read_table(table(tmp_path, [(90, -170), (45, 120), (-30, 3)]))
    assert read_table(table(tmp_path, [(0.1, 7.0), (0.2, 6.5), (0.3, -3)])).orders == (0, 1, 39)


def test_sizes_in_decibels_are_refused_and_one_of_another_sign_is_read(tmp_path):
    """They were read as deg: waves of 60 deg stayed unexplained."""
    phases = [(0.1, 1.0), (0.2, 1.5), (0.3, -3)]
    with pytest.raises(
        InputError, match=r"all sizes of waves \(-60 to -54\) are negative: A1, .. are in deg, .* not in dB"
    ):
        read_table(table(tmp_path, phases, (-60, -54)))
    assert read_table(table(tmp_path, phases, (0.001, -0.002))).coefficients[0, 2].real == -0.002 * np.cos(1.0)


@pytest.mark.slow
@pytest.mark.parametrize(("step", "words"), [(1, "below"), (-1, "above")])
def test_columns_that_are_shifted_are_asked_about_and_shifted_back(step, words):
    """A list from 1 read as one from 0: it was asked whether TE was divided by the ratio, 0.006 times the rig's."""
    data = measured()
    beside = np.arange(int(data.orders.max()) + 2)
    own = np.zeros((len(data), len(beside)), np.complex128)
    own[:, data.orders] = data.values
    noise = np.random.default_rng(5).standard_normal((2, *own.shape)) * 1e-5
    own += np.where(own == 0, noise[0] + 1j * noise[1], 0.0)
    spectral = np.full(own.shape, 1e-5)
    right = replace(data, orders=beside, values=own, spectral_deg=spectral)
    place = np.clip(beside - step, 1, len(beside) - 1)
    wrong = replace(right, values=np.where(beside > 0, own[:, place], own))
    assert not examine(right, RIG, PATH).mistakes
    with pytest.raises(InputError, match=f"at the order {words} its own.* --accept shifted"):
        examine(wrong, RIG, PATH)
    read = examine(wrong, RIG, PATH, accept=["shifted"]).data
    assert set(read.orders) == set(beside) - {beside[-1] if step == 1 else 1}
    assert np.array_equal(read.values, right.values[:, read.orders])
