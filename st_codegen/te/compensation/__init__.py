"""What a transmission error bundle becomes beside its models: blocks, programs, types, signals and tasks.

One task does everything (`PRG_Main` with `FB_Compensator`), or two share the work (`PRG_Slow` with
`FB_CompensatorSlow`, `PRG_Fast` with `FB_CompensatorFast`).
"""

from __future__ import annotations

import numpy as np

from st_codegen.emit.blocks.application import Application, ArrayAlias, GlobalList
from st_codegen.emit.blocks.listing import BlockVariable, Table
from st_codegen.emit.literals import identifier, real
from st_codegen.te.compensation.codes import EXPERIMENT_STATE, TE_ERROR
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
from st_codegen.te.harmonics import TransmissionError


def compensation(te: TransmissionError) -> Application:
    """All that surrounds the models of a bundle, each kind in the order of declaration.

    Raises InputError for names that clash.
    """
    return Application(
        name=identifier(te.name, "bundle name"),
        types=(
            _harmonics_type(te),
            *(codes.enumeration for codes in (TE_ERROR, EXPERIMENT_STATE)),
            set_structure(te),
            exchange_structure(),
        ),
        globals=(_bundle_globals(te), signals(te), experiment_signals()),
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


def _bundle_globals(te: TransmissionError) -> GlobalList:
    """GVL_TE: what the bundle is for."""
    ratio = BlockVariable("REDUCTION_RATIO", "LREAL", initial=real(te.reduction_ratio), comment="theta_in / theta_out")
    return GlobalList(
        "GVL_TE",
        (f"What FB_TEPredict and FB_Compensator were generated for: bundle {te.name}.",),
        (ratio,),
        (Table("ORDER", "DINT", np.array(te.orders, np.int32)),),
        constant=True,
    )
