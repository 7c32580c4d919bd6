"""The detector that comes with the package: small, trained on twins alone, good at real cars."""

import shutil
from pathlib import Path

import urbantwin as ut
from urbantwin.learn import SHIPPED_MODEL, read_model


def test_it_is_small_and_was_trained_on_recordings_of_twins() -> None:
    assert sum(file.stat().st_size for file in SHIPPED_MODEL.iterdir()) < 20e6
    model = read_model(SHIPPED_MODEL)
    assert {"car", "pedestrian", "bicycle"} <= set(model.design.classes)
    # A recording of a twin is named SITE-SEED-RIG-WEATHER-SCENARIO by the campaign that made it.
    assert all(
        data["name"].endswith(("-own-clear-none", "-car-clear-none", "-bus-clear-none"))
        for data in model.trained["datasets"]
    )
    assert (SHIPPED_MODEL / "card.md").is_file()


def test_without_a_model_real_cars_are_found(shared_data: Path, tmp_path: Path) -> None:
    """Two frames at a roadside that no training saw: 93 % of 175 cars by all eight."""
    lumpi, frames = shared_data / "recordings/lumpi", tmp_path / "frames"
    frames.mkdir()
    for name in ("0012.bin", "0024.bin", "boxes.csv"):
        shutil.copy(lumpi / name, frames / name)
    detected = ut.model.detect(frames, tmp_path / "detections", progress=False)
    assert detected.found.frames == ("0012.bin", "0024.bin")
    judged = ut.model.evaluate(
        detected, frames, tmp_path / "report", classes=["car"], within=40, progress=False
    )
    (precision,) = judged.summary()["average_precision"].values()
    assert precision["iou_3d_0.5"][0] > 80
