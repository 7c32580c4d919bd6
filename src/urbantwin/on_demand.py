"""Public names of a package whose modules are imported when they are first asked for.

A package says its names once, where type checkers and people read them:

    if TYPE_CHECKING:
        from urbantwin.geometry.pose import Pose

    __all__ = ["Pose"]

    names_on_demand(__name__)

Who asks for ``Pose`` then waits for that module alone, and not for all that the package has.
"""

from __future__ import annotations

import ast
import sys
from importlib import import_module
from types import ModuleType

__all__ = ["names_on_demand"]


class _Package(ModuleType):
    """A package that imports what its ``if TYPE_CHECKING:`` block names (compare PEP 562)."""

    _modules: dict[str, str]

    def __getattr__(self, name: str) -> object:
        module = self._modules.get(name)
        if module is None:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        if module == self.__name__:  # a package of ours
            value: object = import_module(f"{module}.{name}")
        else:
            value = getattr(import_module(module), name)
        vars(self)[name] = value
        return value

    def __setattr__(self, name: str, value: object) -> None:
        # The import system sets a package's modules as its attributes. One that is spelt like a
        # public name (``compare.compare``) must not hide that.
        hidden = self._modules.get(name, self.__name__) != self.__name__
        if not (isinstance(value, ModuleType) and hidden):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self._modules})


def names_on_demand(package: str) -> None:
    """Let a package import the names of its ``if TYPE_CHECKING:`` block when they are asked for."""
    module = sys.modules[package]
    assert module.__spec__ is not None
    source = module.__spec__.loader.get_source(package)  # type: ignore[union-attr]
    found: dict[str, str] = {}
    for block in ast.parse(source).body:
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING":
            for line in block.body:
                assert isinstance(line, ast.ImportFrom)
                found |= {one.name: str(line.module) for one in line.names}
    vars(module)["_modules"] = found
    module.__class__ = _Package
