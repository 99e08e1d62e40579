"""Between which numbers the elements of a tensor lie, as far as the operations that make them tell."""

from __future__ import annotations

import math

import numpy as np

from st_codegen import ir
from st_codegen.ir.trees import ends_of
from st_codegen.walkers.base import GraphBuilder
from st_codegen.walkers.onnx.graph import GraphWalk
from st_codegen.walkers.onnx.operands import FLOAT32, Tensor


def are_shares(builder: GraphBuilder, tensor: Tensor) -> bool:
    """Whether all numbers of a tensor are known to lie between 0 and 1, but for rounding."""
    ranges = [_range(builder, *place) for place in _places(tensor)]
    return all(low >= -1e-5 and high <= 1.0 + 1e-5 for low, high in ranges)


def stays_below(builder: GraphBuilder, tensor: Tensor, limit: float) -> bool:
    """Whether all numbers of a tensor are known to stay below a magnitude, with room for roundings."""
    return all(_magnitude(builder, *place) < limit / 2 for place in _places(tensor))


def keep_below(walk: GraphWalk, tensor: Tensor, limit: float) -> Tensor:
    """The numbers of a tensor, of which those of magnitude `limit` and above have no answer.

    Numbers that come from the inputs as they are narrow what the inputs may be.
    """
    walk.refuse_special(tensor)
    if stays_below(walk.builder, tensor, limit):
        return tensor
    features = [_feature(walk.builder, *place) for place in _places(tensor)]
    known = [feature for feature in features if feature is not None]
    if len(known) == len(features):
        # just below the limit are doubles that float rounds up to it
        walk.builder.refuse_magnitude(limit * (1.0 - 2.0**-25) if tensor.dtype == FLOAT32 else limit, known)
        return tensor
    count, value = tensor.size, walk.settle(tensor)
    refused = ir.Piecewise(
        (value,),
        start=np.arange(count + 1) * 2,
        knots=np.tile([-limit, limit], count),
        at=np.full(2 * count, np.inf),
        pieces=np.tile([np.inf, 0.0, np.inf], count)[:, None],
    )
    found = walk.builder.combine(value, "+", walk.builder.add(refused))
    return walk.computed(found, tensor.shape, tensor.dtype)


def _places(tensor: Tensor) -> list[tuple[int, int]]:
    return list(zip(np.ravel(tensor.value).tolist(), np.ravel(tensor.column).tolist(), strict=True))


def _source(builder: GraphBuilder, value: int, column: int) -> tuple[int, int] | None:
    """Where the number comes from that an operation picks or rounds; None for other operations."""
    op = builder.ops[value - 1] if value else None
    if isinstance(op, ir.Select):
        return op.source(column, builder.width)
    return (op.inputs[0], column) if isinstance(op, ir.Round) else None


def _feature(builder: GraphBuilder, value: int, column: int) -> int | None:
    """The input that a number is, picked or rounded; None where it is computed."""
    while value:
        source = _source(builder, value, column)
        if source is None:
            return None
        value, column = source
    return column


def _range(builder: GraphBuilder, value: int, column: int) -> tuple[float, float]:
    """The least and the largest number in a column of a value, as far as its operations tell."""
    op = builder.ops[value - 1] if value else None
    source = _source(builder, value, column)
    if source is not None:
        return _range(builder, *source)
    if isinstance(op, ir.Scale) and op.reverse and op.operator is ir.Operator.SUBTRACT:
        low, high = _range(builder, op.inputs[0], column)
        return float(op.constant[column]) - high, float(op.constant[column]) - low
    if isinstance(op, ir.TreeEnsemble):
        smallest, largest = ends_of(op)
        return float(smallest[column]), float(largest[column])
    shares = isinstance(op, ir.Softmax) and not op.logarithm
    shares |= isinstance(op, ir.Activation) and op.function is ir.Function.LOGISTIC
    if isinstance(op, ir.Normalize):
        shares = all(_range(builder, op.inputs[0], other)[0] >= 0.0 for other in range(op.width))
    return (0.0, 1.0) if shares else (-math.inf, math.inf)


def _magnitude(builder: GraphBuilder, value: int, column: int) -> float:
    """The largest magnitude in a column of a value, as far as its operations tell, but for rounding."""
    op = builder.ops[value - 1] if value else None
    source = _source(builder, value, column)
    if source is not None:
        return _magnitude(builder, *source)
    if isinstance(op, ir.ArgMax):
        return op.n_columns - 1.0
    if isinstance(op, ir.ColumnFunction):
        operands = np.full(op.width, np.inf)
        operands[column] = _magnitude(builder, op.inputs[0], column)
        return float(op.largest(operands)[column])
    if not isinstance(op, ir.Scale | ir.Combine) or op.operator is ir.Operator.DIVIDE:
        return float(np.max(np.abs(_range(builder, value, column))))
    sizes = [_magnitude(builder, one, column) for one in op.inputs]
    sizes += [abs(float(op.constant[column]))] if isinstance(op, ir.Scale) else []
    if op.operator in (ir.Operator.ADD, ir.Operator.SUBTRACT):
        return sum(sizes)
    return math.prod(sizes) if op.operator is ir.Operator.MULTIPLY else max(sizes)
