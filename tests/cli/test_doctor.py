from importlib import metadata

from st_codegen.cli import doctor
from tests.cli.helpers import run


def test_versions_and_what_is_missing_are_told_with_the_command_that_helps(monkeypatch, capsys):
    known = {"click": "8.1", "lightgbm": "4.6"}
    required = [
        "click>=8.1",
        "lightgbm>=4.0; extra == 'lightgbm'",
        'onnx>=1.17 ; extra == "onnx"',
        "ruff; extra == 'dev'",
    ]
    monkeypatch.setattr(doctor.metadata, "requires", lambda _: required)

    def version(name):
        if name not in known:
            raise metadata.PackageNotFoundError(name)
        return known[name]

    monkeypatch.setattr(doctor.metadata, "version", version)
    assert run("doctor") == 0
    printed = capsys.readouterr().out.splitlines()[2:]
    assert printed == [
        "always: click 8.1",
        "lightgbm: lightgbm 4.6",
        "onnx: onnx MISSING",
        'to get onnx: pip install --upgrade "st-codegen[onnx]"',
    ]
    known |= {"click": "8.0.9", "lightgbm": "3.3"}
    assert run("doctor") == 1
    assert capsys.readouterr().out.splitlines()[2:] == [
        "always: click 8.0.9, TOO OLD (8.1 is needed)",
        "lightgbm: lightgbm 3.3, TOO OLD (4.0 is needed)",
        "onnx: onnx MISSING",
        'to get lightgbm: pip install --upgrade "st-codegen[lightgbm]"',
        'to get onnx: pip install --upgrade "st-codegen[onnx]"',
        'packages that are always needed are missing or too old: pip install "click>=8.1"',
    ]
    known.clear()
    assert run("doctor") == 1


def test_the_installed_package_has_all_that_is_always_needed(capsys):
    assert run("doctor") == 0
    assert "MISSING" not in next(line for line in capsys.readouterr().out.splitlines() if line.startswith("always"))
