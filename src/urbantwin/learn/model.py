"""A trained detector in a folder: ``model.safetensors`` and ``model.yaml``, never a pickle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import safetensors
import safetensors.torch
import yaml
from pydantic import Field
from torch import Tensor

from urbantwin.artefact import write_json
from urbantwin.artefact.checksum import sha256_of
from urbantwin.artefact.manifest import Part, validated
from urbantwin.detections import DETECTED_CLASSES
from urbantwin.errors import InputError
from urbantwin.io.trust import read_yaml_document
from urbantwin.learn.grid import halvings
from urbantwin.learn.heads import ClassHead, class_heads
from urbantwin.learn.network import Detector
from urbantwin.learn.pillars import features_of
from urbantwin.learn.second_look.network import SecondLook
from urbantwin.taxonomy import semantic_classes

__all__ = ["KIND", "SHIPPED_MODEL", "Design", "FirstWeights", "Model", "first_weights"]
__all__ += ["new_network", "read_model", "write_model"]

#: Folder of the detector that comes with the package: trained on twins alone, see its card.md.
SHIPPED_MODEL = Path(__file__).parent / "shipped"
KIND = "model"
#: Version of the fields in model.yaml.
SCHEMA = 1
_EXPECTED = "a folder that `urbantwin model train` wrote"
_WEIGHTS = "model.safetensors"
_TEXT = "model.yaml"
#: Prefix of the second stage's weights in the file of weights.
_LOOK = "second_look."


@dataclass(frozen=True)
class Design:
    """Inputs, outputs and size of a network.

    Attributes:
        classes: object classes, each one of `DETECTED_CLASSES`.
        range_m: half the edge of the square that the network covers, about the centre of the
            sensors, metres.
        cell_m: edge of a pillar, metres.
        intensity: whether points carry intensity.
        width: multiple of the number of channels.
        points: semantic classes that points are assigned to (``taxonomy.semantic_classes``).
    """

    classes: tuple[str, ...] = DETECTED_CLASSES
    range_m: float = 60.0
    cell_m: float = 0.4
    intensity: bool = False
    width: float = 1.0
    points: tuple[str, ...] = ()

    @property
    def heads(self) -> tuple[ClassHead, ...]:
        """One head for each class."""
        return class_heads(self.classes, self.cell_m)


@dataclass(frozen=True, eq=False)
class Model:
    """A trained detector.

    Attributes:
        design: inputs, outputs and size of the network.
        network: in evaluation mode.
        trained: provenance: datasets with their hashes, number of steps, version.
        second_look: second stage, in evaluation mode; ``None`` without one.
    """

    design: Design
    network: Detector
    trained: Mapping[str, Any]
    second_look: SecondLook | None = None


class _Manifest(Part):
    kind: Literal["model"]
    schema_: Literal[1] = Field(alias="schema")
    classes: list[str]
    range_m: Annotated[float, Field(ge=5, le=500)]
    cell_m: Annotated[float, Field(ge=0.05, le=2)]
    intensity: bool
    width: Annotated[float, Field(ge=0.25, le=16)]
    points: list[str] = Field(default=[])
    second_look: bool = False
    weights_sha256: str
    trained: dict[str, Any]


def new_network(design: Design) -> Detector:
    """Return an untrained network; torch's generator draws its weights."""
    return Detector(
        features_of(intensity=design.intensity),
        design.heads,
        design.width,
        len(design.points),
        halvings(design.cell_m),
    )


@dataclass(frozen=True, eq=False)
class FirstWeights:
    """Initial weights of a training.

    Attributes:
        weights: tensors by name.
        sha256: hash of the file they were read from.
        classes: classes of the heads that the file contains.
    """

    weights: Mapping[str, Tensor]
    sha256: str
    classes: tuple[str, ...]


def first_weights(folder: Path, design: Design) -> FirstWeights:
    """Return the weights of a model that a network of another design can start from.

    Heads are matched by the name of their class.

    Args:
        folder: folder of the model.
        design: design of the network to be trained.

    Raises:
        InputError: the folder is no model, or cell size, width or intensity differ.
    """
    model = read_model(folder)
    for name, unit in (("cell_m", " m"), ("width", ""), ("intensity", "")):
        is_, wanted = getattr(model.design, name), getattr(design, name)
        if is_ != wanted:
            raise InputError(
                f"has {name} {is_}{unit}",
                file=folder / _TEXT,
                place="--from",
                expected=f"a model with {name} {wanted}{unit}",
            )
    found = {}
    for name, value in model.network.state_dict().items():
        if name.startswith("of_points"):
            continue  # the classes of points are known only once the frames are read
        kind, _, rest = name.partition(".")
        if kind == "heads":
            number, _, rest = rest.partition(".")
            told = model.design.classes[int(number)]
            if told not in design.classes:
                continue
            found[f"heads.{design.classes.index(told)}.{rest}"] = value
        else:
            found[name] = value
    return FirstWeights(found, sha256_of(folder / _WEIGHTS), model.design.classes)


def write_model(folder: Path, model: Model) -> None:
    """Write a model into an existing folder (see `artefact.replaced_folder`).

    Args:
        folder: folder to write into.
        model: model on any device.
    """
    weights = {
        name: one.detach().cpu().contiguous() for name, one in model.network.state_dict().items()
    }
    if model.second_look is not None:
        for name, one in model.second_look.state_dict().items():
            weights[_LOOK + name] = one.detach().cpu().contiguous()
    safetensors.torch.save_file(weights, folder / _WEIGHTS)
    design = asdict(model.design) | {"classes": list(model.design.classes)}
    design["points"] = list(model.design.points)
    told = {"kind": KIND, "schema": SCHEMA, **design}
    told["second_look"] = model.second_look is not None
    told |= {"weights_sha256": sha256_of(folder / _WEIGHTS), "trained": dict(model.trained)}
    text = yaml.safe_dump(told, sort_keys=False, allow_unicode=True)
    (folder / _TEXT).write_text(text, encoding="utf-8")
    # Every output folder has a manifest KIND.json; the contents are in model.yaml.
    write_json(folder / f"{KIND}.json", {"kind": KIND, "schema": SCHEMA, "told_in": _TEXT})


def read_model(folder: Path, device: str = "cpu") -> Model:
    """Read a model that `write_model` wrote.

    Args:
        folder: folder of the model.
        device: torch device for the network.

    Raises:
        InputError: the folder is no model, or its files are damaged or do not belong together.
    """
    file, weights = folder / _TEXT, folder / _WEIGHTS
    if not file.is_file():
        raise InputError("is not there", file=file, expected=_EXPECTED)
    value = read_yaml_document(file, _EXPECTED)
    if not isinstance(value, dict):
        raise InputError("does not describe a model", file=file, expected=_EXPECTED)
    told = validated(value, _Manifest, file=file, expected=_EXPECTED)
    known = {"classes": DETECTED_CLASSES, "points": tuple(semantic_classes())}
    for place, names in (("classes", told.classes), ("points", told.points)):
        for name in names:
            if name not in known[place]:
                expected = "some of " + ", ".join(known[place])
                raise InputError(f"names {name!r:.40}", file=file, place=place, expected=expected)
        if len(set(names)) < len(names):
            raise InputError("names a class twice", file=file, place=place, expected="each once")
    design = Design(tuple(told.classes), told.range_m, told.cell_m, told.intensity, told.width,
                    tuple(told.points))  # fmt: skip
    network = new_network(design)
    look = SecondLook(len(design.classes)) if told.second_look else None
    try:
        if sha256_of(weights) != told.weights_sha256:
            raise InputError(
                "is not the file that belongs to model.yaml (its SHA-256 differs)",
                file=weights,
                expected=_EXPECTED,
            )
        known_weights = safetensors.torch.load_file(weights)
        if look is not None:
            own = [name for name in known_weights if name.startswith(_LOOK)]
            look.load_state_dict(
                {name.removeprefix(_LOOK): known_weights.pop(name) for name in own}
            )
        network.load_state_dict(known_weights)
    except (OSError, safetensors.SafetensorError, RuntimeError) as error:
        text = " ".join(str(error).split())
        raise InputError(f"cannot be read: {text:.120}", file=weights, expected=_EXPECTED) from None
    if look is not None:
        look = look.to(device).eval()
    return Model(design, network.to(device).eval(), told.trained, look)
