"""Settings of a fusion study: shared data, channel, and number of nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from urbantwin.errors import InputError
from urbantwin.studies.fusion.box_fusion import Rule
from urbantwin.studies.fusion.channel import Channel

__all__ = ["STUDIES", "Alone", "Early", "How", "Late", "Middle", "Setting", "settings_of"]

#: Studies, in the order of the report.
STUDIES = ("bitrate", "latency", "clock", "pose", "loss", "nodes", "failure")


@dataclass(frozen=True)
class Alone:
    """No sharing: the receiver's own points only."""

    name: str = "alone"
    told: str = "alone"


@dataclass(frozen=True)
class Early:
    """Early fusion: clouds are sent, as cubic cells with an edge of ``edge_m`` metres."""

    edge_m: float = 0.1
    name: str = "early"

    @property
    def told(self) -> str:
        """The way in words."""
        return f"cells of {self.edge_m:g} m"


@dataclass(frozen=True)
class Middle:
    """Middle fusion: the encoder's features of pillars are sent.

    Attributes:
        cells: largest number of cells; all if None.
        bits: bits per value.
        channels: number of channels, those with most energy; all if None.
        stride: cells per edge of a sent cell.
        along_site: whether cells are aligned with the site's axes, otherwise with the node's.
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
    """Late fusion: boxes are sent.

    Attributes:
        least: lowest score of a box.
        motion: send speeds and yaw rates.
        covariance: send the covariance.
        rule: rule to fuse two boxes.
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
        how: shared data.
        value: value on the study's axis; None if the axis is measured (bits, time).
        unit: unit of the value.
        channel: channel between the nodes.
        nodes: number of nodes, including the receiver; all if None.
        aligned: whether old data are predicted to the present time.
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
        """Parameters that determine the detections: settings with equal ones are computed once."""
        return (self.how, self.channel, self.nodes, self.aligned)


#: Shared data of each way in studies other than of bit rate.
_WAYS: tuple[How, ...] = (Early(), Middle(), Late())
#: Studies of a field of the channel: study, unit, field, values after 0, and whether temporal
#: alignment is also tested.
_SWEPT = (
    ("latency", "s", "latency_s", (0.1, 0.2, 0.5, 1.0), True),
    ("clock", "s", "clock_error_s", (0.05, 0.1, 0.2, 0.5), True),
    ("pose", "m", "place_error_m", (0.1, 0.2, 0.5, 1.0), False),
    ("pose", "deg", "yaw_error_deg", (0.2, 0.5, 1.0, 2.0), False),
    ("loss", "share", "loss", (0.01, 0.05, 0.1, 0.2, 0.5), False),
)
#: Latency in the study of clocks, seconds: without latency, time stamps have no effect.
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
    """Return the settings of studies; for each study the receiver alone comes first.

    Args:
        studies: names in `STUDIES`.
        nodes: number of nodes.
        fails_from_s: time of a node's failure, if studied, seconds.
        last: number of the failing node.

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
