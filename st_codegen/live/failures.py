"""What can go wrong with a controller; each class has a code with cause and cure (`st_codegen.diagnostics`)."""

from __future__ import annotations

from st_codegen.errors import InputError


class ControllerError(InputError):
    """A controller cannot be reached, does not answer, or has not what is asked for."""


class UnreachableError(ControllerError):
    """Nothing listens at the address."""


class NoPlcError(ControllerError):
    """A router answers, and behind the AMS port there is no PLC."""


class SilentError(ControllerError):
    """No answer in time, or the connection is lost."""


class NotRunningError(ControllerError):
    """The PLC is in CONFIG, STOP or ERROR."""


class UnknownVariableError(ControllerError):
    """The controller has no variable of a name, or not of that type."""


class NotWritableError(ControllerError):
    """A variable that clients may not write."""


class OtherProjectError(ControllerError):
    """The controller runs a project with another fingerprint."""


class OtherClientError(ControllerError):
    """Another client compares or measures."""


class CorrectionError(ControllerError):
    """The controller corrects the axis that is to be measured."""


class MeasurementError(ControllerError):
    """A measurement ended early; the axis stands."""
