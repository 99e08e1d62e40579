"""`fleet.toml`: which axes there are, where their campaigns stand, and how their models are trained.

[defaults]                           # of all axes; each key may stand in an [[axis]], too
rig = "rig.toml"
target = "twincat"
families = ["ERT", "LGBM", "SVM"]

[[axis]]
name = "r01"
campaign = "r01/2026"                # a folder of curves, or a harmonic table
earlier = ["r01/2024", "r01/2025"]   # campaigns of before, the oldest first
rig = "r01/rig.toml"
type = "RV 160N"                     # compared are axes of a type; default: the name of the rig

[[axis]]                             # one for each path that matches; the star is its name, in all paths here
campaign = "robots/*/2026"
earlier = ["robots/*/2025"]
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

from st_codegen.emit.literals import MAX_IDENTIFIER, identifier
from st_codegen.emit.targets import target_named
from st_codegen.errors import Problems
from st_codegen.files.folders import is_device
from st_codegen.files.toml_tables import TomlTable, read_toml, shown
from st_codegen.rig.model import RigModel, read_rig
from st_codegen.training.export import FORMATS
from st_codegen.training.families import FAMILIES, candidates, family_named
from st_codegen.training.learn import only_exportable
from st_codegen.training.study import LARGEST_SEED, SearchSettings

#: A folder's name on every system: no dots, so that none is a way out of its folder or one of the fleet's own files.
_NAME = re.compile(rf"[A-Za-z0-9](?:[A-Za-z0-9_-]{{0,{MAX_IDENTIFIER - 2}}}[A-Za-z0-9])?")
_OF_ONE_AXIS = ("name", "campaign", "earlier")


class TextCheck(StrEnum):
    """How the text of an axis is checked."""

    PROVE = "prove"  # for every input
    VERIFY = "verify"  # on a sample, for targets and models that prove does not follow


@dataclass(frozen=True)
class AxisOptions:
    """How the models of an axis are trained, compiled and checked; `train` and `generate` explain each option."""

    target: str = "twincat"
    check: TextCheck = TextCheck.PROVE
    orders: tuple[int, ...] | None = None
    most_orders: int = 15
    families: tuple[str, ...] = tuple(FAMILIES)
    folds: int = 10
    seed: int = 0
    test_share: float = 0.2
    limit_us: float = math.inf
    format: str = FORMATS[0]
    skip_bad: bool = False
    keep_faulty: bool = False
    as_is: bool = False
    share: bool = False

    def settings(self) -> SearchSettings:
        """The search. Raises InputError where no family can be saved in the format."""
        return only_exportable(SearchSettings(candidates(self.families), self.folds, self.seed), self.format)


@dataclass(frozen=True)
class FleetAxis:
    """One axis: name, type, the newest campaign and those before it (the oldest first), its rig, and its options.

    shared: below the fleet's folder, where the models stand that it may share; empty: it shares none.
    """

    name: str
    type: str
    campaign: Path
    earlier: tuple[Path, ...]
    rig: Path
    options: AxisOptions
    shared: str = ""


def read_fleet(path: Path) -> tuple[FleetAxis, ...]:
    """The axes of a fleet.toml; paths in it are relative to its folder. Raises one InputError with every problem."""
    problems, rigs = Problems(str(path)), _Rigs()
    base = path.parent.resolve()
    axes: list[FleetAxis] = []
    with TomlTable(read_toml(path), "", problems) as file:
        with file.table("defaults") as defaults:
            options = _options(defaults, AxisOptions())
            for key in _OF_ONE_AXIS:
                if key in defaults:
                    defaults.note(f"'{key}' is of one axis: give it in [[axis]]")
                    defaults.declare(key)  # no unknown key, nor one that others are told of
            common = {key: defaults.text(key, "") for key in ("rig", "type")}
        for table in file.tables("axis", required=True):
            with table:
                axes += _axes(table, common, options, base, rigs)
    _check_different(axes, problems)
    problems.raise_if_any()
    return tuple(axes)


class _Rigs:
    """Rigs that were read; each file is read once, and what is wrong with it is said once."""

    def __init__(self) -> None:
        self._read: dict[Path, RigModel | None] = {}

    def name(self, path: Path, table: TomlTable) -> str:
        """The name of a rig; empty, with a note at the first time, where it cannot be read."""
        if path not in self._read:
            self._read[path] = None
            with table.collect():
                self._read[path] = read_rig(path)
        rig = self._read[path]
        return "" if rig is None else rig.name


def _axes(
    table: TomlTable, common: Mapping[str, str], base_options: AxisOptions, base: Path, rigs: _Rigs
) -> list[FleetAxis]:
    """The axes of a table: one, or one for each path that its pattern matches."""
    options = _options(table, base_options)
    name, campaign = table.text("name", ""), table.text("campaign")
    table.declare("earlier")
    earlier = table.list_of("earlier", lambda key, entry: _path_of(table, key, entry)) if "earlier" in table else None
    if table.values.get("earlier") == []:
        table.note("earlier is empty: name a campaign of before, or leave the key out")
    rig, kind = table.text("rig", common["rig"]), table.text("type", common["type"])
    if not rig:
        table.note("'rig' is missing (here or in [defaults]): what the measurements are compared with")
    many = "*" in campaign
    if many == bool(name):
        table.note("the star in campaign gives the names: leave name out" if many else "'name' is missing")
    found = _matched(table, base, campaign) if many else {name: base / campaign}
    axes = []
    for own, path in found.items():
        before = [base / text.replace("*", own) for text in earlier or ()]
        if many:  # not every axis was measured before: the report names those that were not
            before = [one for one in before if one.exists()]
        for one in [path, *before] if campaign else []:
            if not one.exists():
                table.note(f"there is no campaign {one}")
        rig_file = base / rig.replace("*", own)
        rig_name = rigs.name(rig_file, table) if rig else ""
        if own and _is_name(table, own):
            axes.append(FleetAxis(own, kind or rig_name, path, tuple(before), rig_file, options))
    if many and earlier and axes and not any(axis.earlier for axis in axes):
        table.note("earlier: nothing matches")
    return axes


def _path_of(table: TomlTable, key: str, entry: Any) -> str | None:
    if isinstance(entry, str) and entry:
        return entry
    table.note(f"{key}: {shown(entry)} is not a path")
    return None


def _matched(table: TomlTable, base: Path, pattern: str) -> dict[str, Path]:
    """What a pattern with one star matches: the text of the star -> path, by name."""
    parts = Path(pattern).parts
    starred = [number for number, part in enumerate(parts) if "*" in part]
    if pattern.count("*") != 1:
        table.note(f"campaign = {shown(pattern)}: one star, which stands for the name of the axis")
        return {}
    parent, rest = base.joinpath(*parts[: starred[0]]), parts[starred[0] + 1 :]
    front, back = parts[starred[0]].split("*")
    found = {}
    for path in sorted(parent.iterdir()) if parent.is_dir() else []:
        is_match = path.name.startswith(front) and path.name.endswith(back) and len(path.name) > len(front + back)
        if is_match and not path.name.startswith(".") and path.joinpath(*rest).exists():
            found[path.name[len(front) : len(path.name) - len(back)]] = path.joinpath(*rest)
    if not found:
        table.note(f"campaign = {shown(pattern)}: nothing matches below {parent}")
    return found


def _is_name(table: TomlTable, name: str) -> bool:
    """Whether an axis can have a name: it is that of a folder on every system, and of a project in the PLC."""
    if is_device(name):
        table.note(
            f"name = {shown(name)}: Windows has no folder of this name, which is that of a device; rename the axis"
        )
        return False
    if not _NAME.fullmatch(name):
        what = f"letters, digits, '_' and '-' inside, at most {MAX_IDENTIFIER} (it names a folder and a PLC project)"
        table.note(f"name = {shown(name)}: {what}")
        return False
    with table.collect():
        identifier(name, "axis name")
        return True
    return False


def _check_different(axes: Sequence[FleetAxis], problems: Problems) -> None:
    """Note names that a folder on some systems cannot tell apart, and campaigns that are named twice."""
    names: dict[str, str] = {}
    campaigns: dict[Path, str] = {}
    for axis in axes:
        known = names.setdefault(axis.name.lower(), axis.name)
        if known != axis.name:
            problems.add(f"the axes '{known}' and '{axis.name}' differ in case only: rename one")
        elif sum(other.name == axis.name for other in axes) > 1:
            problems.add(f"two axes are called '{axis.name}': rename one")
        for path in (axis.campaign, *axis.earlier):
            place = path.resolve()
            if place in campaigns:
                owners = " and ".join(dict.fromkeys((f"'{campaigns[place]}'", f"'{axis.name}'")))
                problems.add(f"a campaign is named twice, by {owners}: {path}")
            campaigns[place] = axis.name


def _options(table: TomlTable, base: AxisOptions) -> AxisOptions:
    """The options of a table, and where it has none those of `base`."""
    options = replace(
        base,
        most_orders=table.whole("most_orders", base.most_orders, low=1),
        folds=table.whole("folds", base.folds, low=2),
        seed=table.whole("seed", base.seed, high=LARGEST_SEED),
        test_share=table.number("test_share", base.test_share, low=0.01, high=0.9),
        skip_bad=table.flag("skip_bad", base.skip_bad),
        keep_faulty=table.flag("keep_faulty", base.keep_faulty),
        as_is=table.flag("as_is", base.as_is),
        share=table.flag("share", base.share),
        target=table.text("target", base.target),
        format=table.text("format", base.format),
    )
    if "limit_us" in table:
        options = replace(options, limit_us=table.number("limit_us", low=0.0, unit="us"))
    if "check" in table:
        options = replace(options, check=table.choice("check", TextCheck) or base.check)
    if table.values.get("orders", "auto") == "auto":
        options = replace(options, orders=base.orders if "orders" not in table else None)
    else:
        options = replace(options, orders=tuple(sorted(set(table.list_of("orders", table.whole_of)))))
        if not options.orders and table.is_sound:
            table.note('orders is empty; leave it out, or write orders = "auto"')
    if "families" in table:
        options = replace(options, families=table.list_of("families", lambda _, entry: _family(table, entry)))
        if not options.families and table.is_sound:
            table.note(f"families is empty; known are {', '.join(FAMILIES)}")
    table.declare("limit_us", "check", "orders", "families")
    with table.collect():
        target_named(options.target)
    if options.share and options.orders is None and table.is_sound:
        table.note("share: axes share models of the same orders only; give orders = [..]")
    if options.format not in FORMATS:
        table.note(f"format = {shown(options.format)}; known are {', '.join(FORMATS)}")
    elif table.is_sound:
        with table.collect():
            options.settings()
    return options


def _family(table: TomlTable, entry: Any) -> str | None:
    with table.collect():
        return family_named(str(entry)).name
    return None
