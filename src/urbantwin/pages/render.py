"""Filling templates.

A template lies beside the module that fills it, ends in ``.html.j2`` and is named by its path in
the package. It extends ``pages/base.html.j2``; the macros of ``pages/macros.html.j2`` are global.
Every value is escaped, and a name that was not given is an error.
"""

from __future__ import annotations

import hashlib
from base64 import b64encode
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment

__all__ = ["environment", "page", "write_page"]


def write_page(path: Path, template: str, **data: Any) -> None:  # noqa: ANN401
    """Write a page that needs no other file; the same data give the same bytes.

    Args:
        path: the HTML file.
        template: path of the template in the package, as ``evaluation/page.html.j2``.
        data: variables of the template.
    """
    path.write_text(page(template, **data), encoding="utf-8")


def page(template: str, **data: Any) -> str:  # noqa: ANN401
    """Return a page; see `write_page`."""
    return environment().get_template(template).render(data)


@cache
def environment() -> Environment:
    """Return the templates of the package, with their filters and macros."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from jinja2.runtime import Macro

    made = Environment(
        loader=PackageLoader("urbantwin", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.policies["json.dumps_kwargs"] = {"allow_nan": False}
    made.filters |= {"number": _number, "percent": _percent, "image": _image, "digest": _digest}
    macros = vars(made.get_template("pages/macros.html.j2").module)
    made.globals |= {name: one for name, one in macros.items() if isinstance(one, Macro)}
    return made


def _number(value: float | None, form: str = ".3g", unit: str = "") -> str:
    """Return a number in a format of Python's with its unit; a dash for None."""
    return "–" if value is None else f"{value:{form}}{unit}"


def _percent(value: float | None) -> str:
    """Return a share in per cent, without the sign; a dash for None."""
    return "–" if value is None else f"{100 * value:.1f}"


def _image(path: Path) -> str:
    """Return a PNG as the address of an image that holds its own data."""
    return f"data:image/png;base64,{b64encode(path.read_bytes()).decode()}"


def _digest(text: str) -> str:
    """Return the source that allows a style or a script of this text, and no other.

    Source: W3C, Content Security Policy Level 3, 2.3.1.
    """
    if not text:
        return "none"
    return f"sha256-{b64encode(hashlib.sha256(text.encode()).digest()).decode()}"
