"""The documentation as a site: its build, its links, and that GitHub shows the same pages."""

import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

import pytest
from markdown_it import MarkdownIt

import urbantwin
from urbantwin.cli.commands import GROUPS, every_command

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.glob("**/*.md"))
#: What people read on GitHub.
TEXTS = [*PAGES, *sorted(ROOT.glob("*.md")), *sorted(ROOT.glob("notebook/*.md"))]
GITHUB = MarkdownIt("commonmark").enable(["table", "strikethrough"])

MakeOnce = Callable[[str, Callable[[Path], object]], Path]


class Read(HTMLParser):
    """What a page of HTML has: anchors, links, what it loads, and how many of each element."""

    def __init__(self, text: str, inside: str | None = None) -> None:
        super().__init__()
        self.anchors, self.links, self.loaded = set[str](), list[str](), list[str]()
        self.elements = Counter[str]()
        self._inside, self._depth = inside, 0
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        told = {name: value or "" for name, value in attrs}
        if told.get("id"):
            self.anchors.add(told["id"])
        if tag == "a" and told.get("name"):
            self.anchors.add(told["name"])
        if tag == "a" and "href" in told:
            self.links.append(told["href"])
        for name in ("src", "data", "poster", "srcset"):
            if told.get(name) and tag != "a":
                self.loaded.append(told[name])
        if tag == "link" and "canonical" not in told.get("rel", ""):
            self.loaded.append(told.get("href", ""))
        if self._inside is None or self._depth:
            self.elements[tag] += 1
        self._depth += tag == self._inside

    def handle_endtag(self, tag: str) -> None:
        self._depth -= tag == self._inside


@pytest.fixture(scope="module")
def site(made_once: MakeOnce) -> Path:
    """The site, built as `make docs` builds it but without the gallery's pictures."""
    return made_once("site", lambda folder: build(ROOT, folder / "site")) / "site"


def build(root: Path, out: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-m", "mkdocs", "build", "--strict", "--quiet", "-d", out],
        cwd=root, capture_output=True, text=True, check=False,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1", "PYTHONPATH": str(ROOT / "src")},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "WARNING" not in done.stderr


@cache
def read(path: Path) -> Read:
    return Read(path.read_text(encoding="utf-8"))


def broken(
    page: Path, links: Iterator[str] | list[str], anchors: Callable[[Path], set[str]]
) -> list[str]:
    """Return what a page links to in vain."""
    wrong = []
    for link in links:
        told = urlsplit(link)
        if told.scheme or told.netloc:
            continue
        target = (page.parent / unquote(told.path)).resolve() if told.path else page
        if not target.exists() or (
            told.fragment
            and target.suffix in {".md", ".html"}
            and unquote(told.fragment) not in anchors(target)
        ):
            wrong.append(f"{page.name}: {link}")
    return wrong


@pytest.mark.thorough
def test_every_link_of_the_site_leads_somewhere(site: Path) -> None:
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > len(PAGES)
    found = [
        one
        for page in pages
        if page.name != "404.html"
        for one in broken(
            page, read(page).links, lambda target: read(target).anchors | {"__tabbed"}
        )
    ]
    assert found == []


@cache
def github_anchors(page: Path) -> set[str]:
    """Anchors as GitHub makes them of headings: lower case, no punctuation, numbered."""
    tokens, seen, found = GITHUB.parse(page.read_text(encoding="utf-8")), Counter[str](), set[str]()
    for before, token in pairwise(tokens):
        if before.type == "heading_open":
            text = "".join(
                one.content for one in token.children or () if one.type in {"text", "code_inline"}
            )
            name = re.sub(r"[^\w\- ]", "", text.strip().lower()).replace(" ", "-")
            found.add(f"{name}-{seen[name]}" if seen[name] else name)
            seen[name] += 1
    return found | read_text_anchors(page)


def read_text_anchors(page: Path) -> set[str]:
    return Read(page.read_text(encoding="utf-8")).anchors


@pytest.mark.parametrize("page", TEXTS, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_on_github_leads_somewhere(page: Path) -> None:
    html = Read(GITHUB.render(page.read_text(encoding="utf-8")))
    assert broken(page, [*html.links, *html.loaded], github_anchors) == []


@pytest.mark.thorough
def test_the_site_shows_what_github_shows(site: Path) -> None:
    """Lists, tables, code: Python-Markdown and CommonMark read some of it in two ways."""
    counted = ("h1", "h2", "h3", "h4", "li", "tr", "td", "th", "pre", "blockquote", "strong")
    differ = {}
    for page in PAGES:
        if page.name == "gallery.md":
            continue  # it has pictures only here
        text = page.read_text().replace("<!-- shown", "<!--")
        theirs = Read(GITHUB.render(text)).elements
        article = re.search(
            r"<article.*?>(.*)</article>",
            (site / page.relative_to(DOCS).with_suffix(".html")).read_text(),
            re.DOTALL,
        )
        assert article is not None
        ours = Read(re.sub(r"<aside.*?</aside>", "", article[1], flags=re.DOTALL)).elements
        if wrong := {tag: (theirs[tag], ours[tag]) for tag in counted if theirs[tag] != ours[tag]}:
            differ[str(page.relative_to(DOCS))] = wrong
    assert differ == {}


@pytest.mark.thorough
def test_nothing_is_fetched_from_another_host(site: Path) -> None:
    loaded = {(page.name, what) for page in site.rglob("*.html") for what in read(page).loaded}
    assert len(loaded) > 100
    assert [one for one in loaded if urlsplit(one[1]).netloc] == []
    for style in site.rglob("*.css"):
        assert not re.search(r"(@import|url\()\s*[\"']?(https?:)?//", style.read_text()), style


@pytest.mark.thorough
def test_every_public_name_is_in_the_reference(site: Path) -> None:
    anchors = set[str]().union(
        *(read(page).anchors for page in (site / "reference").glob("*.html"))
    )
    names = {name for name in urbantwin.__all__ if not name.startswith("__")} - set(GROUPS)
    names |= {".".join(filter(None, words)) for words in every_command()}
    assert {name for name in names if f"urbantwin.{name}" not in anchors} == set()


@pytest.mark.thorough
def test_every_command_is_in_the_reference(site: Path) -> None:
    anchors = read(site / "reference" / "help.html").anchors
    assert {"-".join(filter(None, words)) for words in every_command()} <= anchors


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("words", "page"),
    [
        ("Webster", "method/signals.html"),
        ("drop-out", "method/returns.html"),
        ("yaw convention", "reference/labels.html"),
        ("add my own sensor", "howto/add_a_sensor.html"),
        ("train on my own data", "howto/train.html"),
    ],
)
def test_search_works_from_disk(
    site: Path, tmp_path: Path, chromium: Path, words: str, page: str
) -> None:
    """In real Chromium, without a server: the result names the page, and no error is logged."""
    done = subprocess.run(
        [chromium, "--headless=new", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=8000",
         f"--user-data-dir={tmp_path}", "--enable-logging=stderr", "--dump-dom",
         f"{(site / 'index.html').as_uri()}?q={quote(words)}"],
        capture_output=True, text=True, check=True, timeout=120,
    )  # fmt: skip
    assert re.search(r"md-search-result__meta\">[1-9]\d* matching document", done.stdout)
    assert page in done.stdout.partition("md-search-result__list")[2]
    assert "CONSOLE" not in done.stderr


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ("[there](nowhere.md) [here](index.md#no-such-heading)", ("nowhere.md", "no-such-heading")),
        ("[there](../src/no_such_file.py)", ("no_such_file.py",)),
    ],
)
def test_a_broken_link_breaks_the_build(tmp_path: Path, more: str, told: tuple[str, ...]) -> None:
    """With the same rules and hooks, on one page."""
    shutil.copytree(DOCS / "site_build", tmp_path / "docs" / "site_build")
    shutil.copytree(DOCS / "assets", tmp_path / "docs" / "assets")
    for path in (
        *ROOT.glob("*.md"),
        *(ROOT / name for name in ("LICENSE", "NOTICE", "CITATION.cff")),
    ):
        (tmp_path / path.name).write_text("# Text\n")
    (tmp_path / "src").symlink_to(ROOT / "src")
    (tmp_path / "docs" / "index.md").write_text(f"# Start\n\n{more}\n")
    rules = (ROOT / "mkdocs.yml").read_text()
    rules = re.sub(r"plugins:.*?(?=\n\n)", "plugins: []", rules, flags=re.DOTALL)
    rules = rules[: rules.index("\nnav:")] + "\n"
    (tmp_path / "mkdocs.yml").write_text(rules)
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "-d", tmp_path / "site"], cwd=tmp_path,
        capture_output=True, text=True, check=False,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1", "PYTHONPATH": str(ROOT / "src")},
    )  # fmt: skip
    assert done.returncode != 0
    assert all(one in done.stderr for one in told)
