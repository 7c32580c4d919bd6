"""Opening of paths for the viewer, with the artefacts beside them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.artefact import kind_of
from urbantwin.artefact.document import read_bytes
from urbantwin.detections.forms import read_any_form
from urbantwin.drawing.pictures import attributions
from urbantwin.errors import InputError
from urbantwin.fidelity.readers import Recording, open_recording
from urbantwin.fidelity.readers.layouts import layout_of, recordings_inside
from urbantwin.geometry import Pose
from urbantwin.lidar import place_rig
from urbantwin.progress import Progress, untold
from urbantwin.traffic import Motion
from urbantwin.twin import Twin, load_twin
from urbantwin.web.beside import (
    away_from,
    farthest_place,
    pairs_of_sides,
    worst_places,
)
from urbantwin.web.motion_side import MotionSide
from urbantwin.web.own_dataset import OwnDataset
from urbantwin.web.own_fleet import OwnFleet
from urbantwin.web.recorded_side import RecordedSide
from urbantwin.web.scene_events import events_of
from urbantwin.web.sensor_entries import sensors_of_frame, sensors_of_manifest, sensors_of_rig
from urbantwin.web.shown import Shown
from urbantwin.web.tracks import tracks_of, tracks_packet
from urbantwin.web.twin_layers import coverage_packet, lanes_packet, twin_packet
from urbantwin.web.verdicts import DetectionsBeside
from urbantwin.web.wanted import EXPECTED, Wanted, sought

__all__ = ["Wanted", "open_shown"]


def open_shown(wanted: Wanted, tell: Progress = untold) -> Shown:
    """Open the requested paths.

    Raises:
        InputError: a path is missing, damaged, or cannot be shown.
    """
    return _Opening(wanted, tell).shown()


class _Opening:
    def __init__(self, wanted: Wanted, tell: Progress) -> None:
        self.wanted, self.tell = wanted, tell
        self.sought = sought(wanted)

    def shown(self) -> Shown:
        """Return the content to show."""
        paths, kinds = self.sought.paths, self.sought.kinds
        if len(kinds) == 1 and kinds[0] in ("twin", "motion"):
            if self.sought.detections is not None:
                raise InputError("has no frames with points", file=paths[0], expected="a dataset")
            return self._of_site(paths[0], kinds[0])
        for path, kind in zip(paths, kinds, strict=True):
            if kind not in (None, "dataset", "fleet"):
                raise InputError(f"is a {kind}", file=path, expected=EXPECTED)
        return self._of_frames()

    # -- a twin, a motion --------------------------------------------------------------------

    def _of_site(self, path: Path, kind: str) -> Shown:
        folder = path if kind == "twin" else self._twin_folder(path)
        twin = None if folder is None else load_twin(folder)
        if kind == "twin":
            motion = self._motion(path, twin)
        else:
            motion = Motion.load(path)
            if twin is not None and motion.manifest.get("twin_sha256") != twin.sha256:
                if self.wanted.twin is not None:
                    raise InputError(
                        "is not the twin that the motion was driven on", file=folder, expected="it"
                    )
                twin = None
        shown = Shown(title=path.resolve().name, kind="motion" if kind == "motion" else "twin")
        if motion is not None:
            side = MotionSide(motion, chosen=self.wanted.frames.rows)
            if not side.entries:
                raise InputError("has no steps", file=path, expected="at least one")
            shown.sides = [side]
            self._paths_and_events(shown, side)
        if twin is not None:
            shown.title = f"{twin.manifest['name']}"
            self._twin_layers(shown, twin, motion, None)
            shown.sensors = self._rig_of(twin)
        return shown

    def _rig_of(self, twin: Twin) -> list[dict[str, Any]]:
        try:
            spec = twin.rig_spec()
            if spec.ride is not None:
                return []
            rig = place_rig(spec, twin.mesh, anchor_height_m=twin.anchor_height_m)
        except (InputError, KeyError):
            return []  # a twin may be without sensors
        return sensors_of_rig(rig, None)

    # -- frames with points ------------------------------------------------------------------

    def _of_frames(self) -> Shown:
        own = [self._own(path) for path in self.sought.paths]
        pair = len(self.sought.paths) == 2
        in_site = all(
            one is not None and one.site_SE3_frame(one.manifest["frames"][0]["name"]) is not None
            for one in own
        )
        roles = self._roles(own) if pair else ["only"]
        sides: list[RecordedSide] = []
        for path, mine, role in zip(self.sought.paths, own, roles, strict=True):
            side = RecordedSide(
                _recording(path),
                role,
                own=mine,
                beside=sides[0] if sides else None,
                chosen=self.wanted.frames.rows,
                in_site=in_site,
                tell=self.tell,
            )
            sides.append(side)
        if pair and sides[0].name == sides[1].name:
            for side, path in zip(sides, self.sought.paths, strict=True):
                side.name = f"{path.resolve().parent.name}/{side.name}"
        first = sides[0]
        kind = "pair" if pair else "dataset" if own[0] is not None else "frames"
        shown = Shown(
            title=_title(own) or " | ".join(side.name for side in sides),
            kind=kind,
            sides=list(sides),
            scene_frame="site" if in_site else "points",
        )
        self._place_in_twin(shown, own, in_site)
        if pair:
            self._pair(shown, own)
        self._sensors(shown, own, in_site)
        self._paths_and_events(shown, first)
        if self.sought.detections is not None:
            found, notes = read_any_form(self.sought.detections, lambda: first.recording)
            shown.detections = DetectionsBeside(found, first)
            shown.notes += notes
        for one in own:
            if one is not None:
                shown.attribution += attributions(one.manifest)
        shown.attribution = list(dict.fromkeys(shown.attribution))
        if "twin" not in shown.layers:
            shown.ground_z = _ground_of(first)
        return shown

    @staticmethod
    def _own(path: Path) -> OwnDataset | None:
        if kind_of(path) == "fleet":
            return OwnFleet(path)
        manifest = path / "dataset.json"
        if path.is_dir() and manifest.is_file():
            if b'"kind": "dataset' not in read_bytes(manifest, "a manifest"):
                return None
            found = OwnDataset(path)
            if not found.manifest["frames"]:
                raise InputError("has no frames", file=path, expected="at least one")
            return found
        return None

    @staticmethod
    def _roles(own: Sequence[OwnDataset | None]) -> list[str]:
        """Return the roles: real is the side that is not UrbanTwin's; of two alike, the first."""
        if own[0] is not None and own[1] is None:
            return ["synthetic", "real"]
        return ["real", "synthetic"]

    def _pair(self, shown: Shown, own: Sequence[OwnDataset | None]) -> None:
        first, second = shown.sides
        assert isinstance(first, RecordedSide)
        assert isinstance(second, RecordedSide)
        alike = all(one is not None for one in own)
        shown.pairs = pairs_of_sides(first.entries, second.entries, same_clock=alike)
        if not shown.pairs:
            raise InputError(
                "has no frame of both sides", file=self.sought.paths[1], expected="frames"
            )
        if self.sought.report is None:
            return

        def worst_of_pair(one: int, other: int) -> Any:  # noqa: ANN401
            try:
                frame = first.frame(one)
                return farthest_place(frame.points, away_from(frame, second.frame(other)))
            except InputError:
                return None

        pose = first.scene_SE3_frame(shown.pairs[0][0])
        shown.worst = worst_places(
            self.sought.report, shown.pairs, first.entries, pose, worst_of_pair
        )
        shown.events += [
            {
                "time_s": first.entries[row["frame"]].time_s,
                "frame": row["frame"],
                "kind": "worst pair",
                "text": row["text"],
                "track": None,
            }
            for row in shown.worst
            if row["text"].startswith("frame ")
        ]

    def _sensors(self, shown: Shown, own: Sequence[OwnDataset | None], in_site: bool) -> None:
        for side, mine in zip(shown.sides, own, strict=True):
            assert isinstance(side, RecordedSide)
            if mine is None:
                found = sensors_of_frame(side.sample)
            else:
                site = mine.site_SE3_frame(side.entries[0].name)
                scene = None if in_site or site is None else site.inverse()
                found = sensors_of_manifest(mine.sensors, scene)
            known = {one["name"] for one in shown.sensors}
            shown.sensors += [one for one in found if one["name"] not in known]

    def _place_in_twin(self, shown: Shown, own: Sequence[OwnDataset | None], in_site: bool) -> None:
        placed = next((one for one in own if one is not None), None)
        folder = self.wanted.twin
        if folder is None and placed is not None:
            folder = self._twin_folder(placed.folder)
        if folder is None or placed is None:
            if self.wanted.twin is not None:
                raise InputError(
                    "says not where it is on the site",
                    file=self.sought.paths[0],
                    expected="a dataset of urbantwin, or a recording beside one",
                )
            return
        twin = load_twin(folder)
        if self.wanted.twin is None and placed.manifest.get("anchor", {}).get("latitude") not in (
            None,
            twin.manifest["anchor"]["latitude"],
        ):
            return  # twin of another site
        scene: Pose | None = None
        if not in_site:
            site = placed.site_SE3_frame(placed.manifest["frames"][0]["name"])
            scene = None if site is None else site.inverse()
        self._twin_layers(shown, twin, self._motion(placed.folder, twin), scene)

    # -- artefacts beside the path
    # ------------------------------------------------------------------

    def _twin_folder(self, path: Path) -> Path | None:
        if self.wanted.twin is not None:
            return self.wanted.twin
        return _beside(path, "twin")

    def _motion(self, path: Path, twin: Twin | None) -> Motion | None:
        if self.wanted.motion is not None:
            return Motion.load(self.wanted.motion)
        folder = _beside(path, "motion")
        if folder is None:
            return None
        motion = Motion.load(folder)
        if twin is not None and motion.manifest.get("twin_sha256") != twin.sha256:
            return None  # motion on another twin
        return motion

    def _twin_layers(
        self, shown: Shown, twin: Twin, motion: Motion | None, scene_SE3_site: Pose | None
    ) -> None:
        shown.layers["twin"] = lambda: twin_packet(twin, scene_SE3_site)
        if "roads.json" in twin.manifest.get("files", {}):
            shown.layers["lanes"] = lambda: lanes_packet(twin, motion, scene_SE3_site)
            shown.signals = motion is not None and motion.signals.num_rows > 0
        coverage = _beside(twin.folder, "coverage")
        if coverage is not None and scene_SE3_site is None:
            shown.layers["coverage"] = lambda: coverage_packet(coverage)
        shown.attribution += attributions(twin.manifest)
        shown.ground_z = _ground_of_twin(twin, scene_SE3_site)

    @staticmethod
    def _paths_and_events(shown: Shown, side: RecordedSide | MotionSide) -> None:
        tracks = tracks_of(side)
        if tracks is not None and len(tracks.track):
            shown.layers["tracks"] = lambda: tracks_packet(tracks)
            shown.events = [*shown.events, *events_of(tracks)]


def _title(own: Sequence[OwnDataset | None]) -> str:
    """Return the name of a single dataset's site; empty if unknown."""
    if len(own) != 1 or own[0] is None:
        return ""
    twin = (own[0].manifest.get("made_from") or {}).get("twin") or {}
    site = (twin.get("made_from") or {}).get("site") or {}
    return str(site.get("name") or "")


def _recording(path: Path) -> Recording:
    """Open frames of any layout.

    Raises:
        InputError: there is no recording, or it is damaged.
    """
    nothing = path.is_dir() and layout_of(path) is None and not recordings_inside(path)
    if nothing:
        raise InputError("is nothing that can be looked at", file=path, expected=EXPECTED)
    return open_recording(path)


def _beside(path: Path, kind: str) -> Path | None:
    """Return the artefact of a kind beside a path, or beside the parent folder of a part."""
    for above in path.resolve().parents[:2]:
        if kind_of(above / kind) == kind:
            return above / kind
    return None


def _ground_of(side: RecordedSide) -> float:
    """Return the ground's height: the second percentile of the points around the sensors."""
    points = side.sample.points
    near = np.linalg.norm(points[:, :2] - side.sample.sensor_places[0, :2], axis=1) < 60.0
    return float(np.percentile(points[near if near.sum() > 50 else slice(None), 2], 2.0))


def _ground_of_twin(twin: Twin, scene_SE3_site: Pose | None) -> float:
    ground = twin.ground_mesh
    height = float(np.median(ground.vertices[:, 2])) if len(ground.vertices) else 0.0
    if scene_SE3_site is None:
        return height
    return float(scene_SE3_site.apply(np.array([[0.0, 0.0, height]]))[0, 2])
