"""HTML of the viewer's page, served or self-contained."""

from __future__ import annotations

import base64
import hashlib
import json
from html import escape
from importlib.resources import files
from typing import Any

from urbantwin.errors import InputError

__all__ = ["POLICY", "json_for_script", "page_file", "saved_html", "served_html"]

#: Content security policy: no sources but the page's own server.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; media-src blob:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)


def page_file(name: str) -> bytes:
    """Return ``page.js`` or ``page.css``.

    Raises:
        InputError: a checkout without the built page.
    """
    file = files(__package__).joinpath("page", name)
    try:
        return file.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(
            "the page is not built in this checkout", place="view", expected="first: make web"
        ) from None


def json_for_script(value: Any) -> str:  # noqa: ANN401
    """Return JSON that is safe within a ``<script>`` element."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def served_html(document: dict[str, Any]) -> bytes:
    """Return the page for the server."""
    return (
        f"{_head(document)}"
        '<link rel="stylesheet" href="page.css">\n</head>\n<body>\n'
        f'<script type="application/json" id="document">{json_for_script(document)}</script>\n'
        '<script src="page.js"></script>\n</body>\n</html>\n'
    ).encode()


def saved_html(document: dict[str, Any]) -> tuple[bytes, bytes]:
    """Return the parts of a saved page before and behind its packets.

    Script and style are allowed by their hashes only (CSP level 3), and nothing may be loaded.
    """
    # The text must not contain the end tag of its element.
    script = page_file("page.js").decode().replace("</script", "<\\/script")
    style = page_file("page.css").decode().replace("</style", "<\\/style")
    policy = (
        f"default-src 'none'; script-src {_hash(script)}; style-src {_hash(style)}; "
        "img-src data: blob:; media-src blob:; base-uri 'none'; form-action 'none'"
    )
    before = (
        f"{_head(document, policy)}<style>{style}</style>\n</head>\n<body>\n"
        f'<script type="application/json" id="document">{json_for_script(document)}</script>\n'
    )
    return before.encode(), f"<script>{script}</script>\n</body>\n</html>\n".encode()


def _head(document: dict[str, Any], policy: str | None = None) -> str:
    allowed = (
        f'<meta http-equiv="Content-Security-Policy" content="{escape(policy)}">\n'
        if policy
        else ""
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"{allowed}"
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="referrer" content="no-referrer">\n'
        '<link rel="icon" href="data:,">\n'
        f"<title>{escape(str(document['title']))} - UrbanTwin</title>\n"
    )


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
