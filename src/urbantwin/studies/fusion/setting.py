"""What a study compares: how nodes share what they see, over which channel, and how many do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from urbantwin.errors import InputError
from urbantwin.studies.fusion.box_fusion import Rule
from urbantwin.studies.fusion.channel import Channel
from urbantwin.studies.fusion.point_codecs import PointCodec

__all__ = ["STUDIES", "Alone", "Early", "Late", "Middle", "Setting", "settings_of"]

#: What may be studied, in the order of the report.
STUDIES = ("bitrate", "latency", "clock", "pose", "loss", "nodes", "failure")


@dataclass(frozen=True)
class Alone:
    """The receiver's own points and nothing else."""

    name: str = "alone"

    @property
    def told(self) -> str:
        """What it is, in words."""
        return "alone"


@dataclass(frozen=True)
class Early:
    """Clouds are sent.

    Attributes:
        codec: how.
    """

    codec: PointCodec
    name: str = "early"

    @property
    def told(self) -> str:
        """What it is, in words."""
        one = self.codec
        if one.name == "draco":
            return f"draco {one.bits} bits of {one.cube_m:g} m"
        return f"{one.name} {one.edge_m:g} m"


@dataclass(frozen=True)
class Middle:
    """What the encoder says of pillars is sent.

    Attributes:
        cells: so many at most; all if None.
        bits: of a value.
        channels: so many, those with most energy; all if None.
        stride: cells along an edge of what is sent.
        along_site: cells lie along the site's axes; else along the node's.
    """

    cells: int | None = None
    bits: int = 4
    channels: int | None = None
    stride: int = 1
    along_site: bool = True
    name: str = "middle"

    @property
    def told(self) -> str:
        """What it is, in words."""
        cells = "all cells" if self.cells is None else f"{self.cells} cells"
        words = [cells, f"{self.bits} bits"]
        words += [] if self.channels is None else [f"{self.channels} channels"]
        words += [] if self.stride == 1 else [f"cells of {self.stride} pillars' edge"]
        words += [] if self.along_site else ["along the node's axes"]
        return ", ".join(words)


@dataclass(frozen=True)
class Late:
    """Boxes are sent.

    Attributes:
        least: score of the boxes that are told.
        motion: tell how fast they go.
        covariance: tell how well that is known.
        rule: how two boxes become one.
        every: each so manieth frame is told.
    """

    least: float = 0.1
    motion: bool = True
    covariance: bool = True
    rule: Rule = "intersection"
    every: int = 1
    name: str = "late"

    @property
    def told(self) -> str:
        """What it is, in words."""
        words = [f"score {self.least:g} and more"]
        words += [] if self.motion else ["without motion"]
        words += [] if self.covariance else ["without covariance"]
        words += [] if self.rule == "intersection" else ["Kalman update"]
        words += [] if self.every == 1 else [f"every {self.every} frames"]
        return ", ".join(words)


How = Alone | Early | Middle | Late


@dataclass(frozen=True)
class Setting:
    """One point of a curve.

    Attributes:
        study: one of `STUDIES`.
        how: what is shared.
        value: along the study's axis; None where the axis is what is measured (bits, time).
        unit: of the value.
        channel: what comes between.
        nodes: how many take part, the receiver included; all if None.
        aligned: what is old is moved to where it would be now.
    """

    study: str
    how: How
    value: float | None = None
    unit: str = ""
    channel: Channel = field(default_factory=Channel)
    nodes: int | None = None
    aligned: bool = False

    @property
    def work(self) -> tuple[object, ...]:
        """What decides the detections: settings with the same work are computed once."""
        return (self.how, self.channel, self.nodes, self.aligned)


#: What each way shares where something else than bits is studied.
_EARLY = Early(PointCodec("octree", edge_m=0.1))
_MIDDLE = Middle(cells=4000, bits=4)
_LATE = Late()
_WAYS: tuple[How, ...] = (_EARLY, _MIDDLE, _LATE)

_LATENCY_S = (0.1, 0.2, 0.5, 1.0)
_CLOCK_S = (0.05, 0.1, 0.2, 0.5)
_PLACE_M = (0.1, 0.2, 0.5, 1.0)
_YAW_DEG = (0.2, 0.5, 1.0, 2.0)
_LOSS = (0.01, 0.05, 0.1, 0.2, 0.5)
#: Latency at which clocks are studied: without one, nothing is moved by its stamp.
_CLOCK_LATENCY_S = 0.2


def settings_of(
    studies: Sequence[str], nodes: int, *, reach_m: float, fails_from_s: float, last: int
) -> list[Setting]:
    """Return the settings of studies, those of every study with the receiver alone first.

    Args:
        studies: of `STUDIES`.
        nodes: how many there are.
        reach_m: how far the detector looks along x and y: Draco counts in a cube that holds it.
        fails_from_s: when a node falls silent, where that is studied.
        last: number of the node that does.

    Raises:
        InputError: a study is unknown.
    """
    for name in studies:
        if name not in STUDIES:
            raise InputError(
                f"unknown study {name!r:.40}", place="--study", expected=", ".join(STUDIES)
            )
    made: dict[str, Callable[[], list[Setting]]] = {
        "bitrate": lambda: _bitrate(2 * reach_m),
        "latency": lambda: _swept("latency", "s", _LATENCY_S, "latency_s"),
        "clock": _clock,
        "pose": lambda: [
            *_swept("pose", "m", _PLACE_M, "place_error_m", both=False),
            *_swept("pose", "deg", _YAW_DEG, "yaw_error_deg", both=False),
        ],
        "loss": lambda: _swept("loss", "share", _LOSS, "loss", both=False),
        "nodes": lambda: [
            Setting("nodes", how, float(count), "nodes", nodes=count)
            for how in _WAYS
            for count in range(2, nodes + 1)
        ],
        "failure": lambda: [
            Setting("failure", how, channel=one)
            for how in _WAYS
            for one in (Channel(), Channel(silent=last, silent_from_s=fails_from_s))
        ],
    }
    found = []
    for name in STUDIES:
        if name in studies:
            found += [Setting(name, Alone()), *made[name]()]
    return found


def _bitrate(cube_m: float) -> list[Setting]:
    kinds: tuple[Literal["voxel", "octree"], ...] = ("voxel", "octree")
    ways: list[How] = [Early(PointCodec(kind, edge_m=edge))
                       for kind in kinds for edge in (0.05, 0.1, 0.2, 0.4, 0.8)]  # fmt: skip
    ways += [Early(PointCodec("draco", bits=k, cube_m=cube_m)) for k in (8, 9, 10, 11, 12)]
    ways += [Middle(cells=cells, bits=4) for cells in (250, 1000, 4000, None)]
    ways += [Middle(cells=4000, bits=bits) for bits in (1, 2, 8)]
    ways += [Middle(cells=4000, bits=4, channels=channels) for channels in (4, 8, 16)]
    ways += [Middle(cells=None, bits=4, stride=2), Middle(cells=4000, bits=4, along_site=False)]
    ways += [Late(least=least) for least in (0.5, 0.3, 0.1, 0.05)]
    ways += [Late(covariance=False), Late(motion=False, covariance=False)]
    ways += [Late(rule="kalman"), Late(every=2), Late(every=5)]
    return [Setting("bitrate", how) for how in ways]


def _swept(
    study: str, unit: str, values: Sequence[float], name: str, *, both: bool = True
) -> list[Setting]:
    """Return settings of every way for values of a field of the channel, from 0 on.

    ``both``: with and without temporal alignment.
    """
    found = []
    for how in _WAYS:
        for aligned in (False, True) if both else (False,):
            for value in (0.0, *values):
                channel = _channel(name, value)
                found.append(Setting(study, how, value, unit, channel, aligned=aligned))
    return found


def _channel(name: str, value: float) -> Channel:
    told: dict[str, Any] = {name: value}
    return Channel(**told)


def _clock() -> list[Setting]:
    return [
        replace(one, channel=replace(one.channel, latency_s=_CLOCK_LATENCY_S))
        for one in _swept("clock", "s", _CLOCK_S, "clock_error_s")
    ]
