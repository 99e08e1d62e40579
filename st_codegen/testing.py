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

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from st_codegen.emit.output import FileChange, is_real, kinds_of_outputs

#: Lines of a difference that a failed test shows.
_SHOWN = 60


def assert_generated_up_to_date(models: Path | str, out: Path | str, *, trust_pickle: bool = False) -> None:
    """Fail where the files of a target below `out` are not those that `generate` would write of `models` now.

    Every target that has a folder below `out` is compared, and those that the configuration asks for.
    """
    __tracebackhide__ = True
    from st_codegen.driver import differences
    from st_codegen.project.bundle import load

    bundle = load(models, trust_pickle=trust_pickle, real=is_real(Path(out)))
    settings, targets = _settings(bundle.configuration.build)
    changed: list[FileChange] = []
    for target in targets or _targets_in(Path(out)):
        changed += differences(bundle, target, out, **settings)
    if changed:
        names = "\n".join(f"  {change.path}" for change in changed)
        lines = [line.rstrip("\n") for change in changed for line in change.lines()]
        more = f"\n.. and {len(lines) - _SHOWN} more lines" if len(lines) > _SHOWN else ""
        shown = "\n".join(lines[:_SHOWN]) + more
        pytest.fail(
            f"{len(changed)} generated files are not those of {models}; write them with "
            f"{shlex.join(['st-codegen', 'generate', str(models), '--out', str(out)])}, or pytest --update-generated:\n"
            f"{names}\n\n{shown}",
            pytrace=False,
        )


def assert_equals_library(
    models: Path | str, out: Path | str, *, rows: int = 10_000, seed: int = 0, trust_pickle: bool = False
) -> None:
    """Fail where the generated text below `out` computes other numbers than the libraries of `models` (`verify`)."""
    __tracebackhide__ = True
    from st_codegen.project.bundle import load
    from st_codegen.proof.verify import verify

    kinds, real = kinds_of_outputs(Path(out)), is_real(Path(out))
    bundle = load(models, trust_pickle=trust_pickle, outputs=kinds, real=real)
    report = verify(bundle, out, rows=rows, seed=seed, jobs=1)
    if not report.passed:
        failed = [
            f"  {model.name}: {failure.between} differ at {list(failure.input)}: {list(failure.expected)} and "
            f"{list(failure.got)}, allowed {failure.bound:g}"
            for model in report.models
            for failure in model.failures[:3]
        ]
        pytest.fail("\n".join([repr(report), *failed]), pytrace=False)


def _settings(build: dict[str, Any] | Any) -> tuple[dict[str, Any], list[str]]:
    """The arguments of `generate` that a [build] table gives, and its targets."""
    from st_codegen.passes.choose import Layout, Options

    known = Options()
    options = Options(
        Layout(build.get("layout", known.layout)),
        table_bytes=1024 * build["table_limit"] if "table_limit" in build else known.table_bytes,
        outputs_per_cycle=build.get("outputs_per_cycle"),
        data_bytes=build.get("max_bytes"),
    )
    settings = {"options": options, "max_array": build.get("max_array"), "with_tests": build.get("with_tests", False)}
    settings["with_comparison"] = build.get("with_comparison", False)
    return settings, list(build.get("target", ()))


def _targets_in(out: Path) -> list[str]:
    from st_codegen.proof.runner import target_folders

    return [folder.name for folder in target_folders(out)]


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
            from st_codegen.project.bundle import load

            bundle = load(models, trust_pickle=trust_pickle)
            if bundle.configuration.build.get("real"):
                bundle = load(models, trust_pickle=trust_pickle, real=True)
            settings, targets = _settings(bundle.configuration.build)
            for target in targets or ["twincat"]:
                generate(bundle, target, out, **settings)
        assert_generated_up_to_date(models, out, trust_pickle=trust_pickle)

    return compare
