"""Python as it is where `embreex` has no wheel: with this folder on ``PYTHONPATH``."""

import sys
from importlib.machinery import ModuleSpec


class _Missing:
    """Finds no package ``embreex``, whoever asks for it."""

    @staticmethod
    def find_spec(name: str, *_: object) -> ModuleSpec | None:
        if name.partition(".")[0] == "embreex":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return None


sys.meta_path.insert(0, _Missing())
