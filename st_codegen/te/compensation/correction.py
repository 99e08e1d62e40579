"""FB_Correction: direction, law, fading and limits; all that is done with a set of coefficients in a cycle."""

from __future__ import annotations

from st_codegen.emit.blocks.listing import Block, BlockVariable, CodeSection
from st_codegen.emit.blocks.model import header_lines, input_variables
from st_codegen.emit.literals import real
from st_codegen.errors import InputError
from st_codegen.te.compensation.codes import TE_ERROR
from st_codegen.te.compensation.parts import (
    HARMONICS_TYPE,
    LARGEST_ANGLE,
    LARGEST_INPUT,
    SIGNED_SPEED,
    SUFFIX,
    Check,
    boolean,
    check,
    error_output,
    lreal,
    order_index,
    set_variables,
)
from st_codegen.te.harmonics import CORRECTION_LIMIT_DEG, Play, TransmissionError
from st_codegen.te.latency import LONGEST_LEAD_S

#: Input speeds beyond this are no measurement, rpm.
_LARGEST_SPEED = 1e6
#: With its sign, unlike the feature that the models take.
SIGNED_LOAD = lreal(
    "fSignedLoad", "load at the output, set point or measured, above 0 against forward motion; always a number"
)
#: Loads are divided by the magnitude of the load, but by no less than this.
LEAST_TORQUE = 1e-3
#: Reduction ratios with which nothing overflows.
_RATIOS = (1e-3, 1e6)


def parameters(te: TransmissionError, cycle_s: str) -> tuple[BlockVariable, ...]:
    """Inputs that say how the correction is applied; the blocks hand them on under these names."""
    return (
        *(_load_inputs(te, te.play) if te.play else ()),
        lreal("fCycle_s", "cycle time of the calling task, s, up to 1.0", cycle_s),
        boolean("bEnable", "TRUE: the correction ramps up; FALSE: it ramps down to zero"),
        boolean("bPublishedLaw", "TRUE: the law as published, FALSE: the continuous one", "FALSE"),
        lreal("fCorrectionLimit_deg", "largest correction, deg at the motor, 0.0 .. 360.0", str(CORRECTION_LIMIT_DEG)),
        lreal("fSlewLimit_deg_s", "fastest change of the correction, deg/s at the motor, 1.0 .. 1.0E6", "2000.0"),
        lreal("fRampTime_s", "time from no to full correction and back, the slew limit apart, s, 0.0 .. 10.0", "0.5"),
        lreal("fHysteresis_rpm", "input speed that decides the direction, rpm, 0.0 .. 1.0E6", "2.0"),
        lreal("fBlendTime_s", "time from one direction's set to the other's, s, 0.0 .. 10.0", "0.1"),
        lreal("fLead_s", f"lead time: the angle is taken that much later, s, 0.0 .. {LONGEST_LEAD_S}", "0.0"),
        lreal("fFullSpeed_rpm", "continuous law: full from this input speed up, rpm, 0.0 .. 1.0E6", "100.0"),
    )


def _load_inputs(te: TransmissionError, play: Play) -> tuple[BlockVariable, ...]:
    """What tells on which side the flanks touch, before the axis has moved."""
    unit = te.features[play.torque_feature].unit
    return (
        SIGNED_LOAD,
        boolean("bLoadGiven", f"TRUE: {SIGNED_LOAD.name} is given; FALSE: the load opposes the motion", "FALSE"),
        lreal("fLoadTime_s", "time constant with which the load follows it, s, 0.0 .. 10.0", "0.0"),
        lreal("fLoadChange", f"load from which its sign counts, {unit}, 0.0 .. 1.0E6", "5.0"),
        lreal(
            "fBlendAngle_deg",
            "least output angle over which the sets change; 0, or bLoadGiven: none, deg, 0.0 .. 10.0",
            "0.0",
        ),
    )


def torque_variable(te: TransmissionError) -> tuple[BlockVariable, ...]:
    """The input that holds the magnitude of the load, for bundles that know their play."""
    return (input_variables(te.features)[te.play.torque_feature],) if te.play else ()


def results() -> tuple[BlockVariable, ...]:
    """Outputs of the correction; the blocks hand them on under these names."""
    return (
        lreal("fTE_deg", "predicted transmission error, deg at the output shaft"),
        lreal("fCorrection_deg", "to be added to the motor's reference, deg at the motor"),
        lreal("fWeight", "weight of the law at this speed, 0 .. 1"),
        boolean("bActive", "a correction is being applied"),
        boolean("bValid", "nothing is wrong in this call, see eError"),
        error_output(),
    )


def _checks(te: TransmissionError) -> tuple[Check, ...]:
    """The later one decides the error code."""
    parameter, point = TE_ERROR["PARAMETER"], TE_ERROR["OPERATING_POINT"]
    of_play = (
        check("fLoadTime_s", 0.0, 10.0, parameter),
        check("fLoadChange", 0.0, 1e6, parameter),
        check("fBlendAngle_deg", 0.0, 10.0, parameter),
        *(check(torque.name, -LARGEST_INPUT, LARGEST_INPUT, point) for torque in torque_variable(te)),
        check(SIGNED_LOAD.name, -LARGEST_INPUT, LARGEST_INPUT, point),
    )
    return (
        *(of_play if te.play else ()),
        check("fCorrectionLimit_deg", 0.0, 360.0, parameter, "fLimit"),
        check("fSlewLimit_deg_s", 1.0, 1e6, parameter, "fSlew"),
        check("fRampTime_s", 0.0, 10.0, parameter, "fRamp"),
        check("fHysteresis_rpm", 0.0, 1e6, parameter),
        check("fBlendTime_s", 0.0, 10.0, parameter),
        check("fLead_s", 0.0, LONGEST_LEAD_S, parameter),
        check("fFullSpeed_rpm", 0.0, 1e6, parameter),
        check("fCycle_s", 1e-6, 1.0, TE_ERROR["CYCLE_TIME"], "fCycle"),
        check("fSpeed_rpm", -_LARGEST_SPEED, _LARGEST_SPEED, point),
        check("fThetaOut_rad", -LARGEST_ANGLE, LARGEST_ANGLE, TE_ERROR["ANGLE"]),
    )


def correction_block(te: TransmissionError) -> Block:
    """Correction of the motor's reference (Eq. 6) from an angle and a set of coefficients."""
    if not _RATIOS[0] <= te.reduction_ratio <= _RATIOS[1]:
        raise InputError(f"reduction ratio {te.reduction_ratio}: the compensator takes {_RATIOS[0]} .. {_RATIOS[1]:g}")
    both = len(te.directions) == 2
    names = ["NONE", "ANGLE", "OPERATING_POINT", "CYCLE_TIME", "PARAMETER", *([] if both else ["DIRECTION"])]
    return Block(
        "FB_Correction",
        header_lines(*_header(te, both)),
        inputs=(
            lreal("fThetaOut_rad", "angle of the output shaft from its encoder, rad"),
            lreal("fSpeed_rpm", SIGNED_SPEED),
            *torque_variable(te),
            *set_variables(te),
            BlockVariable("eSet", TE_ERROR.type, comment="NONE: the set may be used; else why not"),
            *parameters(te, "0.0005"),
        ),
        outputs=results(),
        variables=(
            BlockVariable("fbSum", "FB_HarmonicSum", comment="sum of Eq. 2"),
            *(_set_locals(te) if both else ()),
            boolean("bStarted", "the direction is known"),
            boolean("bBackward", "direction of rotation"),
            boolean("bFading", "after an error, until the correction has faded out"),
            *((lreal("fBlend", "share of the backward set, 0 .. 1"), lreal("fGoal", "goal of fBlend")) if both else ()),
            *(_PLAY_VARIABLES if te.play else ()),
            lreal("fFull", "correction without ramp and limits, deg at the motor"),
            lreal("fFade", "how far the correction is ramped up, 0 .. 1"),
            lreal("fTarget", "correction before the slew limit, deg at the motor"),
            lreal("fStep", "largest change in this cycle"),
            # kept for calls with bad inputs, so that fading out takes its time
            lreal("fCycle", "last usable cycle time, s", "0.0005"),
            lreal("fLimit", "last usable correction limit, deg", "20.0"),
            lreal("fSlew", "last usable slew limit, deg/s", "2000.0"),
            lreal("fRamp", "last usable ramp time, s", "0.5"),
        ),
        constants=(
            lreal("REDUCTION_RATIO", "theta_in / theta_out", real(te.reduction_ratio)),
            lreal("RAD_PER_TURN", "2 * pi", "6.283185307179586"),
            *(_play_constants(te.play) if te.play else ()),
        ),
        sections=_sections(te),
        codes=TE_ERROR.some(*names),
    )


def _sections(te: TransmissionError) -> tuple[CodeSection, ...]:
    """The steps of the correction, in their order."""
    both, torque, suffix = len(te.directions) == 2, torque_variable(te), SUFFIX[te.directions[0]]
    return (
        CodeSection("inputs, checked", "te_checks", {"checks": _checks(te), "no_error": TE_ERROR["NONE"]}),
        CodeSection(
            "direction of rotation",
            "te_direction",
            {
                "both": both,
                "suffix": suffix,
                "no_error": TE_ERROR["NONE"],
                "wrong": TE_ERROR["DIRECTION"],
                "torque": torque[0].name if torque else "",
            },
        ),
        CodeSection(
            "transmission error of Eq. 3",
            "te_sum",
            {
                "both": both,
                "suffix": suffix,
                "last": len(te.orders) - 1,
                "no_error": TE_ERROR["NONE"],
                "mean": te.orders.index(0) if te.play else None,
            },
        ),
        CodeSection("law of Eq. 6", "te_law", {"no_error": TE_ERROR["NONE"]}),
        CodeSection("fading and limits", "te_limits", {"no_error": TE_ERROR["NONE"]}),
    )


_PLAY_VARIABLES = (
    boolean("bLoadBackward", "the sign of the load is that of backward motion"),
    boolean("bTurned", "it changed in this cycle"),
    lreal("fLoadShare", "the load: 1 as in forward motion .. -1 as in backward motion"),
)


def _play_constants(play: Play) -> tuple[BlockVariable, ...]:
    return (
        lreal("PLAY_DEG", "mean backward less mean forward, without load", real(play.angle_deg)),
        lreal("LEAST_TORQUE", "divides the load where its magnitude is below", real(LEAST_TORQUE)),
    )


def _set_locals(te: TransmissionError) -> tuple[BlockVariable, ...]:
    return (
        BlockVariable("aCosine", HARMONICS_TYPE, comment="blended A_k * cos(phi_k), deg"),
        BlockVariable("aSine", HARMONICS_TYPE, comment="blended A_k * sin(phi_k), deg"),
        *order_index(te),
    )


def _header(te: TransmissionError, both: bool) -> tuple[str, ...]:
    direction = (
        "The direction follows the sign of the speed beyond the hysteresis; at a change the sets of both directions "
        "are blended over fBlendTime_s."
        if both
        else f"This bundle knows one direction, {te.directions[0]}; in the other the correction fades out."
    )
    play = (
        (
            f"The mean is taken apart: the play of {real(te.play.angle_deg)} deg belongs to the direction, the rest to "
            "the load. With bLoadGiven the load is fSignedLoad, and where the axis stands a change of its sign, "
            "beyond fLoadChange, changes the direction before the speed does. Without it the sets change over "
            "fBlendAngle_deg where that takes longer than fBlendTime_s.",
        )
        if te.play
        else ()
    )
    return (
        "FB_Correction: correction of the motor's reference from an angle and a set of coefficients",
        f"Bundle: {te.name}, reduction ratio {real(te.reduction_ratio)}",
        "Motor reference = reduction ratio * theta_out + fCorrection_deg, with",
        "fCorrection_deg = -reduction ratio * TE * weight, ramped and limited.",
        "Weight of the published law (Eq. 6): 1 from 100 rpm input speed up, speed / 150 below,",
        "which jumps from 2/3 to 1 at 100 rpm; of the continuous law (default): speed / fFullSpeed_rpm below that "
        "speed, 100 rpm by default. With 0 it corrects fully at all speeds, also at standstill.",
        direction,
        *play,
        "After any error the correction fades to zero over the ramp time, with the last good value as its start; only "
        "behind that time, and with good inputs, does it ramp up again.",
        "The correction never changes faster than its slew limit, which makes ramp and fading longer where it is the "
        "slower one; it goes to no more than its limit, and a limit that is lowered below the present correction is "
        "reached at the slew limit.",
    )
