"""Street objects as described in files (tags, sizes, parts), and their solids."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, ValidationInfo, model_validator

from urbantwin.errors import InputError
from urbantwin.scene.piece import Piece, block, drum, turned
from urbantwin.scene.solids import rods
from urbantwin.scene.tag_values import count_of, length_m_of
from urbantwin.site.conditions import Strict
from urbantwin.site.yaml_document import nearest, read_document, wrong
from urbantwin.taxonomy import materials, semantic_classes

__all__ = ["Catalogue", "StreetObject", "street_objects"]

Tags = Mapping[str, str]
Values = dict[str, float | str]

#: Operators allowed in expressions.
_OPERATORS: dict[type[ast.AST], Callable[..., float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
}
_FUNCTIONS: dict[str, Callable[..., float]] = {"min": min, "max": max}
#: Sizes defined without a declaration: of lamps, by their position.
_GIVEN = ("reach", "usual_height")
#: The longest expression, characters.
_LONGEST = 200
#: Limits of the size of parts, and of their distance from the base of the object, metres.
_LARGEST_M, _SMALLEST_M = 200.0, 1e-3


def _text(value: Any) -> Any:  # noqa: ANN401 - YAML takes a bare yes or no for a truth
    return {True: "yes", False: "no"}.get(value, value) if isinstance(value, bool) else value


class _Tags(Strict):
    """Conditions on tags: every key has one of its values; ``None`` represents an absent key."""

    wanted: dict[str, list[str | None]]

    @model_validator(mode="before")
    @classmethod
    def _as_lists(cls, value: Any) -> Any:  # noqa: ANN401
        if not isinstance(value, dict):
            return value
        lists = {k: v if isinstance(v, list) else [v] for k, v in value.items()}
        return {"wanted": {k: [_text(v) for v in several] for k, several in lists.items()}}

    def hold(self, tags: Tags) -> bool:
        """Return whether all conditions hold for the tags of a feature."""
        return all(
            any(
                key not in tags if value is None else key in tags and fnmatchcase(tags[key], value)
                for value in values
            )
            for key, values in self.wanted.items()
        )


def _check_expression(value: float | str) -> float | str:
    if isinstance(value, str):
        _parsed(value)
    return value


Expression = Annotated[float | str, AfterValidator(_check_expression)]
Point = Annotated[list[Expression], Field(min_length=3, max_length=3)]


def _origin() -> list[float | str]:
    return [0.0, 0.0, 0.0]


class _Size(Strict):
    """A size: from a tag, otherwise the default."""

    usual: Expression
    tag: str | list[str] = ""
    count: bool = False
    least: float | None = None
    most: float | None = None
    choices: dict[str, float | str] = Field(default_factory=dict)

    def value(self, tags: Tags, known: Values) -> float | str:
        """Return the size in metres, the number, or the chosen text."""
        keys = [self.tag] if isinstance(self.tag, str) else self.tag
        text = next((tags[key] for key in keys if tags.get(key)), None)
        usual = _evaluated(self.usual, known)
        if self.choices:
            return self.choices.get(text or "", usual)
        mapped = (count_of if self.count else length_m_of)(text)
        value = mapped or usual
        if isinstance(value, str):
            return value
        if self.least is not None:
            value = max(value, self.least)
        return value if self.most is None else min(value, self.most)


class _Part(Strict):
    """A box, a drum or a bar with its material and class."""

    box: Point | None = None
    drum: Expression | None = None
    bar: Annotated[list[Point], Field(min_length=2, max_length=2)] | None = None
    at: Point = Field(default_factory=_origin)
    radius: Expression = 0.05
    top: Expression | None = None
    sides: Annotated[int, Field(ge=3, le=64)] | None = None
    material: str
    semantic: str = Field("other-object", alias="class")
    mirror: Literal["x", "y"] | None = None
    when: _Tags | None = None
    unless: _Tags | None = None

    @model_validator(mode="after")
    def _one_shape(self) -> _Part:
        if sum(shape is not None for shape in (self.box, self.drum, self.bar)) != 1:
            raise wrong("has no shape, or several", "one of box, drum, bar")
        if self.semantic not in semantic_classes():
            raise wrong(
                f"has the class {self.semantic!r}", nearest(self.semantic, [*semantic_classes()])
            )
        return self

    def expressions(self) -> list[float | str]:
        """Return all values of the part that may be expressions."""
        found: list[float | str] = [*(self.box or []), *self.at, self.radius]
        found += [one for one in (self.drum, self.top) if one is not None]
        return found + [value for point in self.bar or [] for value in point]

    def pieces(self, tags: Tags, known: Values) -> list[Piece]:
        """Return the part's solids, with the mirrored solid after the original."""
        if (self.when and not self.when.hold(tags)) or (self.unless and self.unless.hold(tags)):
            return []
        sides = [np.ones(3)]
        if self.mirror:
            sides.append(np.where(np.arange(3) == "xy".index(self.mirror), -1.0, 1.0))
        return [self._piece(side, known) for side in sides]

    def _piece(self, side: NDArray[np.float64], known: Values) -> Piece:
        def numbers(values: Sequence[float | str]) -> NDArray[np.float64]:
            return np.array([_number(value, known) for value in values])

        material = str(known.get(self.material, self.material))
        radius = max(_number(self.radius, known), _SMALLEST_M)
        top = radius if self.top is None else max(_number(self.top, known), _SMALLEST_M)
        if self.bar is not None:
            start, end = (side * numbers(point) for point in self.bar)
            if np.linalg.norm(end - start) < _SMALLEST_M:
                end = end + [0.0, 0.0, _SMALLEST_M]
            return Piece(rods(start, end, radius, top, self.sides or 6), self.semantic, material)
        at = side * numbers(self.at)
        if self.box is not None:
            return block(at, np.maximum(numbers(self.box), _SMALLEST_M), material, self.semantic)
        assert self.drum is not None
        high = max(_number(self.drum, known), _SMALLEST_M)
        return drum(at, high, radius, material, self.semantic, top, self.sides or 10)


class StreetObject(Strict):
    """A type of street object.

    Attributes:
        tags: conditions on a feature's tags; none for objects that code selects by name.
        counted: name in the counts of ``twin.json``.
        source: source of its sizes.
        placed: rule for its position.
        sizes: named sizes; each may use the previous sizes.
        parts: its parts.
        arms: for a lamp: parts of each arm.
    """

    tags: _Tags | None = None
    counted: str
    source: str = "not stated"
    placed: Literal["furniture", "pole", "lamp", "by name"] = "furniture"
    sizes: dict[str, _Size] = Field(default_factory=dict)
    parts: list[_Part] = Field(default_factory=list)
    arms: list[_Part] = Field(default_factory=list)

    @model_validator(mode="after")
    def _complete(self, info: ValidationInfo) -> StreetObject:
        if (self.tags is None) != (self.placed == "by name"):
            raise wrong("has no tags", "tags: the tags of the map that make it")
        known = set(_GIVEN)
        for name, size in self.sizes.items():
            _check_names([size.usual], known)
            known.add(name)
        for part in (*self.parts, *self.arms):
            _check_names(part.expressions(), known)
            if part.material not in materials() and part.material not in self.sizes:
                raise wrong(
                    f"has the material {part.material!r}", nearest(part.material, [*materials()])
                )
        try:
            self.pieces({}, (0.0,))
        except InputError as error:
            raise wrong(error.problem, "sizes that are numbers") from None
        return self

    def pieces(
        self,
        tags: Tags,
        yaws: Sequence[float] = (),
        *,
        reach: float = 1.3,
        usual_height: float = 8.0,
    ) -> list[Piece]:
        """Return its solids in its own frame.

        Args:
            tags: tags of the feature.
            yaws: headings of its arms relative to the object's heading, radians.
            reach: distance of the lights from the mast, metres.
            usual_height: height of lamps without a mapped height, metres.

        Raises:
            InputError: an expression has no value: a division by 0, a root of a negative number.
        """
        known: Values = {"reach": reach, "usual_height": usual_height}
        try:
            for name, size in self.sizes.items():
                known[name] = size.value(tags, known)
            found = [piece for part in self.parts for piece in part.pieces(tags, known)]
            for yaw in yaws:
                arm = [piece for part in self.arms for piece in part.pieces(tags, known)]
                found += [turned(piece, yaw) for piece in arm]
        except (ArithmeticError, TypeError) as error:
            raise InputError(f"has a size without a value ({error})", place=self.counted) from None
        return found


class Catalogue:
    """Street objects by name; the user's objects come before those of the package."""

    def __init__(self, objects: Mapping[str, StreetObject]) -> None:
        self._objects = objects

    def __getitem__(self, name: str) -> StreetObject:
        """Return an object by its name."""
        return self._objects[name]

    def __iter__(self) -> Iterator[StreetObject]:
        """Return the objects in the order in which tags are tried."""
        return iter(self._objects.values())

    def of(self, tags: Tags, *placed: str) -> StreetObject | None:
        """Return the first object that a feature's tags make and that is placed by these rules."""
        for one in self:
            if one.placed in placed and one.tags is not None and one.tags.hold(tags):
                return one
        return None


@cache
def _own() -> dict[str, StreetObject]:
    return _read(Path(str(files(__package__).joinpath("street_objects.yaml"))))


def _read(path: Path) -> dict[str, StreetObject]:
    document = read_document(path, kind="street objects")
    found = {}
    for name, value in document.value.items():
        if not isinstance(value, dict):
            raise document.error("is no street object", (name,), "tags, counted, parts")
        found[name] = document.part(name).validated(StreetObject)
    return found


def street_objects(path: Path | None = None) -> Catalogue:
    """Return the catalogue of street objects.

    Args:
        path: the user's own objects, which come before those of the package.

    Raises:
        InputError: the file cannot be read, or describes no street objects.
    """
    own = _own()
    given = {} if path is None else _read(path)
    return Catalogue({**given, **{name: one for name, one in own.items() if name not in given}})


@cache
def _parsed(text: str) -> ast.expr:
    """Return an expression as a tree of numbers, names, operators, ``min`` and ``max``."""
    if len(text) > _LONGEST:
        raise wrong(f"has {len(text)} characters", f"an expression of at most {_LONGEST}")
    try:
        tree = ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise wrong(f"is {text!r}", "a number, or an expression of sizes") from None
    for node in ast.walk(tree):
        sound = (
            (isinstance(node, ast.Constant) and type(node.value) in (int, float))
            or isinstance(node, ast.BinOp | ast.UnaryOp | ast.Name | ast.Load)
            or type(node) in _OPERATORS
            or (isinstance(node, ast.Call) and _name(node.func) in _FUNCTIONS and not node.keywords)
        )
        if not sound:
            if _is_material(text):
                return ast.Name(text)
            raise wrong(f"is {text!r}", "a number, or an expression of sizes")
    return tree


def _is_material(text: str) -> bool:
    return text in materials()


def _name(node: ast.AST) -> str:
    return node.id if isinstance(node, ast.Name) else ""


def _check_names(expressions: Sequence[float | str], known: set[str]) -> None:
    for text in expressions:
        if isinstance(text, float | int) or _is_material(text):
            continue
        for node in ast.walk(_parsed(text)):
            if isinstance(node, ast.Name) and node.id not in known and node.id not in _FUNCTIONS:
                raise wrong(f"uses {node.id!r}", nearest(node.id, sorted(known)))


def _evaluated(value: float | str, known: Values) -> float | str:
    if isinstance(value, float | int) or _is_material(value):
        return value
    return _result(_parsed(value), known)


def _number(value: float | str, known: Values) -> float:
    number = _evaluated(value, known)
    if isinstance(number, str | complex) or np.isnan(number):
        raise TypeError(f"{value!r} is no number")
    return float(np.clip(number, -_LARGEST_M, _LARGEST_M))


def _result(node: ast.expr, known: Values) -> float:
    if isinstance(node, ast.Constant):
        return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        return known[node.id]  # type: ignore[return-value]
    if isinstance(node, ast.BinOp):
        return _OPERATORS[type(node.op)](_result(node.left, known), _result(node.right, known))
    if isinstance(node, ast.UnaryOp):
        return _OPERATORS[type(node.op)](_result(node.operand, known))
    assert isinstance(node, ast.Call)
    return _FUNCTIONS[_name(node.func)](*(_result(one, known) for one in node.args))
