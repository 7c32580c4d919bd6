"""Values of drawn features: numbers and booleans, often stored as text in attribute tables."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

__all__ = ["Count", "Metres", "Text", "Truth", "number_of"]


def number_of(value: Any) -> Any:  # noqa: ANN401
    """Return the number in a text; other values are returned as they are."""
    if isinstance(value, str):
        try:
            number = float(value)
        except ValueError:
            return value
        return int(number) if number.is_integer() else number
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _truth(value: Any) -> Any:  # noqa: ANN401
    words = {"yes": True, "true": True, "1": True, "no": False, "false": False, "0": False}
    if isinstance(value, str):
        return words.get(value.strip().lower(), value)
    return bool(value) if value in (0, 1) else value


def _text(value: Any) -> Any:  # noqa: ANN401
    isnumber_of = isinstance(value, int | float) and not isinstance(value, bool)
    return f"{value:g}" if isnumber_of else value


Count = Annotated[int, BeforeValidator(number_of), Field(ge=0, le=9)]
Metres = Annotated[float, BeforeValidator(number_of), Field(gt=0, le=200, allow_inf_nan=False)]
Truth = Annotated[bool, BeforeValidator(_truth)]
Text = Annotated[str, BeforeValidator(_text)]
