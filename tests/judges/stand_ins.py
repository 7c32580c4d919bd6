"""Stand-ins for modules that development kits import and that what they judge does not need."""

import importlib.abc
import importlib.machinery
import sys
import types

__all__ = ["stand_in"]


class _StandIn(types.ModuleType):
    """A module whose every name is an empty class."""

    __path__ = ()

    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        return type(name, (), {})


class _StandIns(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    def __init__(self, names):
        self.names = names

    def find_spec(self, name, path=None, target=None):
        if any(name == one or name.startswith(f"{one}.") for one in self.names):
            return importlib.machinery.ModuleSpec(name, self, is_package=True)
        return None

    def create_module(self, spec):
        return _StandIn(spec.name)

    def exec_module(self, module):
        pass


def stand_in(*names):
    """Have stand-ins imported in place of modules of these names, and of those in them."""
    sys.meta_path.insert(0, _StandIns(names))
