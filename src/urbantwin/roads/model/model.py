"""The lane model of a site, and its file."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

from urbantwin.artefact import as_json, write_json
from urbantwin.artefact.typed_document import read_typed
from urbantwin.roads.model.consistency import check_model
from urbantwin.roads.model.furniture import RoadArea, RoadSignal, SignalController
from urbantwin.roads.model.junction import ModelJunction
from urbantwin.roads.model.road import ModelRoad

__all__ = ["LaneModel"]


@dataclass(frozen=True)
class LaneModel:
    """All roads of a site: the source of the mesh, of OpenDRIVE and of SUMO's geometry.

    Attributes:
        driving_side: ``right`` or ``left``. On the right, lanes of negative ids run along the
            reference line; on the left, lanes of positive ids do, unless a lane says otherwise.
        roads: streets and the ways through junctions.
        junctions: where they meet.
        areas: crosswalks, stop lines, islands.
        signals: heads and signs.
        controllers: signal programs.
    """

    driving_side: str
    roads: tuple[ModelRoad, ...]
    junctions: tuple[ModelJunction, ...] = ()
    areas: tuple[RoadArea, ...] = ()
    signals: tuple[RoadSignal, ...] = ()
    controllers: tuple[SignalController, ...] = ()

    @cached_property
    def road_by_id(self) -> dict[int, ModelRoad]:
        """Every road by its id."""
        return {road.id: road for road in self.roads}

    @cached_property
    def junction_by_id(self) -> dict[int, ModelJunction]:
        """Every junction by its id."""
        return {junction.id: junction for junction in self.junctions}

    @property
    def next_id(self) -> int:
        """An id that nothing has yet."""
        everything = (self.roads, self.junctions, self.areas, self.signals, self.controllers)
        return 1 + max((item.id for group in everything for item in group), default=0)

    def with_roads(self, roads: tuple[ModelRoad, ...]) -> LaneModel:
        """Return the model with other roads."""
        return replace(self, roads=roads)

    def save(self, path: Path) -> None:
        """Write the model as JSON, every number in full."""
        write_json(path, as_json({"kind": "lane model", **asdict(self)}))

    @classmethod
    def load(cls, path: Path) -> LaneModel:
        """Read what ``save`` wrote.

        Raises:
            InputError: the file is missing or is not a lane model; the field is named.
        """
        model = read_typed(path, cls, "a twin's lane_model.json")
        check_model(model, path)
        return model
