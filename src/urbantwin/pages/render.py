"""Templates of pages (HTML), cards (Markdown) and files of other programs.

A template is in the folder of its module, ends in ``.html.j2``, ``.md.j2`` or the file's own ending
(``.yaml.j2``), and is named by its path in the package. Pages extend ``pages/base.html.j2``; the
macros of ``pages/macros`` are global. All values are escaped (in other programs' files by the
filter ``json``), and undefined names are errors.
"""

from __future__ import annotations

import hashlib
import json
import re
from base64 import b64encode
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal
from urllib.parse import quote

from urbantwin.pages.markdown import code, escaped, front_matter, picture

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

__all__ = ["card", "environment", "page", "text_file", "write_page"]


def write_page(path: Path, template: str, **data: Any) -> None:  # noqa: ANN401
    """Write a self-contained page; the same data give the same bytes.

    Args:
        path: the HTML file.
        template: path of the template in the package, as ``evaluation/page.html.j2``.
        data: variables of the template.
    """
    path.write_text(page(template, **data), encoding="utf-8")


def page(template: str, **data: Any) -> str:  # noqa: ANN401
    """Return a page; see `write_page`."""
    return environment("html").get_template(template).render(data)


def card(template: str, **data: Any) -> str:  # noqa: ANN401
    """Return a card as Markdown; consecutive blank lines are merged."""
    text = environment("md").get_template(template).render(data)
    return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"


def text_file(template: str, **data: Any) -> str:  # noqa: ANN401
    """Return a file of another program: YAML or Python, with values written by ``json``."""
    return _plain_environment().get_template(template).render(data)


@cache
def _plain_environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    made = Environment(
        loader=PackageLoader("urbantwin", ""),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.filters["json"] = partial(json.dumps, ensure_ascii=False, allow_nan=False)
    return made


@cache
def environment(kind: Literal["html", "md"]) -> Environment:
    """Return the template environment of a kind, with its filters and macros."""
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
    if kind == "html":
        made.filters |= {"number": _number, "percent": _percent, "image": _image, "digest": _digest}
    else:
        made.finalize = _as_markdown
        number = partial(_number, dash="-")
        marked: dict[str, Callable[..., str]] = {
            "number": number,
            "cell": _cell,
            "code": code,
            "urlencode": quote,
        }
        made.filters |= {name: _marked(function) for name, function in marked.items()}
        made.globals |= {"front_matter": _marked(front_matter), "picture": _marked(picture)}
    macros = vars(made.get_template(f"pages/macros.{kind}.j2").module)
    made.globals |= {name: one for name, one in macros.items() if isinstance(one, Macro)}
    return made


def _as_markdown(value: object) -> object:
    """Return a value as escaped Markdown."""
    from markupsafe import Markup

    return value if hasattr(value, "__html__") else Markup(escaped(value))


def _marked(function: Callable[..., str]) -> Callable[..., Markup]:
    """Return a function whose result is marked as Markdown."""
    from markupsafe import Markup

    return lambda *arguments, **named: Markup(function(*arguments, **named))


def _cell(value: object) -> str:
    """Return a value as a table cell, with thousands separators; a dash for None."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    return str(_as_markdown(f"{value:g}" if isinstance(value, float) else value))


def _number(value: float | None, form: str = ".3g", unit: str = "", dash: str = "–") -> str:
    """Return a number in a Python format, with its unit; a dash for None."""
    return dash if value is None else f"{value:{form}}{unit}"


def _percent(value: float | None) -> str:
    """Return a fraction in percent, without the sign; a dash for None."""
    return "–" if value is None else f"{100 * value:.1f}"


def _image(path: Path) -> str:
    """Return a PNG as a data URL."""
    return f"data:image/png;base64,{b64encode(path.read_bytes()).decode()}"


def _digest(text: str) -> str:
    """Return the CSP source that allows a style or script with exactly this text.

    Source: W3C, Content Security Policy Level 3, 2.3.1.
    """
    if not text:
        return "none"
    return f"sha256-{b64encode(hashlib.sha256(text.encode()).digest()).decode()}"
