"""Pages that only the site has: files of the repository, the reference, the gallery.

mkdocs calls the functions ``on_*`` (``hooks:`` in ``mkdocs.yml``). Pages in `docs/` link to files
of the repository as they do on disk (``../src/...``), and the site has a page for each such
file. The notebook is not part of the site: a link to it becomes the name of the file.
"""

import html
import json
import posixpath
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
GALLERY = ROOT / "build" / "gallery"
sys.path.insert(0, str(Path(__file__).parent))

from basis import long_pages  # noqa: E402
from reference import command_page, field_page, python_pages  # noqa: E402

#: A link of a page to a file: its text, path and anchor.
LINK = re.compile(r"\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)#\s:]+)(#[^)\s]*)?\)")
#: Where the gallery shows a picture or a saved page: the comment is invisible anywhere else.
SHOWN = re.compile(r"<!-- shown: (\S+) \| (.+?) -->")
#: Of the repository's own pages, which the site has whether a page links to them or not.
OWN = (
    *("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md"),
    *("LICENSE", "NOTICE", "CITATION.cff"),
)
#: GitHub nests in an item by the width of its mark, Python-Markdown by four blanks.
NESTED = re.compile(r"^(?=(?: {3}| {5})\S)", re.MULTILINE)
#: A paragraph of an item and the next item: Python-Markdown wants a blank line between them.
NEXT_ITEM = re.compile(r"(\n\n(?: {4,}(?!- |\d+\. )\S.*\n)+)(?= *(?:\d+\.|-) )")
FENCED = re.compile(r"(^ *(`{3,}).*?^ *\2 *$)", re.DOTALL | re.MULTILINE)
LANGUAGES = {".py": "python", ".csv": "text", ".yaml": "yaml", ".yml": "yaml", ".json": "json"}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that only the site has."""
    linked = {
        path
        for file in files.documentation_pages()
        for path in _outside(file.content_string, file.src_uri)
        if not path.startswith("notebook/")
    }
    for path in sorted({*OWN} | linked):
        if not (ROOT / path).is_file():
            raise PluginError(f"a page links to {path}, which is not in the repository")
        files.append(File.generated(config, _page_of(path), content=_shown_file(path)))
    for name, text in reference_pages().items() if "mkdocstrings" in config.plugins else ():
        files.append(File.generated(config, f"reference/{name}", content=text))
    for file in sorted(GALLERY.rglob("*")) if GALLERY.is_dir() else ():
        if file.is_file():
            name = f"gallery/{file.relative_to(GALLERY).as_posix()}"
            files.append(File.generated(config, name, abs_src_path=str(file)))
    return files


def reference_pages() -> dict[str, str]:
    """Return the pages of the reference, by name."""
    return {
        **python_pages(),
        **long_pages(),
        "help.md": command_page(),
        "fields.md": field_page(),
    }


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Point links at the pages made above, and show what the gallery has."""
    if page.file.src_uri == "index.md":
        page.meta |= {"title": "UrbanTwin", "hide": ["navigation", "toc"]}
    if page.file.src_uri.startswith("reference/") and page.file.generated_by:
        return markdown
    pieces = FENCED.split(markdown)  # text, fenced block, its fence, text, ...
    pieces[::3] = (NEXT_ITEM.sub(r"\1\n", NESTED.sub(" ", text)) for text in pieces[::3])
    del pieces[2::3]
    markdown = "".join(pieces)
    if page.file.src_uri.startswith("repository/"):
        return markdown
    markdown = LINK.sub(lambda link: _linked(link, page.file.src_uri), markdown)
    return SHOWN.sub(lambda comment: _shown(comment[1], comment[2]), markdown)


def _outside(markdown: str, page: str) -> Iterator[str]:
    """Yield the files of the repository outside `docs/` that a page links to."""
    for link in LINK.finditer(markdown):
        if (path := _file_of(link[2], page)) and not path.startswith("docs/"):
            yield path


def _file_of(link: str, page: str) -> str:
    """Return the path from the repository's root of what a page in `docs/` links to."""
    if page.startswith("repository/") or not link.startswith("../"):
        return ""
    return posixpath.normpath(posixpath.join("docs", posixpath.dirname(page), link))


def _linked(link: re.Match[str], page: str) -> str:
    """Return a link as the site has it."""
    path = _file_of(link[2], page)
    if not path or path.startswith("docs/"):
        return link[0]
    if path.startswith("notebook/"):
        return _in_notebook(link[1], path)
    to = posixpath.relpath(_page_of(path), posixpath.dirname(page) or ".")
    return f"[{link[1]}]({to}{link[3] or ''})"


def _in_notebook(text: str, path: str) -> str:
    return f"{text} (`{path}` in the repository)"


def _page_of(path: str) -> str:
    return f"repository/{path if path.endswith('.md') else path + '.md'}"


def _shown_file(path: str) -> str:
    text = (ROOT / path).read_text(encoding="utf-8")
    if path.endswith(".md"):
        # It stands one folder deeper in the site than in the repository.
        text = LINK.sub(
            lambda link: (
                _in_notebook(link[1], link[2]) if link[2].startswith("notebook/") else link[0]
            ),
            text,
        )
        text = re.sub(r"\]\(docs/", "](../", text)
        return re.sub(
            r"\]\((?!\.\./|[a-z]+:|#)([^)#\s]+)",
            lambda link: f"]({Path(_page_of(link[1])).relative_to('repository')}",
            text,
        )
    title = f"# {Path(path).name}\n\n`{path}`\n\n"
    if path.endswith(".ipynb"):
        cells = "\n\n".join(map(_cell, json.loads(text)["cells"]))
        return title + re.sub(r"\]\(\.\./docs/", "](../../", cells)
    return f"{title}````{LANGUAGES.get(Path(path).suffix, 'text')}\n{text.rstrip()}\n````\n"


def _cell(cell: dict[str, Any]) -> str:
    source = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        return re.sub(r"^#", "##", source, flags=re.MULTILINE)
    return f"```python\n{source}\n```"


def _shown(name: str, caption: str) -> str:
    if not (GALLERY / name).is_file():
        if GALLERY.is_dir() and not name.endswith(".html"):
            raise PluginError(f"the gallery has no {name}: remove {GALLERY.name} and make docs")
        return f'!!! note ""\n    {caption}: not made in this build; `make docs` makes it.\n'
    where, told = f"gallery/{name}", html.escape(caption)
    if name.endswith(".html"):
        return f"[{caption}]({where}){{ .md-button }}\n"
    return (
        f'<figure markdown="span">\n[![{told}]({where}){{ loading=lazy }}]({where})\n'
        f"<figcaption>{told}</figcaption>\n</figure>\n"
    )
