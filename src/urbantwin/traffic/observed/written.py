"""Files of an observation: tracks in a common format, and proposed paths for drawing streets."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.result_warning import ResultWarning
from urbantwin.traffic.observed.frame_times import FrameTimes
from urbantwin.traffic.observed.observe import Observation
from urbantwin.traffic.observed.observed_track import ObservedTrack

__all__ = ["observed_summary", "spacing_summary", "spacing_warnings", "write_observation"]

#: Least length of vehicle tracks proposed as lines, metres.
LONG_M = 6.0
#: Step of frames, seconds, from which times are rounded to tenths of seconds, the steps of motions;
#: otherwise actors seen once would be at none of them.
SLOW_S = 0.5


def write_observation(folder: Path, found: Observation) -> dict[str, Any]:
    """Write ``tracks.csv`` and ``proposal.geojson``; return the summary."""
    time_s = found.times.time_s
    if found.times.told and np.diff(time_s).min(initial=np.inf) >= SLOW_S:
        time_s = time_s.round(1)
    with (folder / "tracks.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow("track_id time_s class x y yaw_rad length width height".split())
        for number, track in enumerate(found.tracks, 1):
            for frame, (x, y, yaw) in zip(track.frames, track.boxes, strict=True):
                size = [f"{value:.2f}" for value in track.size]
                row = [f"{time_s[frame]:.3f}", track.actor_class, f"{x:.3f}", f"{y:.3f}"]
                table.writerow([number, *row, f"{yaw:.4f}", *size])
    (folder / "proposal.geojson").write_text(_proposal(found.tracks), encoding="utf-8")
    return observed_summary(found)


def observed_summary(found: Observation) -> dict[str, Any]:
    """Return, by class, numbers of moving and waiting actors, and the median speed."""
    rows = {}
    for name in sorted({track.actor_class for track in found.tracks}):
        of_class = [track for track in found.tracks if track.actor_class == name]
        speeds = [track.speed for track in of_class if track.moves and len(track.frames) > 1]
        rows[name] = {
            "tracks": len(of_class),
            "wait": sum(not track.moves for track in of_class),
            "a_frame": round(
                sum(len(track.frames) for track in of_class) / max(found.frames, 1), 1
            ),
            "median_speed_m_s": round(float(np.median(speeds)), 2) if speeds else None,
        }
    return rows


def spacing_summary(times: FrameTimes, names: Sequence[str]) -> dict[str, Any]:
    """Return the known gaps between frames (N names); empty if they are even."""
    summary: dict[str, Any] = {}
    if times.gap.any():
        summary = {"gaps": int(times.gap.sum()), "of_pairs": len(times.gap)}
        if times.confidence is not None:
            summary["confidence"] = round(float(times.confidence.mean()), 3)
        summary["gap_after"] = [names[k] for k in np.flatnonzero(times.gap).tolist()]
    return summary


def spacing_warnings(times: FrameTimes) -> list[ResultWarning]:
    """Return a warning if gaps between frames were detected."""
    if times.confidence is None or not times.gap.any():
        return []
    return [
        ResultWarning(
            "frames",
            f"{times.gap.sum()} of {len(times.gap)} pairs have a gap between them",
            "moving objects are farther apart than one frame allows "
            f"({times.confidence.mean():.0%} sure), and tracks end there",
            "give the times of the frames, --times",
        )
    ]


def _proposal(tracks: tuple[ObservedTrack, ...]) -> str:
    """Return the paths of vehicles as a sketch, which a person then connects to streets."""
    features = []
    for number, track in enumerate(tracks, 1):
        driven = np.linalg.norm(track.boxes[-1, :2] - track.boxes[0, :2])
        if track.actor_class in ("pedestrian", "bicycle") or driven < LONG_M:
            continue
        points = np.round(track.boxes[:: max(1, len(track.boxes) // 6), :2], 1).tolist()
        properties = {
            "kind": "street",
            "lanes": 1,
            "note": f"track {number}, {track.actor_class}, {track.speed:.1f} m/s",
        }
        line = {"type": "LineString", "coordinates": points}
        features.append({"type": "Feature", "properties": properties, "geometry": line})
    rows = ",\n".join(json.dumps(feature) for feature in features)
    return f'{{\n"type": "FeatureCollection",\n"crs": "site",\n"features": [\n{rows}\n]\n}}\n'
