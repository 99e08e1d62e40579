"""Model files of TwinCAT's machine learning runtime (TF3800, TF3810): the vendor's XML, as its converter writes it.

Read are tree ensembles, networks of dense layers and support vector regression, one engine a file. The vendor's runtime
is not at hand, so the answers of the "library" are an evaluation of the file's own numbers, by the arithmetic that the
format prescribes and nothing shared with the rest of the program: float64 sums in tree order, float32 layers.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen import ir
from st_codegen.beckhoff_ml.file import ACTIVATIONS, KERNELS, MAX_INPUTS, SHOWN, XmlElement, parse
from st_codegen.errors import InputError, UnsupportedModelError, counted, errors_name
from st_codegen.ir.arrays import FloatArray, IntArray
from st_codegen.ir.preorder import preorder
from st_codegen.walkers.base import Classified, GraphBuilder, LoadedModel, Predictor
from st_codegen.walkers.classes import largest, pair_coefficients, pair_votes
from st_codegen.walkers.forest import laid_out
from st_codegen.walkers.limits import check_size

_FUNCTIONS: dict[ir.Function, Callable[[Any], Any]] = {
    ir.Function.LOGISTIC: lambda x: 1 / (1 + np.exp(-x)),
    ir.Function.EXP: np.exp,
    ir.Function.TANH: np.tanh,
    ir.Function.RELU: lambda x: np.maximum(x, 0),
    ir.Function.SOFTPLUS: lambda x: np.logaddexp(0, x),
    ir.Function.IDENTITY: lambda x: x,
}


def load_file(path: Path, name: str) -> LoadedModel:
    """Load one model file. Raises InputError for what is damaged, UnsupportedModelError for what is not read."""
    with errors_name(path.name):
        check_size(path.stat().st_size)
    return read_model(path.read_bytes(), path.name, name)


def read_model(content: bytes, file: str, name: str) -> LoadedModel:
    """A model from the bytes of its file."""
    element = XmlElement(parse(content, file), file)
    if element.tag != "MLlib_XML_File":
        raise InputError(f"{file}: the root element is '{element.tag}', not 'MLlib_XML_File'")
    model = element.only("MachineLearningModel")
    kind = model.text("modelName").lower()
    if kind not in _KINDS:
        raise UnsupportedModelError(
            f"{file}: the model '{kind[:SHOWN]}' is not read; known are {', '.join(_KINDS)} (one engine a file)"
        )
    return _KINDS[kind](model).loaded(name)


@dataclass(frozen=True)
class _Transformation:
    """`scaling * x + offset`, column by column."""

    scaling: FloatArray
    offset: FloatArray

    def __call__(self, x: FloatArray) -> FloatArray:
        return self.scaling * x + self.offset

    def add(self, builder: GraphBuilder, value: int) -> int:
        """Add the transformation to a model as two operations."""
        value = builder.scale(value, "*", self.scaling)
        return builder.scale(value, "+", self.offset)


class _File:
    """What all kinds share: the envelope, the transformations, the finished model."""

    #: Those of a classifier.
    labels: tuple[int, ...] = ()

    def __init__(self, model: XmlElement) -> None:
        self.model = model
        self.configuration = model.only("Configuration")
        self.parameters = model.only("Parameters")
        self.n_inputs = self.inputs()
        if self.n_inputs < 1:
            raise self.configuration.error("a model without inputs")
        self.n_outputs = self.read()
        self.input = self._transformation("InputTransformation", self.n_inputs)
        self.output = self._transformation("OutputTransformation", self.n_outputs)

    def inputs(self) -> int:
        """The number of inputs."""
        raise NotImplementedError

    def read(self) -> int:
        """Read the parameters; returns the number of outputs."""
        raise NotImplementedError

    def add(self, builder: GraphBuilder, value: int) -> int:
        """Add the engine's operations."""
        raise NotImplementedError

    def evaluate(self, x: FloatArray) -> FloatArray:
        """The engine's answer for rows of `x` behind the input transformation."""
        raise NotImplementedError

    def _transformation(self, tag: str, width: int) -> _Transformation | None:
        specifications = self.model.optional("AuxiliarySpecifications")
        modification = specifications.optional("IOModification") if specifications is not None else None
        found = modification.optional(tag) if modification is not None else None
        if found is None:
            return None
        if found.text("str_type") != "SCALED_OFFSET":
            raise UnsupportedModelError(
                f"{found.file}: the transformation '{found.text('str_type')[:SHOWN]}' is not read"
            )
        scaling, offset = found.doubles("scalings"), found.doubles("offsets")
        if len(scaling) != width or len(offset) != width:
            raise found.error(
                f"{counted(len(scaling), 'scaling')} and {counted(len(offset), 'offset')} for "
                f"{counted(width, 'column')}"
            )
        return _Transformation(scaling, offset)

    def loaded(self, name: str) -> LoadedModel:
        """The model, and the evaluation of the file."""
        builder = GraphBuilder(self.n_inputs)
        builder.refuse_nan()
        value = self.add(builder, 0 if self.input is None else self.input.add(builder, 0))
        if self.output is not None and self.labels:
            raise UnsupportedModelError(f"{self.model.file}: a transformation of labels is not read")
        if self.output is not None:
            self.output.add(builder, value)
        information = self.model.optional("AuxiliarySpecifications")
        information = information.optional("PTI") if information is not None else None
        attributes: dict[str, str] = {}
        if information is not None:
            attributes = {str(key): str(value) for key, value in information.element.attrib.items()}
        source = ir.Source(
            library=_plain(attributes.get("str_producer", "Beckhoff MLlib")),
            version=_plain(attributes.get("str_producerVersion", "unknown")),
            model_class=self.model.text("modelName"),
            notes=("evaluated by the arithmetic of the file format, not by the vendor's runtime",),
        )
        features = tuple(ir.Feature(f"f{number}") for number in range(self.n_inputs))
        result = Classified(self.labels, value) if self.labels else None
        return LoadedModel(builder.model(name, features, source, result), self._predictor())

    def _predictor(self) -> Predictor:
        def predict(x: FloatArray) -> FloatArray:
            with np.errstate(all="ignore"):
                result = self.evaluate(x if self.input is None else self.input(x))
                return result if self.output is None else self.output(result)

        return predict


def _plain(text: str) -> str:
    """Text of the file that may stand in a comment."""
    return re.sub(r"[^A-Za-z0-9 ._-]", "_", text)[:60] or "unknown"


class _Trees(_File):
    """Flat arrays: children first left, then right, 0 for a leaf."""

    def inputs(self) -> int:
        for name, wanted in (("str_TreeType", "TREE_TYPE_REGRESSOR"), ("str_PostTransform", "NONE")):
            found = self.configuration.text(name)
            if found != wanted:
                raise UnsupportedModelError(f"{self.model.file}: {name} '{found[:SHOWN]}' is not read, only {wanted}")
        return self.configuration.count("inputDimension", MAX_INPUTS)

    def read(self) -> int:
        parts = {tag: self.parameters.only(tag) for tag in ("SplitValues", "SplitVars", "ChildNodes")}
        trees = self.configuration.count("numTrees", len(parts["SplitValues"].element.attrib) // 2)
        if trees < 1 or any(len(part.element.attrib) != 2 * trees for part in parts.values()):
            raise self.configuration.error(f"{counted(trees, 'tree')} announced, the parameters have another number")
        base = self.parameters.only("BaseValues")
        if base.count("N", 1 << 31) != 1:
            raise UnsupportedModelError(f"{base.file}: trees with several outputs are not read")
        self.base = base.double("BaseValues")
        columns = [self._tree(parts, number) for number in range(trees)]
        sizes = np.array([len(values) for values, _, _ in columns])
        starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        self.values = np.concatenate([values for values, _, _ in columns])
        self.variables = np.concatenate([variables for _, variables, _ in columns])
        shifted = [
            np.where(children > 0, children + start, -1)
            for (_, _, children), start in zip(columns, starts, strict=True)
        ]
        self.left = np.concatenate([part[: len(part) // 2] for part in shifted])
        self.right = np.concatenate([part[len(part) // 2 :] for part in shifted])
        self.layout = preorder(starts, self.left, self.right)
        self.roots = starts
        self._check_weights()
        return 1

    def _tree(self, parts: dict[str, XmlElement], number: int) -> tuple[FloatArray, IntArray, IntArray]:
        values = parts["SplitValues"].doubles(f"TR_{number}")
        variables = parts["SplitVars"].integers(f"TR_{number}")
        children = parts["ChildNodes"].integers(f"TR_{number}")
        nodes = len(values)
        announced = {part.count(f"ND_{number}", 1 << 31) for part in parts.values()}
        if announced != {nodes} or len(variables) != nodes or len(children) != 2 * nodes:
            raise parts["SplitValues"].error(
                f"tree {number}: {counted(nodes, 'value')}, {counted(len(variables), 'variable')}, "
                f"{counted(len(children), 'child', 'children')}; "
                f"announced numbers of nodes: {', '.join(map(str, sorted(announced)))}"
            )
        if np.any(children < 0) or np.any(children >= nodes):
            raise parts["ChildNodes"].error(f"tree {number}: a child outside 0 .. {nodes - 1}")
        if np.any(variables < 0) or np.any(variables >= self.n_inputs):
            raise parts["SplitVars"].error(f"tree {number}: an input outside 0 .. {self.n_inputs - 1}")
        return values, variables, children

    def _check_weights(self) -> None:
        found = self.parameters.only("ClassWeights")
        weights = found.doubles("Weights")
        leaves = self.values[self.left < 0]
        if not np.array_equal(weights, leaves):
            raise found.error(f"the leaf values ({len(weights)}) are not those of the trees ({len(leaves)})")

    def add(self, builder: GraphBuilder, value: int) -> int:
        layout = self.layout
        values = self.values[layout.order]
        return builder.add(
            laid_out(
                value,
                layout,
                columns=tuple(ir.TreeColumn(column) for column in range(self.n_inputs)),
                split=self.variables[layout.order],
                threshold=values,
                missing_left=np.zeros(len(values), np.bool_),
                leaf_value=values[layout.left < 0][:, None],
                tree_output=np.zeros(len(self.roots), np.int32),
                base=np.array([self.base]),
            )
        )

    def evaluate(self, x: FloatArray) -> FloatArray:
        total = np.full(len(x), self.base)
        rows = np.arange(len(x))
        for root in self.roots:
            node = np.full(len(x), root)
            while np.any(self.left[node] >= 0):
                goes_left = x[rows, self.variables[node]] <= self.values[node]
                following = np.where(goes_left, self.left[node], self.right[node])
                node = np.where(self.left[node] >= 0, following, node)
            total += self.values[node]
        return total[:, None]


class _Network(_File):
    """Dense layers; a row of weights a neuron, its constant last; float32."""

    def inputs(self) -> int:
        return self.configuration.count("numInputNeurons", MAX_INPUTS)

    def read(self) -> int:
        count = self.configuration.count("numLayers", len(self.configuration.element))
        bias = self.configuration.text("bool_usesBias").lower() == "true"
        self.layers: list[tuple[FloatArray, FloatArray, ir.Function]] = []
        width = self.n_inputs
        announced = self.configuration.numbered("MlpLayer", count)
        for described, layer in zip(announced, self.parameters.numbered("MlpLayer", count), strict=True):
            if layer.text("str_type").upper() != "DENSE":
                raise UnsupportedModelError(f"{layer.file}: a layer '{layer.text('str_type')[:SHOWN]}' is not read")
            name = layer.text("str_activationFunction").removeprefix("ACT_FN_")
            if name not in ACTIVATIONS:
                raise UnsupportedModelError(
                    f"{layer.file}: the activation function '{name[:SHOWN]}' is not read; known are "
                    f"{', '.join(ACTIVATIONS)}"
                )
            matrix = layer.only("WeightMatrix").matrix(XmlElement.singles)
            neurons = described.count("numNeurons", MAX_INPUTS)
            if matrix.shape != (neurons, width + bias):
                raise layer.error(f"weights of shape {matrix.shape}, expected is {(neurons, width + bias)}")
            weights, constant = (matrix[:, :-1], matrix[:, -1]) if bias else (matrix, np.zeros(neurons))
            self.layers.append((weights, constant, ACTIVATIONS[name]))
            width = neurons
        if not self.layers:
            raise self.configuration.error("a network without layers")
        return width

    def add(self, builder: GraphBuilder, value: int) -> int:
        builder.refuse_magnitude(ir.FLOAT32_OVERFLOW)
        value = builder.add(ir.Round((value,), self.n_inputs))
        for weights, constant, function in self.layers:
            value = builder.linear(value, weights, constant, precision=ir.Precision.FLOAT32)
            value = builder.function(value, function, precision=ir.Precision.FLOAT32)
        return value

    def evaluate(self, x: FloatArray) -> FloatArray:
        values = x.astype(np.float32)
        for weights, constant, function in self.layers:
            values = values @ weights.astype(np.float32).T + constant.astype(np.float32)
            values = _FUNCTIONS[function](values).astype(np.float32)
        return values.astype(np.float64)


class _SupportVectors(_File):
    """sum of coefficient * kernel(x, vector) - rho."""

    def inputs(self) -> int:
        kind = self.configuration.text("str_operationType").removeprefix("SVM_TYPE_")
        self.classifies = kind in ("C_CLASSIFIER", "NU_CLASSIFIER")
        if not self.classifies and kind not in ("EPSILON_REGRESSION", "NU_REGRESSION"):
            raise UnsupportedModelError(f"{self.model.file}: support vectors for '{kind[:SHOWN]}' are not read")
        name = self.configuration.text("str_kernelFunction").removeprefix("KERNEL_FN_")
        if name not in KERNELS:
            raise UnsupportedModelError(
                f"{self.model.file}: the kernel '{name[:SHOWN]}' is not read; known are {', '.join(KERNELS)}"
            )
        self.kernel = KERNELS[name]
        self.gamma = 1.0 if self.kernel is ir.Kernel.LINEAR else self.configuration.double("gamma")
        shifted = self.kernel in (ir.Kernel.POLYNOMIAL, ir.Kernel.SIGMOID)
        self.coef0 = self.configuration.double("coef0") if shifted else 0.0
        self.degree = self.configuration.count("degree", 1000) if self.kernel is ir.Kernel.POLYNOMIAL else 3
        return self.configuration.count("numInputAttributes", MAX_INPUTS)

    def read(self) -> int:
        vectors, coefficients = (
            self.parameters.only(tag).matrix(XmlElement.doubles)
            for tag in ("SupportVectors", "SupportVectorClassCoefficients")
        )
        information = self.parameters.only("ModelInfo")
        announced = information.count("numSVs", 1 << 31)
        classes = information.count("numClasses", announced + 1) if self.classifies else 2
        if vectors.shape != (announced, self.n_inputs) or coefficients.shape != (classes - 1, announced):
            raise self.parameters.error(
                f"vectors of shape {vectors.shape}, coefficients of shape {coefficients.shape}; expected are "
                f"{counted(announced, 'vector')} of {counted(self.n_inputs, 'number')}, "
                f"{counted(classes - 1, 'coefficient')} each"
            )
        self.vectors, self.coefficients = vectors, coefficients
        self.rho = self.parameters.only("ProbabilityInfo").doubles("rhoConstants")
        if self.classifies:
            self.labels = tuple(information.integers("classLabels").tolist())
            self.per_class = information.integers("numSVsPerClass")
            if (
                not 2 <= classes == len(self.labels) == len(self.per_class)
                or np.any(self.per_class < 0)
                or np.sum(self.per_class) != announced
            ):
                raise information.error(f"labels or numbers of vectors that are not those of {classes} classes")
        if len(self.rho) != classes * (classes - 1) // 2:
            raise self.parameters.error(f"{len(self.rho)} rhoConstants for {classes} classes")
        return 1

    def add(self, builder: GraphBuilder, value: int) -> int:
        builder.refuse_magnitude(np.inf)
        sums = builder.add(
            ir.KernelSum(
                inputs=(value,),
                kernel=self.kernel,
                support_vectors=self.vectors,
                coefficients=pair_coefficients(self.coefficients, self.per_class)
                if self.classifies
                else self.coefficients,
                intercept=-self.rho,
                gamma=self.gamma,
                coef0=self.coef0,
                degree=self.degree,
            )
        )
        return largest(builder, pair_votes(builder, sums, len(self.labels))) if self.classifies else sums

    def evaluate(self, x: FloatArray) -> FloatArray:
        kernels = np.empty((len(x), len(self.vectors)))
        for number, vector in enumerate(self.vectors):
            product = x @ vector
            if self.kernel is ir.Kernel.RBF:
                product = np.exp(-self.gamma * np.sum((x - vector) ** 2, axis=1))
            elif self.kernel is ir.Kernel.POLYNOMIAL:
                product = (self.gamma * product + self.coef0) ** self.degree
            elif self.kernel is ir.Kernel.SIGMOID:
                product = np.tanh(self.gamma * product + self.coef0)
            kernels[:, number] = product
        if self.classifies:
            return self._label(kernels)
        total = np.full(len(x), -self.rho[0])
        for number, coefficient in enumerate(self.coefficients[0]):
            total += coefficient * kernels[:, number]
        return total[:, None]

    def _label(self, kernels: FloatArray) -> FloatArray:
        """The number of the first class of most votes; a pair votes for its first class where its sum is above rho."""
        ends = np.cumsum(self.per_class)
        votes, pair = np.zeros((len(kernels), len(ends))), 0
        for one in range(len(ends)):
            for other in range(one + 1, len(ends)):
                total = np.full(len(kernels), -self.rho[pair])
                for own, row in ((one, other - 1), (other, one)):
                    for number in range(ends[own] - self.per_class[own], ends[own]):
                        total += self.coefficients[row, number] * kernels[:, number]
                votes[:, one] += total > 0
                votes[:, other] += ~(total > 0)
                pair += 1
        return np.asarray(np.argmax(votes, axis=1)[:, None], np.float64)


_KINDS: dict[str, Callable[[XmlElement], _File]] = {
    "tree_ensemble": _Trees,
    "mlp_neural_network": _Network,
    "support_vector_machine": _SupportVectors,
}
