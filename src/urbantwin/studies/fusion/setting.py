"""What a study compares: how nodes share what they see, over which channel, and how many do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from urbantwin.errors import InputError
from urbantwin.studies.fusion.box_fusion import Rule
from urbantwin.studies.fusion.channel import Channel

__all__ = ["STUDIES", "Alone", "Early", "How", "Late", "Middle", "Setting", "settings_of"]

#: What may be studied, in the order of the report.
STUDIES = ("bitrate", "latency", "clock", "pose", "loss", "nodes", "failure")


@dataclass(frozen=True)
class Alone:
    """The receiver's own points and nothing else."""

    name: str = "alone"
    told: str = "alone"


@dataclass(frozen=True)
class Early:
    """Clouds are sent, as cubic cells with an edge of ``edge_m`` metres."""

    edge_m: float = 0.1
    name: str = "early"

    @property
    def told(self) -> str:
        """The way in words."""
        return f"cells of {self.edge_m:g} m"


@dataclass(frozen=True)
class Middle:
    """The encoder's features of pillars are sent.

    Attributes:
        cells: largest number of cells; all if None.
        bits: of a value.
        channels: number of channels, those with most energy; all if None.
        stride: cells along an edge of what is sent.
        along_site: cells lie along the site's axes; else along the node's.
    """

    cells: int | None = 4000
    bits: int = 4
    channels: int | None = None
    stride: int = 1
    along_site: bool = True
    name: str = "middle"

    @property
    def told(self) -> str:
        """The way in words."""
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
        least: least score of a box.
        motion: send speeds and rates of turn.
        covariance: send the covariance.
        rule: how two boxes become one.
        every: send every n-th frame.
    """

    least: float = 0.1
    motion: bool = True
    covariance: bool = True
    rule: Rule = "intersection"
    every: int = 1
    name: str = "late"

    @property
    def told(self) -> str:
        """The way in words."""
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
        channel: between the nodes.
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
_WAYS: tuple[How, ...] = (Early(), Middle(), Late())
#: What is studied by a field of the channel: study, unit, field, values from 0 on, whether with
#: temporal alignment, too.
_SWEPT = (
    ("latency", "s", "latency_s", (0.1, 0.2, 0.5, 1.0), True),
    ("clock", "s", "clock_error_s", (0.05, 0.1, 0.2, 0.5), True),
    ("pose", "m", "place_error_m", (0.1, 0.2, 0.5, 1.0), False),
    ("pose", "deg", "yaw_error_deg", (0.2, 0.5, 1.0, 2.0), False),
    ("loss", "share", "loss", (0.01, 0.05, 0.1, 0.2, 0.5), False),
)
#: Latency at which clocks are studied: without one, nothing is moved by its stamp.
_CLOCK_LATENCY_S = 0.2
_BITRATE: tuple[How, ...] = (
    *(Early(edge) for edge in (0.05, 0.1, 0.2, 0.4, 0.8)),
    *(Middle(cells) for cells in (250, 1000, 4000, None)),
    *(Middle(bits=bits) for bits in (1, 2, 8)),
    *(Middle(channels=channels) for channels in (4, 8, 16)),
    Middle(None, stride=2),
    Middle(along_site=False),
    *(Late(least) for least in (0.5, 0.3, 0.1, 0.05)),
    Late(covariance=False),
    Late(motion=False, covariance=False),
    Late(rule="kalman"),
    Late(every=2),
    Late(every=5),
)


def settings_of(
    studies: Sequence[str], nodes: int, *, fails_from_s: float, last: int
) -> list[Setting]:
    """Return the settings of studies, those of every study with the receiver alone first.

    Args:
        studies: of `STUDIES`.
        nodes: how many there are.
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
    every = [Setting(name, Alone()) for name in STUDIES]
    every += [Setting("bitrate", how) for how in _BITRATE]
    for study, unit, name, values, both in _SWEPT:
        base = Channel(latency_s=_CLOCK_LATENCY_S if study == "clock" else 0.0)
        every += [
            Setting(study, how, value, unit, replace(base, **{name: value}), aligned=aligned)
            for how in _WAYS
            for aligned in (False, True)[: 1 + both]
            for value in (0.0, *values)
        ]
    silent = Channel(silent=last, silent_from_s=fails_from_s)
    for how in _WAYS:
        every += [Setting("nodes", how, float(count), "nodes", nodes=count)
                  for count in range(2, nodes + 1)]  # fmt: skip
        every += [Setting("failure", how, channel=one) for one in (Channel(), silent)]
    return [one for name in STUDIES if name in studies for one in every if one.study == name]
