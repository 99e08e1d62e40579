"""Small networks of Keras as tf2onnx writes them: files for `st-codegen`, and for the tests.

    pip install tensorflow-cpu tf2onnx
    python keras_networks.py FOLDER

Of each network FOLDER gets `keras_NAME.onnx`. Weights are random: what is looked at is the form of the file. Gelu is
left out: tf2onnx 1.17 writes it as Erfc, which is no operator of ONNX.
"""

from __future__ import annotations

import sys
from pathlib import Path

import tensorflow as tf
import tf2onnx
from tensorflow.keras import Input, Sequential, layers


def networks() -> dict[str, tf.keras.Model]:
    """Each network with its input."""
    every = ["relu", "elu", "selu", "silu", "softplus", "softsign", "tanh", "sigmoid", "hard_sigmoid", "relu6"]
    return {
        "layers": Sequential(
            [
                Input((3,)),
                layers.Normalization(mean=[900.0, 300.0, 30.0], variance=[2e5, 2e4, 25.0]),
                layers.Dense(8, "relu"),
                layers.BatchNormalization(),
                layers.Dropout(0.1),
                layers.Dense(4, "tanh"),
                layers.Dense(1),
            ]
        ),
        "activations": Sequential(
            [Input((3,)), *[layers.Dense(4, name) for name in every], layers.LeakyReLU(), layers.Dense(2)]
        ),
        "slopes": Sequential(
            [Input((3,)), layers.Dense(4), layers.PReLU(), layers.LayerNormalization(), layers.Dense(1)]
        ),
        "classes": Sequential([Input((4,)), layers.Dense(6, "relu"), layers.Dense(3, "softmax")]),
        "convolution": Sequential(
            [
                Input((12, 2)),
                layers.Conv1D(4, 3, padding="same", activation="relu"),
                layers.BatchNormalization(),
                layers.MaxPooling1D(2),
                layers.Conv1D(3, 3, activation="relu"),
                layers.GlobalAveragePooling1D(),
                layers.Dense(2),
            ]
        ),
        "picture": Sequential(
            [
                Input((7, 7, 1)),
                layers.Conv2D(3, 3, activation="relu"),
                layers.MaxPooling2D(2),
                layers.Conv2D(4, 2, strides=2, activation="relu"),
                layers.Flatten(),
                layers.Dense(2),
            ]
        ),
        "causal": Sequential(
            [
                Input((10, 2)),
                layers.Conv1D(4, 3, padding="causal", activation="relu"),
                layers.Conv1D(4, 3, padding="causal", dilation_rate=2, activation="relu"),
                layers.Flatten(),
                layers.Dense(1),
            ]
        ),
        "lstm": Sequential([Input((6, 2)), layers.LSTM(4), layers.Dense(2)]),
        "lstm_two_layers": Sequential(
            [Input((5, 2)), layers.LSTM(3, return_sequences=True), layers.LSTM(3), layers.Dense(2)]
        ),
        "lstm_both_ways": Sequential([Input((5, 2)), layers.Bidirectional(layers.LSTM(3)), layers.Dense(2)]),
        "gru": Sequential([Input((6, 2)), layers.GRU(4), layers.Dense(2)]),
        "rnn": Sequential([Input((6, 2)), layers.SimpleRNN(4), layers.Dense(2)]),
    }


def main(folder: Path) -> None:
    """Write the files of all networks."""
    folder.mkdir(parents=True, exist_ok=True)
    tf.keras.utils.set_random_seed(0)
    for name, network in networks().items():
        signature = (tf.TensorSpec(network.inputs[0].shape, tf.float32, name="x"),)
        function = tf.function(lambda x, network=network: network(x, training=False), input_signature=signature)
        tf2onnx.convert.from_function(function, signature, opset=15, output_path=str(folder / f"keras_{name}.onnx"))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
