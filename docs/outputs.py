"""Runs what the pages print, so that every output shown is what the program really says.

    python docs/outputs.py [PAGE...]            run the pages and write the output that came
    python docs/outputs.py --check [PAGE...]    exit 1 where a page shows something else

A page is run from top to bottom in an empty directory:

- ```console: a line that begins with `$ ` is a command for bash, what follows is its output;
- ```python: a program, and a ```text block right behind it is its output;
- ```toml that begins with `# NAME.toml`: a file of that name;
- <!-- simulate DEVICE... [OPTION]... -->: those devices listen on tcp://127.0.0.1:4001 from here on;
- <!-- interrupt after N s -->: Ctrl-C for each command of the next block.

Other blocks (```sh, ```py, ...) are not run. Times differ from run to run and are not compared.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PORT = "127.0.0.1:4001"  # as the pages print it; they are run on any free port
BLOCK = re.compile(
    r"<!-- (?P<mark>simulate|interrupt after) (?P<what>.*?) -->\n"
    r"|^```(?P<kind>console|python|toml)\n(?P<body>.*?)^```\n(?:\n```text\n(?P<shown>.*?)^```\n)?",
    re.DOTALL | re.MULTILINE,
)
VARIES = re.compile(
    r" *[+-]? *\d+\.\d+ ms|\"(?:answer_)?ms\": [\d.]+|\d+\.\d s:|\d{4}-\d\d-\d\d[T ][\d:.]+(?:Z|\+00:00)?"
    r"|about [\d.]+ (?:s|min \d+ s)|\"seconds\": [\d.]+|(?:discovered|since) \d{4}-\d\d-\d\d(?: \d\d:\d\d)?"
    r"|\d\d:\d\d:\d\d(?:\.\d+)?|\"who\": \"[^\"]*\"|/dev/pts/\d+"
)
BIN = Path(sys.executable).parent


class Page:
    """One page that is being run: its directory, its simulator, what to interrupt."""

    def __init__(self, path: Path, directory: Path) -> None:
        self.path = path
        self.directory = directory
        self.port = PORT
        self._simulator: subprocess.Popen[str] | None = None
        self._interrupt: float | None = None

    def run(self) -> str:
        """The page's text with the output that came."""
        text = self.path.read_text(encoding="utf-8")
        try:
            return BLOCK.sub(self._block, text)
        finally:
            self._end_simulator()

    def _block(self, found: re.Match[str]) -> str:
        if found["mark"] == "simulate":
            self._simulate(found["what"].split())
        elif found["mark"]:
            self._interrupt = float(found["what"].removesuffix("s"))
        elif found["kind"] == "toml":
            self._file(found["body"])
        elif found["kind"] == "console":
            body = _kept(found["body"], self._console(found["body"]))
            self._interrupt = None
            return f"```console\n{body}```\n"
        else:
            return self._python(found)
        return found[0]

    def _console(self, body: str) -> str:
        out = []
        for command in re.findall(r"^\$ (.*)$", body, re.MULTILINE):
            out += [f"$ {command}\n", self._said(["bash", "-c", self._here(command)])]
        return "".join(out)

    def _python(self, found: re.Match[str]) -> str:
        said = self._said([sys.executable, "-c", self._here(found["body"])])
        program = f"```python\n{found['body']}```\n"
        if "Traceback" in said or "SyntaxError" in said:
            raise SystemExit(f"{self.path}: a program fails:\n{said}")
        if found["shown"] is None:
            return program
        return f"{program}\n```text\n{_kept(found['shown'], said)}```\n"

    def _file(self, body: str) -> None:
        named = re.match(r"# (\S+\.toml)\n", body)
        if named:
            (self.directory / named[1]).write_text(self._here(body), encoding="utf-8")

    def _said(self, command: list[str]) -> str:
        environment = {
            **os.environ,
            "PATH": f"{BIN}:{os.environ['PATH']}",
            "MULTIDROP_AUDIT": str(self.directory / "audit.jsonl"),
            "LOGNAME": "operator",
            "COLUMNS": "100",
        }
        running = subprocess.Popen(
            command,
            cwd=self.directory,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            said, _ = running.communicate(timeout=self._interrupt or 60)
        except subprocess.TimeoutExpired:
            if self._interrupt is None:
                os.killpg(running.pid, signal.SIGKILL)
                raise SystemExit(f"{self.path}: {command[-1]} does not end") from None
            os.killpg(running.pid, signal.SIGINT)
            said, _ = running.communicate(timeout=10)
        lines = [line.rstrip() for line in said.replace(self.port, PORT).splitlines()]
        return "\n".join(lines).strip("\n") + "\n" if said.strip() else ""

    def _here(self, text: str) -> str:
        return text.replace(PORT, self.port)

    def _simulate(self, devices: list[str]) -> None:
        self._end_simulator()
        self._simulator = subprocess.Popen(
            [BIN / "multidrop", "simulate", *devices, "--listen", "tcp://127.0.0.1:0"],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._simulator.stdout is not None
        self.port = self._simulator.stdout.readline().strip().removeprefix("listening on tcp://")
        if not self.port:
            raise SystemExit(f"{self.path}: cannot simulate {' '.join(devices)}")

    def _end_simulator(self) -> None:
        if self._simulator is not None:
            self._simulator.terminate()
            self._simulator.communicate(timeout=10)
            self._simulator = None


def _kept(shown: str, said: str) -> str:
    """What was shown if only times differ, so that a run changes no page without need."""
    return shown if VARIES.sub("#", shown) == VARIES.sub("#", said) else said


def main(arguments: list[str]) -> int:
    """Write or check; returns the exit status."""
    check = "--check" in arguments
    named = [Path(text).resolve() for text in arguments if text != "--check"]
    pages = named or [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    status = 0
    for path in pages:
        with tempfile.TemporaryDirectory() as directory:
            text = Page(path, Path(directory)).run()
        if text == path.read_text(encoding="utf-8"):
            continue
        name = path.relative_to(ROOT)
        if check:
            print(f"{name} shows another output than comes: python docs/outputs.py {name}")
            status = 1
        else:
            path.write_text(text, encoding="utf-8")
            print(name)
    return status


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
