"""One labelled frame of a rig: a pure function of the world, the seed and the frame's number."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh, SurfaceMaterials
from urbantwin.lidar.actor_path import PosedActor
from urbantwin.lidar.actors import ActorShape, MeshSource
from urbantwin.lidar.casting import EmbreeCaster
from urbantwin.lidar.labels import BoxLabel, LabelledFrame, posed_box
from urbantwin.lidar.observer import Observation, Observer
from urbantwin.lidar.returns import draw
from urbantwin.lidar.rig import Rig
from urbantwin.taxonomy import ACTOR_SEMANTICS, semantic_id

__all__ = ["Scanner"]

_MOST_TRACKS = 0xFFFF
_Value = TypeVar("_Value", bound=np.generic)


class Scanner:
    """Scans frames. What the beams hit in the static world is computed here, once.

    Frames are independent: any of them, in any order, in any process, comes out the same.

    Args:
        static: the static world, site frame.
        rig: the sensors.
        seed: of all random numbers.
        meshes: gives the mesh of an asset; ``traffic.assets.asset_mesh`` when not given.
        surface: materials of the ground that are finer than the static world's triangles.
    """

    def __init__(
        self,
        static: LabelledMesh,
        rig: Rig,
        seed: int,
        *,
        meshes: MeshSource | None = None,
        surface: SurfaceMaterials | None = None,
    ) -> None:
        if meshes is None:
            from urbantwin.traffic.assets import asset_mesh

            meshes = asset_mesh
        self._meshes: MeshSource = meshes
        self._shapes: dict[tuple[str, int], ActorShape] = {}
        self._rig = rig
        self._seed = seed
        self._static = static
        self._surface = surface
        self._casters: dict[int, EmbreeCaster] = {}
        self._observers = [
            None
            if one.sensor.pattern is not None
            else Observer(one, static, rig.dataset_SE3_site, surface)
            for one in rig.sensors
        ]

    def scan(self, index: int, actors: Sequence[PosedActor]) -> LabelledFrame:
        """Return the frame of that number.

        Args:
            index: the frame's number, from 0; it selects the random numbers.
            actors: everything that moves, at the frame's time, in any order.

        Raises:
            InputError: a track does not fit the 16 bits that label files have for it.
        """
        present = sorted(actors, key=lambda actor: actor.track)
        placed = [(self._shape(actor), actor.site_SE3_asset) for actor in present]
        to_dataset = self._rig.dataset_SE3_site
        boxes = np.array([posed_box(shape, to_dataset @ pose) for shape, pose in placed])
        boxes = boxes.reshape(-1, 7)
        seen = [
            observer.observe(placed, boxes, draw(self._seed, number, index, observer.rays))
            for number in range(len(self._observers))
            for observer in [self._observer(number, index)]
        ]
        return self._labelled(present, boxes, seen)

    def _observer(self, number: int, index: int) -> Observer:
        """Return a sensor as it is in a frame: a pattern that does not repeat is cast anew."""
        kept = self._observers[number]
        if kept is not None:
            return kept
        one = self._rig.sensors[number]
        if number not in self._casters:
            moved = self._static.vertices - one.site_SE3_sensor.translation
            self._casters[number] = EmbreeCaster(moved, self._static.faces)
        return Observer(
            one,
            self._static,
            self._rig.dataset_SE3_site,
            self._surface,
            frame=index,
            caster=self._casters[number],
        )

    def _labelled(
        self, actors: Sequence[PosedActor], boxes: NDArray[np.float64], seen: Sequence[Observation]
    ) -> LabelledFrame:
        """Fuse the sensors' returns and give every point and actor its labels."""
        actor = _joined([one.actor for one in seen])
        semantic = _joined([one.semantic for one in seen])
        instance = np.zeros(len(actor), np.uint16)
        hit = np.flatnonzero(actor >= 0)
        classes = [semantic_id(ACTOR_SEMANTICS[one.actor_class]) for one in actors]
        semantic[hit] = np.array(classes, np.uint16)[actor[hit]]
        instance[hit] = np.array([one.track for one in actors], np.uint16)[actor[hit]]
        count = np.bincount(actor[hit], minlength=len(actors))
        alone = np.sum([one.alone for one in seen], axis=0)
        rotation = self._rig.dataset_SE3_site.rotation
        return LabelledFrame(
            _joined([one.points for one in seen]),
            semantic,
            instance,
            np.repeat(np.arange(len(seen), dtype=np.uint8), [len(one.actor) for one in seen]),
            _joined([one.ring for one in seen]),
            _joined([one.column for one in seen]),
            tuple(
                BoxLabel(
                    one.track,
                    one.actor_class,
                    boxes[number],
                    int(count[number]),
                    int(alone[number]),
                    rotation @ one.velocity,
                )
                for number, one in enumerate(actors)
            ),
        )

    def _shape(self, actor: PosedActor) -> ActorShape:
        if not 0 < actor.track <= _MOST_TRACKS:
            raise InputError(
                f"track {actor.track} does not fit a label", expected=f"1 to {_MOST_TRACKS}"
            )
        key = (actor.asset, actor.phase)
        if key not in self._shapes:
            self._shapes[key] = ActorShape(self._meshes(*key))
        return self._shapes[key]


def _joined(parts: Sequence[NDArray[_Value]]) -> NDArray[_Value]:
    """Join the sensors' arrays; one sensor's is taken as it is."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)
