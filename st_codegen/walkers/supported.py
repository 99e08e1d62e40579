"""All that is read, as a table made from the registries of the walkers."""

from __future__ import annotations

from collections.abc import Iterator

from st_codegen.walkers.base import LIBRARIES, transforms, walks
from st_codegen.walkers.catboost.model import OBJECTIVES as CATBOOST_LOSSES
from st_codegen.walkers.lightgbm.model import OBJECTIVES as LIGHTGBM_OBJECTIVES
from st_codegen.walkers.xgboost.model import OBJECTIVES as XGBOOST_OBJECTIVES

#: What a walker of each type of result gives.
_GIVES = {
    "Classified": "classes",
    "int": "numbers",
    "Estimated": "numbers",
    "Walked": "classes or numbers, by what it was trained for",
}


def supported() -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Library, what its models give, and their names; the operators of ONNX where its package is installed."""
    for package, library in LIBRARIES.items():
        found: dict[str, list[str]] = {}
        for name, walker in walks.of(package).items():
            if name.startswith("_"):  # a part of another class
                continue
            found.setdefault(_GIVES[walker.__annotations__["return"]], []).append(name)
        for gives in dict.fromkeys(_GIVES.values()):
            if gives in found:
                yield library, gives, tuple(sorted(found[gives]))
        if transforms.of(package):
            yield (
                library,
                "columns, in a Pipeline, or alone where it has no predict",
                tuple(sorted(transforms.of(package))),
            )
    yield "LightGBM", "objectives", LIGHTGBM_OBJECTIVES
    yield "XGBoost", "objectives", XGBOOST_OBJECTIVES
    yield "CatBoost", "losses", CATBOOST_LOSSES
    try:
        from st_codegen.walkers.onnx import model  # noqa: F401 - it imports all that registers operators
        from st_codegen.walkers.onnx.graph import RULES
    except ImportError:
        return
    yield "ONNX", "operators", tuple(sorted({name for _, name in RULES}))


def table() -> str:
    """The table as Markdown."""
    lines = ["| library | gives | models |", "|---|---|---|"]
    lines += [f"| {library} | {gives} | {', '.join(names)} |" for library, gives, names in supported()]
    return "\n".join(lines)
