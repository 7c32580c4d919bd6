"""A cell of a notebook that is interrupted leaves nothing half-written."""

from pathlib import Path

import pytest

import urbantwin as ut

from .conftest import Line


def interrupted_at(share: float):
    """What a person does who stops a cell when so much is done."""

    def progress(done: float, doing: str) -> None:
        if done >= share:
            raise KeyboardInterrupt

    return progress


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_nothing_half_written_is_left(line: Line, tmp_path: Path, share: float) -> None:
    stop = interrupted_at(share)
    for make in (
        lambda: ut.build(line.site, tmp_path / "twin", pictures=False, progress=stop),
        lambda: ut.drive(line.twin, tmp_path / "motion", progress=stop),
        lambda: ut.rig.coverage(line.twin, tmp_path / "coverage", progress=stop),
    ):
        with pytest.raises(KeyboardInterrupt):
            make()
        assert list(tmp_path.iterdir()) == []


def test_a_recording_goes_on_from_where_it_was_interrupted(line: Line, tmp_path: Path) -> None:
    def record(progress) -> ut.Dataset:
        return ut.record(
            line.twin, line.motion, tmp_path / "dataset", stop=0.5, workers=1, pictures=False,
            progress=progress,
        )  # fmt: skip

    with pytest.raises(KeyboardInterrupt):
        record(interrupted_at(0.5))
    assert not (tmp_path / "dataset").exists()
    told: list[str] = []
    made = record(lambda share, doing: told.append(doing))
    assert next(doing for doing in told if doing.startswith("frame ")) != "frame 1 of 6"
    assert [path.name for path in tmp_path.iterdir()] == ["dataset"]
    sums = [(folder / "SHA256SUMS").read_bytes() for folder in (made.folder, line.dataset.folder)]
    assert sums[0] == sums[1]
