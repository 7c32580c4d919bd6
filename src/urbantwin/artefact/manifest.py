"""Manifests validated against models, with one-line errors that name the field."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from urbantwin.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["Part", "PlainName", "Sha256", "refused", "validated"]

Model = TypeVar("Model", bound=BaseModel)


def _plain_name(name: str) -> str:
    if name in ("", ".", "..") or any(one in name for one in "/\\\0") or len(name) > 200:
        raise ValueError("the name of a file or a folder in this one")
    return name


#: A plain name of a file or folder, without path components.
PlainName = Annotated[str, AfterValidator(_plain_name)]


#: A SHA-256 as hexadecimal text.
Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class Part(BaseModel):
    """A mapping in a manifest.

    Types are strict (text is not a number), numbers are finite, and unknown fields are ignored, as
    a later version may add some.
    """

    model_config = ConfigDict(extra="ignore", frozen=True, strict=True, allow_inf_nan=False)


def validated(
    value: object, model: type[Model], *, file: str | Path, expected: str, within: str = ""
) -> Model:
    """Return a document's value as a model.

    Args:
        value: JSON value.
        model: the required model.
        file: file, for errors.
        expected: expected content, for errors.
        within: location of the value in the file.

    Raises:
        InputError: a field is missing or wrong; names the first.
    """
    try:
        return model.model_validate(value)
    except ValidationError as error:
        raise refused(error, file=file, expected=expected, within=within) from None


def refused(
    error: ValidationError, *, file: str | Path, expected: str, within: str = ""
) -> InputError:
    """Return the first of pydantic's errors as an input error; arguments as for `validated`."""
    first = error.errors(include_url=False, include_context=False)[0]
    place = within
    for step in first["loc"]:
        place += f"[{step}]" if isinstance(step, int) else f".{step}" if place else str(step)
    if first["type"] == "missing":
        return InputError("is missing", file=file, place=place, expected=expected)
    wanted = first["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    problem = f"is {_shown(first['input'])}"
    return InputError(problem, file=file, place=place or None, expected=wanted)


def _shown(value: Any) -> str:  # noqa: ANN401
    """Return a value as in the file, approximately and shortened."""
    if isinstance(value, dict | list):
        return "a mapping" if isinstance(value, dict) else f"a list of {len(value)}"
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
