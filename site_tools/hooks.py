"""What the site has beside the files of `docs/`: pages that are read from the code, and files of the repository.

`mkdocs.yml` names this module; `make site` builds it all.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

from site_tools import commands, gallery, problems
from site_tools.markdown import for_the_site, with_pages

ROOT = Path(__file__).resolve().parent.parent
#: Pages that are made of the code, by their names below `docs/`.
MADE: dict[str, Callable[[], str]] = {
    "reference/commands.md": commands.page,
    "gallery.md": gallery.page,
    "reference/problems.md": problems.page,
}
#: Files of the repository, by the names of their pages.
TAKEN = {
    "CHANGELOG.md": "repository/changelog.md",
    "CONTRIBUTING.md": "repository/contributing.md",
    "SECURITY.md": "repository/security.md",
    "examples/effects/README.md": "repository/own_effects.md",
    "examples/motion/README.md": "repository/example_motion.md",
    "examples/user_repository/README.md": "repository/example_repository.md",
}


def on_files(files: Any, config: Any) -> Any:
    """Add the pages that stand in no file of `docs/`."""
    for name, make in MADE.items():
        files.append(File.generated(config, name, content=make()))
    for path, name in TAKEN.items():
        text = (ROOT / path).read_text(encoding="utf-8")
        files.append(File.generated(config, name, content=with_pages(text, _from(path, name))))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """The page as the generator reads Markdown, with links to other files of the repository mended."""
    name = page.file.src_uri
    if name not in TAKEN.values():
        markdown = with_pages(markdown, _from(f"docs/{name}", name))
    return for_the_site(markdown)


def _from(path: str, name: str) -> dict[str, str]:
    """Links as a file of the repository writes them, and where its page finds them."""
    folder = posixpath.dirname(path)
    links = {}
    for other, other_name in TAKEN.items():
        links[posixpath.relpath(other, folder or ".")] = posixpath.relpath(other_name, posixpath.dirname(name) or ".")
    if not path.startswith("docs/"):
        for file in sorted((ROOT / "docs").rglob("*.md")):
            other = file.relative_to(ROOT).as_posix()
            target = posixpath.relpath(other.removeprefix("docs/"), posixpath.dirname(name) or ".")
            links[posixpath.relpath(other, folder or ".")] = target
    return links


def on_post_page(output: str, **_: Any) -> str:
    """Nothing on a page is read from elsewhere."""
    loaded = re.findall(r"<(?:script|link|img|iframe)\b[^>]*?(?:src|href)=\"(?:https?:)?//[^\"]*\"[^>]*>", output)
    outside = [tag for tag in loaded if 'rel="canonical"' not in tag]
    if outside:
        raise ValueError(f"a page loads something from elsewhere: {outside[0]}")
    return output
