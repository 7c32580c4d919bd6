"""Docstrings, comments and local names of the source are in the terms of the field."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "urbantwin"
FILES = sorted(SOURCE.rglob("*.py"))

#: Words that stand for an actor, a sensor or a frame without naming it, and old words for terms.
DIALECT = re.compile(
    r"\b(whoever|whomever|somebody|everybody|nobody|afoot|so manieth|mended)\b"
    r"|\b(is|are) (dear|told|asked for)\b|\bso many of them at most\b|\btried and left\b",
    re.IGNORECASE,
)
#: Quoted code, and names of arguments and attributes before their description.
QUOTED = re.compile(r"`[^`]*`|^ *\w+:", re.MULTILINE)
#: A docstring that is a genitive alone: "Of a packet."
GENITIVE = re.compile(r"Of [^.,:;]{1,40}\.?\Z")
LONGEST_SENTENCE = 40  # words
#: Local names that say nothing, in the packages that have none.
EMPTY_NAMES = {"one", "found", "near", "known", "kept", "mine", "told", "said", "asked"}
NAMED_PLAINLY = ("roads", "tracking", "traffic", "twin", "weakness")


def docstrings(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield ast.get_docstring(node) or ""


def comments(text: str) -> Iterator[str]:
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield token.string


def sentences(docstring: str) -> Iterator[str]:
    """Yield the sentences of paragraphs and of items; not those of code, tables and sources."""
    for block in re.split(r"\n\s*\n|\n(?=\s*(?:[\w*]+:|- ))", docstring):
        drawn = re.search(r">>>|::|\$ |^\s*\||[├└=]|\S {4,}\S", block, re.MULTILINE)
        if not drawn and not re.search(r"\b(19|20)\d\d\b", block):
            yield from re.split(r"(?<=[.:;])\s", block)


@pytest.mark.parametrize("folder", sorted({file.relative_to(SOURCE).parts[0] for file in FILES}))
def test_docstrings_and_comments_are_plain(folder: str) -> None:
    bad = []
    for file in FILES:
        if file.relative_to(SOURCE).parts[0] != folder:
            continue
        text, place = file.read_text(encoding="utf-8"), file.relative_to(SOURCE)
        documented = list(docstrings(ast.parse(text)))
        for prose in (*documented, *comments(text)):
            unquoted = QUOTED.sub("", prose)
            bad += [f"{place}: {words[0]}" for words in DIALECT.finditer(unquoted)]
        for docstring in documented:
            if GENITIVE.match(docstring):
                bad.append(f"{place}: {docstring}")
            bad += [
                f"{place}: {len(sentence.split())} words: {sentence[:60]}"
                for sentence in sentences(docstring)
                if len(sentence.split()) > LONGEST_SENTENCE
            ]
    assert not bad, "\n".join(bad)


@pytest.mark.parametrize("package", NAMED_PLAINLY)
def test_local_names_say_what_they_hold(package: str) -> None:
    bad = []
    for file in sorted((SOURCE / package).rglob("*.py")):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        parameters = {node.arg for node in ast.walk(tree) if isinstance(node, ast.arg)}
        functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
        for node in {inner for function in functions for inner in ast.walk(function)}:
            stored = isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
            if stored and node.id in EMPTY_NAMES - parameters:
                bad.append(f"{file.relative_to(SOURCE)}:{node.lineno}: {node.id}")
    assert not bad, "\n".join(sorted(bad))
