"""The page holds everything, and nothing of the data can break it."""

import numpy as np
from matplotlib.figure import Figure

from urbantwin.fidelity import compare
from urbantwin.fidelity.definitions import MEASURES
from urbantwin.fidelity.report import Report, anchored
from urbantwin.fidelity.report_figure import _shares as draw_shares

from ..whole_page import whole_page


def write(folder, seed):
    folder.mkdir()
    for index in range(3):
        rng = np.random.default_rng(seed + index)
        points = rng.uniform([-20, -20, -2], [20, 20, -1.9], (250, 3))
        np.save(folder / f"<b>{index}.npy", points.astype(np.float32))
    return folder


def test_the_page_is_whole_and_self_contained(tmp_path):
    real, twin = write(tmp_path / "real <i>&", 0), write(tmp_path / "twin", 9)
    out = tmp_path / "out"
    compare(real, twin, out, arbitrary=real, protocol="urbantwin-challenge")
    text = (out / "report.html").read_text()
    page = whole_page(text)
    assert "Fidelity: twin against real <i>&" in page.texts
    assert not any(tag in ("b", "i", "script") for tag, _ in page.tags)
    images = [attrs["src"] for tag, attrs in page.tags if tag == "img"]
    assert len(images) == 5  # the measures, what is missing, the three worst pairs
    assert all(image.startswith("data:image/png;base64,") for image in images)
    assert len(text) < 10_000_000
    assert str(tmp_path) not in text
    for word in (
        "The twin beside an arbitrary site",
        "What to mend next",
        "Challenge protocol",
        "Density-aware Chamfer",
    ):
        assert word in text


def figures(**values):
    return dict.fromkeys(MEASURES) | values


def test_the_headline_in_one_sentence():
    twin = [figures(hausdorff_p95_m=2.0, js_mean=0.3), figures(hausdorff_p95_m=4.0, js_mean=0.3)]
    control = [figures(hausdorff_p95_m=12.0, js_mean=0.2)] * 2
    real = [figures(hausdorff_p95_m=1.5, js_mean=0.1), None]
    whole = anchored(twin, control, real)
    assert Report({}, [], whole, {}).in_short() == (
        "The twin beside an arbitrary site: its P95 Hausdorff distance is 75 % less (3 m against "
        "12 m) and its Jensen-Shannon divergence is 50 % more (0.3 against 0.2); 2 and 3 times "
        "that of one real frame beside the next."
    )
    alone = anchored(twin, [None, None], [None, None])
    assert Report({}, [], alone, {}).in_short() == (
        "The twin alone: its P95 Hausdorff distance is 3 m and Jensen-Shannon divergence is 0.3."
    )


def test_shares_of_real_against_real_all_lie_on_the_axis():
    """Without an arbitrary site; a measure that is 0 has no place on a logarithmic axis."""
    twin = [figures(hausdorff_p95_m=0.0, js_mean=0.3, chamfer_m=0.02)] * 2
    real = [figures(hausdorff_p95_m=1.5, js_mean=0.1, chamfer_m=0.1), None]
    for rows in (twin, [figures(hausdorff_p95_m=0.0, js_mean=0.0, chamfer_m=0.0)] * 2):
        axes = Figure().subplots()
        draw_shares(axes, Report({}, [], anchored(rows, [None, None], real), {}))
        left, right = axes.get_xlim()
        drawn = [line.get_xdata()[0] for line in axes.lines if len(line.get_xdata()) == 1]
        assert len(drawn) == 3
        assert left < 100 < right
        assert all(left <= x <= right for x in drawn)
        marks = {line.get_marker() for line in axes.lines if line.get_xdata()[0] == left}
        assert marks == {"<"}
