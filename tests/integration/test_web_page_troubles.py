"""What the page says, in a real browser, while something is not recorded or not delivered."""

from __future__ import annotations

from pathlib import Path

from integration.browser import Browser
from integration.counting import CountingLine, counting, stop
from integration.gateways import Client
from integration.mosquitto import broker
from integration.processes import running
from integration.test_campaigns_full import small

TABLES = """
[http]
listen = "127.0.0.1:0"
[history]
[mqtt]
host = "127.0.0.1"
port = {port}
outbox = "mqtt-outbox.db"
"""


def test_a_broker_that_is_away_and_a_disk_that_is_full_stand_at_the_top(
    tmp_path: Path, window: Browser
) -> None:
    """In words, with since when, and how long there is room; nothing of it once all is well again."""
    line = CountingLine("press")
    with small(tmp_path) as disk, counting(line), broker(tmp_path) as mosquitto:
        file = disk.folder / "multidrop.toml"
        file.write_text(line.toml + TABLES.format(port=mosquitto.port))
        with running("run", cwd=disk.folder) as program:
            page = window
            url = program.wait_for("http://")
            program.prints("mqtt: connected")
            line.wait_for_more(20)
            page.open(url)
            page.until(lambda: "of 1 devices are well" in page.text(".head"))
            page.until(
                lambda: "states wait for the MQTT broker, which may be" in page.text(".room")
            )
            assert not page.all(".troubles .note")

            mosquitto.kill()
            page.until(lambda: "MQTT broker 127.0.0.1:" in page.text(".troubles .note.warn"))
            page.until(lambda: "states wait on the disk" in page.text(".troubles .note.warn"))
            page.until(lambda: "There is room for" in page.text(".troubles .note.warn"))
            assert "Since " in page.text(".troubles .note.warn")
            assert page.text(".room") == ""

            disk.fill(program)
            page.until(lambda: len(page.all(".troubles .note.bad")) == 2)
            said = page.text(".troubles")
            assert "History is not recorded: database or disk is full." in said
            assert "What waits for the MQTT broker cannot be put on the disk" in said
            assert "wait in memory" in said

            disk.empty(program)
            mosquitto.start()
            page.until(lambda: not page.all(".troubles .note"))
            page.narrow()
            assert page.run("return document.documentElement.scrollWidth <= innerWidth")
            assert [text for text in page.complaints() if "favicon" not in text] == []
            assert Client(url.strip()).get("/health").json["status"] == "ok"
            stop(program)
