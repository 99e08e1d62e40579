"""FB_Compensator: prediction and correction in one task."""

from __future__ import annotations

from collections.abc import Iterable

from st_codegen.emit.blocks.listing import Block, BlockVariable, CodeSection
from st_codegen.emit.blocks.model import header_lines, input_variables
from st_codegen.emit.literals import real
from st_codegen.te.compensation.codes import TE_ERROR
from st_codegen.te.compensation.correction import parameters, results, torque_variable
from st_codegen.te.compensation.parts import (
    LARGEST_INPUT,
    CallArgument,
    boolean,
    check,
    lreal,
    operating_point,
    same,
    set_parts,
)
from st_codegen.te.harmonics import TransmissionError

ANGLE = lreal("fThetaOut_rad", "angle of the output shaft from its encoder, rad")
IN_RANGE = boolean("bInRange", "no input had to be limited to its declared range")


def compensator_block(te: TransmissionError) -> Block:
    """FB_TEPredict and FB_Correction, one after the other."""
    given = parameters(te, "0.0005")
    return Block(
        "FB_Compensator",
        header_lines(
            "FB_Compensator: correction of the motor's reference, for one task that does everything",
            f"Bundle: {te.name}, reduction ratio {real(te.reduction_ratio)}",
            "Motor reference = reduction ratio * theta_out + fCorrection_deg. The law, and what happens after bad "
            "inputs, are described in FB_Correction; for two tasks see FB_CompensatorFast.",
        ),
        inputs=(ANGLE, *operating_point(te), *given),
        outputs=(*results(), IN_RANGE),
        variables=(
            BlockVariable("fbPredict", "FB_TEPredict", comment="harmonics at the operating point"),
            BlockVariable("fbCorrection", "FB_Correction", comment="law, fading and limits"),
            BlockVariable("eSet", TE_ERROR.type, comment="whether the harmonics may be used"),
        ),
        sections=(predict_section(te), *correction_sections(te, given, "fbPredict")),
        codes=TE_ERROR.some("NONE", "OPERATING_POINT", "NO_PREDICTION"),
    )


def predict_section(te: TransmissionError) -> CodeSection:
    """The operating point, checked, and the prediction: leaves `eSet` and `bInRange`."""
    features = input_variables(te.features)
    speed = features[te.speed_feature].name
    checks = [check(variable.name, -LARGEST_INPUT, LARGEST_INPUT, TE_ERROR["OPERATING_POINT"]) for variable in features]
    values = {
        "checks": checks,
        "speed": speed,
        "inputs": [variable.name for variable in features],
        "no_error": TE_ERROR["NONE"],
        "failed": TE_ERROR["NO_PREDICTION"],
    }
    return CodeSection("prediction at the operating point", "te_predict", values)


def correction_sections(te: TransmissionError, given: Iterable[BlockVariable], source: str) -> tuple[CodeSection, ...]:
    """Call FB_Correction with the set of coefficients in `source` and `eSet`, and hand on its results."""
    arguments = [
        *same(["fThetaOut_rad"]),
        CallArgument("fSpeed_rpm", input_variables(te.features)[te.speed_feature].name),
        *(CallArgument(name, f"{source}.{name}") for name, _ in set_parts(te)),
        *same(variable.name for variable in torque_variable(te)),
        *same(["eSet", *(variable.name for variable in given)]),
    ]
    names = [variable.name for variable in results()]
    return (
        CodeSection("correction", "te_call", {"instance": "fbCorrection", "arguments": arguments}),
        CodeSection("outputs", "te_outputs", {"instance": "fbCorrection", "names": names}),
    )
