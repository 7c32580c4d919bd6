"""YAML files of users, read strictly, with one-line errors."""

from __future__ import annotations

import difflib
import re
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from urbantwin.errors import InputError

__all__ = [
    "Document",
    "field_path",
    "must_exist",
    "nearest",
    "not_there",
    "read_document",
    "wrong",
]

Model = TypeVar("Model", bound=BaseModel)
Location = Sequence[int | str]


class _StrictLoader(yaml.SafeLoader):
    """Safe loader that rejects duplicate keys."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if key.value in seen:
                    raise yaml.constructor.ConstructorError(
                        None, None, f"{key.value!r} is given twice", key.start_mark
                    )
                seen.add(key.value)
        return super().construct_mapping(node, deep=deep)


# PyYAML follows YAML 1.1, which reads "1e3" as text; in YAML 1.2 it is 1000.
_StrictLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+$"),
    list("-+0123456789"),
)


@dataclass(frozen=True)
class Document:
    """A mapping read from a file, or a part of it, with the positions of its values.

    Args:
        file: the file, for error messages.
        value: the mapping.
        root: the YAML node of ``value``, or ``None`` if not read from YAML.
        prefix: location of ``value`` in the file: ``("rig",)`` for a site's inline rig.
    """

    file: Path
    value: Mapping[str, Any]
    root: yaml.Node | None = None
    prefix: tuple[int | str, ...] = ()

    def part(self, *location: int | str) -> Document:
        """Return the mapping at a location as a document."""
        value: Any = self.value
        root = self.root
        for step in location:
            value, root = value[step], _entry(root, step)[1]
        return Document(self.file, value, root, (*self.prefix, *location))

    def place(self, location: Location) -> str:
        """Return ``field.path[0].name (line 7)`` for a location below this document."""
        path = field_path((*self.prefix, *location))
        node = self._node(location)
        if node is None or (node is self.root and not self.prefix):
            return path
        return f"{path} (line {node.start_mark.line + 1})"

    def error(self, problem: str, location: Location, expected: str | None = None) -> InputError:
        """Return the error to raise for the value at ``location``."""
        return InputError(
            problem, file=self.file, place=self.place(location) or None, expected=expected
        )

    def validated(self, model: type[Model], context: Mapping[str, Any] | None = None) -> Model:
        """Return the mapping as a ``model``.

        Raises:
            InputError: a field is unknown, missing or wrong; names the first.
        """
        try:
            return model.model_validate(dict(self.value), context=dict(context or {}), strict=True)
        except ValidationError as error:
            details = error.errors(include_url=False)
        # A misspelt field is reported as unknown and as missing; the former is more helpful.
        first = next((item for item in details if item["type"] == "extra_forbidden"), details[0])
        place = self._written(first)
        # If a field has alternatives, report the one that validated furthest.
        for item in details:
            at = self._written(item)
            further = len(at) > len(place) or (
                first["type"] in _TYPES and item["type"] not in _TYPES
            )
            if further and at[: len(place)] == place:
                first, place = item, at
        problem, expected = _in_words(first, model)
        raise self.error(problem, place, expected)

    def _written(self, item: ErrorDetails) -> tuple[int | str, ...]:
        """Return an error's location without the names of alternatives: ``str``, ``literal[...]``.

        The file does not contain these steps.
        """
        here: Any = self.value
        steps: list[int | str] = []
        for number, step in enumerate(item["loc"]):
            last = number == len(item["loc"]) - 1
            if isinstance(here, Mapping) and (step in here or (last and item["type"] == "missing")):
                here = here.get(step)
            elif isinstance(here, list) and isinstance(step, int) and step < len(here):
                here = here[step]
            elif step != "[key]":
                continue
            steps.append(step)
        return tuple(steps)

    def _node(self, location: Location) -> yaml.Node | None:
        """Return the node of a location: its key, or the deepest existing one above it."""
        at = below = self.root
        for step in location:
            key, value = _entry(below, step)
            if key is None:
                break
            # Use the key's line: a block's value starts on the next line.
            at, below = key, value
        return at


def _entry(node: yaml.Node | None, step: int | str) -> tuple[yaml.Node | None, yaml.Node | None]:
    """Return the nodes of the key and of the value at ``step`` of a mapping or a sequence."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            if key.value == step:
                return key, value
    elif isinstance(node, yaml.SequenceNode) and isinstance(step, int) and step < len(node.value):
        return node.value[step], node.value[step]
    return None, None


def wrong(problem: str, expected: str) -> PydanticCustomError:
    """Return a validator's error with problem and expectation."""
    escaped = problem.replace("{", "(").replace("}", ")")
    return PydanticCustomError("wrong", escaped, {"expected": expected})


def field_path(location: Location) -> str:
    """Return ``rig.sensors[0].model`` for ``("rig", "sensors", 0, "model")``."""
    text = ""
    for step in location:
        if isinstance(step, int):
            text += f"[{step}]"
        elif step != "[key]":
            text += f".{step}" if text else step
    return text


def read_document(path: Path, *, kind: str) -> Document:
    """Read a YAML file that holds a mapping.

    Args:
        path: the file.
        kind: expected kind, for error messages: ``"a site"``.

    Raises:
        InputError: the file is missing, is not text, is not YAML, gives a key twice, or holds
            something other than a mapping.
    """
    expected = f"{kind} as YAML"
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=expected) from None
    except IsADirectoryError:
        raise InputError("is a folder", file=path, expected=f"a file: {expected}") from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=path) from None
    except UnicodeDecodeError:
        raise InputError("is not text", file=path, expected=expected) from None
    try:
        loader = _StrictLoader(text)
        root = loader.get_single_node()
        value = None if root is None else loader.construct_document(root)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"line {mark.line + 1}" if mark else None
        if error.problem and error.problem.endswith("given twice"):
            raise InputError(error.problem, file=path, place=place, expected="it once") from None
        problem = f"is not YAML ({error.problem or error.context})"
        raise InputError(problem, file=path, place=place, expected=expected) from None
    except RecursionError:
        raise InputError("is nested too deep", file=path, expected=expected) from None
    except (yaml.YAMLError, ValueError):
        # ReaderError: control characters; ValueError: a date such as 2024-99-99.
        raise InputError("is not YAML", file=path, expected=expected) from None
    if value is None:
        raise InputError("is empty", file=path, expected=expected)
    if not isinstance(value, dict):
        kind_found = "a list" if isinstance(value, list) else "a single value"
        raise InputError(f"holds {kind_found}", file=path, expected=f"{kind}: a mapping of fields")
    if not all(isinstance(key, str) for key in value):
        raise InputError("has a field whose name is not text", file=path, expected=kind)
    return Document(path, value, root)


def _model_at(model: type[BaseModel], location: Location) -> type[BaseModel] | None:
    """Return the model at a location below ``model``."""
    here: type[BaseModel] | None = model
    for step in location:
        if here is not None and isinstance(step, str) and step in here.model_fields:
            here = _model_in(here.model_fields[step].annotation)
    return here


def _model_in(annotation: object) -> type[BaseModel] | None:
    """Return the first model named in an annotation such as ``list[SensorSpec] | None``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for argument in getattr(annotation, "__args__", ()):
        if (found := _model_in(argument)) is not None:
            return found
    return None


def nearest(name: str, known: Sequence[str]) -> str:
    """Return the most similar known name, or all known names."""
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    return f"{close[0]!r}" if close else "one of " + ", ".join(known)


def _names(model: type[BaseModel] | None) -> list[str]:
    """Return the names of a model's fields, including those used in files only."""
    if model is None:
        return []
    return [*model.model_fields, *getattr(model, "also_written_as", ())]


_TYPES = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "list_type": "a list",
    "dict_type": "a mapping of fields",
    "model_type": "a mapping of fields",
    "model_attributes_type": "a mapping of fields",
    "finite_number": "a finite number",
}
_BOUNDS = {
    "greater_than": ("gt", "more than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}


def _in_words(error: ErrorDetails, model: type[BaseModel]) -> tuple[str, str | None]:
    """Return problem and expectation of one of pydantic's errors about ``model``."""
    kind, context = error["type"], error.get("ctx", {})
    problem, expected = f"is {_shown(error['input'])}", None
    if kind == "wrong":
        problem, expected = error["msg"], str(context["expected"])
    elif kind in ("missing", "extra_forbidden"):
        parent, name = _model_at(model, error["loc"][:-1]), str(error["loc"][-1])
        if kind == "missing":
            field = parent.model_fields.get(name) if parent else None
            problem, expected = "is missing", field.description if field else None
        else:
            problem, expected = "is not a field that is known here", nearest(name, _names(parent))
    elif kind in _TYPES:
        expected = _TYPES[kind]
    elif kind in _BOUNDS:
        key, words = _BOUNDS[kind]
        expected = f"{words} {context[key]:g}"
    elif kind == "literal_error":
        expected = str(context["expected"])
    elif kind in ("too_short", "string_too_short"):
        problem, expected = "is empty", "at least one"
    else:
        problem += f": {error['msg']}"
    return problem, expected


def _shown(value: object) -> str:
    """Return a value as the user wrote it, approximately and shortened."""
    if isinstance(value, Mapping | list):
        return "a mapping" if isinstance(value, Mapping) else "a list"
    if value is None:
        return "empty"
    text = repr(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def must_exist(
    document: Document,
    location: tuple[int | str, ...],
    path: Path,
    kind: str,
    *,
    folders: bool = False,
) -> None:
    """Check that a file named in a document exists.

    Raises:
        InputError: it does not, or is a folder where none is allowed.
    """
    problem = not_there(path, folders=folders)
    if problem is not None:
        raise document.error(problem, location, kind)


def not_there(path: Path, *, folders: bool = False) -> str | None:
    """Return why a path is not a file (with ``folders``, nor a folder); ``None`` if it is."""
    try:
        found, folder = path.exists(), path.is_dir()
    except (OSError, ValueError):  # name too long, or with a null byte
        found, folder = False, False
    if not found:
        return f"{str(path)!r} is not found"
    return f"{str(path)!r} is a folder" if folder and not folders else None
