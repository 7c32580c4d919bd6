"""A submission is what the challenge's files are said to be."""

import json

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.exports.challenge import MOST_POINTS, write_challenge


def write_frames(folder, count, points=200):
    folder.mkdir()
    for index in range(count):
        rng = np.random.default_rng(index)
        np.save(folder / f"{index}.npy", rng.uniform(-60, 60, (points, 4)).astype(np.float32))
    return folder


def test_frames_are_float32_triples_within_the_space(tmp_path):
    dataset = write_frames(tmp_path / "frames", 9)
    notes = write_challenge(dataset, tmp_path / "out", frames=5)
    assert any("predictions" in note for note in notes)
    files = sorted((tmp_path / "out/synthetic").iterdir())
    assert [file.name for file in files] == [f"000{i}.bin" for i in range(1, 6)]
    for file, index in zip(files, (0, 2, 4, 6, 8), strict=True):
        points = np.fromfile(file, "<f4").reshape(-1, 3)
        source = np.load(dataset / f"{index}.npy")[:, :3]
        inside = (np.abs(source) <= [40, 40, 5]).all(axis=1)
        assert np.array_equal(points, source[inside])
    with pytest.raises(InputError, match="9 frames"):
        write_challenge(dataset, tmp_path / "out")


def test_detections_are_checked_and_big_frames_thinned(tmp_path):
    dataset = tmp_path / "frames"
    dataset.mkdir()
    np.save(dataset / "0.npy", np.random.default_rng(0).uniform(-5, 5, (MOST_POINTS + 9, 3)))
    found = tmp_path / "found.json"
    found.write_text(json.dumps({"1": [{"box": [0, 0, 0, 1], "score": 1, "class": "Car"}]}))
    with pytest.raises(InputError, match="7 numbers"):
        write_challenge(dataset, tmp_path / "out", frames=1, detections=found)
    assert not (tmp_path / "out").exists()
    box = {"box": [0, 0, 0, 4, 2, 1.5, 0], "score": 0.5, "class": "Car"}
    found.write_text(json.dumps({"1": [box]}))
    notes = write_challenge(dataset, tmp_path / "out", frames=1, detections=found)
    assert any("thinned" in note for note in notes)
    assert (tmp_path / "out/synthetic/0001.bin").stat().st_size == 12 * MOST_POINTS
    assert json.loads((tmp_path / "out/predictions.json").read_text()) == {"1": [box]}

    np.save(dataset / "0.npy", np.full((5, 3), 90.0))
    with pytest.raises(InputError, match="no point within"):
        write_challenge(dataset, tmp_path / "far", frames=1)
