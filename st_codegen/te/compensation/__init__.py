"""What a transmission error bundle becomes beside its models: blocks, programs, types, signals and tasks.

One task does everything (`PRG_Main` with `FB_Compensator`), or two share the work (`PRG_Slow` with
`FB_CompensatorSlow`, `PRG_Fast` with `FB_CompensatorFast`).
"""

from __future__ import annotations

from dataclasses import dataclass

from st_codegen.emit.blocks.application import ArrayAlias, DataType, GlobalList, Task
from st_codegen.emit.blocks.listing import Block
from st_codegen.ir import TransmissionError
from st_codegen.te.compensation.codes import EXPERIMENT_ERROR, EXPERIMENT_STATE, LOAD_ERROR, TE_ERROR
from st_codegen.te.compensation.compensator import compensator_block
from st_codegen.te.compensation.correction import correction_block
from st_codegen.te.compensation.experiment import experiment_block
from st_codegen.te.compensation.harmonic_sum import harmonic_sum_block
from st_codegen.te.compensation.load_torque import load_torque_block
from st_codegen.te.compensation.parts import HARMONICS_TYPE, within_function
from st_codegen.te.compensation.predict import predict_block
from st_codegen.te.compensation.programs import (
    SINGLE_TASK,
    TWO_TASKS,
    experiment_program,
    experiment_signals,
    fast_program,
    main_program,
    signals,
    slow_program,
)
from st_codegen.te.compensation.two_tasks import exchange_structure, fast_block, set_structure, slow_block


@dataclass(frozen=True)
class Compensation:
    """Parts of the application, each kind in the order of declaration."""

    types: tuple[DataType, ...]
    globals: tuple[GlobalList, ...]
    blocks: tuple[Block, ...]
    tasks: tuple[Task, ...]


def compensation(te: TransmissionError) -> Compensation:
    """All parts for a bundle. Raises InputError for names that clash and a ratio that is none."""
    return Compensation(
        types=(
            _harmonics_type(te),
            *(codes.enumeration for codes in (TE_ERROR, LOAD_ERROR, EXPERIMENT_STATE, EXPERIMENT_ERROR)),
            set_structure(te),
            exchange_structure(),
        ),
        globals=(signals(te), experiment_signals()),
        blocks=(
            within_function(),
            predict_block(te),
            harmonic_sum_block(te),
            correction_block(te),
            compensator_block(te),
            slow_block(te),
            fast_block(te),
            load_torque_block(),
            experiment_block(te),
            main_program(te),
            slow_program(te),
            fast_program(te),
            experiment_program(),
        ),
        tasks=TWO_TASKS if te.tasks == 2 else SINGLE_TASK,
    )


def _harmonics_type(te: TransmissionError) -> ArrayAlias:
    orders = ", ".join(map(str, te.orders))
    comment = f"One number for each harmonic; orders: {orders}."
    return ArrayAlias(HARMONICS_TYPE, (comment,), "LREAL", len(te.orders))
