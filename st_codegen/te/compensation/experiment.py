"""FB_Experiment: one measurement of the campaign, both directions (section 2.4)."""

from __future__ import annotations

from st_codegen.emit.blocks.listing import Block, BlockVariable, CodeSection
from st_codegen.emit.blocks.model import header_lines
from st_codegen.emit.literals import real
from st_codegen.te.compensation.codes import EXPERIMENT_STATE, TE_ERROR
from st_codegen.te.compensation.load_torque import LARGEST_TORQUE, LOAD_RATIO
from st_codegen.te.compensation.parts import LARGEST_ANGLE, Check, boolean, check, dint, lreal
from st_codegen.te.harmonics import TransmissionError

#: Limits of section 2.1: motor of the tested side, motor of the loading side (input speeds, rpm).
LARGEST_SPEED = 1800.0
LARGEST_LOAD_SPEED = 4000.0
#: Below this a revolution takes longer than anybody waits, rpm.
_SMALLEST_SPEED = 10.0
#: Why a measurement ends early.
_ERRORS = TE_ERROR.some(
    *("NONE", "ABORTED", "SPEED", "TORQUE", "TEMPERATURE", "PARAMETER", "ENCODER", "ENCODER_JUMP", "CYCLE_TIME"),
    *("SENSOR", "TIME_OUT"),
)


def inputs() -> tuple[BlockVariable, ...]:
    """The inputs of the measurement: commands, settings and sensors."""
    return (
        boolean("bStart", "TRUE starts a measurement; FALSE after its end makes ready for the next"),
        boolean("bAbort", "TRUE ends it: torque and speed go down to zero"),
        lreal("fSpeed_rpm", "input speed of the measurement, rpm"),
        lreal("fTorque_Nm", "load at the slow shaft against the motion, N m"),
        lreal("fTemperature_C", "oil temperature of the measurement, degC"),
        lreal("fThetaIn_rad", "angle of the input shaft from its encoder, rad"),
        lreal("fThetaOut_rad", "angle of the output shaft from its encoder, rad"),
        boolean("bEncodersReady", "both encoders report no error"),
        lreal("fOil_C", "measured oil temperature, degC"),
        lreal("fShaftTorque_Nm", "measured torque at the slow shaft, N m; its sign is not looked at"),
        lreal("fCycle_s", "cycle time of the calling task, s, up to 1.0", "0.0005"),
        lreal("fWarmUpSpeed_rpm", "input speed of the warm-up, rpm", "1000.0"),
        lreal("fHomingSpeed_rpm", "largest input speed of the homing, rpm", "50.0"),
        lreal("fBacklashSpeed_rpm", "input speed that looks for the backlash, rpm", "1.0"),
        lreal("fAcceleration_rpm_s", "change of the input speed, rpm/s", "200.0"),
        lreal("fOilBand_C", "the oil may be this much warmer than wanted at the start; not looked at later, K", "2.0"),
        lreal("fWarmUpTimeOut_s", "longest warm-up, s", "7200.0"),
        lreal("fStepTimeOut_s", "longest other step beside its own motion, s", "120.0"),
    )


def outputs() -> tuple[BlockVariable, ...]:
    """Commands to the axes, and what happens."""
    return (
        lreal("fMotorSpeed_rpm", "speed command of the tested motor, rpm"),
        lreal("fLoadTorque_Nm", "to FB_LoadTorque; positive resists forward motion, N m"),
        boolean("bLoadEnable", "to FB_LoadTorque"),
        boolean("bDataValid", "TRUE for exactly one revolution of the output shaft"),
        boolean("bBackward", "direction of the measurement"),
        lreal("fIn_rad", "angle of the input shaft from the zero of the homing, rad"),
        lreal("fOut_rad", "angle of the output shaft from the zero of the homing, rad"),
        BlockVariable("eState", EXPERIMENT_STATE.type, comment="step"),
        BlockVariable("eError", TE_ERROR.type, comment="NONE, or why the measurement ended early"),
        boolean("bBusy", "a measurement is going on"),
        boolean("bDone", "both directions are measured"),
    )


def _settings() -> tuple[Check, ...]:
    """Parameters with their limits, kept from the start to the end of a measurement."""
    parameter = TE_ERROR["PARAMETER"]
    return (
        check("fWarmUpSpeed_rpm", _SMALLEST_SPEED, LARGEST_SPEED, parameter, "fWarmUpSpeed"),
        check("fHomingSpeed_rpm", 1.0, 200.0, parameter, "fHomingSpeed"),
        check("fBacklashSpeed_rpm", 0.1, 10.0, parameter, "fBacklashSpeed"),
        check("fAcceleration_rpm_s", 10.0, 10000.0, parameter, "fAcceleration"),
        check("fOilBand_C", 0.1, 50.0, parameter, "fOilBand"),
        check("fWarmUpTimeOut_s", 1.0, 86400.0, parameter, "fWarmUpTimeOut"),
        check("fStepTimeOut_s", 1.0, 86400.0, parameter, "fStepTimeOut"),
        check("fTemperature_C", 10.0, 60.0, TE_ERROR["TEMPERATURE"], "fTemperature"),
        check("fTorque_Nm", 0.0, LARGEST_TORQUE, TE_ERROR["TORQUE"], "fTorque"),
        check("fSpeed_rpm", _SMALLEST_SPEED, LARGEST_SPEED, TE_ERROR["SPEED"], "fSpeed"),
    )


def limits() -> dict[str, tuple[float, float]]:
    """What the block takes: least and largest value of each setting, by its name."""
    return {item.name: (float(item.lower), float(item.upper)) for item in _settings()}


def _sensors() -> tuple[Check, ...]:
    """Measured values with the limits of what is believed."""
    return (
        check("fCycle_s", 1e-6, 1.0, TE_ERROR["CYCLE_TIME"], "fCycle"),
        check("fOil_C", -50.0, 200.0, TE_ERROR["SENSOR"], "fOil"),
        check("fShaftTorque_Nm", -1e5, 1e5, TE_ERROR["SENSOR"], "fShaft"),
    )


def _encoders() -> tuple[Check, ...]:
    encoder = TE_ERROR["ENCODER"]
    return (
        check("fThetaIn_rad", -LARGEST_ANGLE, LARGEST_ANGLE, encoder),
        check("fThetaOut_rad", -LARGEST_ANGLE, LARGEST_ANGLE, encoder),
    )


def experiment_block(te: TransmissionError) -> Block:
    """The state machine of a measurement."""
    states = {code.name: code for code in EXPERIMENT_STATE.all}
    errors = {code.name: code for code in _ERRORS}
    values = {
        "state": states,
        "error": errors,
        "settings": _settings(),
        "sensors": _sensors(),
        "encoders": _encoders(),
        "load_ratio": real(LOAD_RATIO),
    }
    return Block(
        "FB_Experiment",
        header_lines(*_header()),
        inputs=inputs(),
        outputs=outputs(),
        variables=_locals(),
        constants=(
            lreal("REDUCTION_RATIO", "theta_in / theta_out", real(te.reduction_ratio)),
            lreal("LOAD_RATIO", "loading motor to slow shaft", real(LOAD_RATIO)),
            lreal("LOAD_SPEED_LIMIT", "speed of the loading motor, rpm", real(LARGEST_LOAD_SPEED)),
            lreal("TURN", "one revolution, rad", "6.283185307179586"),
            lreal("RPM_PER_RAD", "speed towards a goal: that many rpm for each rad of the motor", "9.5"),
            lreal("HOME_BAND", "output shaft is at its zero angle, rad", "1.0E-4"),
            lreal("CENTRE_BAND", "motor is in the middle of the backlash, rad", "1.0E-3"),
            lreal("FOLLOW_BAND", "output shaft follows the motor, rad", "3.5E-5"),
            lreal("TORQUE_BAND", "torque is where it should be, N m", "10.0"),
            lreal("SETTLE_S", "so long in its band, s", "1.0"),
            lreal("JUMP_IN", "change of the input angle in a cycle that no motion explains, rad", "0.5"),
            lreal("JUMP_OUT", "change of the output angle in a cycle that no motion explains, rad", "0.01"),
            lreal("FASTEST", "twice the largest input speed, rad/s", "377.0"),
        ),
        sections=(
            CodeSection("sensors, checked", "experiment_sensors", values),
            CodeSection("steps", "experiment_steps", values),
            CodeSection("errors and time-outs", "experiment_faults", values),
            CodeSection("commands", "experiment_commands", values),
        ),
        codes=(*EXPERIMENT_STATE.all, *_ERRORS),
    )


def _locals() -> tuple[BlockVariable, ...]:
    state, error = EXPERIMENT_STATE.type, TE_ERROR.type
    return (
        BlockVariable("eNext", state, comment="next step"),
        BlockVariable("eReason", error, comment="what is wrong in this cycle"),
        boolean("bUsable", "both angles are usable"),
        boolean("bSeen", "an angle has been seen before"),
        lreal("fIn", "last usable angle of the input shaft, rad"),
        lreal("fOut", "last usable angle of the output shaft, rad"),
        lreal("fZeroIn", "zero of the input shaft, rad"),
        lreal("fZeroOut", "zero of the output shaft, rad"),
        lreal("fOil", "last usable oil temperature, degC"),
        lreal("fShaft", "last usable torque, N m"),
        lreal("fCycle", "last usable cycle time, s", "0.0005"),
        *(lreal(item.kept, f"{item.name} at the start of the measurement", "1.0") for item in _settings()),
        lreal("fTime", "time in this step, s"),
        lreal("fAllowed", "longest time in this step, s"),
        lreal("fSettled", "time in the band, s"),
        lreal("fFrom", "output shaft at the start of the step, rad"),
        lreal("fPlus", "motor at the forward end of the backlash, rad"),
        lreal("fMinus", "motor at the backward end of the backlash, rad"),
        lreal("fGoal", "speed to go to, rpm"),
        lreal("fTorqueGoal", "torque to go to, N m"),
        lreal("fSign", "1.0 forward, -1.0 backward"),
        lreal("fDistance", "distance to go, or angle behind, rad"),
        lreal("fStep", "largest change of the speed in this cycle, rpm"),
        lreal("fStart", "angle at which the measured revolution starts, rad"),
        dint("nTurn", "whole revolutions of the output shaft"),
        dint("nLastTurn", "whole revolutions of the output shaft in the call before"),
    )


def _header() -> tuple[str, ...]:
    return (
        "FB_Experiment: one measurement of the transmission error, forward and backward (section 2.4)",
        "Parameters against their limits, encoders, a load that is left goes down to 10 N m (where friction holds more "
        "at rest, that ends with TIME_OUT: free the gear by hand); warm-up without load, homing with "
        "the motor in the middle of the backlash, run-up with load, one revolution with bDataValid, run-down; then "
        "the other direction without warm-up and homing.",
        "bDataValid starts with the first cycle behind the zero angle of the output shaft and ends before the "
        "first cycle a revolution later: the samples cover one revolution, none of it twice.",
        "Any error, time-out or bAbort takes torque and speed down to zero, the speed by fAcceleration_rpm_s, and says "
        "why in eError: an emergency stop is not its task.",
        "While this block is busy no correction may be added to the motor's reference: end it before bStart, with "
        "bEnable FALSE until bActive is FALSE, since leaving it out at once is a step.",
        f"Limits: {LARGEST_SPEED:.0f} rpm, {LARGEST_LOAD_SPEED:.0f} rpm at the loading motor, "
        f"{LARGEST_TORQUE:.0f} N m at the slow shaft.",
    )
