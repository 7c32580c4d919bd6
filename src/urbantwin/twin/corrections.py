"""A site's corrections during the stages of a build, and their outcomes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely

from urbantwin.result_warning import ResultWarning
from urbantwin.roads.corrected_lanes import with_lanes_corrected
from urbantwin.roads.driving_side import country_of
from urbantwin.roads.side_lanes import CurbMove
from urbantwin.site import Extract, Site
from urbantwin.site.corrections import (
    AddLane,
    AddPole,
    AddTree,
    AddWall,
    Correction,
    MoveCurb,
    Outcome,
    RemoveElement,
    RemoveLane,
    RemoveThing,
    SetTags,
    read_corrections,
    with_elements,
)

__all__ = ["Corrections"]


@dataclass(frozen=True)
class Corrections:
    """The corrections of a site.

    Attributes:
        each: the corrections in the order of their file.
        outcomes: number of a correction -> its outcome; filled stage by stage.
    """

    each: tuple[Correction, ...]
    outcomes: dict[int, Outcome] = field(default_factory=dict)

    @classmethod
    def of_site(cls, site: Site) -> Corrections:
        """Read the corrections of a site, if it has any.

        Raises:
            InputError: the file is wrong.
        """
        if site.corrections is None:
            return cls(())
        return cls(tuple(read_corrections(site.corrections.path, site.frame, site.region)))

    @property
    def of_scene(self) -> list[Correction]:
        """The corrections of static objects."""
        kinds = (AddPole, AddTree, AddWall, RemoveThing)
        return [correction for correction in self.each if isinstance(correction.asked, kinds)]

    def map_corrected(
        self, extract: Extract | None, site: Site, driving_side: str
    ) -> Extract | None:
        """Return the corrected map: elements first, then lanes.

        Raises:
            InputError: a correction refers to an element that the map does not have.
        """
        if extract is None:
            kinds = (SetTags, RemoveElement, AddLane, RemoveLane)
            for correction in self.each:
                if isinstance(correction.asked, kinds):
                    self.keep([Outcome(correction, False, "the site has no map (osm) to correct")])
            return None
        if not self.each:
            return extract
        extract, outcomes = with_elements(extract, self.each, site.frame, site.region)
        self.keep(outcomes)
        if site.roads is not None:
            self._not_of_roads(site, (AddLane, RemoveLane))
            return extract
        extract, outcomes = with_lanes_corrected(
            extract,
            self.each,
            site.frame,
            site.region,
            driving_side=driving_side,
            country=country_of(site.latitude, site.longitude),
        )
        self.keep(outcomes)
        return extract

    def curbs(self) -> dict[int, list[shapely.LineString]]:
        """Return the lines of corrected curbs, by the number of their correction."""
        return {
            correction.number: [
                shape for shape in correction.shapes if isinstance(shape, shapely.LineString)
            ]
            for correction in self.each
            if isinstance(correction.asked, MoveCurb)
        }

    def keep_curbs(self, moves: Mapping[int, CurbMove], site: Site) -> None:
        """Store the outcomes of curbs."""
        if site.roads is not None or (site.osm is None and site.sketch is None):
            self._not_of_roads(site, (MoveCurb,))
            return
        by_number = {correction.number: correction for correction in self.each}
        self.keep(_curb_outcome(by_number[number], move) for number, move in moves.items())

    def keep(self, outcomes: Iterable[Outcome]) -> None:
        """Store the outcomes of a stage."""
        self.outcomes.update({outcome.correction.number: outcome for outcome in outcomes})

    def _not_of_roads(self, site: Site, kinds: tuple[type, ...]) -> None:
        reason = "the site has no map of roads"
        if site.roads is not None:
            reason = f"the roads are those of {site.roads.path.name}: they are corrected there"
        for correction in self.each:
            if isinstance(correction.asked, kinds):
                self.keep([Outcome(correction, False, reason)])

    def notes(self) -> dict[str, Any]:
        """Return the entry of ``twin.json``: counts, and each correction with its place."""
        if not self.each:
            return {}
        outcomes = [self.outcomes[correction.number] for correction in self.each]
        applied = Counter(outcome.applied for outcome in outcomes)
        return {
            "corrections": {
                "applied": applied[True],
                "not_applied": applied[False],
                "each": [_note(outcome) for outcome in outcomes],
            }
        }

    def warnings(self) -> Iterator[ResultWarning]:
        """Yield a warning for each correction that was not applied."""
        for correction in self.each:
            outcome = self.outcomes[correction.number]
            if not outcome.applied:
                yield ResultWarning(
                    "corrections",
                    f"{correction.place} is not applied",
                    outcome.told,
                    "plan.png shows what is there, by the same number",
                )


def _curb_outcome(one: Correction, move: CurbMove) -> Outcome:
    drawn = sum(shape.length for shape in one.shapes)
    why = "; ".join(dict.fromkeys(move.why_not))
    if not move.metres:
        nearest_text = (
            f"the nearest is {move.nearest_m:.1f} m away" if np.isfinite(move.nearest_m) else ""
        )
        text = why or "; ".join(filter(None, ["no curb of a street runs along it", nearest_text]))
        return Outcome(one, False, text)
    text = f"{move.metres:.1f} m of {drawn:.1f} m drawn, moved by up to {move.farthest_m:.2f} m"
    if not move.has_curb:
        text += ", as the edge of a carriageway: nothing raised is beside it"
    return Outcome(one, True, f"{text}; {why}" if why else text)


def _note(one: Outcome) -> dict[str, Any]:
    requested = one.correction.asked
    return {
        "number": one.correction.number,
        "what": f"{requested.action} {requested.what}".strip(),
        "applied": one.applied,
        "told": one.told,
        "at_m": [
            np.round(shapely.get_coordinates(part), 3).tolist()
            for shape in one.shapes
            for part in shapely.get_parts(shape)
        ],
    }
