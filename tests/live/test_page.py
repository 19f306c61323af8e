"""The page in a real browser, as somebody sees and touches it."""

from __future__ import annotations

import io
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from .conftest import Address

CHROMIUM = Path("/usr/bin/chromium")
PATIENCE = 120.0
"""[s] that something may take on a busy machine."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="no playwright: pip install playwright")
    if not CHROMIUM.exists():
        pytest.skip(f"no browser at {CHROMIUM}")
    options = ["--no-sandbox", "--enable-unsafe-swiftshader"]
    with playwright.sync_playwright() as tool:
        opened = tool.chromium.launch(executable_path=str(CHROMIUM), args=options)
        yield opened
        opened.close()


class Tab:
    """A page with what it complained of."""

    def __init__(self, browser: Any, url: str) -> None:
        self.page, self.complaints = browser.new_page(viewport={"width": 1100, "height": 700}), []
        self.page.set_default_timeout(1e3 * PATIENCE)
        self.page.on("console", lambda said: self.complaints.append(said.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto(url)
        self.until("live.frames > 0")

    def now(self, text: str) -> Any:
        return self.page.evaluate(text)

    def until(self, text: str, *, pressing: Tab | None = None) -> None:
        """Wait until it is true; press the dead-man of a tab again where a slow machine let it lapse."""
        end = time.monotonic() + PATIENCE
        while not self.now(text):
            assert time.monotonic() < end, (text, self.page.inner_text("header"), self.complaints)
            if pressing is not None and not pressing.now("live.inputs.enable"):
                pressing.page.dispatch_event("#deadman", "click")  # without the mouse, which may be dragging
            self.page.wait_for_timeout(20)

    def hand(self) -> Any:
        return np.array(self.now("live.frame.handles.hand"))

    def at(self, handle: str) -> tuple[float, float]:
        """[px] where one of the handles is."""
        box = self.page.locator("#scene").bounding_box()
        x, y = self.now(f"live.screen(live.frame.handles.{handle}).slice(0, 2)")
        return box["x"] + x, box["y"] + y

    def close(self) -> None:
        self.page.close()
        assert self.complaints == []


@pytest.fixture
def tab(browser: Any, address: Address) -> Iterator[Tab]:
    opened = Tab(browser, address.page)
    yield opened
    opened.close()


def drag(tab: Tab, handle: str, right: float, down: float) -> None:
    x, y = tab.at(handle)
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    tab.page.mouse.move(x + right, y + down, steps=4)


def test_a_robot_is_in_the_picture_and_it_moves_only_while_the_dead_man_is_held(tab: Tab) -> None:
    from PIL import Image  # noqa: PLC0415  (matplotlib brings it)

    tab.until("document.getElementById('status').textContent === 'holding'")
    assert "dead man" in tab.page.inner_text("#reason")
    start = tab.hand()
    picture = np.asarray(Image.open(io.BytesIO(tab.page.locator("#scene").screenshot())).convert("RGB"), dtype=int)
    grey = (np.ptp(picture, axis=2) < 30) & (picture.mean(axis=2) < 215)  # of the robot; the floor is lighter
    assert 0.02 < grey.mean() < 0.5
    tab.page.click("#deadman")
    moved = f"Math.hypot(...live.frame.handles.hand.map((v, i) => v - {start.tolist()}[i])) > 0.005"
    enabled = "live.inputs.enable && document.getElementById('status').textContent === 'ok'"  # no lapse is under way
    tab.until(f"{enabled} && {moved} && document.getElementById('status').className === 'ok'", pressing=tab)
    tab.page.keyboard.press("Escape")
    tab.until("document.getElementById('status').textContent === 'holding'")
    rest = tab.hand()
    frames = tab.now("live.frames")
    tab.until(f"live.frames > {frames + 5}")
    assert np.array_equal(tab.hand(), rest)


@pytest.mark.nightly
def test_the_hand_follows_a_target_that_is_dragged_and_a_push_has_an_arrow(tab: Tab) -> None:
    start = tab.hand()
    drag(tab, "target", 50, -60)
    tab.page.mouse.up()
    target = np.array(tab.now("live.inputs.target"))
    assert np.linalg.norm(target - start) > 0.03
    tab.until(f"Math.hypot(...live.frame.handles.hand.map((v, i) => v - {target.tolist()}[i])) < 0.003", pressing=tab)
    tab.page.click("#dragpush")
    drag(tab, "hand", 80, 0)
    tab.until("live.frame.arrows.length === 1 && Math.hypot(...live.frame.arrows[0].slice(3, 6)) > 1", pressing=tab)
    tab.page.mouse.up()
    tab.until("live.frame.arrows.length === 0")


def test_a_page_that_hangs_or_is_hidden_has_let_go(tab: Tab) -> None:
    tab.until("document.getElementById('status').textContent === 'ok'", pressing=tab)
    tab.now("(() => { const end = performance.now() + 600; while (performance.now() < end); })()")
    tab.until("!live.inputs.enable")
    assert "silent for" in tab.page.inner_text("#why")
    tab.until("document.getElementById('status').textContent === 'ok'", pressing=tab)
    tab.now(
        "(() => { Object.defineProperty(document, 'hidden', { value: true, configurable: true });"
        " document.dispatchEvent(new Event('visibilitychange')); })()"
    )
    assert not tab.now("live.inputs.enable")
    tab.until("['braking', 'holding'].includes(document.getElementById('status').textContent)")
    assert "hidden" in tab.page.inner_text("#why")


def test_one_tab_commands_and_the_other_watches_until_it_takes_over(browser: Any, address: Address, tab: Tab) -> None:
    other = Tab(browser, address.page)
    other.until("document.getElementById('seattext').textContent.startsWith('this tab watches · 2 tabs')")
    assert other.page.is_disabled("#deadman")
    tab.until("document.getElementById('status').textContent === 'ok'", pressing=tab)
    other.until("document.getElementById('status').textContent === 'ok'", pressing=tab)
    other.page.click("#take")
    tab.until("document.getElementById('seattext').textContent.startsWith('this tab watches')")
    assert not tab.now("live.inputs.enable")
    other.until("document.getElementById('status').textContent === 'ok'", pressing=other)
    other.close()
    tab.until("document.getElementById('status').textContent === 'holding'")


def test_the_participant_sees_a_target_a_hand_and_nothing_else(browser: Any, address: Address, tab: Tab) -> None:
    """On a telephone, too."""
    theirs = Tab(browser, address.participant)
    theirs.page.set_viewport_size({"width": 600, "height": 700})
    tab.until("document.getElementById('seattext').textContent.includes('1 for the participant')")
    for hidden in ("header", "aside", "#legend"):
        assert not theirs.page.is_visible(hidden)
    assert not theirs.page.is_checked("#sound")
    for colours in (("#2f6f9f", "#3fae7a"), ("#f2c14e",)):  # of the target, as it is far or reached, and of the hand
        end = time.monotonic() + PATIENCE
        while not any(shows(theirs, each) for each in colours):
            assert time.monotonic() < end, colours
    theirs.close()


def shows(tab: Tab, colour: str) -> bool:
    """Whether the whole window has 100 pixels of it."""
    from PIL import Image  # noqa: PLC0415  (matplotlib brings it)

    picture = np.asarray(Image.open(io.BytesIO(tab.page.screenshot())).convert("RGB"))
    return bool((picture == list(bytes.fromhex(colour[1:]))).all(axis=2).sum() > 100)


@pytest.mark.parametrize("elsewhere", ["dispatchEvent(new Event('blur'))", "document.getElementById('frozen').focus()"])
def test_a_space_bar_holds_nothing_once_the_keyboard_is_another_window_s_or_a_list_s(tab: Tab, elsewhere: str) -> None:
    """That is told of its release, the page is not."""
    assert tab.now(f"""(() => {{
        dispatchEvent(new KeyboardEvent('keydown', {{code: 'Space'}}));
        const held = live.inputs.enable;
        {elsewhere};
        return [held, live.inputs.enable];
    }})()""") == [True, False]
    assert "elsewhere" in tab.page.inner_text("#why")


def test_escape_releases_wherever_the_keyboard_is(tab: Tab) -> None:
    for place in ("scene", "noise", "frozen"):
        assert tab.now(f"""(() => {{
            document.getElementById('deadman').click();
            const held = live.inputs.enable, place = document.getElementById('{place}');
            place.focus();
            place.dispatchEvent(new KeyboardEvent('keydown', {{code: 'Escape', bubbles: true}}));
            return [held, live.inputs.enable];
        }})()""") == [True, False]
