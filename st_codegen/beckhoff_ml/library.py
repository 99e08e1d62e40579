"""The part of TwinCAT's library Tc3_MLL that generated text uses, for the interpreter.

FB_MllPrediction is not the vendor's runtime: it evaluates the model file by the arithmetic that the format prescribes,
as the reader of such files does (`walkers.beckhoff_ml`).
"""

from __future__ import annotations

from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np

from st_codegen.beckhoff_ml.model import load_file
from st_codegen.errors import InputError
from st_codegen.st import Library, NativeBlock, NativeCall
from st_codegen.st.run.natives import Host
from st_codegen.walkers.base import Predictor

_TEXT = """
TYPE ETcMllDataType : (E_MLLDT_UNDEFINED := 0, E_MLLDT_FP32_REAL := 1, E_MLLDT_FP64_LREAL := 2) DINT; END_TYPE
TYPE ST_MllPredictionParameters : STRUCT MlModelFilepath : STRING(255); MaxConcurrency : UINT := 1; END_STRUCT END_TYPE
FUNCTION_BLOCK FB_MllPrediction
VAR_INPUT stPredictionParameter : ST_MllPredictionParameters; END_VAR
VAR_OUTPUT bBusy : BOOL; bError : BOOL; hrErrorCode : DINT; END_VAR
METHOD Configure : BOOL END_METHOD
METHOD Predict : BOOL
VAR_INPUT
    pDataInp : PVOID; nDataInpDim : UDINT; fmtDataInpType : ETcMllDataType;
    pDataOut : PVOID; nDataOutDim : UDINT; fmtDataOutType : ETcMllDataType;
    nEngineId : UDINT; nConcurrencyId : UDINT;
END_VAR
END_METHOD
END_FUNCTION_BLOCK
"""
#: What the runtime's error codes look like; the real ones are in the vendor's documentation.
_ERROR = -1


def _text(stored: Any) -> str:
    """A string as a machine stores it, with or without lanes: all have the same path."""
    return str(np.ravel(np.asarray(stored, dtype=object))[0])


def mll_library(folder: Path) -> Library | None:
    """Tc3_MLL for a generated folder with model files; a path on the controller means the file that ends so."""
    if not any(folder.glob("Models/*/*.xml")):
        return None

    class Prediction(NativeBlock):
        """FB_MllPrediction."""

        def __init__(self, machine: Host) -> None:
            super().__init__(machine)
            self.predictor: Predictor | None = None

        def Configure(self, call: NativeCall) -> None:  # noqa: N802 - the name of the library
            """Read the file; done in one cycle here."""
            path = PureWindowsPath(_text(call["STPREDICTIONPARAMETER"].v_MLMODELFILEPATH))
            file = folder / "Models" / Path(*path.parts[-2:])
            try:
                self.predictor = load_file(file, path.stem).predict
            except (InputError, OSError):
                self.predictor = None
            call["BERROR"] = self.predictor is None
            call["HRERRORCODE"] = 0 if self.predictor is not None else _ERROR
            call["CONFIGURE"] = True

        def Predict(self, call: NativeCall) -> None:  # noqa: N802
            """The prediction of the active lanes."""
            given, results = call["PDATAINP"], call["PDATAOUT"]
            usable = self.predictor is not None and given is not None and results is not None
            if usable and self.predictor is not None:
                values = self.predictor(np.asarray(given.read(), np.float64))
                usable = values.shape[1] == int(call["NDATAOUTDIM"][0])
                if usable:
                    with np.errstate(over="ignore"):  # a result beyond a REAL arrives as infinity
                        results.write(values)
            call["BERROR"] = not usable
            call["HRERRORCODE"] = 0 if usable else _ERROR
            call["PREDICT"] = usable

    return Library("Tc3_MLL", _TEXT, blocks={"FB_MllPrediction": Prediction})
