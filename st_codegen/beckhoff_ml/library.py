"""The part of TwinCAT's library Tc3_MLL that generated text uses, for the engine that runs it.

FB_MllPrediction is not the vendor's runtime: it evaluates the model file by the arithmetic that the format prescribes,
as the reader of such files does (`walkers.beckhoff_ml`).
"""

from __future__ import annotations

from pathlib import Path, PureWindowsPath
from typing import TYPE_CHECKING

import numpy as np

from st_codegen.beckhoff_ml.model import load_file
from st_codegen.errors import InputError
from st_codegen.ir import BoolArray
from st_codegen.walkers.base import Predictor

if TYPE_CHECKING:
    from st_codegen.st import Library, NativeCall

_TEXT = """
TYPE ETcMllDataType : (E_MLLDT_UNDEFINED := 0, E_MLLDT_FP32_REAL := 1, E_MLLDT_FP64_LREAL := 2) DINT; END_TYPE
TYPE ST_MllPredictionParameters : STRUCT MlModelFilepath : STRING(255); MaxConcurrency : UINT := 1; END_STRUCT END_TYPE
FUNCTION_BLOCK FB_MllPrediction
VAR_INPUT stPredictionParameter : ST_MllPredictionParameters; END_VAR
VAR_OUTPUT bBusy : BOOL; bError : BOOL; hrErrorCode : DINT; END_VAR
VAR sLoaded : STRING(255); END_VAR
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


def mll_library(folder: Path) -> Library | None:
    """Tc3_MLL for a generated folder with model files; a path on the controller means the file that ends so."""
    if not any(folder.glob("Models/*/*.xml")):
        return None
    from st_codegen.st import Library, NativeBlock

    predictors: dict[str, Predictor] = {}

    def read(path: str) -> bool:
        """Read a file; whether it can be used."""
        parts = PureWindowsPath(path)
        try:
            predictors[path] = load_file(folder / "Models" / Path(*parts.parts[-2:]), parts.stem).predict
        except (InputError, OSError):
            return False
        return True

    class Prediction(NativeBlock):
        """FB_MllPrediction; what is loaded stands in the variables of the block alone."""

        is_pure = True

        def Configure(self, call: NativeCall) -> None:  # noqa: N802 - the name of the library
            """Read the files; done in one cycle here."""
            paths = call["STPREDICTIONPARAMETER.MLMODELFILEPATH"]
            known = {path: bool(path) and read(path) for path in np.unique(paths).tolist()}
            usable = np.array([known[path] for path in paths.tolist()])
            call["SLOADED"] = np.where(usable, paths, "")
            _note(call, usable)
            call["CONFIGURE"] = True

        def Predict(self, call: NativeCall) -> None:  # noqa: N802
            """The predictions of the calling rows."""
            given, results = call["PDATAINP"], call["PDATAOUT"]
            loaded = call["SLOADED"]
            usable = np.zeros(len(loaded), np.bool_)
            if given is not None and results is not None:
                x, y = np.asarray(given.read(), np.float64), results.read()
                for path in np.unique(loaded[loaded != ""]).tolist():
                    chosen = loaded == path
                    values = predictors[path](x[chosen])
                    if values.shape[1] == y.shape[1] == int(call["NDATAOUTDIM"][0]):
                        with np.errstate(over="ignore"):  # a result beyond a REAL arrives as infinity
                            y[chosen] = values
                        usable |= chosen
                results.write(y)
            _note(call, usable)
            call["PREDICT"] = usable

    return Library("Tc3_MLL", _TEXT, blocks={"FB_MllPrediction": Prediction})


def _note(call: NativeCall, usable: BoolArray) -> None:
    call["BERROR"] = ~usable
    call["HRERRORCODE"] = np.where(usable, 0, _ERROR)
