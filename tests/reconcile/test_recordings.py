"""Recordings over time: which angles suffice, and all that is wrong with a file at once."""

import numpy as np
import pytest

from st_codegen.errors import InputError
from st_codegen.reconcile.data.recordings import ANGLES, is_recording, observations, read_recordings
from st_codegen.rig.model import parse_rig

RIG = """
[rig]
reduction_ratio = 81.0
[[effect]]
name = "output_shaft_eccentricity"
amplitude_deg = 0.01
phase_rad = 0.0
[[effect]]
name = "control_lag"
lag_ms = 5.0
[[effect]]
name = "coupling_compliance"
stiffness_Nm_per_rad = 5000.0
"""


def recorded(path, columns=("t", *ANGLES, "torque_Nm", "temperature_C")):
    """Half a turn at 600 rpm of the motor, by the rig's own links."""
    rig = parse_rig(RIG)
    lag, coupling = rig.effects[1:]
    from st_codegen.rig.effects import Conditions

    time = np.arange(4000) * 1e-3
    reference = 3600.0 * time
    at = Conditions.of(np.ones(len(time)), 600.0, 400.0, 30.0)
    motor = lag.motor_angle(time, reference)
    fast = motor + coupling.twist(at)
    out = fast / 81.0
    for _ in range(5):
        out = fast / 81.0 + rig.te_deg(out, 1.0, 600.0, 400.0, 30.0)
    every = dict(zip(ANGLES, (reference, motor, fast, out), strict=True))
    every |= {"t": time, "torque_Nm": at.torque_Nm, "temperature_C": at.temperature_C}
    np.savetxt(path, np.column_stack([every[c] for c in columns]), "%.12g", ",", header=",".join(columns), comments="")
    return rig


@pytest.mark.parametrize("fast", ["theta_ref", "theta_mot", "theta_in"])
def test_any_angle_of_the_fast_side_gives_the_error(fast, tmp_path):
    """By the rig's own links: the error is the rig's, whichever angle was recorded beside the output."""
    rig = recorded(tmp_path / "r.csv", ("t", fast, "theta_out", "torque_Nm", "temperature_C"))
    data = observations(read_recordings([tmp_path / "r.csv"]), rig)
    te = 0.01 * np.cos(data.angle_rad)
    assert data.values[:, 0].real == pytest.approx(te, abs=1e-5)


def test_one_angle_does_not_suffice(tmp_path):
    recorded(tmp_path / "r.csv", ("t", "theta_out", "torque_Nm", "temperature_C"))
    assert is_recording(tmp_path / "r.csv")
    with pytest.raises(InputError, match="do not suffice"):
        read_recordings([tmp_path / "r.csv"])


def test_all_problems_of_all_files_at_once(tmp_path):
    recorded(tmp_path / "a.csv", ("t", "theta_in", "theta_out"))
    recorded(tmp_path / "b.csv")
    lines = (tmp_path / "b.csv").read_text().splitlines()
    (tmp_path / "b.csv").write_text("\n".join([*lines[:50], lines[10]]) + "\n")
    (tmp_path / "c.csv").write_text("t,theta_in,theta_out\n1,2\n")
    with pytest.raises(InputError) as caught:
        read_recordings([tmp_path / name for name in ("a.csv", "b.csv", "c.csv")])
    for text in (
        "torque_Nm, temperature_C are missing",
        "50 samples are too few",
        "does not rise from row 50",
        "c.csv",
    ):
        assert text in str(caught.value), text
