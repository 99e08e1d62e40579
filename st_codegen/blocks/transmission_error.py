"""FB_TEPredict and FB_Compensator: what the models of a bundle are for."""

from __future__ import annotations

import numpy as np

from st_codegen.blocks.listing import Block, Listing, Variable
from st_codegen.blocks.model import block_name, feature_text, header_lines, input_variables
from st_codegen.ir import Direction, Quantity, TransmissionError
from st_codegen.literals import real

#: The type of one number for each harmonic; strict compilers want a name for arrays that blocks exchange.
HARMONICS_TYPE = "T_Harmonics"

#: Names of the outputs of FB_TEPredict.
_SUFFIX = {Direction.FORWARD: "Fw", Direction.BACKWARD: "Bw"}


def predict_block(te: TransmissionError) -> Block:
    """FB_TEPredict: amplitudes and phases of all harmonics at an operating point, both directions."""
    listing = Listing(max_array=len(te.outputs) + 1)
    listing.locals("BOOL", "bUsable", "bInside")
    inputs = input_variables(te.features)
    models = list(dict.fromkeys(output.model for output in te.outputs))
    instances = [
        Variable(f"fb{block_name(model)[3:]}", block_name(model), comment=f"model {model}") for model in models
    ]
    by_model = dict(zip(models, instances, strict=True))
    for instance in instances:
        listing.variables[instance.name] = instance
    listing.section(
        "the operating point is checked once for all models", "te_inputs", inputs=[variable.name for variable in inputs]
    )
    # a model block names its inputs by its own features, which the bundle's are
    listing.section("models", "te_models", instances=[instance.name for instance in instances], inputs=inputs)
    if any(output.quantity is Quantity.COSINE for output in te.outputs):
        listing.locals("LREAL", "fCosine", "fSine", "fPhase")
    harmonics: list[dict[str, object]] = []
    for direction in te.directions:
        for number, order in enumerate(te.orders):
            of = {
                quantity.value: f"{by_model[output.model].name}.fOut{output.output + 1}"
                for quantity, output in te.quantities(direction, order).items()
            }
            harmonics.append(
                {"index": number, "order": order, "suffix": _SUFFIX[direction], "direction": direction, "of": of}
            )
    listing.section("amplitudes and phases", "te_harmonics", harmonics=harmonics)
    outputs = []
    for direction in te.directions:
        suffix = _SUFFIX[direction]
        outputs.append(Variable(f"aAmplitude{suffix}", HARMONICS_TYPE, comment=f"A_k {direction}, deg"))
        outputs.append(Variable(f"aPhase{suffix}", HARMONICS_TYPE, comment=f"phi_k {direction}, rad"))
    outputs.append(Variable("bValid", "BOOL", comment="the outputs belong to the inputs of this call"))
    outputs.append(Variable("bInRange", "BOOL", comment="no input had to be limited to its trained range"))
    return _block("FB_TEPredict", _predict_header(te), inputs, tuple(outputs), listing)


def _predict_header(te: TransmissionError) -> tuple[str, ...]:
    return (
        "FB_TEPredict: amplitudes and phases of the transmission error at an operating point",
        f"Bundle: {te.name}",
        "TE(theta) = sum over k of A_k * cos(k * theta + phi_k), theta the angle of the output shaft;",
        "k = 0 is the mean, with its sign and without a phase.",
        *(f"Index {number}: order {order}" for number, order in enumerate(te.orders)),
        *(f"Input {number}: {feature_text(feature)}" for number, feature in enumerate(te.features, 1)),
    )


def compensator_block(te: TransmissionError) -> Block:
    """FB_Compensator: transmission error at an angle (Eq. 3) and correction of the motor's reference (Eq. 6)."""
    listing = Listing(max_array=len(te.orders))
    inputs = (
        Variable("fThetaOut_rad", "LREAL", comment="angle of the output shaft from its encoder, rad"),
        *input_variables(te.features),
        Variable("fCycle_s", "LREAL", initial="0.0005", comment="cycle time of the calling task, s"),
        Variable("bEnable", "BOOL", comment="TRUE: the correction ramps up; FALSE: it ramps down to zero"),
        Variable("bPublishedLaw", "BOOL", initial="FALSE", comment="TRUE: the law as published, see above"),
        Variable("fCorrectionLimit_deg", "LREAL", initial="20.0", comment="largest correction, motor side, deg"),
        Variable("fSlewLimit_deg_s", "LREAL", initial="2000.0", comment="fastest change of it, deg/s"),
        Variable("fRampTime_s", "LREAL", initial="0.5", comment="time from no to full correction, s"),
        Variable("fHysteresis_rpm", "LREAL", initial="2.0", comment="input speed that decides the direction, rpm"),
    )
    outputs = (
        Variable("fTE_deg", "LREAL", comment="predicted transmission error, deg at the output shaft"),
        Variable("fCorrection_deg", "LREAL", comment="to be added to the motor's reference, deg at the motor"),
        Variable("fWeight", "LREAL", comment="weight of the law at this speed, 0 .. 1"),
        Variable("bActive", "BOOL", comment="a correction is being applied"),
        Variable("bValid", "BOOL", comment="all inputs were usable in this call"),
        Variable("bInRange", "BOOL", comment="no input had to be limited to its trained range"),
    )
    listing.variables["fbPredict"] = Variable("fbPredict", "FB_TEPredict", comment="amplitudes and phases")
    listing.locals("LREAL", "fSpeed", "fSum", "fFade", "fTarget", "fStep", "fLimit", "fSlew")
    listing.local("fCycle", "LREAL", initial="0.001")
    listing.local("fRamp", "LREAL", initial="0.5")
    listing.locals("DINT", "nOrder")
    listing.locals("BOOL", "bUsable", "bBackward")
    orders = listing.table("ORDER", "LREAL", np.array(te.orders, dtype=np.float64))
    ratio = listing.constant("REDUCTION_RATIO", te.reduction_ratio)
    names = [variable.name for variable in input_variables(te.features)]
    numbers = [variable.name for variable in inputs if variable.type == "LREAL"]
    listing.section("inputs, checked", "te_check", numbers=numbers)
    listing.section(
        "transmission error of Eq. 3",
        "te_sum",
        inputs=names,
        speed=names[te.speed_feature],
        last=len(te.orders) - 1,
        orders=orders,
        suffixes=[_SUFFIX[direction] for direction in te.directions],
        both=len(te.directions) == 2,
    )
    listing.section("law of Eq. 6", "te_law")
    listing.section("ramp, limits", "te_limits", ratio=ratio)
    return _block("FB_Compensator", _compensator_header(te), inputs, outputs, listing)


def _compensator_header(te: TransmissionError) -> tuple[str, ...]:
    return (
        "FB_Compensator: predicted transmission error and the correction of the motor's reference",
        f"Bundle: {te.name}, reduction ratio {real(te.reduction_ratio)}",
        "Motor reference = reduction ratio * theta_out + fCorrection_deg, with",
        "fCorrection_deg = -reduction ratio * TE * weight.",
        "Weight of the published law (Eq. 6): 1 from 100 rpm input speed up, speed / 150 below,",
        "which jumps from 2/3 to 1 at 100 rpm; of the continuous law (default): speed / 100 below.",
        "Bad inputs (not a number, infinite, no valid prediction) let the correction fade out.",
    )


def _block(
    name: str, header: tuple[str, ...], inputs: tuple[Variable, ...], outputs: tuple[Variable, ...], listing: Listing
) -> Block:
    return Block(
        name=name,
        header=header_lines(header),
        inputs=inputs,
        outputs=outputs,
        variables=tuple(listing.variables.values()),
        constants=tuple(listing.constants),
        tables=tuple(listing.tables),
        sections=tuple(listing.sections),
    )
