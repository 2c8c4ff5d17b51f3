"""Requests that are made up from the OpenAPI document: whatever comes, the answer is one it describes."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from integration.gateways import gateway

CHECKS = (
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_schema_conformance",
    "negative_data_rejection",
    "unsupported_method",
    "ignored_auth",
)
PARTS = '[faults]\npath = "faults"\n[history]\npath = "history.db"\n[passports]\nmost = 20\n'
SECONDS = "12"


def test_made_up_requests(tmp_path: Path, audit: Path) -> None:
    """Event streams are left out, since they do not end."""
    command = str(Path(sys.executable).with_name("schemathesis"))
    with gateway(tmp_path, PARTS) as started:
        client = started.client
        done = subprocess.run(
            [
                *(command, "run", f"{client.url}openapi.json", "--no-color", "--max-time", SECONDS),
                *("--checks", ",".join(CHECKS), "--phases", "examples,coverage,fuzzing"),
                *("--exclude-path-regex", "events|frames", "--generation-database", "none"),
                *("--header", f"Authorization: Bearer {client.token}"),
            ],
            capture_output=True,
            text=True,
            timeout=120,
            cwd=tmp_path,
            check=False,
        )
        assert done.returncode == 0, done.stdout[-6000:] + done.stderr
        assert "Tested: 21" in done.stdout, done.stdout[-2000:]
        assert client.get("/health").json["status"] == "ok"
        assert started.program.process.poll() is None
    records = [json.loads(line) for line in audit.read_text("utf-8").splitlines()]
    assert {record["outcome"] for record in records} <= {"not-sent", "confirmed"}
    assert any(record["outcome"] == "confirmed" for record in records), "no write was made up"
    for record in records:
        assert record["outcome"] == "not-sent" or 0 <= record["asked"] <= 150, record
