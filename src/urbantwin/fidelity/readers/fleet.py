"""Our own fleets: the points of all nodes in the site, by their true poses, and common labels."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.document import read_bytes
from urbantwin.dataset.reading import Fleet
from urbantwin.dataset.reading.columns import POINT
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.own import boxes_of_objects, fields_of_rays, sensor_places
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.geometry import Pose

__all__ = ["is_fleet", "open_fleet"]

_SITE = Pose.from_ypr(np.zeros(3))


def is_fleet(path: Path) -> bool:
    """Return whether a folder is a fleet."""
    manifest = path / "fleet.json"
    return manifest.is_file() and b'"kind": "fleet"' in read_bytes(manifest, "a fleet's manifest")


def open_fleet(path: Path) -> Recording:
    """Open a fleet that ``urbantwin record --nodes`` wrote, as one recording in the site's frame.

    Sensors are numbered through all nodes that are there in a frame.

    Raises:
        InputError: its manifest or a table is damaged.
    """
    files = Fleet(path)

    def read(index: int) -> Frame:
        name = files.names[index]
        clouds: list[NDArray[Any]] = []
        labels: list[NDArray[Any]] = []
        rays: list[dict[str, NDArray[Any]]] = []
        seen_from: list[NDArray[np.float64]] = []
        for node in files.node_names:
            state = files.state(name, node)
            if state.true is None:
                continue
            cloud = files.cloud(name, node)
            clouds.append(
                np.column_stack([state.true.apply(cloud.points[:, :3]), cloud.points[:, 3]])
            )
            labels.append(cloud.labels)
            before = sum(map(len, seen_from))
            own = fields_of_rays(cloud.rays)
            own["sensor"] = own["sensor"].astype(np.int64) + before
            rays.append(own)
            there = sensor_places(files.nodes[node].turns, name, _SITE)
            seen_from.append(state.true.translation[None] if there is None else there)
        points = np.concatenate([np.zeros((0, 4)), *clouds])
        code = np.concatenate([np.zeros(0, np.uint32), *labels])
        given = {"semantic": code & 0xFFFF, "instance": code >> 16}
        given |= (
            {key: np.concatenate([one[key] for one in rays]) for key in rays[0]} if rays else {}
        )
        return frame_of(
            path / "fleet.json",
            dict(zip(POINT, points.T, strict=True)),
            name=name,
            given=given,
            boxes=boxes_of_objects(files.objects.of_frame(name)),
            world_SE3_frame=_SITE,
            sensor_places=np.concatenate(seen_from) if seen_from else np.zeros((1, 3)),
        )

    return Recording(path, "fleet", files.names, read)
