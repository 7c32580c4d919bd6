"""What every page is: well-formed, with a policy that allows what is its own, and no other file."""

import base64
import hashlib
import re
from html.parser import HTMLParser

#: Elements without an end.
VOID = {"meta", "img", "br"}
#: Elements that load or send something.
FORBIDDEN = {"link", "iframe", "object", "embed", "base", "form", "video", "audio"}


class WholePage(HTMLParser):
    """A page as it is read by the standard library: its elements, texts, styles and scripts.

    Attributes:
        tags: (name, attributes) in their order.
        texts: what is seen of the page, without its style and script.
        cells: texts of the cells of tables.
        content: texts of ``style`` and ``script``.
    """

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.cells: list[str] = []
        self.content: dict[str, list[str]] = {"style": [], "script": []}
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag in ("td", "th"):
            self.cells.append("")
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        kind = self._open[-1] if self._open else ""
        if kind in self.content:
            self.content[kind].append(data)
            return
        self.texts.append(data)
        if {"td", "th"} & set(self._open):
            self.cells[-1] += data

    @property
    def policy(self) -> dict[str, str]:
        """Directives of the content security policy."""
        (text,) = (
            attributes["content"]
            for tag, attributes in self.tags
            if tag == "meta" and attributes.get("http-equiv") == "Content-Security-Policy"
        )
        assert text is not None
        return dict(part.strip().split(" ", 1) for part in text.split(";"))


def whole_page(text: str) -> WholePage:
    """Read a page, and check what holds for all of them."""
    assert text.lower().startswith("<!doctype html>")
    page = WholePage(text)
    policy = page.policy
    assert policy["default-src"] == policy["base-uri"] == policy["form-action"] == "'none'"
    assert policy["img-src"] == "data:"
    for kind, parts in page.content.items():
        digests = {
            f"'sha256-{base64.b64encode(hashlib.sha256(part.encode()).digest()).decode()}'"
            for part in parts
        }
        assert set(policy[f"{kind}-src"].split()) == (digests or {"'none'"})
    for tag, attributes in page.tags:
        assert tag not in FORBIDDEN
        assert not [name for name in attributes if name == "style" or name.startswith("on")]
        assert (attributes.get("src") or "data:").startswith("data:")
        assert tag == "a" or "href" not in attributes
        assert re.match("https?://", attributes.get("href") or "https://")
    assert not re.search(r"url\(|@import", "".join(page.content["style"]))
    assert {"html", "title", "h1"} <= {tag for tag, _ in page.tags}
    return page
