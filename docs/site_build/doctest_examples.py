"""Our docstrings' examples as griffe has them: it reads ``Examples:``, we write ``Example:``."""

import re

import griffe

__all__ = ["Examples"]


class Examples(griffe.Extension):
    """Shows the examples of docstrings as code."""

    def on_object(self, *, obj: griffe.Object, **_: object) -> None:
        """Rename the section."""
        if obj.docstring is not None:
            text = obj.docstring.value
            obj.docstring.value = re.sub(r"^Example:$", "Examples:", text, flags=re.MULTILINE)
