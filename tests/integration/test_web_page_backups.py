"""Backups in a real browser: made, compared, saved, stopped; by keyboard, on a phone, in print, damaged, away."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from selenium.webdriver.common.keys import Keys

from integration.browser import Browser
from integration.processes import running
from integration.test_web_passports import IMPATIENT, PLANT, POINTS, SLOW, Site, site_in

VIEW = "#/device/axis"


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("page")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MULTIDROP_AUDIT", str(folder / "audit.jsonl"))
        with site_in(folder) as started:
            yield started


def look_at(window: Browser, site: Site) -> None:
    """The axis, with a token that may write; there is no backup of it yet."""
    window.open(site.client.url)
    window.run("sessionStorage.clear(); localStorage.clear()")
    window.run("sessionStorage.setItem('multidrop token', arguments[0])", site.client.token)
    window.open(f"{site.client.url}{VIEW}")
    window.until(lambda: window.text("#link") == "live")
    window.until(lambda: "none of this device" in window.text(".backups"))


@pytest.fixture
def page(window: Browser, shared: Site) -> Iterator[Browser]:
    """The axis, with a token that may write and no backups; in the end the console must be empty."""
    shared.clear()
    window.usual()
    window.complaints()
    look_at(window, shared)
    yield window
    assert window.complaints() == []


def press(page: Browser, text: str) -> None:
    """Click the button that says so, once it can be."""
    script = """const found = [...document.querySelectorAll("main button")].find((one) =>
        one.textContent === arguments[0] && !one.disabled && one.offsetParent !== null);
        found?.click(); return Boolean(found)"""
    page.until(lambda: page.run(script, text), text)


def begin(page: Browser, site: Site) -> None:
    """A backup that is under way, and that takes its time."""
    site.answers_after(SLOW)
    press(page, "Make a backup")
    page.until(lambda: f"of {POINTS} points" in page.text(".reading"))
    page.until(lambda: page.run("return document.querySelector('progress').position > 0"))


def make(page: Browser, count: int = 1) -> None:
    press(page, "Make a backup")
    page.until(lambda: len(page.all(".passports tbody tr")) == count)


def cells(page: Browser, selector: str) -> list[list[str]]:
    script = """return [...document.querySelectorAll(arguments[0])].map((row) =>
        [...row.cells].map((cell) => cell.textContent))"""
    found: list[list[str]] = page.run(script, selector)
    return found


def test_a_backup_is_made(page: Browser, shared: Site) -> None:
    begin(page, shared)
    shared.answers_after(0.0)
    page.until(lambda: "Backup made" in page.text(".backups .note.good"))
    page.until(lambda: page.all(".passports tbody tr"))
    ((_, points, file, _),) = cells(page, ".passports tbody tr")
    assert (points, [file]) == (str(POINTS), os.listdir(shared.folder / "kept"))
    command = page.text(".restore code")
    assert command == f'multidrop restore "kept/{file}" "axis" --dry-run'


def test_what_was_changed_since(page: Browser, shared: Site) -> None:
    make(page)
    press(page, "Changes since")
    page.until(lambda: "Nothing differs" in page.text(".differences"))
    shared.write("kp", 6)
    shared.write("position_error_limit", 9000)
    try:
        press(page, "Changes since")
        page.until(lambda: "2 points differ" in page.text(".differences"))
        assert cells(page, ".changes tbody tr") == [
            ["0x011", "kp", "4", "6"],
            ["0x018", "position error limit", "8\u202f000counts", "9\u202f000counts"],
        ]
        make(page, 2)
        first = page.run(
            "return document.querySelectorAll('select[aria-label=After] option')[1].value"
        )
        page.run("document.querySelector('select[aria-label=After]').value = arguments[0]", first)
        press(page, "Show differences")
        page.until(lambda: "2 points differ" in page.text(".differences"))
    finally:
        shared.write("kp", 4)
        shared.write("position_error_limit", 8000)


def test_the_file_is_saved(page: Browser, shared: Site, tmp_path: Path) -> None:
    make(page)
    allowed = {"behavior": "allow", "downloadPath": str(tmp_path)}
    page.driver.execute_cdp_cmd("Browser.setDownloadBehavior", allowed)
    press(page, "Save")
    (name,) = os.listdir(shared.folder / "kept")
    page.until((tmp_path / name).exists)
    assert (tmp_path / name).read_bytes() == (shared.folder / "kept" / name).read_bytes()


def test_it_can_be_stopped(page: Browser, shared: Site) -> None:
    begin(page, shared)
    press(page, "Stop")
    page.until(lambda: "Stopped" in page.text(".backups .note.warn"))
    assert os.listdir(shared.folder / "kept") == []


def test_a_device_that_falls_silent(window: Browser, tmp_path: Path) -> None:
    with site_in(tmp_path, plant=IMPATIENT) as site:
        look_at(window, site)
        begin(window, site)
        device = site.line.devices.pop()
        window.until(lambda: "No backup was made" in window.text(".backups .note.bad"))
        window.until(lambda: "no reply" in window.text(".head .state"))
        site.line.devices.append(device)
        window.until(lambda: "answers" in window.text(".head .state"))


def test_what_somebody_else_begins_is_seen(page: Browser, shared: Site) -> None:
    shared.answers_after(SLOW)
    assert shared.post("/api/passports", "axis").status == 200
    page.until(lambda: "points" in page.text(".reading"))
    shared.answers_after(0.0)
    page.until(lambda: len(page.all(".passports tbody tr")) == 1)


def test_without_a_token_it_may_be_compared_and_not_made(page: Browser, shared: Site) -> None:
    shared.made()
    page.run("sessionStorage.clear()")
    page.open(f"{shared.client.url}{VIEW}")
    press(page, "Changes since")
    page.until(lambda: "Nothing differs" in page.text(".differences"))
    press(page, "Make a backup")
    page.until(lambda: "leaves a file" in page.text("dialog"))
    page.one("dialog").send_keys(Keys.ESCAPE)
    page.until(lambda: not page.all("dialog"))


def test_a_backup_that_was_damaged(page: Browser, shared: Site) -> None:
    name = shared.made()["name"]
    path = shared.folder / "kept" / name
    odd = "<img src=x onerror=alert(1)>"
    path.write_text(path.read_text("utf-8").replace('name = "kp"', f'name = "{odd}"', 1), "utf-8")
    page.open(f"{shared.client.url}{VIEW}")
    page.until(lambda: "damaged" in page.text(".passports .tag.bad"))
    assert "checksum" in page.text(".passports .meaning")
    assert not page.run(
        "return [...document.querySelectorAll('.passports button')].some((one) => one.textContent === 'Changes since')"
    )


def test_the_keyboard_is_enough(page: Browser, shared: Site) -> None:
    shared.made()
    page.open(f"{shared.client.url}{VIEW}")
    page.until(lambda: len(page.all(".passports tbody tr")) == 1)
    page.until(  # and the page has heard that it is over
        lambda: page.run(
            "return [...document.querySelectorAll('button')].some((one) => one.textContent === 'Make a backup' && !one.disabled)"
        )
    )
    page.run(
        "[...document.querySelectorAll('.head button')].find((one) => one.textContent === 'Backups').focus()"
    )
    page.driver.switch_to.active_element.send_keys(Keys.ENTER)
    assert page.run("return document.activeElement.textContent") == "Backups"
    for wanted in ("Make a backup", "Changes since"):
        page.driver.switch_to.active_element.send_keys(Keys.TAB)
        assert page.run("return document.activeElement.textContent") == wanted
    page.driver.switch_to.active_element.send_keys(Keys.ENTER)
    page.until(lambda: "Nothing differs" in page.text(".differences"))


def test_a_phone_has_room_for_it(page: Browser, shared: Site) -> None:
    shared.made()
    edited = {"name": "x" * 40, "role": "setting", "value": 123456789012.5, "type": "uint32"}
    (name,) = os.listdir(shared.folder / "kept")
    text = (shared.folder / "kept" / name).read_text("utf-8")
    inside = ", ".join(f"{key} = {json.dumps(value)}" for key, value in edited.items())
    from multidrop.passports.passport import Passport

    changed = text.replace("[points]\n", f'[points]\n"0x7FF" = {{ {inside}, raw = "1" }}\n')
    again = Passport.from_text(changed, "x", damaged=True).to_text()
    (shared.folder / "kept" / name).write_text(again, "utf-8")
    page.narrow()
    page.open(f"{shared.client.url}{VIEW}")
    press(page, "Changes since")
    page.until(lambda: page.all(".changes tbody tr"))
    assert page.run("return document.documentElement.scrollWidth <= innerWidth")
    for button in page.all(".passports button"):
        assert button.rect["height"] >= 44, "too small for a thumb"


def test_in_print_it_is_dark_on_white(page: Browser, shared: Site) -> None:
    shared.made()
    page.open(f"{shared.client.url}{VIEW}")
    page.until(lambda: page.all(".passports tbody tr"))
    dark = {"name": "prefers-color-scheme", "value": "dark"}
    emulate = "Emulation.setEmulatedMedia"
    page.driver.execute_cdp_cmd(emulate, {"media": "print", "features": [dark]})
    try:
        paper = "return getComputedStyle(document.body).backgroundColor"
        ink = "return getComputedStyle(document.querySelector('.passports td')).color"
        assert (page.run(paper), page.run(ink)) == ("rgb(255, 255, 255)", "rgb(0, 0, 0)")
        assert not page.run(
            "return [...document.querySelectorAll('main button')].some((one) => one.offsetParent)"
        )
    finally:
        page.driver.execute_cdp_cmd(emulate, {"media": "", "features": []})


def test_a_gateway_that_keeps_none(window: Browser, tmp_path: Path) -> None:
    with site_in(tmp_path, plant=PLANT.partition("[passports]")[0]) as site:
        window.open(f"{site.client.url}{VIEW}")
        window.until(lambda: "[passports] is not in the plant file" in window.text(".backups"))


def test_differences_stay_when_the_server_was_lost(window: Browser, tmp_path: Path) -> None:
    """A cable that was pulled and put back does not take away what somebody is reading."""
    with site_in(tmp_path) as site:
        site.made()
        window.open(f"{site.client.url}{VIEW}")
        press(window, "Changes since")
        window.until(lambda: "Nothing differs" in window.text(".differences"))
        site.program.process.send_signal(signal.SIGSTOP)
        try:
            window.until(lambda: "Server lost" in window.text("#lost"))
            assert window.run("return document.querySelector('.backups button.main').disabled")
        finally:
            site.program.process.send_signal(signal.SIGCONT)
        window.until(lambda: window.text("#link") == "live")
        assert "Nothing differs" in window.text(".differences")


def test_a_gateway_that_was_started_anew(window: Browser, tmp_path: Path) -> None:
    """It knows nothing of the backup that was under way: nobody waits for that for ever."""
    with site_in(tmp_path) as site:
        look_at(window, site)
        begin(window, site)
        site.program.end(signal.SIGKILL)
        file = site.folder / "multidrop.toml"
        text = file.read_text("utf-8")
        file.write_text(text.replace("127.0.0.1:0", f"127.0.0.1:{site.client.port}"), "utf-8")
        with running("run", str(file)) as program:
            program.wait_for("http://")
            window.until(lambda: "started anew" in window.text(".backups .note.bad"))
            window.until(
                lambda: (
                    not window.run("return document.querySelector('.backups button.main').disabled")
                )
            )


def test_state_and_fault_by_name(page: Browser) -> None:
    """What the protocol knows of them, as `multidrop status` says it."""
    page.until(lambda: "drive status" in page.text(".says"))
    assert "faults" in page.text(".says")
    press(page, "Ask again")
    page.until(lambda: "said" in page.text(".says"))
