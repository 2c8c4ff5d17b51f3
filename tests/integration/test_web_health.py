"""`/health` and `troubles`: what is said of parts that cannot do their work."""

from __future__ import annotations

from pathlib import Path

from integration.counting import CountingLine, counting, stop, wait_until
from integration.gateways import Client
from integration.processes import running

AWAY = """
[http]
listen = "127.0.0.1:0"
[history]
dsn = "postgresql://nobody@127.0.0.1:1/nowhere"
[mqtt]
host = "127.0.0.1"
port = 1
"""


def test_what_waits_is_degraded_and_a_line_that_is_lost_too(tmp_path: Path) -> None:
    """No restart would mend it, so the status stays 200; who may not read is told no error."""
    line = CountingLine("press")
    with counting(line):
        (tmp_path / "multidrop.toml").write_text(line.toml + AWAY)
        with running("run", cwd=tmp_path) as program:
            client = Client(program.wait_for("http://").strip())
            waiting = {"history": "waiting", "mqtt": "waiting"}
            wait_until(lambda: client.get("/health").json["parts"] == waiting)
            health = client.get("/health")
            assert (health.status, health.json["status"]) == (200, "degraded")
            troubles = client.get("/api/status").json["troubles"]
            assert [one["part"] for one in troubles] == ["history", "mqtt"]
            assert "does not take the history: " in troubles[0]["text"]
            assert "samples wait on the disk." in troubles[0]["text"]
            assert "Only the newest state of each point waits for it." in troubles[1]["text"]
            assert not any(one["losing"] for one in troubles)
            since = [one["since"] for one in troubles]
            line.wait_for_more(20)
            again = client.get("/api/status").json["troubles"]
            assert [
                one["since"] for one in again
            ] == since  # since it began, not since it was asked
            stop(program)


def test_a_line_that_is_lost_is_degraded(tmp_path: Path) -> None:
    line = CountingLine("press")
    with counting(line):
        text = line.toml.replace(line.port, "tcp://127.0.0.1:1")
        (tmp_path / "multidrop.toml").write_text(text + '[http]\nlisten = "127.0.0.1:0"\n')
        with running("run", cwd=tmp_path) as program:
            client = Client(program.wait_for("http://").strip())
            wait_until(lambda: client.get("/health").json["lines_lost"] == 1)
            health = client.get("/health")
            assert health.status == 200
            assert health.json == {"status": "degraded", "lines_lost": 1, "parts": {}}
            stop(program)
