"""The programs, the signals that they share with the rest of the controller, and the tasks that call them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

from st_codegen.emit.blocks.application import GlobalList, Task
from st_codegen.emit.blocks.listing import Block, BlockVariable, CodeSection
from st_codegen.emit.blocks.model import header_lines, input_variables
from st_codegen.emit.literals import real
from st_codegen.te.compensation import experiment
from st_codegen.te.compensation.compensator import ANGLE, IN_RANGE
from st_codegen.te.compensation.correction import SIGNED_LOAD, parameters, results, torque_variable
from st_codegen.te.compensation.parts import CallArgument, lreal, names_of, operating_point
from st_codegen.te.compensation.two_tasks import AGE_LIMIT, EXCHANGE, fast_results
from st_codegen.te.harmonics import TransmissionError

#: What the paper's rig runs: 250 us for the axes, 500 us for the models.
FAST_US = 250
SLOW_US = 500

#: Everything in one task.
SINGLE_TASK = (Task("PlcTask", SLOW_US, 10, ("PRG_Experiment", "PRG_Main")),)
#: Models in a slow task of lower priority (a larger number), sum and correction in the fast one.
TWO_TASKS = (
    Task("FastTask", FAST_US, 10, ("PRG_Fast",)),
    Task("SlowTask", SLOW_US, 20, ("PRG_Experiment", "PRG_Slow")),
)

#: Lists of signals, for the dialects that have global variables.
SIGNALS = "GVL_Machine"
EXPERIMENT_SIGNALS = "GVL_Experiment"


def compensation_inputs(te: TransmissionError) -> tuple[BlockVariable, ...]:
    """What the machine gives to the compensation: angle, operating point, settings."""
    return (ANGLE, *operating_point(te), *_settings(te))


def compensation_outputs() -> tuple[BlockVariable, ...]:
    """What the compensation gives to the machine."""
    return (*results(), IN_RANGE)


def _settings(te: TransmissionError) -> tuple[BlockVariable, ...]:
    """Parameters of the correction without the cycle time, which belongs to the task."""
    return tuple(variable for variable in parameters(te, "0.0005") if variable.name != "fCycle_s")


def signals(te: TransmissionError) -> GlobalList:
    """GVL_Machine: the signals between programs and the rest of the controller.

    Measured values and commands can be linked to inputs of the controller, results to outputs; settings and what the
    tasks tell each other cannot.
    """
    measured = {*names_of((ANGLE, *input_variables(te.features)))} | {"bEnable", SIGNED_LOAD.name}
    inputs = (_at("%I*", item) if item.name in measured else item for item in compensation_inputs(te))
    outputs = (_at("%Q*", item) if item.type in ("LREAL", "BOOL") else item for item in compensation_outputs())
    return GlobalList(
        SIGNALS,
        (
            "Signals of the programs: link those at %I* to sensors and motion profile, those at %Q* to the",
            "axes, or write and read them in programs of your own.",
        ),
        (*inputs, *outputs, AGE_LIMIT, *fast_results(), EXCHANGE),
        of_programs=True,
    )


def _at(address: str, variable: BlockVariable) -> BlockVariable:
    return dataclasses.replace(variable, address=address)


def experiment_inputs() -> tuple[BlockVariable, ...]:
    """Commands, settings and sensors of a measurement; the cycle time belongs to the task."""
    return tuple(variable for variable in experiment.inputs() if variable.name != "fCycle_s")


def experiment_outputs() -> tuple[BlockVariable, ...]:
    """What a measurement gives to the axes, and what happens in it."""
    return (*experiment.outputs(), lreal("fMotorTorque_Nm", "torque of the loading motor, N m"))


def experiment_signals() -> GlobalList:
    """GVL_Experiment: the signals of PRG_Experiment."""
    return GlobalList(
        EXPERIMENT_SIGNALS,
        ("Signals of a measurement: link the inputs to sensors and the operator, the outputs to the axes.",),
        (*experiment_inputs(), *experiment_outputs()),
        of_programs=True,
    )


def _given(names: Iterable[str], signals: str = SIGNALS) -> list[CallArgument]:
    return [CallArgument(name, name, signals) for name in names]


def _call(instance: str, arguments: list[CallArgument], title: str) -> CodeSection:
    return CodeSection(title, "te_call", {"instance": instance, "arguments": arguments})


def _results(instance: str, names: Iterable[str], title: str, signals: str = SIGNALS) -> CodeSection:
    return CodeSection(title, "te_results", {"instance": instance, "names": list(names), "list": signals})


def cycle_constant(microseconds: int) -> BlockVariable:
    """CYCLE_S, the cycle time of a program that a task calls."""
    return lreal("CYCLE_S", "cycle time of the task that calls this program, s", real(microseconds * 1e-6))


def main_program(te: TransmissionError) -> Block:
    """PRG_Main: everything in one task."""
    arguments = [*_given(names_of(compensation_inputs(te))), CallArgument("fCycle_s", "CYCLE_S")]
    return Block(
        "PRG_Main",
        header_lines(
            "PRG_Main: prediction and correction in one task",
            f"Bundle: {te.name}",
            "To be called by one task with the cycle time CYCLE_S, in place of PRG_Fast and PRG_Slow.",
        ),
        inputs=compensation_inputs(te),
        outputs=compensation_outputs(),
        variables=(BlockVariable("fbCompensator", "FB_Compensator", comment="prediction and correction"),),
        constants=(cycle_constant(SLOW_US),),
        sections=(
            _call("fbCompensator", arguments, "prediction and correction"),
            _results("fbCompensator", names_of(compensation_outputs()), "signals to the axes"),
        ),
        kind="PROGRAM",
    )


def slow_program(te: TransmissionError) -> Block:
    """PRG_Slow, which runs the models in the slow task."""
    arguments = [*_given(names_of(input_variables(te.features))), *_given([EXCHANGE.name])]
    return Block(
        "PRG_Slow",
        header_lines(
            "PRG_Slow: coefficients at the operating point, for PRG_Fast",
            f"Bundle: {te.name}",
            "To be called by the slow task; one that is late or stops lets the correction of PRG_Fast fade out.",
        ),
        variables=(BlockVariable("fbSlow", "FB_CompensatorSlow", comment="models"),),
        sections=(_call("fbSlow", arguments, "coefficients"),),
        kind="PROGRAM",
        needs_globals=True,
    )


def fast_program(te: TransmissionError) -> Block:
    """PRG_Fast: sum and correction from the coefficients of PRG_Slow."""
    speed = input_variables(te.features)[te.speed_feature]
    given = [
        ANGLE.name,
        speed.name,
        *names_of(torque_variable(te)),
        *names_of(_settings(te)),
        AGE_LIMIT.name,
        EXCHANGE.name,
    ]
    outputs = [*names_of(compensation_outputs()), *names_of(fast_results())]
    return Block(
        "PRG_Fast",
        header_lines(
            "PRG_Fast: correction from the coefficients of PRG_Slow",
            f"Bundle: {te.name}",
            "To be called by the fast task with the cycle time CYCLE_S, in place of PRG_Main.",
        ),
        variables=(BlockVariable("fbFast", "FB_CompensatorFast", comment="harmonic sum and correction"),),
        constants=(cycle_constant(FAST_US),),
        sections=(
            _call("fbFast", [*_given(given), CallArgument("fCycle_s", "CYCLE_S")], "correction"),
            _results("fbFast", outputs, "signals to the axes"),
        ),
        kind="PROGRAM",
        needs_globals=True,
    )


def experiment_program() -> Block:
    """PRG_Experiment: a measurement, and the loading side."""
    cycle = CallArgument("fCycle_s", "CYCLE_S")
    load = [
        CallArgument("fTorque_Nm", "fbExperiment.fLoadTorque_Nm"),
        CallArgument("bEnable", "fbExperiment.bLoadEnable"),
        cycle,
    ]
    return Block(
        "PRG_Experiment",
        header_lines(
            "PRG_Experiment: measurements of the transmission error, and the torque of the loading side",
            "To be called by a task with the cycle time CYCLE_S. While bBusy is TRUE the motor follows "
            "fMotorSpeed_rpm, without correction.",
        ),
        inputs=experiment_inputs(),
        outputs=experiment_outputs(),
        variables=(
            BlockVariable("fbExperiment", "FB_Experiment", comment="the measurement, step by step"),
            BlockVariable("fbLoadTorque", "FB_LoadTorque", comment="the loading side"),
        ),
        constants=(cycle_constant(SLOW_US),),
        sections=(
            _call("fbExperiment", [*_given(names_of(experiment_inputs()), EXPERIMENT_SIGNALS), cycle], "measurement"),
            _call("fbLoadTorque", load, "loading side"),
            _results("fbExperiment", names_of(experiment.outputs()), "signals of the measurement", EXPERIMENT_SIGNALS),
            _results("fbLoadTorque", ["fMotorTorque_Nm"], "signal to the loading motor", EXPERIMENT_SIGNALS),
        ),
        kind="PROGRAM",
    )
