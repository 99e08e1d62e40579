"""Small networks as both exporters of PyTorch write them: files for `st-codegen`, and for the tests.

    pip install torch onnx onnxscript
    python torch_networks.py FOLDER

Of each network FOLDER gets `torch_NAME.onnx` (`torch.onnx.export(dynamo=False)`) and `dynamo_NAME.onnx`
(`dynamo=True`). Weights are random: what is looked at is the form of the file.
"""

from __future__ import annotations

import sys
from pathlib import Path

import onnx
import torch
from torch import nn


class Last(nn.Module):
    """The last state of a recurrent layer over a window (batch, samples, channels), and a linear layer of it."""

    def __init__(self, layer: nn.Module, width: int) -> None:
        super().__init__()
        self.layer, self.head = layer, nn.Linear(width, 2)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        states, _ = self.layer(x)
        return self.head(states[:, -1])


class Residual(nn.Module):
    """Inputs brought to a common scale, a block around which they are added, and a norm of the layer."""

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("mean", torch.tensor([900.0, 300.0, 30.0, 1.0]))
        self.register_buffer("scale", torch.tensor([500.0, 150.0, 5.0, 0.3]))
        self.inner = nn.Sequential(nn.Linear(4, 8), nn.SiLU(), nn.Dropout(0.1), nn.Linear(8, 4))
        self.norm, self.head = nn.LayerNorm(4), nn.Linear(4, 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x = (x - self.mean) / self.scale
        return self.head(self.norm(x + self.inner(x)))


class Reconstruction(nn.Module):
    """An autoencoder that gives how far its output lies from its input."""

    def __init__(self) -> None:
        super().__init__()
        self.inner = nn.Sequential(nn.Linear(6, 3), nn.Tanh(), nn.Linear(3, 6))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return ((x - self.inner(x)) ** 2).mean(dim=1, keepdim=True)


class Causal(nn.Module):
    """Dilated convolutions that see the past alone, and the newest sample of their result."""

    def __init__(self) -> None:
        super().__init__()
        self.first, self.second = nn.Conv1d(2, 4, 3), nn.Conv1d(4, 4, 3, dilation=2)
        self.head = nn.Linear(4, 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x = torch.relu(self.first(nn.functional.pad(x, (2, 0))))
        x = torch.relu(self.second(nn.functional.pad(x, (4, 0))))
        return self.head(x[:, :, -1])


def activations() -> nn.Module:
    """One layer behind another, each with another activation."""
    layers: list[nn.Module] = [nn.Linear(3, 4)]
    for layer in (
        nn.GELU(),
        nn.ELU(),
        nn.SELU(),
        nn.CELU(),
        nn.Softplus(),
        nn.Softsign(),
        nn.Hardswish(),
        nn.Hardsigmoid(),
    ):
        layers += [layer, nn.Linear(4, 4)]
    return nn.Sequential(*layers, nn.PReLU(), nn.LeakyReLU(), nn.Mish(), nn.Sigmoid())


def networks() -> dict[str, tuple[nn.Module, tuple[int, ...]]]:
    """Each network, and the shape of one of its inputs."""
    return {
        "layers": (
            nn.Sequential(nn.Linear(3, 8), nn.ReLU(), nn.BatchNorm1d(8), nn.Linear(8, 4), nn.Tanh(), nn.Linear(4, 1)),
            (3,),
        ),
        "activations": (activations(), (3,)),
        "residual": (Residual(), (4,)),
        "reconstruction": (Reconstruction(), (6,)),
        "classes": (nn.Sequential(nn.Linear(4, 6), nn.ReLU(), nn.Linear(6, 3), nn.Softmax(dim=1)), (4,)),
        "convolution": (
            nn.Sequential(
                nn.Conv1d(2, 4, 3, padding=1),
                nn.BatchNorm1d(4),
                nn.ReLU(),
                nn.MaxPool1d(2),
                nn.Conv1d(4, 3, 3),
                nn.ReLU(),
                nn.AdaptiveAvgPool1d(1),
                nn.Flatten(),
                nn.Linear(3, 2),
            ),
            (2, 12),
        ),
        "picture": (
            nn.Sequential(
                nn.Conv2d(1, 3, 3),
                nn.ReLU(),
                nn.MaxPool2d(2),
                nn.Conv2d(3, 4, 2, stride=2),
                nn.ReLU(),
                nn.Flatten(),
                nn.Linear(4, 2),
            ),
            (1, 7, 7),
        ),
        "causal": (Causal(), (2, 10)),
        "lstm": (Last(nn.LSTM(2, 4, batch_first=True), 4), (6, 2)),
        "lstm_two_layers": (Last(nn.LSTM(2, 3, num_layers=2, batch_first=True), 3), (5, 2)),
        "lstm_both_ways": (Last(nn.LSTM(2, 3, bidirectional=True, batch_first=True), 6), (5, 2)),
        "gru": (Last(nn.GRU(2, 4, batch_first=True), 4), (6, 2)),
        "rnn": (Last(nn.RNN(2, 4, batch_first=True), 4), (6, 2)),
    }


def without_traces(path: Path) -> None:
    """Take out what the exporters note beside the graph: the places in the program that wrote it."""
    model = onnx.load(path)
    for part in (
        model,
        model.graph,
        *model.graph.node,
        *model.graph.input,
        *model.graph.value_info,
        *model.graph.output,
    ):
        part.ClearField("doc_string")
        part.ClearField("metadata_props")
    onnx.save(model, path)


def main(folder: Path) -> None:
    """Write the files of all networks."""
    folder.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(0)
    for name, (network, shape) in networks().items():
        network.eval()
        torch.onnx.export(
            network,
            (torch.randn(1, *shape),),
            folder / f"torch_{name}.onnx",
            dynamo=False,
            input_names=["x"],
            output_names=["y"],
            dynamic_axes={"x": {0: "batch"}, "y": {0: "batch"}},
        )
        torch.onnx.export(
            network,
            (torch.randn(2, *shape),),
            folder / f"dynamo_{name}.onnx",
            dynamo=True,
            external_data=False,
            input_names=["x"],
            output_names=["y"],
            dynamic_shapes=({0: torch.export.Dim("batch")},),
        )
        for exporter in ("torch", "dynamo"):
            without_traces(folder / f"{exporter}_{name}.onnx")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
