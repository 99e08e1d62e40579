"""Writing generated files: staged in a temporary folder, moved into place, never half a project.

`st-codegen.json` beside the generated files lists them with the SHA-256 of their content (`traces`), so that a later
run removes what is no longer generated and leaves the user's own files alone, to which a generated file belongs once it
was changed by hand.
"""

from __future__ import annotations

import contextlib
import difflib
import hashlib
import json
import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from st_codegen.emit.blocks.model import block_name
from st_codegen.emit.manifest_shape import check_manifest
from st_codegen.emit.render import RenderedFile
from st_codegen.emit.targets import TARGETS
from st_codegen.emit.traces import without_traces
from st_codegen.errors import GeneratedCodeError, InputError, counted
from st_codegen.files.folders import link_file, replace_folder
from st_codegen.files.temporary import temporary_folder
from st_codegen.ir import ModelIR, OutputKind

MANIFEST = "st-codegen.json"
_FORMAT = 1
#: Lines of a change by hand that a message shows
_SHOWN = 30
#: What the manifest calls the facts of the models' purpose, whatever the purpose is: named after the first one.
PURPOSE = "transmission_error"
#: The files that the models were read from, with their SHA-256; a file saved again may hold the same model.
PROVENANCE = "provenance"
#: What the next run keeps: the layouts of models, and which of them share tables.
CHOICES = "choices"
#: What `compare` has to know: the blocks that the controller can run, and the fingerprint of the text.
COMPARISON = "comparison"
_FACTS = ("models", "blocks", PURPOSE, CHOICES, PROVENANCE, COMPARISON)


@dataclass(frozen=True)
class Manifest:
    """What a generated folder contains: files with the SHA-256 of their content, and the project's `driver.facts`."""

    files: Mapping[str, str]
    facts: Mapping[str, Any]

    @property
    def purpose(self) -> Mapping[str, Any]:
        """What the models are for, by its own words; empty for lone models."""
        found: Mapping[str, Any] = self.facts[PURPOSE]
        return found

    def text(self) -> str:
        """The manifest as JSON: one line a file, sorted, so that a change moves nothing else."""
        return json.dumps({"format": _FORMAT, "files": dict(self.files), **self.facts}, indent=1) + "\n"


def read_manifest(folder: Path) -> Manifest:
    """The manifest of a folder, empty where there is none. Raises GeneratedCodeError for one that cannot be read."""
    path = folder / MANIFEST
    if not path.is_file():
        return Manifest({}, {key: {} for key in _FACTS})
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        check_manifest(content)
        manifest = Manifest(dict(content["files"]), {key: dict(content.get(key, {})) for key in _FACTS})
        safe = content["format"] == _FORMAT and all(_is_below(name) for name in manifest.files)
    except (ValueError, RecursionError) as error:
        why = "nested too deeply" if isinstance(error, RecursionError) else error
        raise GeneratedCodeError(f"{path}: not readable ({why}); delete it and generate again") from None
    if not safe:
        raise GeneratedCodeError(f"{path}: written by another version, or changed; delete it and generate again")
    return manifest


def _without_provenance(text: str) -> str:
    """The text of a manifest without the hashes of the model files; what is no manifest stays as it is."""
    try:
        content = json.loads(text)
    except ValueError:
        return text
    return json.dumps({**content, PROVENANCE: {}}, indent=1) + "\n" if isinstance(content, dict) else text


def block_of(folder: Path, model: ModelIR) -> tuple[str, tuple[int, ...]]:
    """The block of a generated folder that computes a model, and which of the block's outputs are the model's.

    Raises GeneratedCodeError where the folder was generated without this model, or with other outputs or classes.
    """
    models = read_manifest(folder).facts["models"]
    facts = models.get(model.name)
    if facts is None:
        raise GeneratedCodeError(
            f"{folder}: no block {block_name(model.name)}"
            + "".join(f", but {block_name(name)} of the same model" for name in _names_of(model, models)[:1])
            + "; names or models have changed: name them as before, or generate again"
        )
    labels = [] if model.classes is None else list(model.classes.labels)
    if facts["outputs"] != list(model.outputs) or facts.get("labels", []) != labels:
        raise GeneratedCodeError(
            f"{folder}: {facts['block']} has other outputs or classes than the model now has: generate again, or give "
            "the same --outputs"
        )
    return facts["block"], tuple(facts.get("block_outputs", range(len(facts["outputs"]))))


def _names_of(model: ModelIR, models: Mapping[str, Any]) -> list[str]:
    """By which names a manifest has a model: one that computes the same."""
    return [name for name, facts in models.items() if model.source.digest == facts.get("digest", "") != ""]


def check_names(generated: Path, models: Sequence[ModelIR], prefix: str) -> None:
    """Raise GeneratedCodeError where generated folders have lone models by other names, and tell how to give these.

    `prefix` stands in front of the names of `models`. Models that are not there are told by `block_of`.
    """
    for folder in _folders_in(generated):
        known = read_manifest(folder).facts["models"]
        named = {model.name: _names_of(model, known) for model in models}
        if all(name in known for name in named) or not all(named.values()):
            continue
        was = dict.fromkeys(name for its in named.values() for name in its)
        if len(was) < len(named):  # a model that is there twice has one block
            continue
        raise GeneratedCodeError(
            f"{folder}: generated with the names {', '.join(was)}; the same models are called {', '.join(named)} now: "
            f"{_options(named, prefix)}, or generate again"
        )


def _options(named: Mapping[str, Sequence[str]], prefix: str) -> str:
    """What to give so that models get the names they were generated with; `named`: those, by the names they have."""
    own = {name.removeprefix(prefix): its for name, its in named.items()}
    first, names = next(iter(own.items()))
    for front in (name.removesuffix(first) for name in names if name.endswith(first)):
        if all(front + name in its for name, its in own.items()):
            return f"give --prefix {front}" if front else "give --prefix= (none)"
    if len(own) == len(names) == 1:
        kept = names[0].startswith(prefix)
        return f"give {'' if kept else '--prefix= '}--block-name {names[0].removeprefix(prefix)}"
    return "name the model files as they were"


def _models_in(generated: Path) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """The models of generated folders (`generated` is one, or holds them) by name, with the facts of each."""
    for folder in _folders_in(generated):
        yield from read_manifest(folder).facts["models"].items()


def _folders_in(generated: Path) -> tuple[Path, ...]:
    """A folder and those of targets in it, of which some are generated."""
    return (generated, *(generated / name for name in TARGETS))


def kinds_of_outputs(generated: Path) -> dict[str, tuple[OutputKind, ...]]:
    """For each classifier of generated folders (`generated` is one, or holds them), what its outputs are.

    Where the folders differ, the first one counts.
    """
    found: dict[str, tuple[OutputKind, ...]] = {}
    for name, facts in _models_in(generated):
        given = facts.get("kinds", ())
        found.setdefault(name, tuple(kind for kind in OutputKind if kind in given))
    return found


def is_real(generated: Path) -> bool:
    """Whether models of generated folders (`generated` is one, or holds them) are computed in REAL.

    Raises GeneratedCodeError where some are and others are not: they are compared with different models.
    """
    found = {"real" in facts for _, facts in _models_in(generated)}
    if len(found) > 1:
        raise GeneratedCodeError(f"{generated}: some targets were generated with --real and some without: name one")
    return found == {True}


def _is_below(name: str) -> bool:
    """Whether a name leads to a file below its folder, on every system."""
    path = PurePosixPath(name)
    return not path.is_absolute() and ".." not in path.parts and not {"\\", ":"} & set(name)


@contextlib.contextmanager
def staged(
    parent: Path, files: Iterable[RenderedFile], facts: Mapping[str, Any], tell: Callable[[Path], None] | None = None
) -> Iterator[Path]:
    """Write files and their manifest into a temporary folder in `parent`, removed at the end of the block.

    `tell` is told each file that is written.
    Raises InputError for names that are one name where case does not count, as on Windows, or that leave the folder.
    """
    with temporary_folder(parent) as folder:
        stage = folder / "stage"
        stage.mkdir()
        sums: dict[str, str] = {}
        taken: dict[str, str] = {}
        for file in files:
            if not _is_below(file.path):
                raise InputError(f"the generated file {file.path!r} would leave the folder: rename the project")
            other = taken.setdefault(file.path.casefold(), file.path)
            if other != file.path:
                raise InputError(f"the generated files {other} and {file.path} differ in case only: rename a model")
            sums[file.path] = _write(stage / file.path, file.pieces)
            if tell is not None:
                tell(stage / file.path)
        (stage / MANIFEST).write_text(
            Manifest(dict(sorted(sums.items())), facts).text(), encoding="utf-8", newline="\n"
        )
        yield stage


def _write(path: Path, pieces: Iterable[str]) -> str:
    """Write a text piece by piece; returns the SHA-256 of its content, which editors' traces do not change."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        for piece in pieces:
            file.write(piece.encode("utf-8"))
    return hashlib.sha256(content_of(path)).hexdigest()


def content_of(path: Path) -> bytes:
    """The content of a generated file, by which it is compared: without the traces of editors."""
    return without_traces(path.name, path.read_bytes())


def generated_names(folder: Path) -> list[str]:
    """The files of a folder that are ours, the manifest included."""
    files = read_manifest(folder).files
    return [*files, MANIFEST] if files else []


def changed_since(folder: Path) -> tuple[str, ...]:
    """The generated files of a folder that are not as they were written, or are gone."""
    files = read_manifest(folder).files
    return tuple(name for name, sha256 in files.items() if not _is_as_written(folder / name, sha256))


def check_place(folder: Path) -> None:
    """Raise InputError where the generated folder cannot stand: a link or a file has its name."""
    if folder.is_symlink():
        raise InputError(
            f"{folder} is a symbolic link, which the generated folder would replace: generate into the folder that it "
            "points to, or remove the link"
        )
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; the generated files need a folder of this name")


def install(stage: Path, folder: Path, *, force: bool = False) -> tuple[str, ...]:
    """Put a staged folder in place of `folder`; files in `folder` that are not generated are kept.

    Returns the files of an earlier run that are no longer generated and are kept all the same, since they have been
    changed after they were generated.

    The new folder is completed beside the old one and exchanged with it in one step (two where the system cannot), so
    that a crash leaves the old project or the new one. Raises InputError where a file of the user's has the name of a
    generated one, and, without `force`, where a generated file that is not as it would be written now was changed by
    hand: it shows the change.
    """
    check_place(folder)
    if not folder.exists():
        stage.rename(folder)
        return ()
    if not force:
        _refuse_to_lose_changes(folder, stage)
    changed = _keep_user_files(folder, stage)
    replace_folder(stage, folder)
    return changed


def _keep_user_files(folder: Path, stage: Path) -> tuple[str, ...]:
    """Bring the user's own files over; unchanged generated files get their old times, so that no tool reloads them.

    Returns the orphans that were changed by hand, which count as the user's own.
    """
    sums = read_manifest(folder).files
    new = {path.relative_to(stage).as_posix() for path in stage.rglob("*") if path.is_file()}
    changed = tuple(name for name in sums if name not in new and not _is_as_written(folder / name, sums[name]))
    # a solution is one thing in several files of one name: where one of them was changed, the others stay with it
    kept = {PurePosixPath(name).with_suffix("") for name in changed}
    together = {name for name in sums if name not in new and PurePosixPath(name).with_suffix("") in kept}
    ours = {*sums, MANIFEST}.difference(together)
    spelt = {name.casefold(): name for name in new}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        target = stage / name
        if path.is_dir() and not path.is_symlink():
            if name not in ours and not target.exists() and _holds_user_files(path, folder, ours):
                target.mkdir(parents=True)
        elif name not in ours:
            if (other := spelt.get(name.casefold(), name)) != name:
                raise InputError(f"{path} differs from the generated {other} in case only: rename or delete it")
            if target.exists() and not _same_content(path, target):
                raise InputError(
                    f"{path} was not generated, but a generated file has the same name: rename or delete it"
                )
            if not target.exists():
                target.parent.mkdir(parents=True, exist_ok=True)
                link_file(path, target)
        elif target.exists() and _same_content(path, target):
            shutil.copy2(path, target)  # with its traces and times, so that no tool reloads it
    return tuple(name for name in changed if os.path.lexists(folder / name))


def _is_as_written(path: Path, sha256: str) -> bool:
    """Whether a file still has the content that was written."""
    if path.is_symlink() or not path.is_file():
        return False
    return sha256 in (hashlib.sha256(text).hexdigest() for text in (content_of(path), path.read_bytes()))


def _same_content(path: Path, target: Path) -> bool:
    """Whether two files differ in traces of editors at most."""
    if not (path.is_file() and target.is_file()):
        return False
    found, wanted = path.read_bytes(), target.read_bytes()
    return found == wanted or without_traces(path.name, found) == without_traces(target.name, wanted)


#: Files in which a development environment keeps what belongs to a controller: targets, terminals, links.
_SOLUTION = (".sln", ".tsproj")


def _refuse_to_lose_changes(folder: Path, stage: Path) -> None:
    """Raises InputError where a generated file that was changed by hand would be overwritten by another text."""
    lost = [
        name
        for name, sha256 in read_manifest(folder).files.items()
        if (folder / name).is_file() and (stage / name).is_file()
        if not _is_as_written(folder / name, sha256) and not _same_content(folder / name, stage / name)
    ]
    if not lost:
        return
    lines = [line for name in lost for line in FileChange.between(name, folder, stage).lines()]
    shown = "\n".join(line.rstrip("\n") for line in lines[:_SHOWN])
    more = f"\n.. and {counted(len(lines) - _SHOWN, 'more line')}" if len(lines) > _SHOWN else ""
    systems = any(Path(name).suffix in _SOLUTION for name in lost)
    solution = "; a solution that is yours from now on stays as it is with --project plc" if systems else ""
    raise InputError(
        f"{len(lost)} generated file{' was' if len(lost) == 1 else 's were'} changed by hand and would be overwritten: "
        f"{', '.join(str(folder / name) for name in lost)}. Put the change into the model or the configuration, or "
        f"into a file of your own{solution}; --force overwrites. On disk (-) and as generated now (+):\n{shown}{more}"
    )


@dataclass(frozen=True)
class FileChange:
    """A generated file on disk and as it would be written now, line by line, without editors' traces."""

    path: Path
    before: tuple[str, ...]
    after: tuple[str, ...]

    @classmethod
    def between(cls, name: str, folder: Path, stage: Path, *, provenance: bool = False) -> FileChange:
        """The file of a name in the generated folder and in the staged one; empty where it is in one only."""
        return cls(folder / name, *(_lines(root / name, provenance=provenance) for root in (folder, stage)))

    def lines(self) -> Iterator[str]:
        """The unified diff."""
        return difflib.unified_diff(self.before, self.after, f"{self.path} (on disk)", f"{self.path} (generated)")

    def counts(self) -> tuple[int, int]:
        """How many lines only the new and only the old text has, wherever they stand."""
        before, after = Counter(self.before), Counter(self.after)
        return (after - before).total(), (before - after).total()


def _lines(path: Path, *, provenance: bool) -> tuple[str, ...]:
    """The lines of a generated file as they are compared."""
    if not path.is_file():
        return ()
    text = content_of(path).decode("utf-8", errors="backslashreplace")
    if path.name == MANIFEST and not provenance:
        text = _without_provenance(text)
    return tuple(text.splitlines(keepends=True))


def _holds_user_files(path: Path, folder: Path, ours: set[str]) -> bool:
    inside = [p for p in path.rglob("*") if not p.is_dir() or p.is_symlink()]
    return not inside or any(p.relative_to(folder).as_posix() not in ours for p in inside)
