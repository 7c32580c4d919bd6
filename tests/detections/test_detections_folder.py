"""Detections written and read again, and what is refused."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from urbantwin.detections import Detections, joined, read_detections, write_detections
from urbantwin.errors import InputError


def made() -> Detections:
    """Three frames, the second of them empty."""
    box = np.array([[1.0, 2, 3, 4, 2, 1.5, 0.5], [5, 6, 0, 4, 2, 1.5, -3]])
    return replace(
        joined(
            ("000000", "000001", "000002"),
            [
                (box, ("car", "bus"), np.array([0.25, 1])),
                (np.zeros((0, 7)), (), np.zeros(0)),
                (box[:1], ("pedestrian",), np.array([0.0])),
            ],
            np.array([0, 0.1, 0.2]),
        ),
        track=np.array([7, -1, 7]),
    )


@pytest.mark.parametrize("timed", [True, False])
def test_what_is_written_is_read(tmp_path: Path, timed: bool) -> None:
    wrote = made() if timed else replace(made(), time_s=None)
    write_detections(tmp_path / "found", wrote, {"model": "m"})
    read = read_detections(tmp_path / "found")
    for name in ("frame", "box", "score", "track"):
        assert np.array_equal(getattr(read, name), getattr(wrote, name)), name
    assert (read.frames, read.class_names) == (wrote.frames, wrote.class_names)
    assert np.array_equal(read.time_s, wrote.time_s) if timed else read.time_s is None
    assert [len(read.of(index)) for index in range(3)] == [2, 0, 1]
    assert read.of(2).class_names == ("pedestrian",)


def test_the_same_detections_are_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_detections(tmp_path / name, made(), {})
    first, second = (
        {file.name: file.read_bytes() for file in (tmp_path / name).iterdir()} for name in "ab"
    )
    assert first == second


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda d: replace(d, score=np.array([0.2, 2.5, 0])), "scores like 2.5; expected 0 to 1"),
        (lambda d: replace(d, score=np.array([0.2, np.nan, 0])), "not finite"),
        (lambda d: replace(d, box=d.box * [1, 1, 1, 1, 0, 1, 1]), "without extent"),
        (lambda d: replace(d, box=d.box + [0, 0, 0, 0, 0, 0, 90]), "as if in degrees"),
        (lambda d: replace(d, box=d.box + [0, 0, np.inf, 0, 0, 0, 0]), "not finite"),
        (lambda d: replace(d, class_names=("car", "Kraken", "car")), "class 'Kraken' is unknown"),
    ],
)
def test_what_cannot_be_is_refused(
    tmp_path: Path, wrong: Callable[[Detections], Detections], said: str
) -> None:
    write_detections(tmp_path / "found", wrong(made()), {})
    with pytest.raises(InputError, match=said):
        read_detections(tmp_path / "found")


def test_a_frame_that_the_manifest_does_not_name_is_refused(tmp_path: Path) -> None:
    write_detections(tmp_path / "found", made(), {})
    file = tmp_path / "found" / "detections.json"
    told = json.loads(file.read_text())
    told["frames"][2] = "elsewhere"
    file.write_text(json.dumps(told))
    with pytest.raises(InputError, match="frame '000002' is not one of"):
        read_detections(tmp_path / "found")


def test_headings_of_more_than_half_a_turn_are_turned_back(tmp_path: Path) -> None:
    turned = made()
    write_detections(
        tmp_path / "found", replace(turned, box=turned.box + [0, 0, 0, 0, 0, 0, 2 * np.pi]), {}
    )
    assert np.allclose(read_detections(tmp_path / "found").box, turned.box)
