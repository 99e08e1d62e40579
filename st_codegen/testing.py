"""Tests of generated code in the repository of a PLC project; a plugin of pytest.

    from st_codegen.testing import assert_equals_library, assert_generated_up_to_date

    def test_generated_files_are_those_of_the_models():
        assert_generated_up_to_date("models", "plc")

    def test_generated_text_computes_what_the_library_computes():
        assert_equals_library("models", "plc", rows=2000)

The fixture `generated_golden` compares as the first does, and with `pytest --update-generated` writes the files. Both
take the options in the `[build]` table of `st-codegen.toml`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from st_codegen.emit.output import FileChange, is_real, kinds_of_outputs
from st_codegen.errors import GeneratedCodeError, counted
from st_codegen.files.made_by import command_line

if TYPE_CHECKING:
    from st_codegen.project.bundle import Bundle

#: Lines of a difference that a failed test shows.
_SHOWN = 60


def assert_generated_up_to_date(models: Path | str, out: Path | str, *, trust_pickle: bool = False) -> None:
    """Fail where the files of a target below `out` are not those that `generate` would write of `models` now.

    Every target that has a folder below `out` is compared, and those that [build] asks for, each as [build] wants it.
    """
    __tracebackhide__ = True
    from st_codegen.driver import differences

    bundle = _bundle(models, Path(out), trust_pickle)
    changed: list[FileChange] = []
    for target, wishes in _wishes(bundle, Path(out)).items():
        changed += differences(bundle, target, out, **wishes)
    if changed:
        names = "\n".join(f"  {change.path}" for change in changed)
        lines = [line.rstrip("\n") for change in changed for line in change.lines()]
        writing = command_line("st-codegen", "generate", Path(models), "--out", Path(out))
        more = f"\n.. and {counted(len(lines) - _SHOWN, 'more line')}" if len(lines) > _SHOWN else ""
        shown = "\n".join(lines[:_SHOWN]) + more
        pytest.fail(
            f"generated files are not those of {models} ({len(changed)}); write them with "
            f"{writing}, or pytest --update-generated:\n{names}\n\n{shown}",
            pytrace=False,
        )


def assert_equals_library(
    models: Path | str, out: Path | str, *, rows: int = 10_000, seed: int = 0, trust_pickle: bool = False
) -> None:
    """Fail where the generated text below `out` computes other numbers than the libraries of `models` (`verify`)."""
    __tracebackhide__ = True
    from st_codegen.proof.verify import verify

    bundle = _bundle(models, Path(out), trust_pickle)
    report = verify(bundle, out, rows=rows, seed=seed, jobs=1)
    if not report.passed:
        failed = [f"  {model.name}: {failure}" for model in report.models for failure in model.failures[:3]]
        pytest.fail("\n".join([repr(report), *failed]), pytrace=False)


def _bundle(models: Path | str, out: Path, trust_pickle: bool) -> Bundle:
    """The models as [build] wants them; where it says nothing, with the outputs and numbers that stand below `out`.

    What stands there counts only where [build] is silent: a class that is asked for and missing is a difference.
    """
    from st_codegen.ir import OutputKind
    from st_codegen.project.bundle import load
    from st_codegen.project.configuration import read_configuration
    from st_codegen.walkers.limits import set_features

    build = read_configuration(Path(models)).build
    words = [OutputKind(word.strip()) for word in build["outputs"].split(",")] if "outputs" in build else None
    kinds = kinds_of_outputs(out) if words is None else words
    set_features(build.get("features"))
    try:
        return load(models, trust_pickle=trust_pickle, outputs=kinds, real=build.get("real", False) or is_real(out))
    finally:
        set_features(None)


def _wishes(bundle: Bundle, out: Path) -> dict[str, Any]:
    """What [build] wants, by the names of its targets and of those that stand below `out`."""
    from st_codegen.cost.profile import load_profile
    from st_codegen.driver import limits_for, wishes_of
    from st_codegen.emit.targets import target_named
    from st_codegen.proof.explain import Pricing

    build = bundle.configuration.build
    names = dict.fromkeys([*build.get("target", ()), *_targets_in(out)]) or ("twincat",)
    chosen = [target_named(name) for name in names]
    found: dict[str, Any] = {**wishes_of(build, chosen)}
    for target in chosen if "profile" in build else ():
        limits = limits_for(target, build.get("max_array"))
        found[target.name]["cost"] = Pricing(target, limits, load_profile(build["profile"]))
    return found


def _targets_in(out: Path) -> list[str]:
    from st_codegen.proof.runner import target_folders

    with contextlib.suppress(GeneratedCodeError):  # nothing is there yet
        return [folder.name for folder in target_folders(out)]
    return []


def pytest_addoption(parser: pytest.Parser) -> None:
    """The option that writes generated files."""
    parser.getgroup("st-codegen").addoption(
        "--update-generated", action="store_true", help="write the generated files of tests with generated_golden"
    )


@pytest.fixture
def generated_golden(request: pytest.FixtureRequest) -> Callable[..., None]:
    """A function (models, out, trust_pickle=False) that compares generated files, or writes them on demand."""

    def compare(models: Path | str, out: Path | str, *, trust_pickle: bool = False) -> None:
        __tracebackhide__ = True
        if request.config.getoption("--update-generated"):
            from st_codegen.driver import generate

            bundle = _bundle(models, Path(out), trust_pickle)
            for target, wishes in _wishes(bundle, Path(out)).items():
                generate(bundle, target, out, **wishes)
        assert_generated_up_to_date(models, out, trust_pickle=trust_pickle)

    return compare
