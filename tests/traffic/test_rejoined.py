"""Tracks that are broken in two and belong together: joined, and no others."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from urbantwin.geometry import SiteFrame
from urbantwin.traffic.recorded.read import read_recording
from urbantwin.traffic.recorded.rejoined import rejoined
from urbantwin.traffic.recorded.track import RecordedTrack

DESCRIPTION = """
tracks: {}
origin: {{latitude: 49.005306, longitude: 8.4374089}}
columns: {{track: track_id, time: timestamp_ms, class: agent_type, x: x, y: y, yaw: psi_rad}}
units: {{time: ms, angle: rad}}
"""


def part(track: RecordedTrack, rows: slice, name: str) -> RecordedTrack:
    fields = (getattr(track, one)[rows] for one in ("time_s", "xy", "yaw", "z"))
    return RecordedTrack(name, track.actor_class, *fields, track.size)


def broken(tracks: Sequence[RecordedTrack], seed: int) -> tuple[list[RecordedTrack], int]:
    """Long tracks cut in two, with a gap of 0.5 to 1.5 s, under two names."""
    random = np.random.default_rng(seed)
    found, cuts = [], 0
    for one in tracks:
        count, lost = len(one.time_s), int(random.integers(5, 16))
        if count < 60 + lost:
            found.append(one)
            continue
        at = int(random.integers(25, count - 25 - lost))
        found.append(part(one, slice(0, at), f"{one.name} begins"))
        found.append(part(one, slice(at + lost, count), f"{one.name} ends"))
        cuts += 1
    return sorted(found, key=lambda one: float(one.time_s[0])), cuts


def test_who_turns_and_brakes_is_found_again_beside_another() -> None:
    time_s = np.arange(0, 12, 0.1)
    angle = 8.0 * time_s / 25.0
    turning = np.column_stack([25 * np.sin(angle), 25 - 25 * np.cos(angle)])
    gone = 10 * time_s - 0.4 * time_s**2
    braking = np.column_stack([gone, np.full_like(gone, -4.0)])
    nothing, size = np.full(len(time_s), np.nan), np.array([4.5, 1.8, 1.5])
    tracks = [
        RecordedTrack(name, "car", time_s, xy, nothing, nothing, size)
        for name, xy in (("turns", turning), ("brakes", braking), ("beside", braking + [0, -3.2]))
    ]
    parts, cuts = broken(tracks, 1)
    assert cuts == 3
    whole, mended = rejoined(parts)
    assert mended == 3
    for one, true in zip(
        sorted(whole, key=lambda x: x.name), ("beside", "brakes", "turns"), strict=True
    ):
        (track,) = (x for x in tracks if x.name == true)
        assert one.name == f"{true} begins"
        kept = np.isin(track.time_s, one.time_s)
        assert one.xy == pytest.approx(track.xy[kept])


def test_real_tracks_that_are_cut_are_joined_and_no_others(
    shared_data: Path, tmp_path: Path
) -> None:
    described = tmp_path / "tracks.yaml"
    recording = shared_data / "tracks/karlsruhe-k733/vehicle_tracks_000.csv"
    described.write_text(DESCRIPTION.format(recording))
    tracks = read_recording(described, SiteFrame(49.005306, 8.4374089)).tracks
    assert rejoined(tracks)[1] == 0
    parts, cuts = broken(tracks, 1)
    whole, mended = rejoined(parts)
    ends = {one.name: one.time_s[-1] for one in tracks}
    joined = [one for one in whole if one.name.removesuffix(" begins") in ends]
    right = [x for x in joined if x.time_s[-1] == ends[x.name.removesuffix(" begins")]]
    assert mended >= 0.65 * cuts
    assert len([one for one in right if one.name.endswith("begins")]) == mended
