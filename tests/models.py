"""Small models in the intermediate representation, for tests: one of each kind, and random ones."""

import numpy as np
from hypothesis import strategies as st

from st_codegen.ir import (
    Activation,
    Aggregate,
    ArgMax,
    Clip,
    Combine,
    Comparison,
    CoupledPairs,
    Distances,
    Exceeds,
    Feature,
    FillMissing,
    Function,
    Kernel,
    KernelSum,
    Linear,
    LinearLeaves,
    ModelIR,
    NanRule,
    NearestMean,
    Norm,
    Normalize,
    Operator,
    Piecewise,
    Precision,
    Round,
    Scale,
    Scan,
    Select,
    SlidingLinear,
    Softmax,
    Source,
    SummationOrder,
    Towards,
    TreeColumn,
    TreeEnsemble,
    WeightedMedian,
    WholeNumber,
)
from st_codegen.ir.preorder import preorder

#: To what libraries round; REAL is the controller's.
PRECISIONS = (Precision.FLOAT32, Precision.FLOAT64)
SOURCE = Source("test", "1.0", "made for a test")


def model(*ops, features=3, name="m", **options):
    """A model of these operations."""
    names = tuple(Feature(f"f{number}") for number in range(features))
    outputs = tuple(f"out{number + 1}" for number in range(ops[-1].width))
    return ModelIR(name, names, ops, outputs, SOURCE, **options)


def random_trees(
    random,
    *,
    features=3,
    trees=4,
    splits=6,
    outputs=1,
    wide=False,
    categorical=(),
    linear=False,
    infinite=False,
    columns=None,
    thresholds=None,
    **options,
):
    """A TreeEnsemble of random shape; `thresholds` gives the numbers that splits use."""
    columns = columns or tuple(TreeColumn(c, n_categories=5 if c in categorical else 0) for c in range(features))
    left, right, roots = [], [], []
    for _ in range(trees):
        start = len(left)
        roots.append(start)
        left.append(-1)
        right.append(-1)
        leaves = [start]
        for _ in range(random.integers(0, splits + 1)):
            node = leaves.pop(random.integers(len(leaves)))
            left[node], right[node] = len(left), len(left) + 1
            left += [-1, -1]
            right += [-1, -1]
            leaves += [left[node], right[node]]
    layout = preorder(np.array(roots), np.array(left), np.array(right))
    nodes, inner = len(layout.order), layout.left >= 0
    split = np.where(inner, random.integers(0, len(columns), nodes), -1)
    numbers = thresholds if thresholds is not None else np.round(random.normal(size=9), 1)
    threshold = np.where(inner, random.choice(numbers, nodes), 0.0)
    if infinite:
        threshold = np.where(inner & (random.random(nodes) < 0.2), np.inf, threshold)
    is_category = np.array([column.categorical for column in columns] + [False])[split] & inner
    width = 7  # n_categories + 2
    row = np.where(is_category, (np.cumsum(is_category) - 1) * width, 0)
    leaf_count = int((~inner).sum())
    linear_leaves = None
    if linear:
        counts = random.integers(0, 3, leaf_count)
        start = np.concatenate([[0], np.cumsum(counts)])
        linear_leaves = LinearLeaves(
            random.normal(size=leaf_count),
            start,
            random.integers(0, features, start[-1]),
            random.normal(size=start[-1]),
            zero_magnitude=random.choice([0.0, 1e-35]),
        )
    single = options.get("sum_precision") is Precision.FLOAT32

    def values(*shape):
        numbers = random.normal(size=shape)
        return numbers.astype(np.float32).astype(float) if single else numbers

    return TreeEnsemble(
        inputs=(0,),
        columns=columns,
        roots=layout.roots,
        split=split,
        threshold=threshold,
        left=layout.left,
        right=layout.right,
        missing_left=inner & (random.random(nodes) < 0.5),
        leaf=np.where(inner, -1, np.cumsum(~inner) - 1),
        leaf_value=values(leaf_count, outputs if wide else 1),
        tree_output=np.arange(trees) % outputs if not wide else np.zeros(trees, np.int32),
        base=values(outputs),
        category_row=row if categorical else np.zeros(0, np.int32),
        category_left=random.random(width * int(is_category.sum())) < 0.5 if categorical else np.zeros(0, bool),
        linear=linear_leaves,
        **options,
    )


@st.composite
def tree_models(draw, thresholds_only=False):
    """Any ensemble that the walkers can make, as a whole model.

    `thresholds_only`: splits compare numbers with thresholds, leaves are numbers.
    """
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    features = draw(st.integers(1, 4))
    single_input = draw(st.booleans())
    comparison = draw(st.sampled_from(Comparison))
    aggregate = draw(st.sampled_from([Aggregate.SUM] * 4 + [Aggregate.MINIMUM, Aggregate.MAXIMUM]))
    outputs = draw(st.integers(1, 3))
    numbers = np.array([-1e30, -2.5, -1.0, -0.1, 0.0, 1e-35, 0.1, 0.5, 1.0, 3.25, 1e30])
    if single_input or comparison is Comparison.LESS:
        numbers = numbers.astype(np.float32).astype(np.float64)
    accepts_nan = draw(st.booleans())
    columns = []
    kinds = ["number", "number", "zero"]
    if not thresholds_only:
        kinds += ["interval", "category", "list", "category interval"]
    for column in range(features):
        kind = draw(st.sampled_from(kinds))
        columns.append(
            {
                "number": TreeColumn(column),
                "zero": TreeColumn(column, nan=NanRule.ZERO),
                "interval": TreeColumn(column, missing_interval=(-0.25, 1e-35)),
                "category": TreeColumn(column, n_categories=5, negative_fraction_is_zero=draw(st.booleans())),
                "category interval": TreeColumn(column, n_categories=5, missing_interval=(1.0, 1.0)),
                "list": TreeColumn(column, n_categories=5, categories=(-3.0, 0.5, 1.0, 2.0, 1000.0)),
            }[kind]
        )
    linear = not thresholds_only and draw(st.booleans()) and outputs == 1 and aggregate is Aggregate.SUM
    sum_precision = Precision.FLOAT64 if linear else draw(st.sampled_from(PRECISIONS))
    op = random_trees(
        random,
        features=features,
        trees=draw(st.integers(3, 6)),
        splits=draw(st.integers(0, 8)),
        outputs=outputs,
        wide=draw(st.booleans()),
        columns=tuple(columns),
        categorical=[c.column for c in columns if c.categorical],
        linear=linear,
        infinite=draw(st.booleans()) and comparison is Comparison.LESS_OR_EQUAL,
        thresholds=numbers,
        comparison=comparison,
        input_precision=Precision.FLOAT32 if single_input else Precision.FLOAT64,
        sum_precision=sum_precision,
        aggregate=aggregate,
        base_last=draw(st.booleans()),
        divisor=draw(st.sampled_from([1.0, 3.0, 7.0])) if aggregate is Aggregate.SUM else 1.0,
    )
    limits = draw(st.sampled_from([(), (None,) * features, (1e10,) * features]))
    return model(op, features=features, accepts_nan=accepts_nan, magnitude_limits=limits)


def _rng():
    return np.random.default_rng(3)


W = np.array([[0.5, -1.25, 2.0], [1.0, 0.0, -0.75]])
VECTORS = np.array([[0.1, 0.2, 0.3], [-1.0, 0.5, 2.0], [0.0, 0.0, 1.0]])

PIECES = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [5.0, 0.0], [5.0, -2.0], [-1.0, 0.0], [0.5, 0.0], [0.25, 0.0]])

#: The columns that models of one function read: one of them where half of all numbers have no answer.
FUNCTION_COLUMNS = {
    function: [0] if function in (Function.SQRT, Function.LOG, Function.POWER) else [0, 1, 2]
    for function in Function
    if function is not Function.NORMAL_QUANTILE  # of shares only
}

#: Functions and quotients without an answer at 0.0, which stands for a missing value in the text.
MISSING_BEHIND = {
    **{
        f"missing behind {function.value}": model(
            Select((0,), [0]),
            Scale((1,), Operator.SUBTRACT, [shift]),
            Activation((2,), function, 1, parameter, limit=limit),
            FillMissing((3,), [1.5]),
            accepts_nan=True,
        )
        for function, shift, parameter, limit in (
            (Function.LOG, 0.0, 1.0, np.inf),
            (Function.LOG1P, 1.5, 1.0, np.inf),
            (Function.SQRT, 1.5, 1.0, np.inf),
            (Function.EXP, -600.0, 1.0, 500.0),
            (Function.EXPM1, -600.0, 1.0, 500.0),
            (Function.COS, 1e7, 1.0, np.inf),
            (Function.NORMAL_QUANTILE, 0.0, 1.0, np.inf),
            (Function.POWER, 0.0, -1.0, np.inf),
        )
    },
    "missing behind quotients": model(
        Select((0,), [0, 0]),
        Scale((1,), Operator.DIVIDE, [2.0, -0.5], reverse=True),
        Combine((2, 1), Operator.DIVIDE, 2),
        FillMissing((3,), [1.5, -2.0]),
        accepts_nan=True,
    ),
}

#: One model for each operation and each of its variants.
SMALL_MODELS = {
    "select": model(Select((0,), [2, 0, 0])),
    **{
        f"scale {operator.name.lower()} {precision.value} {'reversed' if reverse else ''}".strip(): model(
            Scale((0,), operator, [0.5, -3.0, 1e-3], precision, reverse)
        )
        for operator in Operator
        for precision in PRECISIONS
        for reverse in (False, True)
    },
    **{
        f"combine {operator.name.lower()}": model(
            Select((0,), [0, 1]), Select((0,), [1, 2]), Combine((1, 2), operator, 2, Precision.FLOAT32)
        )
        for operator in Operator
    },
    "round": model(Round((0,), 3)),
    "fill missing": model(FillMissing((0,), [1.5, 1.5, 1.5]), accepts_nan=True),
    "fill each column, then compare": model(
        FillMissing((0,), [1.5, -2.0, 0.25]),
        TreeEnsemble(**{**vars(random_trees(_rng(), comparison=Comparison.LESS_OR_EQUAL)), "inputs": (1,)}),
        accepts_nan=True,
    ),
    "missing in some inputs only": model(
        Select((0,), [2, 1]),
        FillMissing((1,), [1.5, -2.0]),
        Linear((2,), [[1.0, 2.0]], [0.5], SummationOrder.SEQUENTIAL),
        accepts_nan=True,
        must_be_present=(2,),
    ),
    "fill sentinel": model(FillMissing((0,), [0.0, 0.0, 0.0], sentinel=-999.0)),
    "piecewise constant": model(
        Piecewise(
            (0,),
            [0, 2, 2, 3],
            [-1.0, 0.5, 1e-35],
            [4.0, np.inf, 7.0],
            [[1.0], [np.inf], [2.0], [9.0], [5.0], [6.0]],
            [np.nan, 8.0, 3.0],
        ),
        FillMissing((1,), [-5.0, 0.0, 0.0]),
        accepts_nan=True,
    ),
    "piecewise linear": model(
        Piecewise((0,), [0, 2, 4, 5], [0.0, 1.0, -1.0, 2.0, 0.5], [0.0, 1.0, 5.0, -1.0, 2.0], PIECES)
    ),
    "piecewise quadratic": model(
        Piecewise(
            (0,),
            [0, 2, 4, 5],
            [0.0, 1.0, -1.0, 2.0, 0.5],
            [0.0, 1.0, 5.0, -1.0, 2.0],
            np.hstack([PIECES, PIECES[:, 1:]]),
        )
    ),
    "distances": model(Distances((0,), VECTORS, root=True)),
    "distances by the largest": model(Distances((0,), VECTORS, squared=False, largest=True)),
    "distances by magnitude": model(Distances((0,), VECTORS[:1], squared=False)),
    "nearest": model(NearestMean((0,), [[1.0, 2.0, -1.5]], 2)),
    "nearest of several": model(Distances((0,), VECTORS), NearestMean((1,), [[1.0, 2.0, -1.5], [0.5, 0.0, 3.0]], 3)),
    "nearest, weighted": model(
        Distances((0,), VECTORS, squared=False), NearestMean((1,), [[1.0, 2.0, -1.5], [0.5, 0.0, 3.0]], 2, inverse=True)
    ),
    "nearest of computed numbers": model(
        Distances((0,), VECTORS),
        Distances((0,), VECTORS, squared=False),
        NearestMean((1, 2), [[1.0, 2.0, -1.5]], 2),
    ),
    "nearest of one": model(Distances((0,), VECTORS), NearestMean((1,), [[1.0, 2.0, -1.5]], 1, inverse=True)),
    "normal quantiles": model(Activation((0,), Function.LOGISTIC, 3), Activation((1,), Function.NORMAL_QUANTILE, 3)),
    "coupled pairs": model(
        Activation((0,), Function.LOGISTIC, 3), Clip((1,), [1e-7] * 3, [1 - 1e-7] * 3), CoupledPairs((2,), 3)
    ),
    "coupled pairs of two": model(
        Select((0,), [1]), Activation((1,), Function.LOGISTIC, 1), Clip((2,), [1e-7], [1 - 1e-7]), CoupledPairs((3,), 2)
    ),
    "median": model(WeightedMedian((0,), [0.5, 0.25, 0.3])),
    "median in float32": model(WeightedMedian((0,), np.float32([0.1, 0.7, 0.6]), Precision.FLOAT32)),
    "median of one": model(Select((0,), [1]), WeightedMedian((1,), [0.5])),
    "clip": model(Clip((0,), [-1.0, 0.0, -2.0], [1.0, 0.5, 2.0])),
    "exceeds": model(Exceeds((0,), [0.5, 0.0, -1.0])),
    "exceeds or equals": model(Exceeds((0,), [0.5, 0.0, -1.0], inclusive=True)),
    **{f"whole, {towards.value}": model(WholeNumber((0,), 3, towards)) for towards in Towards},
    "argmax": model(ArgMax((0,), 3)),
    "argmax of two": model(Select((0,), [1, 0]), ArgMax((1,), 2)),
    "argmax of one": model(Select((0,), [1]), ArgMax((1,), 1)),
    "argmax merged": model(ArgMax((0,), 3, merged=0.25)),
    "argmax of sums": model(Linear((0,), W, [0.25, -1.0]), ArgMax((1,), 2)),
    "softmax": model(Softmax((0,), 3)),
    "larger and smaller": model(
        Scale((0,), Operator.SUBTRACT, [1.0, 0.0, -1.0], reverse=True),
        Combine((0, 1), Operator.MAXIMUM, 3),
        Combine((0, 2), Operator.MINIMUM, 3),
    ),
    "softmax of one": model(Select((0,), [1]), Softmax((1,), 1)),
    "softmax float32": model(Round((0,), 3), Softmax((1,), 3, Precision.FLOAT32)),
    "logarithm of softmax": model(Softmax((0,), 3, logarithm=True)),
    "logarithm of softmax float32": model(Round((0,), 3), Softmax((1,), 3, Precision.FLOAT32, logarithm=True)),
    "rounds": model(
        Scan(
            (0,),
            (Linear((0,), W, [0.25, -1.0]), Activation((1,), Function.TANH, 2), Scale((2,), Operator.ADD, [0.5, 1.0])),
            [0, 2, 1],
            1,
            [0.0, -0.5],
        )
    ),
    "one round": model(Scan((0,), (Select((0,), [2, 1]), Linear((1,), [[0.5, -1.0]], [1.0])), [0], 2, [0.0])),
    "scale of doubt": model(Scale((0,), Operator.MULTIPLY, [0.5, -3.0, 0.1], doubt=[1e-12, 0.0, 1e-12])),
    "sums at places": model(SlidingLinear((0,), W[:, :2], [0.25, -1.0], [0, 1], [0, 1])),
    "sum at one place": model(SlidingLinear((0,), [[2.0]], [0.25], [1], [1])),
    "sums at places float32": model(
        Round((0,), 3), SlidingLinear((1,), W[:, :2], [0.25, -1.0], [0], [2, 0], Precision.FLOAT32)
    ),
    "many columns": model(
        Scale((0,), Operator.MULTIPLY, [2.0, 2.0, 2.0]),
        Select((0, 1), [*range(1, 6), *np.arange(70) % 6, 0, 1]),
        SlidingLinear((2,), np.ones((1, 7)), [0.0], np.arange(0, 71, 7), np.arange(7)),
    ),
    **{
        f"power {exponent}": model(
            Select((0,), [0]), Activation((1,), Function.POWER, 1, exponent), Activation((2,), Function.POWER, 1, 2.0)
        )
        for exponent in (-2.0, -1.0, -0.5, 3.0, 7.5)
    },
    "linear": model(Linear((0,), W, [0.25, -1.0])),
    "linear float32": model(Round((0,), 3), Linear((1,), W, [0.25, -1.0], precision=Precision.FLOAT32)),
    "linear sequential": model(
        Round((0,), 3), Linear((1,), W, [0.25, -1.0], SummationOrder.SEQUENTIAL, Precision.FLOAT32)
    ),
    **{
        f"function {function.value}": model(Select((0,), columns), Activation((1,), function, len(columns), 0.3))
        for function, columns in FUNCTION_COLUMNS.items()
    },
    **{
        f"function {function.value} float32": model(
            Select((0,), columns),
            Round((1,), len(columns)),
            Activation((2,), function, len(columns), 0.25, Precision.FLOAT32),
        )
        for function, columns in FUNCTION_COLUMNS.items()
    },
    **{f"normalize {norm.value}": model(Round((0,), 3), Normalize((1,), norm, 3)) for norm in Norm},
    **{
        f"kernel {kernel.value} degree {degree}": model(
            KernelSum((0,), kernel, VECTORS, [[1.0, -2.0, 0.5]], [0.1], gamma=0.7, coef0=-0.2, degree=degree)
        )
        for kernel in Kernel
        for degree in (0, 1, 4)
    },
    "kernel float32": model(
        Round((0,), 3), KernelSum((1,), Kernel.RBF, VECTORS, [[1.0, -2.0, 0.5]], [0.1], precision=Precision.FLOAT32)
    ),
    "kernel two outputs": model(KernelSum((0,), Kernel.RBF, VECTORS, [[1.0, -2.0, 0.5], [0.0, 1.0, 1.0]], [0.1, 0.2])),
    "trees": model(random_trees(_rng(), comparison=Comparison.LESS_OR_EQUAL), accepts_nan=True),
    "one leaf": model(random_trees(_rng(), splits=0, trees=1, comparison=Comparison.LESS)),
    "sum of quotients": model(
        Round((0,), 3),
        Scale((1,), Operator.DIVIDE, [1.0, -2.0, 0.5], Precision.FLOAT32, reverse=True),
        Combine((2, 1), Operator.DIVIDE, 3, Precision.FLOAT32),
        Linear((3,), [[3.0, -4.0, 5.0]], [0.5], precision=Precision.FLOAT32),
    ),
    "scaled trees": model(
        Scale((0,), Operator.SUBTRACT, [0.1, 0.2, 0.3]),
        Scale((1,), Operator.DIVIDE, [2.0, 3.0, 0.7]),
        Select((2,), [2, 1, 0]),
        TreeEnsemble(**{**vars(random_trees(_rng(), comparison=Comparison.LESS)), "inputs": (3,)}),
        accepts_nan=True,
    ),
}
