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
#: Mistakes of measuring that `reconcile --accept` corrects, by what they are of, the word for all that is asked about,
#: and the one for none but those named.
MISTAKES = {
    "transmission error": (
        "sign", "column_scale", "waves", "low_pass", "smoothing", "filter", "start", "drift", "taken_off", "misread_te",
    ),
    "angles": ("home_offset", "shaft", "axis", "ratio", "misread_angle", "misread_ratio"),
    "conditions": ("conditions", "torque", "misread_torque", "misread_temperature", "misread_speed"),
    "directions and columns": ("direction", "exchanged_directions", "copied", "shifted"),
    "single runs": ("block", "labels"),
}  # fmt: skip
ALL, AS_IS = "all", "as_is"
#: Where `reconcile --update-models` puts models and code.
UPDATED_MODELS, UPDATED_CODE = "models", "plc"
