"""The code of a recurrent layer: one loop over the rounds, with the code of its operations inside."""

from __future__ import annotations

import dataclasses

import numpy as np

from st_codegen.emit.blocks.listing import Listing
from st_codegen.emit.blocks.operations import Step, lay_out, lay_out_all
from st_codegen.errors import counted
from st_codegen.ir import Scan


@lay_out.register
def _(op: Scan, step: Step, listing: Listing) -> None:
    state, row = len(op.initial), op.columns
    current = listing.local(f"aRound{step.number}", "LREAL", row + state)
    for name, rounds in (("nRound", len(op.starts)), ("nColumn", max(state, row))):
        listing.loop(name, rounds)
    listing.local("nResult", "DINT")
    # the sections of the body stand inside that of the loop
    inner = dataclasses.replace(listing, sections=[])
    steps = [
        Step(
            number=f"{step.number}_{number}",
            widths=tuple(op.body_width(value) for value in part.inputs),
            result=f"aStep{step.number}_{number}",
        )
        for number, part in enumerate(op.body, 1)
    ]
    lay_out_all(current, op.body, steps, inner)
    listing.section(
        f"{counted(len(op.starts), 'round')}, each with what the one before left",
        "scan",
        step=step,
        last_round=len(op.starts) - 1,
        last_column=row - 1,
        last_state=state - 1,
        row=row,
        current=current,
        new=steps[-1].result,
        state=state,
        starts=listing.table(step.table("ROUND"), "DINT", op.starts),
        initial=listing.table(step.table("INITIAL"), "LREAL", op.initial) if np.any(op.initial) else None,
        sections=inner.sections,
    )
