"""Stages of a signal program: the fewest that give green to everybody without conflicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

from urbantwin.roads.signals.intergreen import Intergreens
from urbantwin.roads.signals.phases import walks
from urbantwin.roads.signals.streams import Stream, Traffic

__all__ = ["Stage", "stages_of"]

#: More maximal sets than this are not compared, nor more stages put into every order.
MOST_SETS, MOST_ORDERED = 400, 6
#: Covers are compared up to this many steps of the search.
MOST_STEPS = 20_000


@dataclass(frozen=True)
class Stage:
    """What has green at the same time.

    Attributes:
        streams: numbers of the streams that it serves.
        green: links of vehicles, inner ones included, and crossings.
    """

    streams: frozenset[int]
    green: frozenset[int]


def stages_of(
    traffic: Traffic, flow: Sequence[float], intergreens: Intergreens
) -> tuple[Stage, ...]:
    """Return the stages of a program, in the order that loses least time.

    Streams that go together form maximal sets (cliques: Bron and Kerbosch, Algorithm 457, 1973);
    of the smallest covers of all streams by such sets, the one with the least sum of critical flow
    ratios is taken (Webster, Traffic Signal Settings, 1958).

    Args:
        traffic: the streams.
        flow: flow ratio of the critical lane of each stream.
        intergreens: time between one green and the next.
    """
    streams = traffic.streams
    friends = _friends(traffic)
    sets = _maximal_sets(friends)
    cover = _smallest_cover(sets, len(streams), flow)
    stages = [_stage(traffic, members) for members in cover]
    stages = _with_all_links(traffic, stages)
    stages = [_with_permitted(traffic, stage) for stage in stages]
    return _ordered(stages, intergreens)


def critical_ratios(stages: Sequence[Stage], flow: Sequence[float]) -> list[float]:
    """Return each stage's largest flow ratio; a stream's is shared by the stages that serve it."""
    return _ratios([stage.streams for stage in stages], flow)


def _ratios(sets: Sequence[frozenset[int]], flow: Sequence[float]) -> list[float]:
    served = [max(1, sum(k in members for members in sets)) for k in range(len(flow))]
    return [max((flow[k] / served[k] for k in members), default=0.0) for members in sets]


def _friends(traffic: Traffic) -> dict[int, frozenset[int]]:
    streams = traffic.streams

    def friendly(a: Stream, b: Stream) -> bool:
        return traffic.all_together(a.required, b.required)

    return {
        k: frozenset(j for j, other in enumerate(streams) if j != k and friendly(stream, other))
        for k, stream in enumerate(streams)
    }


def _maximal_sets(friends: Mapping[int, frozenset[int]]) -> list[frozenset[int]]:
    found: list[frozenset[int]] = []

    def grow(chosen: frozenset[int], more: set[int], done: set[int]) -> None:
        if not more and not done:
            found.append(chosen)
        if not more or len(found) >= MOST_SETS:
            return
        pivot = max(sorted(more | done), key=lambda k: len(more & friends[k]))
        for k in sorted(more - friends[pivot]):
            grow(chosen | {k}, more & friends[k], done & friends[k])
            more.remove(k)
            done.add(k)

    grow(frozenset(), set(friends), set())
    missing = set(friends) - frozenset().union(*found)
    return found + [frozenset({k}) for k in sorted(missing)]


def _smallest_cover(
    sets: Sequence[frozenset[int]], count: int, flow: Sequence[float]
) -> list[frozenset[int]]:
    """Return the fewest sets that hold every stream, of equally few those of least flow ratios."""
    holding = [[s for s in sets if k in s] for k in range(count)]
    best: list[frozenset[int]] = []
    cost = (count + 1, 0.0)
    steps = 0

    def search(chosen: list[frozenset[int]], left: frozenset[int]) -> None:
        nonlocal best, cost, steps
        steps += 1
        if not left:
            found = (len(chosen), round(sum(_ratios(chosen, flow)), 9))
            if found < cost:
                best, cost = list(chosen), found
            return
        if len(chosen) + 1 > cost[0] or (best and steps > MOST_STEPS):
            return
        hardest = min(left, key=lambda k: (len(holding[k]), k))
        for members in sorted(holding[hardest], key=lambda s: (-len(s & left), sorted(s))):
            search([*chosen, members], left - members)

    search([], frozenset(range(count)))
    return best


def _stage(traffic: Traffic, members: frozenset[int]) -> Stage:
    green: set[int] = set()
    streams = [traffic.streams[k] for k in sorted(members)]
    driven = [stream for stream in streams if not stream.walk]
    own = [[k] for stream in driven for k in stream.links]
    # The inner links of one stream may cross each other: the first ones go.
    behind = [[k] for stream in driven for k in stream.required]
    # Who waits for one link of a lane holds up all that are behind.
    inside = [traffic.of_lane[k] for stream in driven for k in stream.optional]
    walked = [[k] for stream in streams if stream.walk for k in stream.links]
    for links in (*own, *behind, *inside, *walked):
        if traffic.all_together(links, [*green, *links]):
            green.update(links)
    return Stage(members, frozenset(green))


def _with_all_links(traffic: Traffic, stages: list[Stage]) -> list[Stage]:
    """Give green to inner links that no stage has yet: wherever they fit, else alone.

    They fit also where people would be in their way who can cross in another stage.
    """
    for index in sorted(traffic.junction.of_index):
        if any(index in stage.green for stage in stages):
            continue
        fitting = [traffic.all_together([index], stage.green) for stage in stages]
        if not any(fitting) and (found := _without_walkers(traffic, stages, index)):
            stages = found
            continue
        stages = [
            Stage(stage.streams, stage.green | {index}) if fits else stage
            for stage, fits in zip(stages, fitting, strict=True)
        ]
        if not any(fitting):
            stages.append(_around(traffic, index))
    return stages


def _around(traffic: Traffic, index: int) -> Stage:
    """Return a stage of an inner link and of every stream that goes with it."""
    green, members = {index}, set[int]()
    for k, stream in enumerate(traffic.streams):
        if traffic.all_together(stream.required, [*green, *stream.required]):
            green.update(stream.required)
            members.add(k)
    return Stage(frozenset(members), frozenset(green))


def _with_permitted(traffic: Traffic, stage: Stage) -> Stage:
    """Let turns that have a stage of their own look for gaps in another beside their street."""
    roads = {
        link.road
        for k in stage.green
        for link in traffic.junction.of_index[k]
        if link.movement == "through"
    }
    green = set(stage.green)
    for index in sorted(traffic.permitted - green):
        beside = {link.road for link in traffic.junction.of_index[index]} <= roads
        if beside and all(traffic.may_meet(index, k) for k in green):
            green.add(index)
    return Stage(stage.streams, frozenset(green))


def _without_walkers(traffic: Traffic, stages: list[Stage], index: int) -> list[Stage] | None:
    for k, stage in enumerate(stages):
        others = frozenset().union(*(other.green for other in stages if other is not stage))
        blocked = {j for j in stage.green if not traffic.together(index, j)}
        if blocked <= others and all(walks(traffic.junction, j) for j in blocked):
            green = (stage.green - blocked) | {index}
            return [*stages[:k], Stage(stage.streams, green), *stages[k + 1 :]]
    return None


def _ordered(stages: Sequence[Stage], intergreens: Intergreens) -> tuple[Stage, ...]:
    if len(stages) > MOST_ORDERED:
        return tuple(stages)

    def lost(order: Sequence[Stage]) -> float:
        after = (*order[1:], order[0])
        return sum(
            intergreens.change(a.green, b.green).seconds for a, b in zip(order, after, strict=True)
        )

    first, *others = stages
    return min(((first, *rest) for rest in permutations(others)), key=lost)
