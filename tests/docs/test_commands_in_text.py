"""Every command that a page, a message or an example names is there, with the options it names."""

import json
import re
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import click
import pytest

from urbantwin.cli.commands import GROUPS, command_at, every_command
from urbantwin.cli.program import program

from ..source_imports import MODULES, ROOT

PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("examples/**/*.md")])
#: Between two texts of Python that are one, between lines of a docstring, and in a notebook.
_JOINED = re.compile(r'"\s*\n\s*f?"|\n\s*(?:#:? )?')
_NAMED = re.compile(r"`+urbantwin ([^`]+)`+")


@cache
def command(words: tuple[str, ...]) -> click.Command:
    """Return the command that words begin with."""
    found: click.Command = program()
    for word in words:
        assert isinstance(found, click.Group)
        inner = found.get_command(click.Context(found), word)
        assert inner is not None, f"no command {word}: urbantwin {' '.join(words)}"
        found = inner
    return found


def parsed(line: str) -> None:
    """Parse a whole command line, which a person may copy."""
    words = shlex.split(line)[1:]
    depth = 2 if words[0] in GROUPS else 1
    found = command(tuple(words[:depth]))
    found.make_context(words[depth - 1], words[depth:])


def named(text: str) -> None:
    """Look up a command that a sentence names: with placeholders, parts, or whole."""
    words = [word.strip("()[],.;|") for word in text.split()]
    if words[0].startswith("-") or not words[0].islower():  # --help; COMMAND
        return
    depth = 2 if words[0] in GROUPS and len(words) > 1 and words[1].islower() else 1
    found = command(tuple(words[:depth]))
    known = {word for option in found.params for word in (*option.opts, *option.secondary_opts)}
    for word in re.findall(r"--[a-z][\w-]*", text):
        assert word in known | {"--help"}, f"{word}: urbantwin {text}"


def lines_of(text: str) -> Iterator[str]:
    """Yield the command lines of the blocks of a page."""
    for block in re.findall(r"^```(?:sh|console)?\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        for line in block.replace("\\\n", " ").splitlines():
            for part in re.split(r" #|&&|\|(?= )|;(?= )|>", line):
                whole = part.strip().removeprefix("$ ")
                if whole.startswith("urbantwin ") and "..." not in whole and "Usage" not in line:
                    yield whole


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_of_a_page_are_ours(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for line in lines_of(text):
        parsed(line)
    for one in _NAMED.findall(
        _JOINED.sub(" ", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S))
    ):
        named(one)


def test_commands_of_groups_are_named_with_their_group() -> None:
    names = "|".join(name for _, several in GROUPS.values() for name in several if name != "run")
    for path in (*PAGES, *MODULES):
        found = re.search(rf"`(?:{names}) --[a-z].*?`", path.read_text(encoding="utf-8"))
        assert found is None, f"{path.name}: {found and found[0]}"


def test_commands_in_the_sources_are_ours() -> None:
    others = [
        *ROOT.glob("benchmarks/*.py"),
        *ROOT.glob("tests/**/*.py"),
        *ROOT.glob("docs/**/*.py"),
    ]
    for path in (*MODULES, *others):
        if path != Path(__file__):
            text = path.read_text(encoding="utf-8")
            if "`urbantwin " in text:
                for one in _NAMED.findall(_JOINED.sub(" ", text)):
                    named(one.partition("{")[0] if one[0] != "{" else "--help")


def test_commands_of_the_notebook_are_ours() -> None:
    for path in ROOT.glob("examples/*.ipynb"):
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            for one in _NAMED.findall("".join(cell["source"])):
                named(one)


@pytest.mark.parametrize(("group", "name"), every_command())
def test_the_example_of_a_command_is_one(group: str, name: str) -> None:
    parsed(command_at(group, name).example)


def test_the_page_of_commands_lists_all_with_their_first_lines() -> None:
    text = (ROOT / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `urbantwin ([a-z ]+)` \| (.*?) \| \[", text, re.MULTILINE)
    assert rows == [
        (f"{group} {name}".strip(), command_at(group, name).title.removesuffix("."))
        for group, name in every_command()
    ]
