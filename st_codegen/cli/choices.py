"""What options offer. The rooms have these names too; here they stand so that `--help` imports no room.

A test compares them with the rooms'.
"""

from __future__ import annotations

TARGETS = ("iec", "plcopen", "codesys", "scl", "twincat", "beckhoff-ml")
OUTPUTS = ("class", "probability", "decision", "mean", "deviation", "column", "reconstruction")
EVALUATORS = ("st", "reference", "source")
EXCHANGES = ("start", "end")
#: Targets whose text the simulated axis runs.
DIALECTS = ("twincat", "codesys", "iec", "scl")
TASK_FORMS = ("one", "two", "split")
FAMILIES = ("SVM", "MLP", "RF", "DT", "ET", "ERT", "GBM", "HGBM", "LGBM", "XGBM", "ELM")
MODEL_FORMS = ("native", "skops", "onnx")
LARGEST_SEED = 2**31 - 1
#: Mistakes of measuring that `reconcile --accept` corrects: those that are looked for first, what may stand in place of
#: changes of the rig, and the word for none but those named.
MISTAKES = (
    "sign", "direction", "home_offset", "column_scale", "ratio", "drift", "axis", "torque", "low_pass", "smoothing",
    "filter", "block", "labels", "start", "conditions", "taken_off", "copied", "shifted", "waves",
)  # fmt: skip
MISREAD = (
    "misread_torque", "misread_temperature", "misread_speed", "misread_angle", "misread_ratio", "misread_te",
    "exchanged_directions",
)  # fmt: skip
AS_IS = "as_is"
#: Where `reconcile --update-models` puts models and code.
UPDATED_MODELS, UPDATED_CODE = "models", "plc"
