"""Train the ten families on the measured harmonic table, compile the bundle and verify it."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import st_codegen  # noqa: E402
from tests.families import SHARED, write_bundle  # noqa: E402


def main() -> int:
    """Exit code 0 when library, reference and text agree, 1 when not, 2 without the measured table."""
    if not SHARED.is_dir():
        print(f"{SHARED}: the measured tables are not beside this checkout")
        return 2
    build = ROOT / "build" / "real_rig"
    write_bundle(build / "models")
    bundle = st_codegen.load(build / "models", trust_pickle=True)
    generated = st_codegen.generate(bundle, "twincat", build)
    report = st_codegen.verify(bundle, build, rows=1_000)
    for model in report.models:
        print(f"{model.name:16} {model.n:8,} rows  {'exact' if model.exact else f'{model.max_abs_err:.2g}'}")
    print(f"{generated.folder}: {'all agree' if report.passed else 'NOT ALL AGREE'}")
    return 0 if report.passed else 1


if __name__ == "__main__":
    sys.exit(main())
