"""Blind cases of joints: `python -m tests.reconcile.joint.run --json build/blind_joint.json`.

Each case is simulated by `machine.py`, reconciled as a user would, and what is said is held against what was put in.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import traceback
from pathlib import Path
from typing import Any

from st_codegen.errors import InputError
from st_codegen.reconcile.joint.findings import joint_report
from st_codegen.reconcile.joint.reading import read_joints
from st_codegen.reconcile.joint.run import reconcile_joints

from .machine import Joint, Measured, simulate, write

LUGRE = {"dry": 1.0, "viscous": 0.8}
#: name, what the joint holds, how it is measured, names that are true of it, names that must be said
KINDS: dict[str, tuple[dict[str, Any], dict[str, Any], set[str], set[str]]] = {
    "nothing": ({}, {}, set(), set()),
    "nothing, quantised": ({}, {"quantum": 0.1}, set(), set()),
    "dry": ({"dry": 1.0}, {}, {"dry_friction"}, {"dry_friction"}),
    "viscous": ({"viscous": 0.8}, {}, {"viscous_friction"}, {"viscous_friction"}),
    "dry and viscous": (LUGRE, {}, set(), {"dry_friction", "viscous_friction"}),
    "soft bristles": ({**LUGRE, "bristle": 150.0}, {}, {"reversal_hysteresis"}, {"dry_friction", "viscous_friction"}),
    "stribeck": ({**LUGRE, "breakaway": 0.8}, {}, {"stribeck"}, {"dry_friction", "stribeck"}),
    "by load": ({**LUGRE, "by_load": 0.15}, {}, {"load_dependent_friction"}, {"dry_friction"}),
    "directions": ({**LUGRE, "back": 0.3}, {}, set(), {"dry_friction", "viscous_friction"}),
    "warming": ({**LUGRE, "viscous": 1.5, "cooling": 0.5}, {}, {"viscous_friction_drift"}, {"viscous_friction_drift"}),
    "ripple": ({**LUGRE, "ripple": 0.2}, {}, {"torque_ripple"}, {"torque_ripple"}),
    "ripple, drifting": ({**LUGRE, "ripple": 0.3, "order": 44.0, "drift": 0.15}, {}, {"torque_ripple"}, set()),
    "hum": ({**LUGRE, "hum": 0.15}, {}, set(), {"dry_friction"}),
    "spring": ({**LUGRE, "spring_Hz": 30.0}, {"shake": 3.0}, {"elasticity"}, {"elasticity"}),
    "spring, load side": ({**LUGRE, "spring_Hz": 20.0, "behind": True}, {"shake": 3.0}, {"elasticity"}, set()),
    "spring, not shaken": ({**LUGRE, "spring_Hz": 30.0}, {}, {"elasticity"}, set()),
    "shaken": (LUGRE, {"shake": 3.0}, set(), {"dry_friction"}),
    "late": (LUGRE, {"late": 6}, set(), {"dry_friction", "viscous_friction"}),
    "slow dq": (LUGRE, {"lag": 0.02}, set(), {"dry_friction", "viscous_friction"}),
    "quantised": (LUGRE, {"quantum": 0.1}, set(), {"dry_friction", "viscous_friction"}),
    "coupled": (LUGRE, {"coupled": 1.0}, set(), {"dry_friction"}),
    "one way": (LUGRE, {"path": "oneway"}, set(), set()),
    "one speed": (LUGRE, {"path": "one_speed"}, set(), set()),
}
NOISES = ((0.005, 5e-7), (0.05, 2e-6), (0.4, 1e-5))


def run_case(kind: str, noise: int, seed: int, folder: Path) -> dict[str, Any]:
    """Simulate, reconcile and score one case."""
    holds, how, allowed, wanted = KINDS[kind]
    joint = Joint(**holds)
    torque, angle = NOISES[noise]
    measured = Measured(**{"torque_noise": torque, "angle_noise": angle, "seed": seed, **how})
    path = write(simulate(joint, measured), folder / "joint.csv", {"q": "q_rad"})
    try:
        report = joint_report(reconcile_joints(read_joints([path])), None)["joints"][0]
    except InputError as error:
        return {"kind": kind, "noise": noise, "false": [f"refused: {error}"], "missing": sorted(wanted), "said": []}
    return {"kind": kind, "noise": noise, **score(joint, measured, report, allowed, wanted)}


def score(joint: Joint, how: Measured, report: dict[str, Any], allowed: set[str], wanted: set[str]) -> dict[str, Any]:
    """False statements, what is missing, what was said."""
    allowed = allowed | wanted | ({"dry_friction"} if joint.dry else set())
    allowed |= {"viscous_friction"} if joint.viscous else set()
    allowed |= {"friction"} if joint.dry or joint.viscous else set()
    false, said = [], []
    for effect in report["effects"]:
        said.append(effect["text"])
        if effect["name"] not in allowed:
            false.append(f"name: {effect['text']}")
        for key, truth, least in (*_truths(joint), *_modes(joint)):
            value = effect["parameters"].get(key)
            # three standard errors, and never nearer than a share that nobody minds
            if value and abs(value["value"] - truth) > max(3 * (value["stderr"] or 0.0), least * abs(truth)):
                false.append(f"{key} is {truth:.3g}: {effect['text']}")
    late = sum(float(text.split(" ms ")[0].split()[-1]) * (1 if " later " in text else -1)
               for text in report["measurement"] if " ms " in text)  # fmt: skip
    if abs(late - how.late) > 1.5 and not joint.spring_Hz:
        false.append(f"late by {how.late} ms, said {late:g}")
    if joint.hum and not any("17.3" in text for text in report["unexplained"]) and report["verdict"] == "explained":
        false.append("the hum is called noise")
    if report["verdict"] in ("explained", "nothing_missing") and (joint.spring_Hz and how.shake):
        false += [] if any(e["name"] == "elasticity" for e in report["effects"]) else ["an elasticity is called noise"]
    names = {effect["name"] for effect in report["effects"]}
    return {"false": false, "missing": sorted(wanted - names), "said": said, "unexplained": report["unexplained"],
            "verdict": report["verdict"], "gap": report["gap"]["held_out"]}  # fmt: skip


def _truths(joint: Joint) -> list[tuple[str, float, float]]:
    # what friction over load or direction means in the mean is no single number
    dry = joint.dry * (1 + joint.back / 2)
    plain = not (joint.by_load or joint.cooling)
    found = [("dry_friction_Nm", dry, 0.03), ("viscous_friction_Nm_s", joint.viscous, 0.05)] if plain else []
    return [
        *found,
        ("order_per_revolution", joint.order, 0.02),
        ("amplitude_Nm", joint.ripple, 0.5 if joint.drift else 0.1),
    ]


def _modes(joint: Joint) -> list[tuple[str, float, float]]:
    return [("resonance_Hz", 2**0.5 * joint.spring_Hz, 0.02), ("antiresonance_Hz", joint.spring_Hz, 0.02),
            ("damping_ratio", 2**0.5 * joint.damping, 0.3)]  # fmt: skip


def main(values: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.reconcile.joint.run", description=__doc__)
    parser.add_argument("--json", type=Path, default=Path("build/blind_joint.json"))
    parser.add_argument("--kind", default="", help="only kinds whose name contains this text")
    parser.add_argument("--seed", type=int, default=500, help="of the first case; below 500: to look at")
    options = parser.parse_args(values)
    results = []
    for number, kind in enumerate(name for name in KINDS if options.kind in name):
        for noise in range(len(NOISES)):
            with tempfile.TemporaryDirectory() as folder:
                try:
                    result = run_case(kind, noise, options.seed + 3 * number + noise, Path(folder))
                except Exception:  # a crash is a result
                    result = {
                        "kind": kind,
                        "noise": noise,
                        "false": [traceback.format_exc()[-600:]],
                        "missing": [],
                        "said": [],
                    }
            results.append(result)
            mark = "FALSE" if result["false"] else "silent" if result["missing"] else "right"
            told = [result[key] for key in ("said", "false", "missing")]
            sys.stdout.write(f"{mark:6} {kind}, noise {noise}: {told} {result.get('unexplained')}\n")
            sys.stdout.flush()
    false = sum(bool(one["false"]) for one in results)
    silent = sum(bool(one["missing"]) and not one["false"] for one in results)
    table = {"cases": len(results), "right": len(results) - false - silent, "silent": silent, "false": false}
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_text(json.dumps({"summary": table, "cases": results}, indent=1) + "\n")
    sys.stdout.write(f"{table}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
