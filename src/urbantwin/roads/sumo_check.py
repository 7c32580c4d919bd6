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
_LARGEST = 1e7
#: Required attributes of elements: texts, numbers within bounds, whole numbers, and shapes.
_TEXTS = {
    "lane": ("id",),
    "junction": ("id", "type"),
    "connection": ("from", "to"),
    "tlLogic": ("id",),
    "phase": ("state",),
    "request": ("response", "foes"),
}
_NUMBERS = {
    "lane": {"speed": (1e-6, 1000.0), "length": (1e-6, _LARGEST), "width": (0.0, 1000.0)},
    "junction": {"x": (-_LARGEST, _LARGEST), "y": (-_LARGEST, _LARGEST)},
    "phase": {"duration": (1e-3, 1e6)},
    "tlLogic": {"offset": (-1e9, 1e9)},
}
_WHOLE = {
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
                raise _wrong(problem, path, item)
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


def _wrong(problem: str, path: Path, item: etree._Element) -> InputError:
    return InputError(problem, file=path, place=f"line {item.sourceline}", expected=_EXPECTED)


def _problem_of(item: etree._Element) -> str | None:
    """Return the error message of an element, apart from references; ``None`` if it is valid."""
    tag = item.tag
    for name in _TEXTS.get(tag, ()):
        if not item.get(name) and tag != "request":
            return f"{tag} has no {name}"
    for name, (low, high) in _NUMBERS.get(tag, {}).items():
        if name in _OPTIONAL and not item.get(name):
            continue
        value = finite_number(item.get(name))
        if value is None or not low <= value <= high:
            return f"{tag} has no {name} that can be"
    for name in _WHOLE.get(tag, ()):
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
    numbers = [[finite_number(one) for one in point.split(",")] for point in points]
    return len(points) >= least and all(
        len(one) in (2, 3) and all(v is not None and abs(v) <= _LARGEST for v in one)
        for one in numbers
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
            raise _wrong("edge has no lanes in order", path, edge)
        lanes |= {lane.get("id"): lane for lane in own}
        inside = bool(edge.get("function"))
        ends = [] if inside else [edge.get("from"), edge.get("to")]
        crossed = edge.get("crossingEdges", "").split()
        if any(end not in junctions for end in ends) or any(one not in edges for one in crossed):
            raise _wrong("edge names what is not there", path, edge)
        if any(lane.get("id") != f"{edge.get('id')}_{k}" for k, lane in enumerate(own)):
            raise _wrong("edge has lanes of another", path, edge)
    for junction in junctions.values():
        named = f"{junction.get('incLanes', '')} {junction.get('intLanes', '')}".split()
        if any(one not in lanes for one in named):
            raise _wrong("junction names a lane that is not there", path, junction)
    states = {name: _width_of(logic, path) for name, logic in logics.items()}
    for item in root.iter("connection"):
        ends = [f"{item.get(one)}_{item.get(one + 'Lane')}" for one in ("from", "to")]
        ends += [item.get("via")] if item.get("via") else []
        if any(one not in lanes for one in ends):
            raise _wrong("connection names a lane that is not there", path, item)
        program = item.get("tl")
        if program and not int(item.get("linkIndex") or -1) < states.get(program, 0):
            raise _wrong("connection names a signal that is not there", path, item)
        if program and not item.get("linkIndex"):
            raise _wrong("connection has no linkIndex", path, item)


def _named(root: etree._Element, tag: str, path: Path) -> dict[str, etree._Element]:
    found: dict[str, etree._Element] = {}
    for item in root.iter(tag):
        name = item.get("id")
        if not name or name in found:
            raise _wrong(f"{tag} has no id of its own", path, item)
        found[name] = item
    return found


def _width_of(logic: etree._Element, path: Path) -> int:
    """Return the number of links in a program's states, which is equal in all phases."""
    widths = {len(phase.get("state")) for phase in logic.iter("phase")}
    if len(widths) != 1:
        raise _wrong("tlLogic has states of different lengths", path, logic)
    return widths.pop()
