"""Two tasks: models in the slow one, harmonic sum and correction in the fast one, and what they exchange.

The slow task writes the buffer that the fast one does not read, then publishes its number. A buffer carries the number
of its set, written before anything else in it: a reader that still finds the published number there after its copy has
a whole set, whatever the other task did meanwhile. (Lamport, Concurrent reading and writing, CACM 20, 1977.)
"""

from __future__ import annotations

from st_codegen.emit.blocks.application import Structure
from st_codegen.emit.blocks.listing import Block, BlockVariable, CodeSection
from st_codegen.emit.blocks.model import header_lines, input_variables
from st_codegen.emit.literals import real
from st_codegen.te.compensation.codes import TE_ERROR
from st_codegen.te.compensation.compensator import ANGLE, IN_RANGE, correction_sections, predict_section
from st_codegen.te.compensation.correction import parameters, results, torque_variable
from st_codegen.te.compensation.parts import (
    SIGNED_SPEED,
    boolean,
    check,
    dint,
    lreal,
    operating_point,
    order_index,
    set_parts,
    set_variables,
)
from st_codegen.te.harmonics import TransmissionError

SET_TYPE = "ST_TESet"
EXCHANGE_TYPE = "ST_TEExchange"
EXCHANGE = BlockVariable("stExchange", EXCHANGE_TYPE, comment="the one variable that both tasks know")
AGE_LIMIT = lreal("fAgeLimit_s", "sets older than this are not used, s, 0.0 .. 10.0", "0.02")
#: Parts of a set of coefficients beyond this are no angle, deg.
_LARGEST_PART = 1e6


def set_structure(te: TransmissionError) -> Structure:
    """A set of coefficients and what is known of it."""
    return Structure(
        SET_TYPE,
        ("A set of coefficients, as the slow task hands it to the fast one.",),
        (
            dint("nNumber", "number of the set; 0: none yet"),
            BlockVariable("eError", TE_ERROR.type, comment="NONE: the set may be used; else why not"),
            boolean("bInRange", "no input had to be limited to its declared range"),
            *set_variables(te),
        ),
    )


def exchange_structure() -> Structure:
    """The double buffer through which the slow task hands sets of coefficients to the fast one."""
    return Structure(
        EXCHANGE_TYPE,
        ("What slow and fast task share: two buffers, and the number of the newest whole set.",),
        (
            dint("nSequence", "number of the newest set; odd: it is in stOdd, even: in stEven"),
            BlockVariable("stOdd", SET_TYPE, comment="sets with odd numbers"),
            BlockVariable("stEven", SET_TYPE, comment="sets with even numbers"),
        ),
    )


def slow_block(te: TransmissionError) -> Block:
    """FB_CompensatorSlow: coefficients at the operating point, handed to the fast task."""
    values = {"names": [name for name, _ in set_parts(te)], "last": len(te.orders) - 1}
    return Block(
        "FB_CompensatorSlow",
        header_lines(
            "FB_CompensatorSlow: coefficients at the operating point, for FB_CompensatorFast in another task",
            f"Bundle: {te.name}",
            "Writes the buffer that is not read, and publishes its number when the set is whole. This relies on "
            "stores of aligned numbers of 32 and 64 bits being whole and in order, as on x86.",
            "A set is published with every call, also one that says why it must not be used.",
        ),
        inputs=operating_point(te),
        outputs=(
            boolean("bValid", "the set may be used"),
            BlockVariable("eError", TE_ERROR.type, comment="NONE, or why the set must not be used"),
            IN_RANGE,
        ),
        in_outs=(EXCHANGE,),
        variables=(
            BlockVariable("fbPredict", "FB_TEPredict", comment="harmonics at the operating point"),
            BlockVariable("eSet", TE_ERROR.type, comment="whether the set may be used"),
            dint("nNumber", "number of the new set"),
            *order_index(te),
        ),
        constants=(dint("LAST_NUMBER", "numbers start again at 1 behind it; even", "1000000000"),),
        sections=(
            predict_section(te),
            CodeSection("write the other buffer, then publish it", "te_publish", values),
            CodeSection("outputs", "te_slow_outputs", {"no_error": TE_ERROR["NONE"]}),
        ),
        codes=TE_ERROR.some("NONE", "OPERATING_POINT", "NO_PREDICTION"),
    )


def fast_results() -> tuple[BlockVariable, ...]:
    """What the fast task knows of the exchange."""
    return (
        lreal("fAge_s", "time since the set in use arrived, s"),
        dint("nTorn", "sets that changed while they were copied, up to 1000000"),
    )


def fast_block(te: TransmissionError) -> Block:
    """FB_CompensatorFast: correction from the newest whole set."""
    given = parameters(te, "0.00025")
    names = [name for name, _ in set_parts(te)]
    values = {
        "names": names,
        "last": len(te.orders) - 1,
        "age": check("fAgeLimit_s", 0.0, 10.0, TE_ERROR["PARAMETER"], "fAgeLimit"),
        "cycle": check("fCycle_s", 1e-6, 1.0, TE_ERROR["CYCLE_TIME"], "fCycle"),
        "limit": real(_LARGEST_PART),
        **{name.lower(): TE_ERROR[name] for name in ("NOT_READY", "STALE", "PARAMETER", "NO_PREDICTION")},
    }
    return Block(
        "FB_CompensatorFast",
        header_lines(
            "FB_CompensatorFast: correction of the motor's reference from the coefficients of FB_CompensatorSlow",
            f"Bundle: {te.name}, reduction ratio {real(te.reduction_ratio)}",
            "Motor reference = reduction ratio * theta_out + fCorrection_deg. The law, and what happens after bad "
            "inputs, are described in FB_Correction.",
            "A set that the slow task changed while it was copied is left alone: the last whole one stays in use, "
            "until it is older than fAgeLimit_s.",
        ),
        inputs=(
            ANGLE,
            lreal(input_variables(te.features)[te.speed_feature].name, SIGNED_SPEED),
            *torque_variable(te),
            *given,
            AGE_LIMIT,
        ),
        outputs=(*results(), IN_RANGE, *fast_results()),
        in_outs=(EXCHANGE,),
        variables=(
            BlockVariable("fbCorrection", "FB_Correction", comment="law, fading and limits"),
            BlockVariable("stCopy", SET_TYPE, comment="the set that is being copied"),
            BlockVariable("stUsed", SET_TYPE, comment="the newest whole set"),
            BlockVariable("eSet", TE_ERROR.type, comment="whether the set may be used"),
            dint("nNewest", "number of the newest set"),
            *order_index(te),
            boolean("bArrived", "a whole set came with this call"),
            boolean("bSound", "all coefficients in use are numbers"),
            lreal("fCycle", "last usable cycle time, s", "0.00025"),
            lreal("fAgeLimit", "last usable age limit, s", "0.02"),
        ),
        sections=(
            CodeSection("newest set, copied and checked", "te_receive", values),
            CodeSection("age of the set", "te_age", values),
            *correction_sections(te, given, "stUsed"),
        ),
        codes=TE_ERROR.some("PARAMETER", "NO_PREDICTION", "NOT_READY", "STALE"),
    )
