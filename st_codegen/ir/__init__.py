"""Intermediate representation: all that walkers make and all that later stages read.

A model is a straight list of operations on vectors. Value 0 is the vector of the model's inputs (one number a feature);
operation `i` reads earlier values and produces value `i + 1`. What differs between libraries (comparison, rounding,
order of additions, missing values) is data here, never a special case downstream.

Everything is frozen, arrays are read-only, and invariants are checked when an object is made: a walker cannot hand on
an operation that a later stage would have to doubt.
"""

from st_codegen.ir.arrays import AnyArray, BoolArray, ComplexArray, Float32Array, FloatArray, Int32Array, IntArray
from st_codegen.ir.base import (
    CEILING,
    FLOAT32_OVERFLOW,
    Aggregate,
    ColumnFunction,
    Comparison,
    Elementwise,
    Function,
    Kernel,
    NanRule,
    Norm,
    Operation,
    Operator,
    Precision,
    Quotient,
    SummationOrder,
    Towards,
)
from st_codegen.ir.cells import CellTable, Rank, RankColumn, TableAxis
from st_codegen.ir.coupling import CoupledPairs
from st_codegen.ir.decisions import MAX_DEVIATION_ROWS, ArgMax, Classes, Exceeds, Label, OutputKind, Softmax
from st_codegen.ir.digest import digest
from st_codegen.ir.model import Feature, ModelIR, Output, Source
from st_codegen.ir.neighbours import Distances, NearestMean, WeightedMedian
from st_codegen.ir.operations import (
    Activation,
    Clip,
    Combine,
    FactoredKernel,
    FillMissing,
    KernelSum,
    Linear,
    Normalize,
    Round,
    Scale,
    Select,
    SlidingLinear,
    WholeNumber,
)
from st_codegen.ir.pieces import Piecewise
from st_codegen.ir.scan import Scan
from st_codegen.ir.trees import BranchedTree, CutTrees, LinearLeaves, RankSlabs, TreeColumn, TreeEnsemble, depth_of

__all__ = [
    "CEILING",
    "FLOAT32_OVERFLOW",
    "MAX_DEVIATION_ROWS",
    "Activation",
    "Aggregate",
    "AnyArray",
    "ArgMax",
    "BoolArray",
    "BranchedTree",
    "CellTable",
    "Classes",
    "Clip",
    "ColumnFunction",
    "Combine",
    "Comparison",
    "ComplexArray",
    "CoupledPairs",
    "CutTrees",
    "Distances",
    "Elementwise",
    "Exceeds",
    "FactoredKernel",
    "Feature",
    "FillMissing",
    "Float32Array",
    "FloatArray",
    "Function",
    "Int32Array",
    "IntArray",
    "Kernel",
    "KernelSum",
    "Label",
    "Linear",
    "LinearLeaves",
    "ModelIR",
    "NanRule",
    "NearestMean",
    "Norm",
    "Normalize",
    "Operation",
    "Operator",
    "Output",
    "OutputKind",
    "Piecewise",
    "Precision",
    "Quotient",
    "Rank",
    "RankColumn",
    "RankSlabs",
    "Round",
    "Scale",
    "Scan",
    "Select",
    "SlidingLinear",
    "Softmax",
    "Source",
    "SummationOrder",
    "TableAxis",
    "Towards",
    "TreeColumn",
    "TreeEnsemble",
    "WeightedMedian",
    "WholeNumber",
    "depth_of",
    "digest",
]
