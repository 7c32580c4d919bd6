"""Public names of packages, imported on first access.

A package lists its names once, for type checkers and readers:

    if TYPE_CHECKING:
        from urbantwin.geometry.pose import Pose

    __all__ = ["Pose"]

    names_on_demand(__name__)

Access to ``Pose`` then imports its module only, not the whole package.
"""

from __future__ import annotations

import ast
import sys
from importlib import import_module
from types import ModuleType

__all__ = ["names_on_demand"]


class _Package(ModuleType):
    """A package that imports the names in its ``if TYPE_CHECKING:`` block (compare PEP 562)."""

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
        # The import system sets submodules as attributes of a package. A submodule spelt like a
        # public name (``compare.compare``) must not hide that name.
        hidden = self._modules.get(name, self.__name__) != self.__name__
        if not (isinstance(value, ModuleType) and hidden):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self._modules})


def names_on_demand(package: str) -> None:
    """Make a package import the names of its ``if TYPE_CHECKING:`` block on access."""
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
