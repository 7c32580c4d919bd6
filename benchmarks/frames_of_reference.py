"""How often `compare` says what is wrong with frames that were spoilt, and nothing of honest ones.

Every case is a pair of frames of one place (a real frame and the next; a frame of a dataset and a
later one, with other traffic), made worse at random (noise, drop-out, sectors and heights that
the twin lacks), and one thing that is done to the real one.
"""

from __future__ import annotations

import argparse
import json
import re
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from argoverse_log import DATA
from urbantwin.fidelity.consistency import doubts_about
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers import open_recording

Array = NDArray[np.float64]
Random = np.random.Generator
#: What was done to a frame, and what must be said: words, or a number to be found in them.
Spoilt = tuple[Frame, str, float | None]


def as_plain(frame: Frame) -> Frame:
    """A frame as a folder of clouds gives it: no labels, no pose, the sensor at the origin."""
    return replace(
        frame,
        points=frame.points,
        boxes=None, semantic=None, instance=None, world_SE3_frame=None,
    )  # fmt: skip


def lacking(frame: Frame, random: Random) -> Frame:
    """A twin's frame without what a twin may lack: walls in some sectors, heights; other noise."""
    points = frame.points - frame.sensor_places[0]
    kept = random.random(len(points)) > random.uniform(0, 0.3)
    level = np.percentile(points[:, 2], 20)
    tall = points[:, 2] > level + 1.0
    heading = np.degrees(np.arctan2(points[:, 1], points[:, 0])) % 360
    for _ in range(random.integers(0, 4)):
        first, width = random.uniform(0, 360), random.uniform(20, 90)
        kept &= ~(tall & ((heading - first) % 360 < width))
    if random.random() < 0.5:
        kept &= points[:, 2] < level + random.uniform(3, 12)
    frame = frame.only(kept)
    noise = random.normal(scale=random.uniform(0.0, 0.05), size=frame.points.shape)
    return replace(frame, points=frame.points + noise)


def _moved(frame: Frame, linear: Array, shift: tuple[float, ...] = (0, 0, 0)) -> Frame:
    return replace(
        frame,
        points=frame.points @ linear.T + shift,
        sensor_places=frame.sensor_places @ linear.T + shift,
    )


def _about_z(degrees: float) -> Array:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def quarter(frame: Frame, random: Random) -> Spoilt:
    turn = float(random.choice([90, 180, -90]))
    return _moved(frame, _about_z(turn)), "rotated", abs(turn)


def turned(frame: Frame, random: Random) -> Spoilt:
    turn = float(random.uniform(3, 178) * random.choice([-1, 1]))
    return _moved(frame, _about_z(turn)), "rotated", abs(turn)


def mirrored(frame: Frame, random: Random) -> Spoilt:
    flip = np.diag(random.choice([[1, -1, 1], [-1, 1, 1]]).astype(float))
    return _moved(frame, flip), "mirrored", None


def shifted(frame: Frame, random: Random) -> Spoilt:
    way, far = random.uniform(0, 2 * np.pi), random.uniform(1.5, 25)
    x = float(far * np.cos(way))
    shift = (x, float(far * np.sin(way)), 0.0)
    return _moved(frame, np.eye(3), shift), "shifted by", abs(x)


def raised(frame: Frame, random: Random) -> Spoilt:
    up = float(random.uniform(0.7, 8) * random.choice([-1, 1]))
    return _moved(frame, np.eye(3), (0, 0, up)), "shifted in height", abs(up)


def tilted(frame: Frame, random: Random) -> Spoilt:
    tilt = float(random.uniform(4, 12))
    c, s = np.cos(np.radians(tilt)), np.sin(np.radians(tilt))
    tip = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    turn = _about_z(random.uniform(0, 360))
    return _moved(frame, turn @ tip @ turn.T), "tilted", tilt


def other_unit(frame: Frame, random: Random) -> Spoilt:
    name, metres = [("feet", 0.3048), ("millimetres", 0.001), ("centimetres", 0.01)][
        random.integers(3)
    ]
    return _moved(frame, np.eye(3) / metres), name, None


def other_axes(frame: Frame, random: Random) -> Spoilt:
    axes, up = [
        ([[0, -1, 0], [0, 0, -1], [1, 0, 0]], "along -y"),
        ([[0, -1, 0], [0, 0, 1], [-1, 0, 0]], "along y"),
        ([[1, 0, 0], [0, -1, 0], [0, 0, -1]], "along -z"),
    ][random.integers(3)]
    return _moved(frame, np.array(axes, float)), up, None


def fewer_rings(frame: Frame, random: Random) -> Spoilt:
    assert frame.ring is not None
    return frame.only(frame.ring % 2 == 0), "sensor", None


def cut_view(frame: Frame, random: Random) -> Spoilt:
    seen = frame.points - frame.sensor_places[0]
    elevation = np.degrees(np.arctan2(seen[:, 2], np.hypot(seen[:, 0], seen[:, 1])))
    return frame.only(elevation > np.percentile(elevation, 1) + 8), "lowest beams", None


def cut_range(frame: Frame, random: Random) -> Spoilt:
    away = np.linalg.norm(frame.points - frame.sensor_places[0], axis=1)
    reach = float(np.percentile(away, random.uniform(75, 92)))
    return frame.only(away < reach), "end sharply", reach


def fewer_columns(frame: Frame, random: Random) -> Spoilt:
    if frame.column is None:
        return frame.only(np.arange(len(frame.points)) % 3 == 0), "another sensor", None
    return frame.only(frame.column % 2 == 0), "another", None


SPOILT: dict[str, Callable[[Frame, Random], Spoilt]] = {
    "quarter and half turns": quarter, "any other turn": turned, "mirrored": mirrored,
    "shifted in plan": shifted, "shifted in height": raised, "tilted": tilted,
    "another unit": other_unit, "another axis up": other_axes, "half the rings": fewer_rings,
    "lowest 8 degrees missing": cut_view, "range cut": cut_range, "fewer columns": fewer_columns,
}  # fmt: skip


def is_said(said: list[str], words: str, value: float | None) -> bool:
    """Whether one sentence has the words and, of its numbers, one near the value."""
    for one in said:
        if words in one:
            found = [abs(float(text)) for text in re.findall(r"\d+\.?\d*", one)]
            return value is None or any(abs(n - value) < max(1.0, 0.05 * value) for n in found)
    return False


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("recordings", type=Path, nargs="+", help="of one place each")
    parser.add_argument("--argoverse", type=Path, default=DATA)
    parser.add_argument("--cases", type=int, default=20, help="of each kind")
    parser.add_argument("--frames", type=int, default=12, help="of each recording")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    places: list[list[Frame]] = []
    for path in [*options.recordings, options.argoverse]:
        recording = open_recording(path)
        spread = np.linspace(0, len(recording) - 1, min(len(recording), options.frames))
        places.append([as_plain(recording.read(int(i))) for i in np.unique(spread.astype(int))])
    rows: dict[str, list[bool]] = defaultdict(list)
    wrong = []
    for case in range(options.cases):
        random = np.random.default_rng(case)

        def pair(which: int, random: Random = random) -> tuple[Frame, Frame]:
            a, b = random.choice(len(places[which]), 2, replace=False)
            return places[which][a], lacking(places[which][b], random)

        for kind in ("nothing", *SPOILT, "another place"):
            which = int(random.integers(len(places)))
            real, twin = pair(which)
            if kind == "nothing":
                said = doubts_about(real, twin)
                good = not said
            elif kind == "another place":
                twin = pair((which + 1 + int(random.integers(len(places) - 1))) % len(places))[1]
                said = doubts_about(real, twin)
                good = is_said(said, "different places", None)
            else:
                if kind == "half the rings" and real.ring is None:
                    continue
                real, words, value = SPOILT[kind](real, random)
                said = doubts_about(real, twin)
                good = is_said(said, words, value)
            rows[kind].append(good)
            if not good:
                wrong.append({"case": case, "kind": kind, "place": which, "said": said})
    if options.json:
        print(json.dumps({"good": {k: [sum(v), len(v)] for k, v in rows.items()}, "wrong": wrong}))
        return
    for kind, found in rows.items():
        print(f"{kind:26s} {sum(found):4d} of {len(found):4d}")
    for one in wrong:
        print(one)


if __name__ == "__main__":
    main()
