"""The wheel, installed where there is no checkout: what users get."""

import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A fresh environment with the wheel; its dependencies are those of the running one."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    subprocess.run([*pip, "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", folder, ROOT], check=True)
    (wheel,) = folder.glob("*.whl")
    venv.create(folder / "env", with_pip=False)
    python = folder / "env" / "bin" / "python"
    site = Path(
        subprocess.run(
            [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"],
            check=True,
            capture_output=True,
            text=True,
        ).stdout.strip()
    )
    subprocess.run([*pip, "--python", python, "install", "-q", "--no-deps", wheel], check=True)
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder / "env" / "bin"


@pytest.mark.thorough
def test_the_installed_command_compiles_verifies_and_predicts_outside_the_checkout(installed, lone_folder, tmp_path):
    def run(*arguments):
        return subprocess.run(
            [installed / "st-codegen", *map(str, arguments)], cwd=tmp_path, capture_output=True, text=True, check=True
        )

    where = subprocess.run(
        [installed / "python", "-c", "import st_codegen; print(st_codegen.__file__)"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert str(installed.parent) in where.stdout
    run(lone_folder, "--target", "twincat", "--target", "iec")
    run("verify", lone_folder, "--rows", 200)
    (tmp_path / "x.csv").write_text("f0,f1,f2\n500,300,27\n")
    run("predict", lone_folder, "--input", "x.csv", "--output", "y.csv")
    assert (tmp_path / "y.csv").read_text().startswith("te\n")
