"""The page in a real browser: Chromium, headless, by Playwright; drawn by the processor."""

import shutil
import time
from urllib.parse import urlsplit

import pytest

import urbantwin as ut

FLAGS = [
    "--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--no-first-run",
]  # fmt: skip


@pytest.fixture(scope="module")
def browser(built_page, chromium):
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        yield opened
        opened.close()


@pytest.fixture
def look_at(browser):
    """What opens an address and waits for its first picture; then nothing may have gone wrong."""
    opened = []

    def look(address, width=900, height=600):
        page = browser.new_page(viewport={"width": width, "height": height})
        wrong, asked = [], []
        page.on(
            "console",
            lambda said: wrong.append(said.text) if said.type in ("error", "warning") else None,
        )
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("requestfailed", lambda request: wrong.append(request.url))
        page.on("request", lambda request: asked.append(request.url))
        page.goto(address)
        page.evaluate("urbantwin.ready")
        opened.append((page, address, wrong, asked))
        return page

    yield look
    for page, address, wrong, asked in opened:
        assert page.evaluate("urbantwin.errors") == []
        assert wrong == []  # also what the content security policy forbids is said there
        own = urlsplit(address)
        for one in map(urlsplit, asked):
            assert one.scheme in ("data", "blob") or (one.scheme, one.netloc) == (
                own.scheme,
                own.netloc,
            )
        page.close()


def until(page, condition, seconds=90):
    """Wait until an expression is true; not by Playwright's own way, which the policy forbids."""
    end = time.monotonic() + seconds
    while not page.evaluate(condition):
        assert time.monotonic() < end, (condition, page.evaluate("urbantwin.state()"))
        time.sleep(0.05)


def test_a_served_dataset_plays_twenty_frames_and_selects_a_box(dataset, look_at):
    with ut.view(dataset, progress=False, browser=False) as shown:
        page = look_at(shown.address)
        state = page.evaluate("urbantwin.state()")
        assert state["points"][0] > 1000
        assert state["boxes"][0] >= 3
        page.evaluate("document.activeElement.blur()")
        page.keyboard.press("Space")
        until(page, "urbantwin.state().frames_shown > 20")
        page.keyboard.press("Space")
        memory = page.evaluate("urbantwin.memory()")
        assert memory["packets_bytes"] <= memory["packets_limit_bytes"]
        row = page.get_by_text("truck 4", exact=True).first
        row.click()
        until(page, "urbantwin.state().selected_box !== null", 20)
        chosen = page.evaluate("urbantwin.state().selected_box")
        assert (chosen["track"], chosen["class"]) == (4, "truck")


def test_a_saved_page_works_from_disk(dataset, look_at, tmp_path):
    made = ut.view(dataset, save=tmp_path / "a page.html", frames="0:3", progress=False)
    page = look_at(made.path.as_uri())
    assert page.evaluate("location.protocol") == "file:"
    first = page.evaluate("urbantwin.state()")
    assert first["points"][0] == made.document["sides"][0]["frames"][0]["points"]
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Space")
    until(page, "urbantwin.state().frames_shown > 3")


def test_another_page_of_the_browser_cannot_read_it(dataset, browser):
    with ut.view(dataset, frames="0:1", progress=False, browser=False) as shown:
        page = browser.new_page()
        page.goto("data:text/html,<title>a stranger</title>")
        said = page.evaluate(
            "address => fetch(address).then(a => a.text()).catch(error => 'refused')", shown.address
        )
        assert said == "refused"
        framed = page.evaluate(
            """address => new Promise(done => {
                 const script = document.createElement('script');
                 script.onload = () => done('ran');
                 script.onerror = () => done('refused');
                 script.src = address + 'page.js';
                 document.head.append(script);
               })""",
            shown.address,
        )
        assert framed == "refused"
        page.close()


def test_a_damaged_frame_is_said_and_the_rest_plays(dataset, look_at, tmp_path):
    folder = tmp_path / "dataset"
    shutil.copytree(dataset, folder, ignore=lambda *_: ["pictures"])
    damaged = folder / "points" / "000002.npy"
    damaged.write_bytes(damaged.read_bytes()[:-5])
    made = ut.view(folder, save=tmp_path / "page.html", frames="0:4", progress=False)
    page = look_at(made.path.as_uri())
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Space")
    until(page, "urbantwin.state().error?.includes('000002')")
    until(page, "urbantwin.state().step === 3 && urbantwin.state().error === null")
