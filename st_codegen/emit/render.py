"""Intermediate representation and a target -> text files. The only file that knows Jinja."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2

from st_codegen.emit.blocks.listing import Block, CodeSection
from st_codegen.emit.blocks.model import Limits
from st_codegen.emit.contents import Contents
from st_codegen.emit.scl_text import scl_section
from st_codegen.emit.targets.base import PLAIN, FileForm, FilePlan, Target

_IN_XML = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;"})


@dataclass(frozen=True)
class RenderedFile:
    """A file as it will be written: path below the target's folder, and its text piece by piece."""

    path: str
    pieces: Iterator[str]


def templates_folder() -> Path:
    """`templates/` of the installed package, or of the checkout."""
    installed = Path(str(files("st_codegen"))) / "templates"
    return installed if installed.is_dir() else Path(__file__).resolve().parents[2] / "templates"


def _environment(folder: Path, *, autoescape: bool) -> jinja2.Environment:
    """The templates of the package with the rules that hold for all of them."""
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=autoescape,
    )


@cache
def _templates(folder: Path, name: str) -> jinja2.Environment:
    """The templates of targets with the folder `name`. They lay out, Python decides; an undefined name is an error.

    Every template sees the macros of `common/macros.st.j2`, the dialect of that folder, and `code(block, section)`,
    which prints a section of a block by the section's own template. Templates are compiled once in a process.
    """
    templates = _environment(folder, autoescape=False)
    templates.filters["xml"] = _as_xml_text
    templates.filters["single_round"] = _single_round
    templates.filters["scl_section"] = scl_section

    def code(block: Block, section: CodeSection) -> str:
        template = templates.get_template(f"common/operations/{section.template}.st.j2")
        return template.render(block=block, **section.values)

    templates.globals["code"] = code
    templates.globals["dialect"] = templates.get_template(f"{name}/dialect.st.j2").module
    macros = templates.get_template("common/macros.st.j2").module
    templates.globals.update({name: macro for name, macro in vars(macros).items() if not name.startswith("_")})
    return templates


def _as_xml_text(text: str) -> str:
    """Text between tags or in double quotes."""
    return str(text).translate(_IN_XML)


def _single_round(body: str, variable: str, value: int) -> str:
    """The body of a loop that has one round, to stand without the loop."""
    return re.sub(rf"\b{variable}\b", str(value), re.sub(r"^ {4}", "", body, flags=re.MULTILINE))


def render(contents: Contents, target: Target, limits: Limits | None = None) -> Iterator[RenderedFile]:
    """The files of a project for one target, in a fixed order.

    All checks are made before the first file is handed out; texts are printed piece by piece while they are consumed,
    so that a table of millions of numbers is never a string. Raises InputError, TargetError.
    """
    return print_plans(target, list(target.plan(contents, limits or target.limits)))


def print_plans(target: Target, plans: Iterable[FilePlan]) -> Iterator[RenderedFile]:
    """The files that a target has planned, printed piece by piece while they are consumed."""
    templates = _templates(templates_folder(), target.templates)
    return (RenderedFile(plan.path, _print(templates, plan)) for plan in plans)


def render_report(template: str, values: Mapping[str, Any]) -> str:
    """A page of a report from `templates/`; text is escaped for HTML, an undefined name is an error."""
    return _environment(templates_folder(), autoescape=True).get_template(template).render(**values)


def _print(templates: jinja2.Environment, plan: FilePlan) -> Iterator[str]:
    pieces = templates.get_template(plan.template).generate(**plan.values)
    return pieces if plan.form == PLAIN else _formed(pieces, plan.form)


def _formed(pieces: Iterator[str], form: FileForm) -> Iterator[str]:
    """The pieces of a text as those of its file."""
    held = "\ufeff" if form.has_mark else ""
    for piece in pieces:
        if piece:
            yield held
            held = piece.replace("\n", form.line_end)
    yield held if form.ends_last_line else held.removesuffix(form.line_end)
