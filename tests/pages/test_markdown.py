"""Texts of strangers in Markdown, as a reader of CommonMark that is not ours shows them."""

import re
from html import unescape

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt

from urbantwin.pages.markdown import code, escaped, front_matter, picture
from urbantwin.pages.render import environment

READER = MarkdownIt("commonmark").enable(["table", "strikethrough"])
NASTY = [
    "a | b",
    "<script>alert(1)</script>",
    "[a](http://evil.example)",
    "![x](javascript:alert(1))",
    "*bold* _italic_ ~~gone~~ `code`",
    "1. one",
    "- item",
    "# heading",
    "---",
    "&lt;b&gt;",
    "line\nbreak\r\n\n# two",
    "\x1b[31mred",
    "`` two ``",
    "a\\|b",
    "\\",
    "$x$ @who #12",
    "===",
    "+ plus",
    "> quote",
    "1) one",
    "<!-- no comment -->",
    "[^1]",
    "｜ 車 ä",
]


def shown(html: str) -> str:
    return " ".join(unescape(re.sub(r"<[^>]+>", "", html)).split())


def one_line(text: str) -> str:
    return " ".join(text.split())


@pytest.mark.parametrize("text", [one for one in NASTY if "\x1b" not in one])
def test_a_text_is_shown_as_it_is(text):
    html = READER.render(escaped(text))
    assert html.startswith("<p>")
    assert html.count("<") == 2  # the paragraph alone
    assert shown(html) == one_line(text)
    (row,) = re.findall(r"<tbody>(.*?)</tbody>", READER.render(_table([[text, "end"]])), re.DOTALL)
    assert re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL)[1:] == ["end"]
    assert shown(row) == f"{one_line(text)} end"


@pytest.mark.parametrize("text", [one for one in NASTY if "\x1b" not in one])
def test_code_is_shown_as_it_is_also_in_a_table(text):
    html = READER.render(_table([[text, "end"]], "cell|code"))
    (row,) = re.findall(r"<tbody>(.*?)</tbody>", html, re.DOTALL)
    assert re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL)[1:] == ["end"]
    assert shown(row) == f"{one_line(text)} end"
    assert "<script" not in html


def _table(rows: list[list[object]], first: str = "cell", numbers: int = 0) -> str:
    """The table that a template makes of rows of two cells."""
    template = (
        '{% call table(["a", "b"], numbers) %}{% for cell, other in rows %}'
        f"{{{{ tr({first}, other) }}}}\n"
        "{% endfor %}{% endcall %}"
    )
    return environment("md").from_string(template).render(rows=rows, numbers=numbers)


@given(st.text(st.characters(codec="utf-8", exclude_categories=("Cc", "Cf", "Cs", "Zl", "Zp"))))
def test_any_text_stays_in_its_paragraph(text):
    if one_line(text):
        html = READER.render(escaped(text[:200]))
        assert html.count("<") == 2
        assert html.startswith("<p>")


def test_a_control_character_is_told_and_not_passed_on():
    assert "\x1b" not in escaped("\x1b[31m")
    assert "\x1b" not in code("\x1b[31m")


def test_numbers_and_what_is_missing_in_a_table():
    _, rule, *rows = _table([[1234567, None], [True, 0.5]], numbers=1).split("\n")
    assert rule == "|---|---:|"
    assert [row for row in rows if row] == ["| 1,234,567 | - |", "| yes | 0.5 |"]


def test_front_matter_is_yaml_of_a_stranger_s_name():
    name = 'A: "b" | --- #c\n---'
    lines = front_matter({"pretty_name": name, "license": "odbl"}).splitlines()
    assert lines[0] == lines[-1] == "---"
    assert yaml.safe_load("\n".join(lines[1:-1])) == {"pretty_name": name, "license": "odbl"}
    assert "---" not in lines[1:-1]


def test_pictures():
    html = READER.render(picture("pictures/a b.png", "x ](y"))
    assert 'src="pictures/a%20b.png"' in html
    assert 'alt="x ](y"' in html
