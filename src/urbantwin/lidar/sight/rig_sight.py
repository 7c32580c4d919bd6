"""What the sensors of a rig see of their junctions, and what hides the rest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.lidar.rig import MountedSensor, Rig
from urbantwin.lidar.sight.field_of_view import FieldOfView
from urbantwin.lidar.sight.ground import CELL_M
from urbantwin.lidar.sight.junction import CLEAR_M, NEAR_M, Junction, Junctions, View
from urbantwin.result_warning import ResultWarning
from urbantwin.roads import RoadNetwork
from urbantwin.taxonomy import semantic_classes

__all__ = ["LITTLE", "MUCH_NEAR", "Hiding", "RigSight", "SensorSight", "sight_of_rig"]

#: Limits of warnings: least visible share of a junction, largest share of near points.
LITTLE, MUCH_NEAR = 0.5, 0.3
#: Least hidden share that is reported; number of obstacles that a warning names.
_LEAST, _NAMED = 0.01, 3

_POLES = "poles and signs"
_WORDS = {
    "building": "buildings",
    "vegetation": "trees and hedges",
    "trunk": "trees and hedges",
    **dict.fromkeys(("pole", "traffic-sign"), _POLES),
    "fence": "fences and walls",
    **dict.fromkeys(("road", "parking", "sidewalk", "other-ground", "terrain"), "the ground"),
}
_OTHER, _BESIDE = "other things", "the edge of its field of view"


class Hiding(NamedTuple):
    """An obstacle that hides a part of the junction.

    Attributes:
        what: description.
        share: hidden share of the junction (0..1).
        nearest_m: distance of the sensor to the nearest of it; ``None`` outside the field of view.
    """

    what: str
    share: float
    nearest_m: float | None

    def __str__(self) -> str:
        """Return a description."""
        away = "" if self.nearest_m is None else f" ({self.nearest_m:.0f} m away)"
        return f"{100 * self.share:.0f} % behind {self.what}{away}"


@dataclass(frozen=True)
class SensorSight:
    """What one sensor sees.

    Attributes:
        name: name of the sensor.
        view: what it sees of its junction.
        hiding: obstacles, largest first.
        nearest: description of the nearest object.
        better: best position at the junction, if its own is not good.
    """

    name: str
    view: View
    hiding: tuple[Hiding, ...]
    nearest: str
    better: View | None

    def problems(self, *, little: bool) -> Iterator[str]:
        """Yield problems of its position.

        Args:
            little: whether all sensors together see too little of the junction.
        """
        if little:
            yield f"sees {100 * self.view.seen:.0f} % of the junction's lanes and crossings"
        if self.view.near > MUCH_NEAR:
            near = f"{100 * self.view.near:.0f} %"
            yield f"{near} of its points are of things, not of ground, nearer than {NEAR_M:g} m"
        # A pole may be its own.
        if self.view.nearest_m < CLEAR_M and self.nearest != _POLES:
            yield f"{self.nearest} are {self.view.nearest_m:.1f} m away"

    def remedy(self) -> str:
        """Return a better position in words; empty if none is known."""
        if self.better is None:
            return ""
        fields = ", ".join(
            f"{name} {value:g}" for name, value in self.better.stance.written().items()
        )
        return f"at {fields} it would see {100 * self.better.seen:.0f} %"

    def notes(self) -> dict[str, Any]:
        """Return a summary for JSON."""
        notes: dict[str, Any] = {
            "seen": round(self.view.seen, 3),
            f"points_of_things_within_{NEAR_M:g}_m": round(self.view.near, 3),
        }
        if np.isfinite(self.view.nearest_m):
            notes["nearest"] = {"what": self.nearest, "m": round(self.view.nearest_m, 2)}
        notes["hidden"] = {
            hiding.what: {
                "share": round(hiding.share, 3),
                **({} if hiding.nearest_m is None else {"nearest_m": round(hiding.nearest_m, 1)}),
            }
            for hiding in self.hiding
        }
        if self.better is not None:
            notes["better"] = {
                **self.better.stance.written(),
                "seen": round(self.better.seen, 3),
            }
        return notes


@dataclass(frozen=True)
class RigSight:
    """What all sensors of a rig see together of their junctions.

    Attributes:
        points: (M, 3) above lanes and crossings, one per `CELL_M` square, site frame, metres.
        sees: (S, M) whether each sensor sees each point.
        sensors: what each sees of its own junction, in the order of ``sees``.
    """

    points: NDArray[np.float64]
    sees: NDArray[np.bool_]
    sensors: tuple[SensorSight, ...]

    @property
    def seen(self) -> float:
        """Share (0..1) that any sensor sees."""
        return float(self.sees.any(axis=0).mean()) if self.sees.size else 0.0

    def notes(self) -> dict[str, Any]:
        """Return a summary for JSON."""
        return {
            "junction_m2": round(len(self.points) * CELL_M**2, 1),
            "seen": round(self.seen, 3),
            "by_sensor": {sight.name: sight.notes() for sight in self.sensors},
        }

    def warnings(self) -> Iterator[ResultWarning]:
        """Yield warnings about the sensors' positions."""
        for sight in self.sensors:
            problems = list(sight.problems(little=self.seen < LITTLE))
            if problems:
                hidden = ", ".join(str(hiding) for hiding in sight.hiding[:_NAMED])
                yield ResultWarning(
                    f"sensor {sight.name}", ", ".join(problems), hidden, sight.remedy()
                )


def sight_of_rig(
    rig: Rig, network: RoadNetwork, region: shapely.Polygon, mesh: LabelledMesh
) -> RigSight | None:
    """Return what a rig sees; ``None`` for a rig on an actor, and without lanes.

    Args:
        rig: the sensors.
        network: the lanes.
        region: the region of interest.
        mesh: the static world, site frame.
    """
    if rig.ride is not None:
        return None
    junctions = Junctions(network, region, mesh)
    seen: list[tuple[Junction, SensorSight]] = []
    for mounted in rig.sensors:
        east, north, _ = mounted.site_SE3_sensor.translation
        junction = junctions.at(float(east), float(north))
        if len(junction.ground.points):
            seen.append((junction, _sensor_sight(mounted, junction)))
    if not seen:
        return None
    places = list(dict.fromkeys(junction for junction, _ in seen))
    starts = np.cumsum([0, *(len(one.ground.points) for one in places)])
    sees = np.zeros((len(seen), starts[-1]), bool)
    for row, (junction, sight) in enumerate(seen):
        k = places.index(junction)
        sees[row, starts[k] : starts[k + 1]] = sight.view.sees
    points = np.concatenate([one.ground.points for one in places])
    return RigSight(points, sees, tuple(sight for _, sight in seen))


def _sensor_sight(mounted: MountedSensor, junction: Junction) -> SensorSight:
    view = junction.view_of(mounted)
    nearest_face = junction.around.nearest_thing(view.stance.place)[1]
    what = "" if nearest_face < 0 else str(_words(junction)[nearest_face])
    better = None
    close = view.nearest_m < CLEAR_M and what != _POLES
    if view.seen < LITTLE or view.near > MUCH_NEAR or close:
        field = FieldOfView.coarse(mounted.sensor, mounted.columns)
        best = junction.best_view(field, pitch=view.stance.pitch, roll=view.stance.roll)
        better = best if best is not None and best.score > view.score else None
    return SensorSight(mounted.name, view, _hiding(view, junction), what, better)


def _hiding(view: View, junction: Junction) -> tuple[Hiding, ...]:
    """Return the obstacles that hide points of the ground."""
    hits, away = junction.around.towards(view.stance.place, junction.ground.points[~view.sees])
    blocked = (hits.face >= 0) & (hits.range_m < away)
    what = np.where(blocked, _words(junction)[hits.face], _BESIDE)
    obstacles = [
        Hiding(
            str(name),
            float((what == name).sum() / len(view.sees)),
            None if name == _BESIDE else float(hits.range_m[what == name].min()),
        )
        for name in np.unique(what)
    ]
    large = [obstacle for obstacle in obstacles if obstacle.share >= _LEAST]
    return tuple(sorted(large, key=lambda obstacle: (-obstacle.share, obstacle.what)))


def _words(junction: Junction) -> NDArray[np.str_]:
    """Return the description of each face (F + 1,) of the surroundings."""
    names = {entry.id: _WORDS.get(entry.name, _OTHER) for entry in semantic_classes().values()}
    kinds, which = np.unique(junction.around.mesh.semantic, return_inverse=True)
    words = [*(names.get(int(kind), _OTHER) for kind in kinds), _OTHER]
    # The last element is for rays without a hit.
    return np.asarray(np.array(words)[np.append(which, len(kinds))])
