"""The card of a dataset in another program's format, from what its export says of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import Field

from urbantwin.artefact import read_json, sha256_of
from urbantwin.artefact.manifest import Part, validated
from urbantwin.artefact.markdown import bullets, code, escaped, front_matter
from urbantwin.artefact.privacy import Finding
from urbantwin.dataset.card.licences import hub_licence
from urbantwin.dataset.card.page import joined, licence_lines, privacy_lines, section

__all__ = ["EXPORTED", "card_of_export"]

#: Kind of folder that an export of a dataset leaves.
EXPORTED = "exported"
_EXPECTED = "what `urbantwin export DATASET` writes"


class _Export(Part):
    format: str
    urbantwin: str
    dataset_sha256: str = ""
    inputs: list[dict[str, Any]] = Field(default_factory=list)
    losses: list[str] = Field(default_factory=list)
    notes: list[str] = Field(default_factory=list)


def card_of_export(folder: Path, private: Sequence[Finding] | None) -> str:
    """Return the card of an exported dataset as Markdown.

    Args:
        folder: what ``urbantwin export`` wrote.
        private: what was found of people in its files; None where nobody looked.

    Raises:
        InputError: its manifest is damaged.
    """
    file = folder / f"{EXPORTED}.json"
    told = validated(read_json(file, kind=EXPORTED), _Export, file=file, expected=_EXPECTED)
    title = f"Simulated LiDAR frames of a street, as {told.format}"
    return joined(
        front_matter({"pretty_name": title, "license": hub_licence(told.inputs)}),
        ["", f"# {escaped(title)}", ""],
        [
            f"Exported by UrbanTwin {escaped(told.urbantwin)} from a dataset whose `dataset.json` "
            f"has the SHA-256 {code(told.dataset_sha256 or 'not told')}. The card of that one "
            "tells of its classes, sensors, traffic and limits.",
        ],
        section("What this format could not hold", bullets(map(escaped, told.losses))),
        section("Notes", bullets(map(escaped, told.notes))),
        section("Inputs, licences and attribution", licence_lines(told.inputs)),
        section("Personal data", privacy_lines(told.inputs, private)),
        section("Checksum", [f"SHA-256 of `{file.name}`: `{sha256_of(file)}`."]),
    )
