"""Numbers with names: error codes and states.

TwinCAT has them as enumerations; the portable subset, whose compilers disagree on enumerations, as DINT constants of
the blocks that use them.
"""

from __future__ import annotations

from collections.abc import Iterable

from st_codegen.emit.blocks.application import Enumeration, EnumValue
from st_codegen.emit.blocks.listing import Code


class Codes:
    """The values of one enumeration by name."""

    def __init__(self, type_: str, prefix: str, comment: tuple[str, ...], values: Iterable[tuple[str, str]]) -> None:
        self.type = type_
        self.comment = comment
        self._codes = {
            name: Code(type_, f"{prefix}_{name}", name, number, text) for number, (name, text) in enumerate(values)
        }

    def __getitem__(self, name: str) -> Code:
        return self._codes[name]

    def some(self, *names: str) -> tuple[Code, ...]:
        """The values that a block uses."""
        return tuple(self._codes[name] for name in names)

    @property
    def all(self) -> tuple[Code, ...]:
        """All codes of the enumeration, in the order of their numbers."""
        return tuple(self._codes.values())

    @property
    def enumeration(self) -> Enumeration:
        """The enumeration as a type of the generated project."""
        return Enumeration(
            self.type, self.comment, tuple(EnumValue(code.name, code.value, code.comment) for code in self.all)
        )


#: Why a block of the project gives no result: one list, so that a number has one meaning wherever it is seen.
TE_ERROR = Codes(
    "E_TEError",
    "ERROR",
    ("Why there is no correction, no measurement or no torque of the loading side.",),
    (
        ("NONE", "no error"),
        ("ANGLE", "angle not a number, infinite or beyond 1.0E9 rad"),
        ("OPERATING_POINT", "speed, torque, temperature not a number or absurd"),
        ("CYCLE_TIME", "cycle time not above 0, or above 1 s"),
        ("PARAMETER", "a limit, rate or time outside of its range"),
        ("NO_PREDICTION", "a model gave no valid result"),
        ("DIRECTION", "the bundle has no models for this direction"),
        ("NOT_READY", "no set of coefficients has arrived yet"),
        ("STALE", "the set of coefficients is older than the age limit"),
        ("ABORTED", "bAbort"),
        ("SPEED", "speed outside of the limits of motor or load side"),
        ("TORQUE", "torque outside of its limits"),
        ("TEMPERATURE", "temperature outside of its limits, or oil too warm"),
        ("ENCODER", "an encoder reports an error or no usable number"),
        ("ENCODER_JUMP", "an angle changed faster than the axis can turn"),
        ("SENSOR", "torque or temperature is no usable number"),
        ("TIME_OUT", "a step took longer than its time-out"),
        ("LOAD_TORQUE", "torque of the loading side not a number or infinite"),
    ),
)

EXPERIMENT_STATE = Codes(
    "E_ExperimentState",
    "STATE",
    ("Steps of a measurement, in order.",),
    (
        ("IDLE", "waits for bStart"),
        ("CHECK", "parameters against limits, encoders, no load left"),
        ("WARM_UP", "constant speed without load until the oil is warm"),
        ("HOMING", "output shaft to its zero angle"),
        ("BACKLASH_PLUS", "motor forward until the output follows"),
        ("BACKLASH_MINUS", "motor backward until the output follows"),
        ("CENTRING", "motor to the middle of the backlash, encoders to zero"),
        ("RUN_UP", "speed, then torque up to their set points"),
        ("WAIT_ZERO", "until the output shaft crosses its zero angle"),
        ("MEASURE", "data are valid for exactly one revolution"),
        ("RUN_DOWN", "torque and speed down to zero"),
        ("DONE", "both directions measured"),
        ("STOPPING", "after an error: torque and speed down to zero"),
        ("FAILED", "stopped, see the error; bStart FALSE leads to IDLE"),
    ),
)
