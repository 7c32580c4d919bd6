"""HOTA, MOTA and IDF1: closed forms, and what TrackEval says."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from urbantwin.evaluation.tracks import Moment, clear_mot, hota, identities


def figures(moments: list[Moment]) -> dict[str, float]:
    return {**hota(moments), **clear_mot(moments), **identities(moments)}


def wandering(seed: int, spread: float = 12) -> list[Moment]:
    """Objects that come and go, some missed, some followed by others after a while.

    Where they are spread far, nobody can be taken for anybody else.
    """
    draw = np.random.default_rng(seed)
    tracks, frames = int(draw.integers(2, 7)), int(draw.integers(5, 30))
    begins = draw.integers(0, frames // 2, tracks)
    place = draw.uniform(0, spread, (tracks, 2))
    called = np.arange(tracks)
    found = []
    for number in range(frames):
        place += draw.normal(0, 0.5, place.shape)
        if draw.random() < 0.2:
            first, second = draw.choice(tracks, 2, replace=False)
            called[[first, second]] = called[[second, first]]
        here = np.flatnonzero((begins <= number) & (draw.random(tracks) < 0.9))
        seen = here[draw.random(len(here)) < 0.8]
        ghosts = int(draw.integers(0, 2))
        at = np.concatenate([place[seen] + draw.normal(0, 0.6, (len(seen), 2)),
                             draw.uniform(0, spread, (ghosts, 2))])  # fmt: skip
        who = np.concatenate([called[seen], tracks + np.arange(ghosts)])
        away = np.hypot(*(place[here][:, None] - at[None]).transpose(2, 0, 1))
        found.append(Moment(here, who, np.maximum(0, 1 - away / 2)))
    # Numbers without gaps, as the metrics want them.
    for side in ("labelled", "followed"):
        known = np.unique(np.concatenate([getattr(one, side) for one in found]))
        found = [
            Moment(**{**vars(one), side: np.searchsorted(known, getattr(one, side))})
            for one in found
        ]
    return found


def as_job(scenes: list[list[Moment]]) -> list[dict[str, Any]]:
    return [
        {
            "labelled": [one.labelled.tolist() for one in moments],
            "followed": [one.followed.tolist() for one in moments],
            "similarity": [one.similarity.tolist() for one in moments],
        }
        for moments in scenes
    ]


def test_they_are_what_trackeval_says(judge: Callable[..., Any]) -> None:
    scenes = [wandering(seed) for seed in range(40)]
    said = judge("trackeval_figures", job=as_job(scenes))
    for moments, figures_there in zip(scenes, said, strict=True):
        assert figures(moments) == pytest.approx(figures_there, abs=1e-9)


@pytest.mark.thorough
def test_they_are_what_motmetrics_says(judge: Callable[..., Any]) -> None:
    """It lets who was followed once be followed on after a gap, which TrackEval does not."""
    near = [wandering(seed) for seed in range(40, 60)]
    far = [wandering(seed, spread=5000) for seed in range(60, 80)]
    for moments, said in zip(near + far, judge("motmetrics_figures", job=as_job(near + far)),
                             strict=True):  # fmt: skip
        names = ["idf1"] if any(moments is one for one in near) else list(said)
        ours = {name: figures(moments)[name] for name in names}
        assert ours == pytest.approx({name: said[name] for name in names}, abs=1e-9)
    assert sum(figures(moments)["swaps"] for moments in far) > 20


def test_found_at_once_and_swapped_halfway() -> None:
    here = np.eye(2)
    ours = np.arange(2)
    perfect = figures([Moment(ours, ours, here)] * 10)
    assert perfect.pop("swaps") == 0
    assert all(value == pytest.approx(1) for value in perfect.values())
    other = Moment(ours, ours[::-1], here[:, ::-1])
    swapped = figures([Moment(ours, ours, here)] * 5 + [Moment(ours, ours[::-1], here)] * 5)
    assert swapped["mota"] == pytest.approx(1 - 2 / 20)
    assert swapped["idf1"] == pytest.approx(0.5)
    assert swapped["deta"] == pytest.approx(1)
    assert swapped["assa"] == pytest.approx(1 / 3)  # 5 of 10 + 10 - 5
    assert figures([Moment(ours, ours, here), other])["swaps"] == 0  # the same, told in turn
    nothing = np.zeros(0, np.int64)
    lost = figures([Moment(ours, nothing, np.zeros((2, 0)))] * 3)
    assert lost["mota"] == lost["idf1"] == lost["hota"] == 0
