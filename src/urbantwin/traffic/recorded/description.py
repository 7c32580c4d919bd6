"""Description of recorded tracks: columns, units, coordinate frame, classes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from urbantwin.site.conditions import Angle, Strict
from urbantwin.site.yaml_document import Document, nearest, read_document, wrong
from urbantwin.taxonomy import ACTOR_CLASSES

__all__ = ["COLUMNS", "IGNORED", "SignalsSpec", "TracksSpec", "class_of", "load_description"]

#: Target of classes that are left out.
IGNORED = "ignore"

#: Words in class names (KITTI, nuScenes, OpenLABEL and ASAM OpenX, inD and related ones, TUMTraf,
#: SUMO) -> classes of UrbanTwin, of which the first that exists is used. Special words come first.
_CLASS_WORDS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("dontcare", (IGNORED,)),
    ("misc", (IGNORED,)),
    ("animal", ("animal", IGNORED)),
    ("barrier", (IGNORED,)),
    ("cone", (IGNORED,)),
    ("obstacle", (IGNORED,)),
    ("debris", (IGNORED,)),
    ("pushable", (IGNORED,)),
    ("rack", (IGNORED,)),
    ("motorcycl", ("motorcycle",)),
    ("motorbike", ("motorcycle",)),
    ("moped", ("motorcycle",)),
    ("bicycl", ("bicycle",)),
    ("cyclist", ("bicycle",)),
    ("bike", ("bicycle",)),
    ("pedestrian", ("pedestrian",)),
    ("person", ("pedestrian",)),
    ("walker", ("pedestrian",)),
    ("tram", ("tram", IGNORED)),
    ("train", ("tram", IGNORED)),
    ("bus", ("bus",)),
    ("trailer", ("trailer", "truck")),
    ("truck", ("truck",)),
    ("lorry", ("truck",)),
    ("van", ("van", "car")),
    ("passenger", ("car",)),
    ("car", ("car",)),
)


def class_of(name: str) -> str | None:
    """Return UrbanTwin's class of a recording's, ``ignore`` for no actor, ``None`` if unknown."""
    plain = name.lower().replace(" ", "").replace("_", "").replace("-", "")
    if plain in ACTOR_CLASSES:
        return plain
    for word, classes in _CLASS_WORDS:
        if word in plain:
            return next(
                (
                    actor_class
                    for actor_class in classes
                    if actor_class in (*ACTOR_CLASSES, IGNORED)
                ),
                IGNORED,
            )
    return None


Finite = Annotated[float, Field(allow_inf_nan=False)]
Name = Annotated[str, Field(min_length=1)]
TimeUnit = Literal["s", "ms", "us", "ns"]

#: Fields that a column can hold.
COLUMNS = (
    *("track", "time", "frame", "class", "x", "y", "z", "latitude", "longitude"),
    *("yaw", "length", "width", "height"),
)


class Origin(Strict):
    """The origin of x, y: x east, y north."""

    latitude: Annotated[float, Field(ge=-90, le=90)]
    longitude: Annotated[float, Field(ge=-180, le=180)]


class FramePose(Strict):
    """The pose of the tracks' frame in the site frame: metres, degrees counter-clockwise."""

    x: Finite = 0.0
    y: Finite = 0.0
    z: Finite = 0.0
    yaw_deg: Angle = 0.0


class UnitsSpec(Strict):
    """Units of columns of times and angles."""

    time: TimeUnit | None = None
    angle: Literal["rad", "deg"] | None = None


class SignalsSpec(Strict):
    """A table of the states of signal groups.

    Attributes:
        file: CSV: a row per group and time, or per change.
        group: column of the group.
        time: column of the time, by the clock of the tracks.
        state: column of the state.
        unit: unit of the time.
        states: state -> SUMO's letter (``G`` ``g`` ``y`` ``u`` ``r`` ``O``), in addition to those
            of SAE J2735 and colours, which are known.
        places: group -> its stop lines (x, y) in the tracks' frame.
    """

    file: Name
    group: Name = "signal_group_id"
    time: Name = "timestamp_ms"
    state: Name = "movement_state"
    unit: TimeUnit | None = None
    states: dict[str, Literal["G", "g", "y", "u", "r", "O", "o"]] = Field(default_factory=dict)
    places: dict[str, list[tuple[Finite, Finite]]] = Field(default_factory=dict)

    @field_validator("places", mode="before")
    @classmethod
    def _groups_are_text(cls, value: Any) -> Any:  # noqa: ANN401
        if not isinstance(value, dict):
            return value
        return {
            str(group): [tuple(point) if isinstance(point, list) else point for point in lines]
            if isinstance(lines, list)
            else lines
            for group, lines in value.items()
        }


class TracksSpec(Strict):
    """The fields of a description; all but ``tracks`` are optional if the file has the information.

    Attributes:
        tracks: the file.
        format: format of the file; by default from its name and content.
        columns: for CSV: field -> name of its column.
        units: units of the columns.
        rate_hz: frame rate, if times are frame numbers.
        heading: reference and direction of ``yaw``.
        point: reference point of the actor for x and y.
        origin: latitude and longitude of the origin of x, y; or
        crs: coordinate reference system of x, y: ``EPSG:25832``; or
        pose: pose of the tracks' frame in the site frame. Without any of them it is the site frame.
        classes: class of the recording -> UrbanTwin's, or ``ignore``.
        sizes: ``recorded``: if plausible for the class; ``catalogue``: those of the catalogue's
            meshes.
        signals: states of the signals.
        licence: licence of the recording, for manifests and cards.
        attribution: attribution of the recording, for manifests and cards.
    """

    tracks: Name
    format: Literal["csv", "openlabel", "nuscenes", "kitti", "openscenario"] | None = None
    columns: dict[str, Name] = Field(default_factory=dict)
    units: UnitsSpec = UnitsSpec()
    rate_hz: Annotated[float, Field(gt=0, le=1e4)] | None = None
    heading: Literal["east-counter-clockwise", "north-clockwise"] = "east-counter-clockwise"
    point: Literal["centre", "front"] = "centre"
    origin: Origin | None = None
    crs: Name | None = None
    pose: FramePose | None = None
    classes: dict[str, str] = Field(default_factory=dict)
    sizes: Literal["recorded", "catalogue"] = "recorded"
    signals: SignalsSpec | None = None
    licence: str = "not stated"
    attribution: str = "not stated"

    @field_validator("columns")
    @classmethod
    def _columns_are_known(cls, value: dict[str, str]) -> dict[str, str]:
        for name in value:
            if name not in COLUMNS:
                raise wrong(f"has a column {name!r}", nearest(name, COLUMNS))
        return value

    @field_validator("classes")
    @classmethod
    def _classes_are_known(cls, value: dict[str, str]) -> dict[str, str]:
        for name in value.values():
            if name not in (*ACTOR_CLASSES, IGNORED):
                raise wrong(f"has {name!r}", nearest(name, (*ACTOR_CLASSES, IGNORED)))
        return value

    @field_validator("pose")
    @classmethod
    def _lies_in_one_place(cls, value: Any, info: Any) -> Any:  # noqa: ANN401
        frames = [name for name in ("origin", "crs") if info.data.get(name) is not None]
        if len(frames) + (value is not None) > 1:
            raise wrong("is given twice", "one of origin, crs and pose")
        return value


def load_description(path: Path) -> tuple[TracksSpec, Document | None]:
    """Return a description of tracks and its document; a default one for a file of tracks.

    Args:
        path: a description (``.yaml``, ``.yml``), or the tracks themselves.

    Raises:
        InputError: the description is missing or wrong; the message names file, field and line.
    """
    if path.suffix.lower() not in (".yaml", ".yml"):
        return TracksSpec(tracks=path.name), None
    document = read_document(path, kind="a description of tracks")
    return document.validated(TracksSpec), document
