"""PRG_Record: what `st-codegen record` needs on the controller beside FB_Experiment.

The samples of a measurement go through a ring, from which they are read while the measurement runs. A client that has
taken the program into its hands must keep changing nAlive; where it stops, the measurement is aborted.
"""

from __future__ import annotations

import dataclasses

from st_codegen.emit.blocks.application import Application, GlobalList
from st_codegen.emit.blocks.listing import Block, BlockVariable, CodeSection
from st_codegen.emit.blocks.model import header_lines
from st_codegen.te.compensation.codes import EXPERIMENT_STATE
from st_codegen.te.compensation.parts import boolean, dint, lreal
from st_codegen.te.compensation.programs import EXPERIMENT_SIGNALS, SLOW_US, cycle_constant

LIST, PROGRAM = "GVL_Record", "PRG_Record"
#: What a client writes.
FROM_CLIENT = ("nOwner", "nAlive", "fAliveTimeOut_s", "nEvery")
#: Samples of the ring: four seconds of a task of 500 us where every cycle is kept.
SAMPLES = 8192
#: Angles from the zero of the homing, the angle of the encoder, and the conditions.
KEPT = ("fIn_rad", "fOut_rad", "fThetaOut_rad", "fShaftTorque_Nm", "fOil_C")


def with_recorder(application: Application) -> Application:
    """The application with the program after PRG_Experiment, in the same task."""
    tasks = tuple(
        dataclasses.replace(
            task,
            programs=tuple(
                name
                for program in task.programs
                for name in ((program, PROGRAM) if program == "PRG_Experiment" else (program,))
            ),
        )
        for task in application.tasks
    )
    return dataclasses.replace(
        application, globals=(*application.globals, _signals()), blocks=(*application.blocks, _program()), tasks=tasks
    )


def _signals() -> GlobalList:
    return GlobalList(
        LIST,
        ("Samples of st-codegen record: sample n stands at n MOD the length of the arrays.",),
        (
            dint("nOwner", "number of the client that measures; 0: nobody"),
            dint("nAlive", "changed by the client all the time"),
            lreal("fAliveTimeOut_s", "without a change for so long, a measurement is aborted", "5.0"),
            dint("nEvery", "every so many cycles a sample is kept", "1"),
            dint("nMeasurement", "measurements so far"),
            dint("nSamples", "samples of this measurement so far"),
            *(BlockVariable(name, "LREAL", SAMPLES, comment="ring of samples") for name in KEPT),
            BlockVariable("bBackward", "BOOL", SAMPLES, comment="ring of samples: the direction"),
        ),
    )


def _program() -> Block:
    return Block(
        PROGRAM,
        header_lines(
            f"{PROGRAM}: keeps the samples of a measurement for st-codegen record",
            "To be called after PRG_Experiment by the same task.",
            "A measurement whose client is silent for fAliveTimeOut_s is aborted, so that nothing goes on moving "
            "when a connection is lost.",
        ),
        variables=(
            dint("nLeft", "cycles until the next sample"),
            dint("nPlace", "place of the sample in the ring"),
            dint("nLastAlive", "nAlive in the last cycle"),
            lreal("fSilent", "time without a change of nAlive, s"),
            boolean("bWasBusy", "a measurement was going on in the last cycle"),
            boolean("bAborts", "this program has set bAbort"),
        ),
        constants=(cycle_constant(SLOW_US), dint("RING", "samples of the ring", str(SAMPLES))),
        sections=(
            CodeSection("samples", "record_samples", {"list": LIST, "experiment": EXPERIMENT_SIGNALS, "kept": KEPT}),
            CodeSection(
                "the client is there",
                "record_alive",
                {"list": LIST, "experiment": EXPERIMENT_SIGNALS, "idle": EXPERIMENT_STATE["IDLE"]},
            ),
        ),
        kind="PROGRAM",
        needs_globals=True,
    )
