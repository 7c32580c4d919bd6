"""Content of the viewer's page: its document, and its packets, made on request."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.taxonomy import BOX_SEMANTICS, semantic_classes
from urbantwin.web.beside import away_from
from urbantwin.web.points import points_packet
from urbantwin.web.shown_boxes import boxes_packet
from urbantwin.web.side import Side
from urbantwin.web.verdicts import DetectionsBeside

__all__ = ["Shown"]

#: Largest total size of cached packets, bytes.
_KEPT_BYTES = 192 << 20
_FORMAT = 1


@dataclass(eq=False)
class Shown:
    """Content of the page.

    Attributes:
        title: title for display.
        kind: ``dataset``, ``motion``, ``twin``, ``frames`` or ``pair``.
        sides: one or two sides; none for a twin alone.
        scene_frame: ``site`` or ``points``.
        pairs: indices of paired frames; None with one side.
        layers: functions that make packets without a frame, by name.
        signals: whether the lanes' packet has signal states.
        sensors: see `sensor_entries`.
        events: see `scene_events`.
        worst: worst places of a report.
        ground_z: height of the ground near the sensors, metres.
        detections: detections over the labels of side 0.
        attribution: attributions of the data.
        notes: notes for the user.
    """

    title: str
    kind: str
    sides: list[Side] = field(default_factory=list)
    scene_frame: str = "site"
    pairs: list[tuple[int, int]] | None = None
    layers: dict[str, Callable[[], bytes]] = field(default_factory=dict)
    signals: bool = False
    sensors: list[dict[str, Any]] = field(default_factory=list)
    events: list[dict[str, Any]] = field(default_factory=list)
    worst: list[dict[str, Any]] | None = None
    ground_z: float = 0.0
    detections: DetectionsBeside | None = None
    attribution: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Begin without any packet."""
        self._packets: OrderedDict[str, bytes] = OrderedDict()
        self._size = 0
        self._lock = Lock()
        self._making: dict[str, Lock] = {}

    def document(self) -> dict[str, Any]:
        """Return the page's document; see docs/reference/formats.md."""
        has = self.layers
        return {
            "format": _FORMAT,
            "title": self.title,
            "kind": self.kind,
            "classes": [
                {"id": one.id, "name": one.name, "colour": list(one.colour)}
                for one in semantic_classes().values()
            ],
            "box_classes": [
                {"name": name, "colour": list(semantic_classes()[of].colour)}
                for name, of in BOX_SEMANTICS.items()
            ],
            "sides": [self.document_side(number) for number in range(len(self.sides))],
            "pairs": None if self.pairs is None else [list(pair) for pair in self.pairs],
            "events": self.events,
            "worst": self.worst,
            "sensors": self.sensors,
            "twin": {
                "packet": "twin",
                "lanes": "lanes" if "lanes" in has else None,
                "signals": self.signals,
                "coverage": {"packet": "coverage"} if "coverage" in has else None,
            }
            if "twin" in has
            else None,
            "tracks": "tracks" if "tracks" in has else None,
            "detections": self.detections is not None,
            "scene_frame": self.scene_frame,
            "up": [0, 0, 1],
            "ground_z": round(self.ground_z, 3),
            "units": "m",
            "attribution": self.attribution,
        }

    def document_side(self, number: int) -> dict[str, Any]:
        """Return the document's entry of a side."""
        side = self.sides[number]
        return {
            "name": side.name,
            "role": side.role,
            "fields": [*side.fields, *(["away"] if self.pairs is not None else [])],
            "frames": [
                {
                    "name": one.name,
                    "time_s": one.time_s,
                    "points": one.points,
                    "error": one.error,
                }
                for one in side.entries
            ],
            "rate_hz": round(side.rate_hz, 6),
            "box_packet": side.has_boxes or (self.detections is not None and number == 0),
            "point_packet": side.has_points,
        }

    def names(self) -> list[str]:
        """Return the names of all packets: layers first, then frame by frame."""
        found = list(self.layers)
        shown = self._frames_shown()
        for number, side in enumerate(self.sides):
            told = self.document_side(number)
            for index in shown[number]:
                if side.entries[index].error is None:
                    if told["point_packet"]:
                        found.append(f"points/{number}/{index}")
                    if told["box_packet"]:
                        found.append(f"boxes/{number}/{index}")
        return found

    def _frames_shown(self) -> list[list[int]]:
        if self.pairs is not None:
            return [sorted({pair[side] for pair in self.pairs}) for side in (0, 1)]
        return [list(range(len(side.entries))) for side in self.sides]

    def packet(self, name: str) -> bytes:
        """Return a packet; recent ones are cached.

        Raises:
            KeyError: no packet has this name.
            InputError: its input cannot be read.
        """
        make = self._maker(name)
        with self._lock:
            own = self._making.setdefault(name, Lock())
        with own:  # simultaneous requests share one
            with self._lock:
                if name in self._packets:
                    self._packets.move_to_end(name)
                    return self._packets[name]
            made = make()
            with self._lock:
                self._packets[name] = made
                self._size += len(made)
                while self._size > _KEPT_BYTES and len(self._packets) > 1:
                    self._size -= len(self._packets.popitem(last=False)[1])
        return made

    def _maker(self, name: str) -> Callable[[], bytes]:
        if name in self.layers:
            return self.layers[name]
        kind, _, rest = name.partition("/")
        side, _, frame = rest.partition("/")
        if kind not in ("points", "boxes") or not (_is_number(side) and _is_number(frame)):
            raise KeyError(name)
        number, index = int(side), int(frame)
        if number >= len(self.sides) or index >= len(self.sides[number].entries):
            raise KeyError(name)
        told = self.document_side(number)
        if not told["point_packet" if kind == "points" else "box_packet"]:
            raise KeyError(name)
        return (
            (lambda: self._points(number, index))
            if kind == "points"
            else (lambda: self._boxes(number, index))
        )

    def _refuse_damaged(self, number: int, index: int) -> None:
        error = self.sides[number].entries[index].error
        if error is not None:
            raise InputError(error)

    def _points(self, number: int, index: int) -> bytes:
        self._refuse_damaged(number, index)
        side = self.sides[number]
        frame = side.frame(index)
        away: NDArray[np.float64] | None = None
        if self.pairs is not None:
            other = next((pair[1 - number] for pair in self.pairs if pair[number] == index), None)
            try:
                if other is not None:
                    away = away_from(frame, self.sides[1 - number].frame(other))
            except InputError:
                pass  # the damaged frame is reported where it is shown
        return points_packet(frame, full_scale=side.full_scale, fields=side.fields, away=away)

    def _boxes(self, number: int, index: int) -> bytes:
        self._refuse_damaged(number, index)
        boxes = self.sides[number].boxes(index)
        if self.detections is not None and number == 0:
            boxes = self.detections.over(index, boxes)
        return boxes_packet(boxes)


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) <= 9
