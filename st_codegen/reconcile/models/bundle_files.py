"""A bundle with terms: the old folder's files, one ONNX model an effect and direction, tables in bundle.toml."""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from st_codegen.errors import InputError, Problems
from st_codegen.project.bundle import Bundle
from st_codegen.reconcile.models.formula import FormulaNode, evaluate, write_onnx
from st_codegen.reconcile.models.terms import SIGN, Decision, Part, inputs_of
from st_codegen.te.bundle_file import BUNDLE_FILE, LARGEST_PLAY, read_description
from st_codegen.te.harmonics import Direction, Play, TransmissionError
from st_codegen.te.purpose import transmission_error

_ORDERS = re.compile(r"^(\s*orders\s*=\s*)\[[^\]]*\]", re.MULTILINE)
_PLAY = re.compile(
    r"^([ \t]*\[[ \t]*play[ \t]*\].*\n(?:(?![ \t]*\[).*\n)*?[ \t]*angle_deg[ \t]*=[ \t]*)[^\s#]+", re.MULTILINE
)


def check_changeable(file: Path) -> None:
    """Raise InputError where the orders or the play of a bundle.toml are written so that nothing can change them."""
    text, problems = file.read_text(encoding="utf-8-sig"), Problems(str(file))
    if not _ORDERS.search(text):
        problems.add("write the orders as a line `orders = [..]`, which terms may add to")
    if read_description(file).play is not None and not _PLAY.search(text):
        problems.add("write the play as a table `[play]` with a line `angle_deg = ..`, which terms may change")
    problems.raise_if_any()


def write_updated(bundle: Bundle, folder: Path, decisions: Sequence[Decision], target: Path) -> tuple[str, ...]:
    """Copy a bundle's folder to `target`, with the terms that enter it. Returns the names of the new files.

    The text of bundle.toml stays as it is but for its list of orders and its play; tables are added at its end.
    """
    te = transmission_error(bundle)
    inputs = inputs_of(te)
    target.mkdir(parents=True)
    for path in sorted(folder.iterdir()):
        if path.is_file():
            shutil.copyfile(path, target / path.name)
    entered = [decision for decision in decisions if decision.entered]
    groups: dict[tuple[str, Direction], list[Part]] = {}
    for decision in entered:
        for part in decision.parts:
            groups.setdefault((part.name, part.direction), []).append(part)
    places: dict[Part, tuple[str, int]] = {}
    files = []
    for (name, direction), parts in groups.items():
        file = _free_name(f"{name}_{direction}", target)
        nodes: list[FormulaNode] = []
        for part in parts:
            places[part] = (file, len(nodes))
            nodes += [part.cosine] if part.order == 0 else [part.cosine, part.sine]
        orders = ", ".join(str(part.order) for part in parts)
        write_onnx(target / file, nodes, inputs, f"{name}, {direction}, orders {orders}")
        files.append(file)
    text = (folder / BUNDLE_FILE).read_text(encoding="utf-8")
    wanted = [*te.orders, *(decision.order for decision in entered if decision.new)]
    text = _ORDERS.sub(lambda found: f"{found[1]}{wanted}", text, count=1).rstrip("\n") + "\n"
    text += "".join(_tables(decision, places) for decision in entered)
    play = None if te.play is None else replace(te.play, angle_deg=_play_deg(te, te.play, entered))
    if play is not None and play != te.play:
        text = _PLAY.sub(lambda found: f"{found[1]}{play.angle_deg!r}", text, count=1)
    (target / BUNDLE_FILE).write_text(text, encoding="utf-8", newline="\n")
    written = read_description(target / BUNDLE_FILE)
    if list(written.orders) != wanted or written.play != play:
        raise InputError(
            f"{folder / BUNDLE_FILE}: the list of orders or the play is written in a way that cannot be changed"
        )
    return tuple(files)


def _play_deg(te: TransmissionError, play: Play, entered: Sequence[Decision]) -> float:
    """The play with what the terms of the mean add to it: backward less forward, without load, at the lowest speed."""
    at = {}
    for number, (feature, name) in enumerate(zip(te.features, inputs_of(te), strict=True)):
        low, high = feature.lower or 0.0, feature.upper or 0.0
        value = low if number == te.speed_feature else (low + high) / 2.0
        at[name] = np.array([0.0 if number == play.torque_feature else value])
    added = sum(
        -SIGN[part.direction] * float(evaluate([part.cosine], at)[0, 0])
        for decision in entered
        for part in decision.parts
        if part.order == 0
    )
    return min(max(play.angle_deg + added, 0.0), LARGEST_PLAY)


def _free_name(stem: str, folder: Path) -> str:
    """A file name whose stem no other model has."""
    taken = {path.stem.lower() for path in folder.iterdir()}
    number, name = 1, stem
    while name.lower() in taken:
        number += 1
        name = f"{stem}_{number}"
    return f"{name}.onnx"


def _tables(decision: Decision, places: dict[Part, tuple[str, int]]) -> str:
    """The tables of one order: the first part of a new order is its harmonic, the others are added."""
    lines = []
    seen = set()
    for part in decision.parts:
        kind = "harmonic" if decision.new and part.direction not in seen else "term"
        seen.add(part.direction)
        file, output = places[part]
        lines += ["", f"[[{kind}]]", f'direction = "{part.direction}"', f"order = {part.order}"]
        if part.order == 0:
            lines.append(f'amplitude = {{file = "{file}", output = {output}}}')
        else:
            lines.append(f'cosine = {{file = "{file}", output = {output}}}')
            lines.append(f'sine = {{file = "{file}", output = {output + 1}}}')
    return "\n".join(lines) + "\n"
