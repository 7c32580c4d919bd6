"""Templates escape what they are given, and no module writes HTML beside them."""

import ast
import re

import numpy as np
import pytest
from jinja2 import UndefinedError
from PIL import Image

from urbantwin.experiments.campaign.index import write_index
from urbantwin.pages import page
from urbantwin.pages.render import environment

from ..source_imports import MODULES, SOURCE
from ..whole_page import whole_page

TEMPLATES = sorted(SOURCE.rglob("*.j2"))
NASTY = """<script>alert(1)</script></style> & <img src=x onerror='a()'> "b" {{ 7 * 7 }}"""
#: A line of a notebook, the viewer's own page, a cell of Markdown.
OWN_HTML = {"interface/stage.py", "web/page_document.py", "web/saved_page.py", "pages/markdown.py"}


def test_strangers_texts_are_texts(tmp_path) -> None:
    counts = {"frames": 1234, "points": 5, "boxes": 0, "bytes": 2_000_000}
    dataset = {"path": "datasets/a", "levels": {NASTY: NASTY}, "manifest_sha256": "0", **counts}
    index = {
        "grid": NASTY,
        "axes": {NASTY: [NASTY, 1]},
        "cells": 2,
        "counts": counts,
        "datasets": [dataset],
        "failed": [{"path": NASTY, "why": NASTY}],
        "inputs": [{"name": NASTY, "licence": NASTY, "attribution": None}],
    }
    picture = tmp_path / "picture.png"
    Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(picture)
    write_index(tmp_path, index, picture)
    read = whole_page((tmp_path / "campaign.html").read_text())
    assert {tag for tag, _ in read.tags} == {
        *("html", "head", "meta", "title", "style", "body", "h1", "h2", "p", "img"),
        *("table", "thead", "tbody", "tr", "th", "td"),
    }
    assert read.cells.count(NASTY) == 7
    assert f"Campaign: {NASTY}" in read.texts
    assert "1,234" in read.cells


def test_data_of_a_script_do_not_end_it() -> None:
    template = environment("html").from_string(
        '{% extends "pages/base.html.j2" %}{% set title = "A" %}'
        "{% block content %}<h1>A</h1>{% endblock %}"
        "{% block script %}const a = {{ data|tojson }};{% endblock %}"
    )
    read = whole_page(template.render(data={"b": NASTY, "a": [1, None]}))
    (script,) = read.content["script"]
    assert script.startswith('const a = {"b": ')
    assert "<" not in script


def test_a_name_that_was_not_given_is_an_error() -> None:
    with pytest.raises(UndefinedError):
        page("experiments/campaign/index.html.j2", index={"grid": "a"})


def test_every_page_extends_the_one_base_and_escapes_everything() -> None:
    assert len(TEMPLATES) > 10
    for path in TEMPLATES:
        if path.name.endswith((".yaml.j2", ".py.j2", ".txt.j2")):  # another program's, not a page
            continue
        text = path.read_text()
        kind = "md" if path.name.endswith(".md.j2") else "html"
        environment(kind).get_template(path.relative_to(SOURCE).as_posix())
        assert not re.search(r"\|\s*safe\b|autoescape|\sstyle=|\son\w+=|https?://|url\(", text)
        extends = text.startswith('{% extends "pages/base.html.j2" %}')
        assert extends == (kind == "html" and path.parent.name != "pages")


def test_every_template_is_filled_and_every_one_that_is_named_is_there() -> None:
    named = {f"pages/macros.{kind}.j2" for kind in ("html", "md")}
    for path in (*MODULES, *TEMPLATES):
        named |= set(re.findall(r'"([\w/.]+\.j2)"', path.read_text(encoding="utf-8")))
    assert named == {path.relative_to(SOURCE).as_posix() for path in TEMPLATES}


def test_no_module_writes_html() -> None:
    found = []
    for module in MODULES:
        if module.relative_to(SOURCE).as_posix() in OWN_HTML:
            continue
        text = module.read_text(encoding="utf-8")
        if not re.search(r"</?(html|p|td|tr|table|h[1-6]|div|ul|li|img|script|style)\b", text):
            continue
        found += [
            f"{module}:{node.lineno}"
            for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and re.search(r"</(html|p|td|tr|table|h[1-6]|div|ul|li|script|style)>", node.value)
        ]
    assert not found
