"""The target for TwinCAT's machine learning runtime: model files, the blocks that have them computed, their reader."""

from st_codegen.beckhoff_ml.bounds import engine_answers, engine_bound
from st_codegen.beckhoff_ml.library import mll_library
from st_codegen.beckhoff_ml.target import BeckhoffMlTarget
from st_codegen.emit.targets import enter_target
from st_codegen.proof.arithmetic import ARITHMETIC, LIBRARIES, Arithmetic
from st_codegen.walkers.files import FORMATS, FileFormat

enter_target(BeckhoffMlTarget())
FORMATS[BeckhoffMlTarget.name] = FileFormat(
    (".xml",), ".xml (TwinCAT machine learning)", "st_codegen.beckhoff_ml.model"
)
LIBRARIES[BeckhoffMlTarget.name] = mll_library
ARITHMETIC[BeckhoffMlTarget.name] = Arithmetic(
    engine_bound,
    engine_answers,
    "the model files were evaluated by the arithmetic that their format prescribes, not by the vendor's runtime; "
    "the bounds are those of that arithmetic",
)
