"""Functions that are also commands; options are read from annotations and docstrings.

The command line (`urbantwin.cli`) is generated from these functions, so an option is declared once:

- name, type and default of an option are those of the parameter; `option_name` lists the few
  options that would otherwise be Python keywords;
- ``Annotated[int, Ge(0)]`` limits the value, in Python and on the command line; a string
  annotation, ``Annotated[..., "EAST NORTH YAW"]``, is the placeholder of the value in the help;
- the entry under ``Args:`` is the option's help, the first line of the docstring the command's
  help, and the first line under ``Example:`` that begins with ``$`` the command's example.
"""

from __future__ import annotations

import ast
import functools
import inspect
import os
import re
import textwrap
from collections import ChainMap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import Annotated, Any, Literal, ParamSpec, TypeVar, get_args, get_origin

from annotated_types import Ge, Interval

from urbantwin.errors import InputError

__all__ = ["Command", "Parameter", "command", "option_name", "read_command"]

_P = ParamSpec("_P")
_T = TypeVar("_T")

#: Parameters whose options have other names: Python keywords, and repeated options.
_OPTION_NAMES = {"changes": "set", "reach": "range", "weights": "from"}
#: Parameters that are named options although positional in Python.
_ALWAYS_NAMED = ("out", "to")
_ONE_BY_ONE = {"classes": "class", "heads": "head", "nodes": "node", "studies": "study"}


def option_name(parameter: str, *, many: bool = False) -> str:
    """Return the option of a parameter: ``--key-env`` of ``key_env``.

    Args:
        parameter: name of the parameter.
        many: whether the option may be given several times.
    """
    name = (_ONE_BY_ONE if many else _OPTION_NAMES).get(parameter, parameter)
    return "--" + name.replace("_", "-")


def command(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Check a function's arguments against the limits in its annotations before each call.

    With ``overwrite`` the function may replace any regular file; without, only a file that
    urbantwin wrote for the same output (`artefact.written_files`).
    """

    @functools.wraps(function)
    def checked(*arguments: _P.args, **named: _P.kwargs) -> _T:
        _check_limits(function, arguments, named)
        if "overwrite" not in inspect.signature(function).parameters:
            return function(*arguments, **named)
        from urbantwin.artefact import overwriting

        with overwriting(allowed=bool(named.get("overwrite", False))):
            return function(*arguments, **named)

    return checked


@dataclass(frozen=True)
class Parameter:
    """A parameter of a command.

    Attributes:
        name: name in Python.
        kind: ``path``, ``str``, ``int``, ``float``, ``bool`` or the allowed values.
        size: number of values of one option; above 1 for tuples only.
        many: whether the option may be repeated.
        required: whether it has no default.
        positional: whether the command line takes it by position, without its name.
        least, most: limits of the value.
        metavar: placeholder of the value in the help, if annotated.
        default: default value.
        help: its entry under ``Args:``.
    """

    name: str
    kind: str | tuple[str, ...]
    size: int
    many: bool
    required: bool
    positional: bool
    least: float | None
    most: float | None
    metavar: str | None
    default: Any
    help: str

    def check(self, value: Any) -> None:  # noqa: ANN401
        """Raise an `InputError` if a value is outside the limits."""
        if not isinstance(value, int | float):
            return
        low, high = self.least, self.most
        if (low is not None and not value >= low) or (high is not None and not value <= high):
            raise InputError(f"{value}", place=self.option, expected=self.limits)

    @property
    def option(self) -> str:
        """Name of the option: ``--key-env`` of ``key_env``."""
        return option_name(self.name, many=self.many)

    @property
    def limits(self) -> str:
        """The limits in words; empty without limits."""
        if self.least is not None and self.most is not None:
            return f"{self.least:g} to {self.most:g}"
        if self.least is not None:
            return f"at least {self.least:g}"
        return "" if self.most is None else f"at most {self.most:g}"


@dataclass(frozen=True)
class Command:
    """A command, read from the source of its function without importing its dependencies.

    Attributes:
        module: module of the function.
        name: name of the function.
    """

    module: str
    name: str

    @cached_property
    def _definition(self) -> ast.FunctionDef:
        spec = find_spec(self.module)
        assert spec is not None
        source: str = spec.loader.get_source(self.module)  # type: ignore[union-attr]
        return [
            node
            for node in ast.parse(source).body
            if isinstance(node, ast.FunctionDef) and node.name == self.name
        ][-1]  # earlier definitions are overloads

    @cached_property
    def documentation(self) -> str:
        """The docstring."""
        return ast.get_docstring(self._definition) or ""

    @property
    def title(self) -> str:
        """The first line of the docstring."""
        return self.documentation.partition("\n")[0]

    @property
    def description(self) -> str:
        """The paragraphs between the first line and the sections."""
        _, _, rest = self.documentation.partition("\n")
        return re.split(r"^\w+:$", rest, maxsplit=1, flags=re.MULTILINE)[0].strip()

    @property
    def example(self) -> str:
        """The command-line example."""
        found = re.search(r"^\$ (.+)$", self._section("Example"), re.MULTILINE)
        return found[1] if found else ""

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters, in order."""
        given = self._definition.args
        missing: list[ast.expr | None] = [None] * (len(given.args) - len(given.defaults))
        positional = zip(given.args, [*missing, *given.defaults], strict=True)
        named = zip(given.kwonlyargs, given.kw_defaults, strict=True)
        texts = self._help()
        return tuple(
            _parameter(
                one,
                default,
                texts.get(one.arg, ""),
                positional=before and one.arg not in _ALWAYS_NAMED,
            )
            for before, several in ((True, positional), (False, named))
            for one, default in several
        )

    def _section(self, title: str) -> str:
        found = re.search(rf"^{title}:\n((?:(?: .*)?\n?)*)", self.documentation, re.MULTILINE)
        return textwrap.dedent(found[1]) if found else ""

    def _help(self) -> dict[str, str]:
        entries = re.findall(r"^(\w+): (.*(?:\n .*)*)", self._section("Args"), re.MULTILINE)
        return {name: " ".join(text.split()) for name, text in entries}


@functools.cache
def read_command(module: str, name: str) -> Command:
    """Return a command, read from its source."""
    return Command(module, name)


class _Unknown(dict[str, Any]):
    """Namespace that maps unknown annotation names to placeholder classes."""

    def __missing__(self, name: str) -> Any:  # noqa: ANN401
        return type(name, (), {})


#: Names allowed in annotations.
_NAMES: dict[str, Any] = {
    "Annotated": Annotated,
    "AnyPath": str | os.PathLike[str],
    "Callable": Callable,
    "Ge": Ge,
    "Interval": Interval,
    "Literal": Literal,
    "Sequence": Sequence,
    **{one.__name__: one for one in (bool, float, int, str, tuple)},
}


def _parameter(one: ast.arg, default: ast.expr | None, text: str, *, positional: bool) -> Parameter:
    assert one.annotation is not None
    annotation = ast.unparse(one.annotation)
    return _as_parameter(
        one.arg, annotation, text, positional=positional, required=default is None,
        default=None if default is None else ast.literal_eval(default),
    )  # fmt: skip


def _as_parameter(
    name: str, annotation: str, text: str, *, positional: bool, required: bool, default: object
) -> Parameter:
    declared = eval(annotation, {"__builtins__": {}}, ChainMap(_NAMES, _Unknown()))  # trusted
    marks: tuple[Any, ...] = ()
    if get_origin(declared) is Annotated:
        declared, *marks = get_args(declared)  # type: ignore[assignment]
    kind, size, many = _kind(declared)
    return Parameter(
        name, kind, size, many, required, positional,
        next((one.ge for one in marks if getattr(one, "ge", None) is not None), None),
        next((one.le for one in marks if getattr(one, "le", None) is not None), None),
        next((one for one in marks if isinstance(one, str)), None), default, text,
    )  # fmt: skip


def _kind(declared: Any) -> tuple[str | tuple[str, ...], int, bool]:  # noqa: ANN401
    """Return the option type of an annotation: kind, number of values, and whether repeatable."""
    origin, inner = get_origin(declared), get_args(declared)
    if origin is Literal:
        return inner, 1, False
    if origin is Sequence:
        return _kind(inner[0])[0], 1, True
    if origin is tuple:
        return _kind(inner[0])[0], len(inner), False
    if inner:  # a union: the first member with an option type
        if os.PathLike[str] in inner and get_origin(inner[0]) is not Sequence:
            return "path", 1, False
        return next(found for one in inner if (found := _kind(one))[0] != "")
    return (declared.__name__ if declared in (bool, float, int, str) else ""), 1, False


def _check_limits(
    function: Callable[..., Any], arguments: tuple[Any, ...], named: dict[str, Any]
) -> None:
    limits = _limits(function)
    if not limits:
        return
    try:
        given = inspect.signature(function).bind(*arguments, **named).arguments
    except TypeError:
        return  # the call itself raises the error
    for name, value in given.items():
        if name in limits:
            limits[name].check(value)


@functools.cache
def _limits(function: Callable[..., Any]) -> dict[str, Parameter]:
    return {
        name: _as_parameter(name, text, "", positional=False, required=False, default=None)
        for name, text in inspect.get_annotations(function).items()
        if isinstance(text, str) and text.startswith("Annotated")
    }
