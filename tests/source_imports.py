"""What the sources of the package import, read once for all tests of a process."""

import ast
import gc
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "urbantwin"
MODULES = sorted(SOURCE.rglob("*.py"))


class Import(NamedTuple):
    """An import, inside a function perhaps: of names, or of names from a module."""

    line: int
    names: tuple[str, ...]
    source: str | None = None
    level: int = 0
    #: Whether only the type checker reads it.
    typing: bool = False


def imports_of(module: Path) -> list[Import]:
    """Return what one of `MODULES` imports."""
    return _imports()[module]


@cache
def _imports() -> dict[Path, list[Import]]:
    was = gc.isenabled()
    gc.disable()  # the search for garbage among a million nodes takes twice as long as the rest
    try:
        return {one: list(_in(ast.parse(one.read_text()), typing=False)) for one in MODULES}
    finally:
        if was:
            gc.enable()


def _in(node: ast.AST, *, typing: bool) -> Iterator[Import]:
    """Go through the statements of a node, whose expressions hold no import."""
    match node:
        case ast.Import():
            yield Import(node.lineno, tuple(one.name for one in node.names), typing=typing)
        case ast.ImportFrom():
            names = tuple(one.name for one in node.names)
            yield Import(node.lineno, names, node.module or "", node.level, typing)
    for field in ("body", "handlers", "cases", "orelse", "finalbody"):
        checked = field == "body" and isinstance(node, ast.If) and _is_type_checking(node.test)
        inner = getattr(node, field, None)
        for one in inner if isinstance(inner, list) else ():
            yield from _in(one, typing=typing or checked)


def _is_type_checking(test: ast.expr) -> bool:
    return isinstance(test, ast.Name) and test.id == "TYPE_CHECKING"
