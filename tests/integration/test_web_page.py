"""The page in a real browser: values move, a write is confirmed, an old value is called old."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from selenium.webdriver.common.keys import Keys

from integration.browser import Browser
from integration.gateways import PLANT, RunningGateway, gateway

SPEED = '[data-point="infeed/speed"]'
FEED = '[data-point="infeed/feed"]'


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningGateway]:
    folder = tmp_path_factory.mktemp("page")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MULTIDROP_AUDIT", str(folder / "audit.jsonl"))
        with gateway(folder, '[history]\npath = "history.db"\n') as started:
            yield started


@pytest.fixture
def page(window: Browser, shared: RunningGateway) -> Iterator[Browser]:
    """The overview, with values; in the end the console must be empty."""
    window.usual()
    window.complaints()
    window.open(shared.client.url)
    window.run("sessionStorage.clear(); localStorage.clear()")
    window.until(lambda: "rpm" in window.text(SPEED))
    yield window
    assert window.complaints() == []


def number(window: Browser, row: str) -> str:
    return window.text(f"{row} .number")


def classes(window: Browser, row: str) -> list[str]:
    """In one go: the page is drawn anew when its server is back."""
    script = "return [...(document.querySelector(arguments[0])?.classList ?? ['is-old'])]"
    found: list[str] = window.run(script, row)
    return found


def test_values_move(page: Browser, shared: RunningGateway) -> None:
    for value in (12.5, 13):
        assert shared.client.write("infeed", "feed", value).status == 200
        page.until(lambda value=value: number(page, FEED) == f"{value:g}")  # type: ignore[misc]
    assert page.text("#link") == "live"
    assert "answers" in page.text(".device .state")
    assert "full" in page.text(".fill")


def test_a_device_and_its_points(page: Browser, shared: RunningGateway) -> None:
    page.one('a.device[href="#/device/infeed"]').click()
    page.until(lambda: page.text("h1") == "infeed")
    page.until(lambda: number(page, SPEED) == "0")
    assert "how fast it feeds" in page.text(FEED)
    assert page.all(f"{FEED} .write-it")
    assert not page.all(f"{SPEED} .write-it")
    page.one(f"{SPEED} button").click()
    page.until(lambda: "✓" in page.text(f"{SPEED} button"))


def give_token(page: Browser, token: str) -> None:
    page.one('dialog input[type="password"]').send_keys(token, Keys.ENTER)


def test_a_write_is_confirmed(page: Browser, shared: RunningGateway) -> None:
    assert shared.client.write("infeed", "feed", 20).status == 200
    page.open(f"{shared.client.url}#/device/infeed")
    page.until(lambda: number(page, FEED) == "20")
    page.one(f"{FEED} .write-it").click()
    give_token(page, "wrong")
    page.until(lambda: "not known" in page.text("dialog .note"))
    page.run("document.querySelector('dialog input').value = ''")
    give_token(page, str(shared.client.token))
    field = page.one('dialog input[name="value"]')
    field.send_keys("999", Keys.ENTER)
    page.until(lambda: "0 to 150" in page.text("dialog .note"))
    field.clear()
    field.send_keys("42.5", Keys.ENTER)
    page.until(lambda: page.text("dialog button.main") == "Write 42.5 m/min")
    old, new = (shown.text for shown in page.all("dialog .change strong .number"))
    assert (old, new) == ("20", "42.5")
    assert shared.client.get("/api/values/infeed/feed").json["value"] == 20, "nothing was written"
    page.one("dialog button.main").send_keys(Keys.ENTER)
    page.until(lambda: "read back" in page.text("dialog .note"))
    page.until(lambda: number(page, FEED) == "42.5")
    page.run("document.querySelector('dialog').close()")
    # the browser says that a request was answered with 401: the wrong token
    assert all("401" in text for text in page.complaints())


def test_a_command_says_that_it_may_move_something(page: Browser, shared: RunningGateway) -> None:
    page.run("sessionStorage.setItem('multidrop token', arguments[0])", shared.client.token)
    page.open(f"{shared.client.url}#/device/infeed")
    page.one('[data-point="infeed/control"] .write-it').click()
    page.until(lambda: "may move" in page.text("dialog .note.warn"))
    page.one("dialog").send_keys(Keys.ESCAPE)
    page.until(lambda: not page.all("dialog"))


@pytest.mark.parametrize(
    "view", ["#/", "#/device/infeed", "#/trends?p=infeed/speed", "#/wire/press"]
)
def test_a_phone_has_room_for_it(page: Browser, shared: RunningGateway, view: str) -> None:
    page.narrow()
    page.open(f"{shared.client.url}{view}")
    page.until(lambda: page.text("h1"))
    page.until(lambda: page.text("#link") == "live")
    assert page.run("return document.documentElement.scrollWidth <= innerWidth")
    for link in page.all("nav a"):
        assert link.rect["height"] >= 44, "too small for a thumb"
        assert link.rect["y"] > 600


def test_trends_begin_with_the_points_of_a_device(page: Browser, shared: RunningGateway) -> None:
    page.open(f"{shared.client.url}#/trends")
    page.until(lambda: page.text(".empty button") == "infeed")
    page.one(".empty button").click()
    page.until(lambda: "infeed speed" in page.text(".picker"))
    assert not page.all(".empty")


def test_trends_draw_what_came(page: Browser, shared: RunningGateway) -> None:
    page.open(f"{shared.client.url}#/trends?p=infeed/speed&p=infeed/feed&span=300")
    page.until(lambda: len(page.all(".uplot canvas")) == 2, "a chart for each unit")
    page.until(lambda: page.all(".chip"))
    page.one(".chip button").click()
    page.until(lambda: len(page.all(".chip")) == 1)
    page.until(lambda: len(page.all(".uplot canvas")) == 1)
    field = page.one('input[type="search"]')
    field.send_keys("press/speed", Keys.ENTER)
    page.until(lambda: len(page.all(".chip")) == 2)


def test_frames_are_decoded_live(page: Browser, shared: RunningGateway) -> None:
    page.open(f"{shared.client.url}#/wire/press")
    page.until(lambda: "read speed" in page.text(".frames tbody"))
    page.until(lambda: len(page.all(".frames tbody tr")) > 5)
    assert "rpm" in page.text(".frames tbody")


def test_dark_and_light(page: Browser, shared: RunningGateway) -> None:
    def paper() -> str:
        return str(page.run("return getComputedStyle(document.body).backgroundColor"))

    page.scheme("light")
    light = paper()
    page.scheme("dark")
    assert paper() != light
    for wanted, ground in (("dark", None), ("light", light), ("auto", None)):
        page.one("#theme").click()
        assert page.text("#theme") == wanted
        assert ground is None or paper() == ground
    page.scheme("light")


def test_the_keyboard_is_enough(page: Browser, shared: RunningGateway) -> None:
    page.run("document.querySelector('a.device').focus()")
    page.driver.switch_to.active_element.send_keys(Keys.ENTER)
    page.until(lambda: page.text("h1") == "infeed")
    assert page.run("return document.activeElement.id") == "view"
    page.driver.switch_to.active_element.send_keys(Keys.TAB)
    assert page.run("return document.activeElement.matches('#view a')")


def test_charts_in_print_are_dark_on_white(page: Browser, shared: RunningGateway) -> None:
    """They are drawn anew, as wide as a page, at once: a printer does not wait. And it says of when they are."""
    page.scheme("dark")
    page.open(f"{shared.client.url}#/trends?p=infeed/speed&span=300")
    page.until(lambda: page.all(".uplot canvas"))
    drawn = """const canvas = document.querySelector(".uplot canvas");
        const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d", { willReadFrequently: true });
        copy.drawImage(canvas, 0, 0);
        const { data } = copy.getImageData(0, 0, canvas.width, canvas.height);
        const of = (...shade) => {
          for (let at = 0; at < data.length; at += 4)
            if (shade.every((part, place) => data[at + place] === part)) return true;
          return false;
        };
        return [of(0x5f, 0xcd, 0xb6), of(0x0a, 0x6c, 0x60), canvas.clientWidth]"""
    try:
        page.until(lambda: page.run(drawn)[:2] == [True, False], "the curve for the dark")
        at_once = f"""const [done] = arguments; dispatchEvent(new Event("beforeprint"));
            let before = Promise.resolve(); // what waits in the same turn is drawn, nothing of the server
            for (let hop = 0; hop < 50; hop += 1) before = before.then(() => {{}});
            before.then(() => done((() => {{ {drawn} }})()))"""
        dark, light, width = page.driver.execute_async_script(at_once)
        assert (dark, light, width <= 680) == (False, True, True)
        assert f"127.0.0.1:{shared.client.port}, " in page.text("#printed")
        page.run("dispatchEvent(new Event('afterprint'))")
        page.until(lambda: page.run(drawn)[:2] == [True, False])
    finally:
        page.scheme("light")


def test_names_from_the_plant_are_text(window: Browser, tmp_path: Path) -> None:
    """A meaning that looks like markup is shown as it is."""
    odd = "<img src=x onerror=alert(1)>"
    with gateway(tmp_path, plant=PLANT.replace("how fast it feeds", odd)) as started:
        window.open(f"{started.client.url}#/device/infeed")
        window.until(lambda: odd in window.text(FEED))
        assert not window.all("main img")


def test_a_server_that_is_lost(window: Browser, tmp_path: Path) -> None:
    """It says so, calls every value old, and comes back by itself when the server does."""
    with gateway(tmp_path) as started:
        window.open(started.client.url)
        window.until(lambda: "rpm" in window.text(SPEED))
        started.program.process.send_signal(signal.SIGSTOP)  # a cable that was pulled
        try:
            window.until(lambda: "Server lost" in window.text("#lost"))
            assert window.text("#link") == "server lost"
            window.until(lambda: "is-old" in classes(window, SPEED))
        finally:
            started.program.process.send_signal(signal.SIGCONT)
        window.until(lambda: window.text("#link") == "live")
        window.until(lambda: "is-old" not in classes(window, SPEED))
        started.program.end(signal.SIGTERM)
        window.until(lambda: "Server lost" in window.text("#lost"))


def test_a_device_that_is_lost(window: Browser, tmp_path: Path) -> None:
    """Its card says no reply; the value that it had is struck out and old."""
    nobody = PLANT.replace("address = 1", "address = 9")
    with gateway(tmp_path, plant=nobody) as started:
        window.open(started.client.url)
        card = 'a.device[href="#/device/press"]'
        window.until(lambda: "no reply" in window.text(f"{card} .state"))
        window.until(lambda: "1 of 2 devices are well" in window.text("main .head"))
        window.until(lambda: "no reply" in window.text("section.line > header"))
