"""Frames as PyTorch takes them: samples, batches, workers, and draws that are always the same."""

import pickle
from typing import Any

import numpy as np
import pytest

import urbantwin as ut

torch = pytest.importorskip(
    "torch", reason="torch is not installed: pip install 'urbantwin[detector]'"
)

from urbantwin.dataset.reading.torch_frames import FIELDS, collated  # noqa: E402

from .conftest import Line  # noqa: E402

pytestmark = pytest.mark.xdist_group("learn")


def half(sample: dict[str, Any], draw: np.random.Generator) -> dict[str, Any]:
    kept = draw.random(len(sample["points"])) < 0.5
    return sample | {name: sample[name][kept] for name in ("points", "semantic", "instance")}


def same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    return one.keys() == other.keys() and all(
        torch.equal(value, other[name]) if torch.is_tensor(value) else value == other[name]
        for name, value in one.items()
    )


def test_a_sample_holds_what_the_frame_says(line: Line) -> None:
    some = line.dataset.where(min_points=1)
    samples = some.torch(FIELDS, flow=True)
    assert isinstance(samples, torch.utils.data.Dataset)
    assert len(samples) == len(some)
    frame, sample = some[2], samples[2]
    for column, name in enumerate(FIELDS):
        np.testing.assert_array_equal(sample["points"][:, column], getattr(frame, name))
    np.testing.assert_array_equal(sample["semantic"], frame.semantic)
    np.testing.assert_array_equal(sample["instance"], frame.instance)
    np.testing.assert_array_equal(sample["flow"], frame.flow())
    np.testing.assert_allclose(sample["boxes"], frame.box_array, rtol=1e-6)
    rows = frame.boxes.to_pylist()
    assert len(rows) > 0
    assert [samples.classes[n] for n in sample["box_class"]] == [row["class"] for row in rows]
    assert sample["box_track"].tolist() == [row["track"] for row in rows]
    assert sample["box_points"].tolist() == [row["num_points"] for row in rows]
    assert sample["box_velocity"][:, 0].tolist() == pytest.approx([row["vx"] for row in rows])
    assert sample["box_occlusion"].tolist() == pytest.approx([row["occlusion"] for row in rows])
    assert (sample["frame"], sample["time_s"], sample["number"]) == (frame.name, frame.time_s, 2)
    # Of boxes that nobody can see, occlusion is not a number.
    every = line.dataset.torch()[2]
    unknown = line.dataset[2].boxes["occlusion"].null_count
    assert int(torch.isnan(every["box_occlusion"]).sum()) == unknown > 0
    assert "flow" not in every
    assert "semantic" not in line.dataset.torch(labels=False)[2]


def test_a_frame_without_boxes_is_a_sample_too(line: Line) -> None:
    batch = collated([line.dataset.where(tracks=[]).torch()[k] for k in (0, 1)])
    assert batch["boxes"].shape == (0, 7)
    assert batch["box_frame"].shape == batch["box_class"].shape == (0,)
    assert batch["box_velocity"].shape == (0, 3)


def test_a_batch_says_whose_each_row_is(line: Line) -> None:
    samples = line.dataset.torch(transform=lambda sample, draw: sample | {"extra": 7})
    own = [samples[k] for k in (1, 3)]
    batch = collated(own)
    for number, sample in enumerate(own):
        for index, names in (
            ("point_frame", ("points", "semantic", "instance")),
            ("box_frame", ("boxes", "box_class", "box_track")),
        ):
            for name in names:
                assert torch.equal(batch[name][batch[index] == number], sample[name])
    assert batch["frame"] == [line.dataset.names[1], line.dataset.names[3]]
    assert batch["extra"] == [7, 7]


def test_any_number_of_workers_gives_the_same_batches(line: Line) -> None:
    def drawn(workers: int, epochs: tuple[int, ...]) -> list[dict[str, Any]]:
        samples = line.dataset.where(min_points=1).torch(transform=half, seed=3)
        loader = samples.loader(batch_size=2, workers=workers, shuffle=True)
        found = []
        for epoch in epochs:
            samples.set_epoch(epoch)
            found += list(loader)
        return found

    alone, shared = drawn(0, (0, 1)), drawn(2, (0, 1))
    assert len(alone) == len(shared) == 6
    assert all(same(one, other) for one, other in zip(alone, shared, strict=True))
    # Another epoch has another order and other draws, and needs not those before it.
    assert not all(same(one, other) for one, other in zip(alone[:3], alone[3:], strict=True))
    assert all(same(one, other) for one, other in zip(alone[3:], drawn(0, (1,)), strict=True))


def test_it_goes_to_another_process_by_pickle(line: Line) -> None:
    samples = line.dataset.where(min_points=1).torch(transform=half, seed=9)
    samples.set_epoch(4)
    again = pickle.loads(pickle.dumps(samples))
    assert same(again[1], samples[1])


def test_a_field_that_points_do_not_have(line: Line) -> None:
    with pytest.raises(ut.InputError, match=r"no field 'colour'; expected x, y, z"):
        line.dataset.torch(("x", "colour"))
