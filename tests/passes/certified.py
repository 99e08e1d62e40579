"""Text of an estimator that `prove` follows and the independent checker confirms."""

import json
import subprocess
import sys
from pathlib import Path

from st_codegen.driver import generate
from st_codegen.passes.choose import Options
from st_codegen.project.bundle import load
from st_codegen.proof.prove.certificate import certificate
from st_codegen.proof.prove.prove import prove

CHECKER = Path(__file__).resolve().parents[2] / "checker" / "check_certificate.py"


def certified(fitted, layout, chosen, folder):
    """The bundle, the generated folder and the block's file of an estimator; the layout is chosen and certified."""
    import skops.io

    models, out, path = folder / "models", folder / "out", folder / "certificate.json"
    models.mkdir()
    skops.io.dump(fitted, models / "small.skops")
    bundle = load(models)
    assert generate(bundle, "iec", out, options=Options(layout)).compiled.decisions[0].chosen == chosen
    report = prove(bundle, out)
    assert report.proved
    path.write_text(json.dumps(certificate(bundle, models, out, report)))
    command = [sys.executable, *map(str, (CHECKER, path, models, out))]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    return bundle, out, out / "iec" / "FB_Small.st"
