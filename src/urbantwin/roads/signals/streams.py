"""Streams of a signalised junction: what always gets green together, and which go together."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

from urbantwin.roads.signals.controlled_links import Link, Signalised, turn_between
from urbantwin.roads.signals.inner_links import Feed
from urbantwin.roads.signals.plan_check import FACING_DEG

__all__ = ["INNER_M", "LONG_TURN_M", "Stream", "Traffic"]

#: Stop lines of one program with less than this between them are one junction's, metres.
INNER_M = 40.0
#: Vehicles that turn across wait between two of its junctions where three have room, metres.
WAITING_ROOM_M = 22.5
#: Who waits in the middle of turns this long stands in the way of opposing turns that cross theirs,
#: metres; shorter ones have their place to wait at the stop line.
LONG_TURN_M = 25.0
#: Approaches whose directions differ by less lie side by side on one arm, degrees.
SAME_ARM_DEG = 30.0
#: Over this many opposing lanes a turn from a lane of its own gets a stage of its own; over more
#: than that many, or from two lanes, it goes in no other (Traffic Signal Timing Manual, 2nd ed.,
#: NCHRP 812, 4.3; RiLSA 2015, 2.3.1.2).
PROTECTED_FROM, GAPS_UP_TO = 2, 2


@dataclass(frozen=True)
class Stream:
    """Lanes of an approach, or a crossing, that get green together.

    Attributes:
        lanes: lanes that wait, or the crossing.
        walk: whether it is a crossing.
        links: links at its own stop lines.
        required: these and the inner links behind them that go with them.
        optional: inner links where those who turn across may wait for another stage.
    """

    lanes: tuple[str, ...]
    walk: bool
    links: tuple[int, ...]
    required: tuple[int, ...]
    optional: tuple[int, ...]


class Traffic:
    """What goes through one signalised junction, and who may go together.

    Args:
        junction: its links and their conflicts.
        feeds: ways between its own stop lines.
        left_hand: whether traffic keeps to the left.
        protects: whether turns across many lanes have a stage of their own.
        apart: links that go with no opposing traffic, whoever shares their lanes.
    """

    def __init__(
        self,
        junction: Signalised,
        feeds: Iterable[Feed],
        *,
        left_hand: bool,
        protects: bool = True,
        apart: Collection[int] = (),
    ) -> None:
        self.junction = junction
        self._protects, self._apart = protects, frozenset(apart)
        self._across = ("right" if left_hand else "left", "u-turn")
        self._kerb = "left" if left_hand else "right"
        inner: dict[int, list[Feed]] = defaultdict(list)
        for feed in feeds:
            own = feed.program == feed.to_program == junction.program
            if own and feed.room < INNER_M and feed.index != feed.to_index:
                inner[feed.index].append(feed)
        #: Ways from a link to the inner links behind it.
        self.inner: Mapping[int, Sequence[Feed]] = dict(inner)
        self._together: dict[tuple[int, int], bool] = {}

    @cached_property
    def streams(self) -> tuple[Stream, ...]:
        """All streams: vehicles in the order of their links, then crossings."""
        inside = {feed.to_index for ways in self.inner.values() for feed in ways}
        groups = self._groups(set(self._indices(walk=False)) - inside)
        known = {index for links, _ in groups for part in self._behind(links) for index in part}
        # A ring whose every link lets traffic into the next has no entries.
        groups += self._groups(set(self._indices(walk=False)) - known)
        found = []
        for links, lanes in groups:
            required, optional = self._behind(links)
            found.append(Stream(lanes, False, links, required, optional))
        for index in self._indices(walk=True):
            ways = self.junction.of_index[index]
            lanes = tuple(sorted({way.lane for way in ways}))
            found.append(Stream(lanes, True, (index,), (index,), ()))
        return tuple(found)

    @cached_property
    def protected(self) -> frozenset[int]:
        """Links that turn across from lanes of their own in a stage of their own."""
        own = self._turning_lanes if self._protects else []
        found = {
            link.index
            for link, lanes, opposing in own
            if opposing >= PROTECTED_FROM or (opposing and lanes > 1)
        }
        # Whom a stage for one serves as well, it serves.
        facing = {
            other.index
            for link, *_ in own
            if link.index in found
            for other, *_ in own
            if turn_between(link.bearing, other.bearing) > FACING_DEG
        }
        return frozenset(found | facing) | self._apart

    @cached_property
    def permitted(self) -> frozenset[int]:
        """Protected links that may look for gaps in another stage as well."""
        lonely = {
            link.index
            for link, lanes, opposing in self._turning_lanes
            if lanes > 1 or opposing > GAPS_UP_TO
        }
        return self.protected - lonely - self._apart

    @cached_property
    def _turning_lanes(self) -> list[tuple[Link, int, int]]:
        """Return links from lanes that turn across only, how many, and how many lanes oppose."""
        vehicles = [link for link in self.junction.links if link.movement != "walk"]
        moves: dict[str, set[str]] = defaultdict(set)
        lanes_of: dict[str, set[str]] = defaultdict(set)
        for link in vehicles:
            moves[link.lane].add(link.movement)
            lanes_of[link.road].add(link.lane)
        found = []
        for link in vehicles:
            own = [lane for lane in lanes_of[link.road] if moves[lane] <= set(self._across)]
            if link.lane not in own or len(own) == len(lanes_of[link.road]):
                continue
            opposing = {
                other.lane
                for other in vehicles
                if other.movement == "through"
                and self.junction.are_foes(link, other)
                and turn_between(link.bearing, other.bearing) > FACING_DEG
            }
            found.append((link, len(own), len(opposing)))
        return found

    @cached_property
    def of_lane(self) -> Mapping[int, Sequence[int]]:
        """Link -> all links of its lane."""
        found: dict[str, set[int]] = defaultdict(set)
        for link in self.junction.links:
            found[link.lane].add(link.index)
        return {link.index: sorted(found[link.lane]) for link in self.junction.links}

    def waits_for_gaps(self, link: Link) -> bool:
        """Whether a link turns across opposing traffic that has green with it."""
        return link.movement in self._across and any(
            other.movement == "through"
            and self.junction.are_foes(link, other)
            and self.together(link.index, other.index)
            for other in self.junction.links
        )

    def together(self, i: int, j: int) -> bool:
        """Whether two links may have green at once: one gives way to the other at most."""
        key = (min(i, j), max(i, j))
        if key not in self._together:
            alone = bool({i, j} & self.protected) and self._meet(i, j)
            self._together[key] = i == j or (not alone and self.may_meet(i, j))
        return self._together[key]

    def may_meet(self, i: int, j: int) -> bool:
        """Whether two links could have green at once if no turn were protected."""
        pairs = product(self.junction.of_index[i], self.junction.of_index[j])
        return all(self._pair(a, b) for a, b in pairs)

    def _meet(self, i: int, j: int) -> bool:
        pairs = product(self.junction.of_index[i], self.junction.of_index[j])
        return any(self.junction.are_foes(a, b) and a.road != b.road for a, b in pairs)

    def all_together(self, some: Iterable[int], others: Iterable[int]) -> bool:
        """Whether each of some links may have green with each of others."""
        others = tuple(others)
        return all(self.together(i, j) for i in some for j in others)

    def _pair(self, a: Link, b: Link) -> bool:
        if not self.junction.are_foes(a, b) or a.road == b.road:
            return True
        if "walk" in (a.movement, b.movement):
            vehicle, walker = (b, a) if a.movement == "walk" else (a, b)
            meets = self.junction.meets_walkers(vehicle, walker) or self._side_by_side(vehicle)
            return not meets and self.junction.gives_way(vehicle, walker)
        if SAME_ARM_DEG <= turn_between(a.bearing, b.bearing) <= FACING_DEG:
            return False
        if a.cycle_track or b.cycle_track:
            # As with people who cross: who turns off the street beside meets them.
            turning = b if a.cycle_track else a
            waits = self.junction.gives_way(a, b) or self.junction.gives_way(b, a)
            return turning.is_turn and waits and not self._side_by_side(turning)
        if {a.movement, b.movement} <= set(self._across) and min(a.length, b.length) > LONG_TURN_M:
            return False
        return self._waits_for(a, b) or self._waits_for(b, a)

    def _side_by_side(self, link: Link) -> bool:
        """Whether two lanes of a road turn beside each other, where one hides who walks."""
        return link.is_turn and any(
            other.road == link.road
            and other.lane != link.lane
            and other.movement == link.movement
            and other.to.rpartition("_")[0] == link.to.rpartition("_")[0]
            for other in self.junction.links
        )

    def _waits_for(self, a: Link, b: Link) -> bool:
        """Whether one turns out of the other's way and gives way to it."""
        gives_way = self.junction.gives_way
        return a.is_turn and gives_way(a, b) and not gives_way(b, a)

    def _indices(self, *, walk: bool) -> list[int]:
        of_index = self.junction.of_index
        return [i for i in sorted(of_index) if (of_index[i][0].movement == "walk") == walk]

    def _groups(self, indices: set[int]) -> list[tuple[tuple[int, ...], tuple[str, ...]]]:
        """Return links and lanes that wait side by side, turns that go alone apart."""
        moves: dict[str, set[str]] = defaultdict(set)
        waiting = [link for i in sorted(indices) for link in self.junction.of_index[i]]
        for link in waiting:
            moves[link.lane].add(link.movement)
        kinds: dict[tuple[str, str], list[Link]] = defaultdict(list)
        for link in waiting:
            kind = "main"
            if link.index in self.protected:
                kind = "across"
            elif moves[link.lane] == {self._kerb}:
                kind = "kerb"
            kinds[link.road, kind].append(link)
        found: list[tuple[set[int], set[str]]] = []
        for members in kinds.values():
            own = ({link.index for link in members}, {link.lane for link in members})
            # What shares a letter of the program shares all, and so do those who share a lane.
            for other in [x for x in found if x[0] & own[0] or x[1] & own[1]]:
                found.remove(other)
                own = (own[0] | other[0], own[1] | other[1])
            found.append(own)
        return [(tuple(sorted(links)), tuple(sorted(lanes))) for links, lanes in found]

    def _behind(self, links: Iterable[int]) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Return links with the inner ones that go with them, and those that may wait inside.

        Whoever turns across twice turns round; ways through with more turns than that are not for
        anybody's use.
        """
        turns = {index: self._turns_across(index) for index in links}
        required, optional = dict.fromkeys(links), dict[int, None]()
        queue = list(links)
        for index in queue:
            for feed in self.inner.get(index, ()):
                target = feed.to_index
                count = turns[index] + self._turns_across(target)
                if count > 1 or turns.get(target, 2) <= count:
                    continue
                turns[target] = count
                queue.append(target)
                waits = turns[index] and feed.room >= WAITING_ROOM_M
                into = optional if waits or index in optional else required
                # Who waits for one link of a lane holds up all that are behind.
                into.update(dict.fromkeys(self.of_lane[target]))
        return tuple(required), tuple(k for k in optional if k not in required)

    def _turns_across(self, index: int) -> int:
        return all(link.movement in self._across for link in self.junction.of_index[index])
