"""Takes the pictures of the page: starts `multidrop demo` and drives a browser over it.

python docs/pictures/page.py    writes docs/pictures/page-*.png, after two minutes; needs `make chromium`
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from pathlib import Path

from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

FOLDER = Path(__file__).parent
WIDE, NARROW = (1280, 800, 1.0), (390, 780, 1.5)
UNTIL_A_TRIP = 100  # s: two trips, and trends that show something


def started() -> tuple[subprocess.Popen[str], str, str]:
    """The demo; its address and its token."""
    command = [str(Path(sys.executable).with_name("multidrop")), "demo"]
    demo = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    token = ""
    assert demo.stdout is not None
    for line in demo.stdout:
        if line.startswith("token for writing: "):
            token = line.split(": ")[1].strip()
        if re.match(r"http://", line):
            return demo, line.strip(), token
    raise SystemExit("the demo did not start")


class Camera:
    def __init__(self, url: str) -> None:
        options = webdriver.ChromeOptions()
        for argument in ("--headless=new", "--no-sandbox", "--hide-scrollbars", "--disable-gpu"):
            options.add_argument(argument)
        self.driver = webdriver.Chrome(options=options, service=Service("/usr/bin/chromedriver"))
        self._url = url

    def look(self, view: str, scheme: str, size: tuple[int, int, float] = WIDE) -> None:
        width, height, scale = size
        metrics = {"width": width, "height": height, "deviceScaleFactor": scale, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        feature = {"name": "prefers-color-scheme", "value": scheme}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})
        self.driver.get("about:blank")
        self.driver.get(self._url + view)
        time.sleep(4)

    def click(self, text: str) -> None:
        """The button that says so."""
        find = "[...document.querySelectorAll('main button')].find((one) => one.textContent === arguments[0])"
        self.driver.execute_script(f"{find}.click()", text)

    def wait_for(self, text: str, script: str) -> None:
        WebDriverWait(self.driver, 60).until(lambda found: text in found.execute_script(script))

    def keep(self, name: str) -> None:
        self.driver.save_screenshot(str(FOLDER / f"page-{name}.png"))
        print(f"page-{name}.png")


def backups(camera: Camera, token: str) -> None:
    """A backup, one point that was changed since, and the list of both."""
    camera.look("#/device/axis", "light")
    camera.click("Make a backup")
    camera.wait_for("1", "return String(document.querySelectorAll('.passports tbody tr').length)")
    write = """fetch("/api/write", {method: "POST", body: arguments[0], headers:
        {"Content-Type": "application/json", Authorization: `Bearer ${arguments[1]}`}})"""
    body = json.dumps({"device": "axis", "point": "kp", "value": 9})
    camera.driver.execute_script(write, body, token)
    time.sleep(1)
    camera.click("Changes since")
    camera.wait_for("1 point", "return document.querySelector('.differences').textContent")
    camera.click("Backups")
    time.sleep(1)
    camera.keep("backups")


def main() -> None:
    demo, url, token = started()
    camera = Camera(url)
    try:
        time.sleep(UNTIL_A_TRIP)
        camera.look("#/", "dark")
        camera.keep("plant")
        camera.look("#/device/winder", "light")
        camera.keep("device")
        points = "p=infeed/actual_speed&p=winder/actual_speed&p=vessel/level&p=vessel/valve"
        camera.look(f"#/trends?{points}&span=300", "dark")
        camera.keep("trends")
        camera.look("#/wire/axis", "dark")
        camera.keep("wire")
        camera.look("#/", "light", NARROW)
        camera.keep("phone")
        camera.look("#/faults", "light")
        camera.driver.find_element(By.CSS_SELECTOR, "td a").click()
        time.sleep(1)
        camera.keep("fault")
        camera.look("#/device/press", "light")
        keep = "sessionStorage.setItem('multidrop token', arguments[0])"
        camera.driver.execute_script(keep, token)
        camera.driver.find_element(By.CSS_SELECTOR, ".write-it").click()
        time.sleep(1)
        field = camera.driver.find_element(By.CSS_SELECTOR, "dialog input")
        field.send_keys("900", Keys.ENTER)
        time.sleep(0.5)
        camera.keep("write")
        backups(camera, token)
    finally:
        camera.driver.quit()
        demo.terminate()
        demo.wait()


if __name__ == "__main__":
    main()
