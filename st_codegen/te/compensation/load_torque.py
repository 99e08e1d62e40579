"""FB_LoadTorque: the torque of the loading motor (section 2.1: a second servo axis with a reducer of ratio 156)."""

from __future__ import annotations

from st_codegen.emit.blocks.listing import Block, CodeSection
from st_codegen.emit.blocks.model import header_lines
from st_codegen.emit.literals import real
from st_codegen.te.compensation.codes import TE_ERROR
from st_codegen.te.compensation.parts import boolean, check, error_output, lreal

#: Ratio of the loading side's reducer, and the largest torque that the torque meter at the slow shaft stands [N m].
LOAD_RATIO = 156.0
LARGEST_TORQUE = 2000.0


def load_torque_block() -> Block:
    """Torque at the slow shaft -> torque of the loading motor, limited and ramped."""
    parameter = TE_ERROR["PARAMETER"]
    checks = (
        check("fTorqueLimit_Nm", 0.0, LARGEST_TORQUE, parameter, "fLimit"),
        check("fRate_Nm_s", 1.0, 1e5, parameter, "fRate"),
        check("fCycle_s", 1e-6, 1.0, TE_ERROR["CYCLE_TIME"], "fCycle"),
        check("fTorque_Nm", -1e9, 1e9, TE_ERROR["LOAD_TORQUE"]),
    )
    return Block(
        "FB_LoadTorque",
        header_lines(
            "FB_LoadTorque: torque of the loading motor for a torque at the slow shaft",
            f"Reduction ratio of the loading side {real(LOAD_RATIO)}; losses of its reducer are not modelled.",
            "The torque changes at most at its rate and goes to no more than its limit; a limit that is lowered "
            "below the present torque is reached at that rate. After bad inputs, and without bEnable, the torque "
            "goes down to zero at that rate.",
        ),
        inputs=(
            lreal("fTorque_Nm", "wanted torque at the slow shaft, N m"),
            boolean("bEnable", "TRUE: the torque is applied; FALSE: it goes down to zero"),
            lreal("fCycle_s", "cycle time of the calling task, s, up to 1.0", "0.0005"),
            lreal("fTorqueLimit_Nm", "largest torque at the slow shaft, N m, 0.0 .. 2000.0", "2000.0"),
            lreal("fRate_Nm_s", "fastest change of the torque, N m/s at the slow shaft, 1.0 .. 100000.0", "200.0"),
        ),
        outputs=(
            lreal("fMotorTorque_Nm", "to the loading motor, N m"),
            lreal("fShaftTorque_Nm", "commanded torque at the slow shaft, N m"),
            boolean("bReached", "the torque is where it should be"),
            boolean("bLimited", "more was wanted than the limit allows"),
            boolean("bValid", "all inputs were usable in this call"),
            error_output(),
        ),
        variables=(
            lreal("fGoal", "torque to go to, N m"),
            lreal("fStep", "largest change in this cycle, N m"),
            lreal("fCycle", "last usable cycle time, s", "0.0005"),
            lreal("fLimit", "last usable limit, N m", "2000.0"),
            lreal("fRate", "last usable rate, N m/s", "200.0"),
        ),
        constants=(lreal("LOAD_RATIO", "loading motor to slow shaft", real(LOAD_RATIO)),),
        sections=(
            CodeSection("inputs, checked", "load_checks", {"checks": checks, "no_error": TE_ERROR["NONE"]}),
            CodeSection("limit and ramp", "load_ramp", {"no_error": TE_ERROR["NONE"]}),
        ),
        codes=TE_ERROR.some("NONE", "CYCLE_TIME", "PARAMETER", "LOAD_TORQUE"),
    )
