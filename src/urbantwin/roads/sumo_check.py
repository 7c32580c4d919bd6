"""Checks of a SUMO network file, as far as its readers rely on it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lxml import etree

from urbantwin.errors import InputError
from urbantwin.number_text import finite_number, whole_number

__all__ = ["check_sumo_network", "reading_sumo_network"]

_EXPECTED = "a SUMO network, as netconvert writes it"
_MAX_COORDINATE = 1e7
#: Required attributes of elements: texts, numbers within bounds, whole numbers, and shapes.
_TEXT_ATTRIBUTES = {
    "lane": ("id",),
    "junction": ("id", "type"),
    "connection": ("from", "to"),
    "tlLogic": ("id",),
    "phase": ("state",),
    "request": ("response", "foes"),
}
_NUMBERS = {
    "lane": {"speed": (1e-6, 1000.0), "length": (1e-6, _MAX_COORDINATE), "width": (0.0, 1000.0)},
    "junction": {
        "x": (-_MAX_COORDINATE, _MAX_COORDINATE),
        "y": (-_MAX_COORDINATE, _MAX_COORDINATE),
    },
    "phase": {"duration": (1e-3, 1e6)},
    "tlLogic": {"offset": (-1e9, 1e9)},
}
_INTEGER_ATTRIBUTES = {
    "lane": ("index",),
    "connection": ("fromLane", "toLane", "linkIndex"),
    "request": ("index",),
}
#: Optional numbers.
_OPTIONAL = {"width", "offset", "linkIndex"}


def check_sumo_network(path: Path) -> None:
    """Check a network: its numbers and its references.

    Raises:
        InputError: the file is missing, not XML, or not a valid network; the message names the
            line.
    """
    with reading_sumo_network(path):
        parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True)
        root = etree.parse(str(path), parser).getroot()
        if root.tag != "net" or root.getroottree().docinfo.doctype:
            raise InputError("is not a SUMO network", file=path, expected=_EXPECTED)
        for item in root.iter(etree.Element):
            problem = _problem_of(item)
            if problem:
                raise _input_error(problem, path, item)
        _check_names(root, path)


@contextmanager
def reading_sumo_network(path: Path) -> Iterator[None]:
    """Convert errors in reading a network's file into an error with one line.

    Raises:
        InputError: reading failed.
    """
    try:
        yield
    except etree.XMLSyntaxError as error:
        problem = f"is not XML ({error.msg})"
        raise InputError(problem, file=path, expected=_EXPECTED) from None
    except OSError as error:
        why = error.strerror or "not found"
        raise InputError(f"cannot be read ({why})", file=path, expected=_EXPECTED) from None
    except (KeyError, ValueError, TypeError, IndexError, AttributeError, ArithmeticError) as error:
        problem = f"is not a valid network ({type(error).__name__}: {error})"
        raise InputError(problem, file=path, expected=_EXPECTED) from None


def _input_error(problem: str, path: Path, item: etree._Element) -> InputError:
    return InputError(problem, file=path, place=f"line {item.sourceline}", expected=_EXPECTED)


def _problem_of(item: etree._Element) -> str | None:
    """Return the error message of an element, apart from references; ``None`` if it is valid."""
    tag = item.tag
    for name in _TEXT_ATTRIBUTES.get(tag, ()):
        if not item.get(name) and tag != "request":
            return f"{tag} has no {name}"
    for name, (low, high) in _NUMBERS.get(tag, {}).items():
        if name in _OPTIONAL and not item.get(name):
            continue
        value = finite_number(item.get(name))
        if value is None or not low <= value <= high:
            return f"{tag} has no {name} that can be"
    for name in _INTEGER_ATTRIBUTES.get(tag, ()):
        if name in _OPTIONAL and not item.get(name):
            continue
        number = whole_number(item.get(name))
        if number is None or not 0 <= number < 1e6:
            return f"{tag} has no {name} that can be"
    if tag in ("lane", "edge", "junction") and not _is_shape(item):
        return f"{tag} has no shape that can be"
    return None


def _is_shape(item: etree._Element) -> bool:
    least = 2 if item.tag == "lane" else 0
    points = (item.get("shape") or "").split()
    numbers = [[finite_number(word) for word in point.split(",")] for point in points]
    return len(points) >= least and all(
        len(row) in (2, 3) and all(v is not None and abs(v) <= _MAX_COORDINATE for v in row)
        for row in numbers
    )


def _check_names(root: etree._Element, path: Path) -> None:
    """Check for duplicate ids and dangling references."""
    edges = _named(root, "edge", path)
    junctions = _named(root, "junction", path)
    logics = _named(root, "tlLogic", path)
    lanes: dict[str, etree._Element] = {}
    for edge in edges.values():
        own = edge.findall("lane")
        if not own or [lane.get("index") for lane in own] != [str(k) for k in range(len(own))]:
            raise _input_error("edge has no lanes in order", path, edge)
        lanes |= {lane.get("id"): lane for lane in own}
        inside = bool(edge.get("function"))
        ends = [] if inside else [edge.get("from"), edge.get("to")]
        crossed = edge.get("crossingEdges", "").split()
        if any(end not in junctions for end in ends) or any(name not in edges for name in crossed):
            raise _input_error("edge names what is not there", path, edge)
        if any(lane.get("id") != f"{edge.get('id')}_{k}" for k, lane in enumerate(own)):
            raise _input_error("edge has lanes of another", path, edge)
    for junction in junctions.values():
        named = f"{junction.get('incLanes', '')} {junction.get('intLanes', '')}".split()
        if any(name not in lanes for name in named):
            raise _input_error("junction names a lane that is not there", path, junction)
    states = {name: _width_of(logic, path) for name, logic in logics.items()}
    for item in root.iter("connection"):
        ends = [f"{item.get(end)}_{item.get(end + 'Lane')}" for end in ("from", "to")]
        ends += [item.get("via")] if item.get("via") else []
        if any(name not in lanes for name in ends):
            raise _input_error("connection names a lane that is not there", path, item)
        program = item.get("tl")
        if program and not int(item.get("linkIndex") or -1) < states.get(program, 0):
            raise _input_error("connection names a signal that is not there", path, item)
        if program and not item.get("linkIndex"):
            raise _input_error("connection has no linkIndex", path, item)


def _named(root: etree._Element, tag: str, path: Path) -> dict[str, etree._Element]:
    elements: dict[str, etree._Element] = {}
    for item in root.iter(tag):
        name = item.get("id")
        if not name or name in elements:
            raise _input_error(f"{tag} has no id of its own", path, item)
        elements[name] = item
    return elements


def _width_of(logic: etree._Element, path: Path) -> int:
    """Return the number of links in a program's states, which is equal in all phases."""
    widths = {len(phase.get("state")) for phase in logic.iter("phase")}
    if len(widths) != 1:
        raise _input_error("tlLogic has states of different lengths", path, logic)
    return widths.pop()
