"""The page holds everything, and nothing of the data can break it."""

import re
from html.parser import HTMLParser

import numpy as np

from urbantwin.fidelity import compare


class Balanced(HTMLParser):
    """Counts tags, and refuses one that closes another."""

    def __init__(self):
        super().__init__()
        self.open, self.seen = [], []

    def handle_starttag(self, tag, attrs):
        self.seen.append((tag, dict(attrs)))
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


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
    page = Balanced()
    page.feed(text)
    assert not page.open
    assert "real &lt;i&gt;&amp;" in text
    assert not any(tag in ("b", "i", "script", "link") for tag, _ in page.seen)
    images = [attrs["src"] for tag, attrs in page.seen if tag == "img"]
    assert len(images) == 5  # the measures, what is missing, the three worst pairs
    assert all(image.startswith("data:image/png;base64,") for image in images)
    assert not re.search(r'(src|href)="(?!data:)', text)
    assert str(tmp_path) not in text
    for word in (
        "The twin beside an arbitrary site",
        "What to mend next",
        "Challenge protocol",
        "Density-aware Chamfer",
    ):
        assert word in text
    compare(real, twin, tmp_path / "again", arbitrary=real, protocol="urbantwin-challenge")
    assert (tmp_path / "again/report.html").read_text() == text
