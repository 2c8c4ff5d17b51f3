"""The rules of the house, read from the source: floors, strangers, purity, names, sizes.

Each rule is a function from a module's name and source to what is wrong with it,
and each has been seen to find a violation (`VIOLATIONS`).
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import multidrop
from multidrop.protocols import PROTOCOLS

SRC = Path(multidrop.__file__).parent

GROUND = {
    "broadcasting",
    "checksums",
    "conversation",
    "decoder",
    "description",
    "device",
    "errors",
    "events",
    "exchange",
    "later",
    "naming",
    "numerals",
    "observer",
    "plant",
    "points",
    "probing",
    "profile",
    "relay",
    "serving",
    "sweeping",
    "session",
    "timing",
    "toml_values",
    "transaction",
    "unanswered",
    "writing",
}
FLOORS = {  # package or module below multidrop -> its floor; imports point down only
    **dict.fromkeys(GROUND, 0),
    "protocols": 1,
    "catalog": 2,
    "plantfile": 2,
    "profiles": 2,
    "io": 3,
    "sim": 4,
    "passports": 4,
    "tools": 5,
    "gateway": 5,
    "cli": 6,
    "": 7,  # the package itself, which shows people what they need of the others
    "__main__": 7,
}
PURE = GROUND | {"protocols"}
WORLD = {
    "asyncio",
    "logging",
    "os",
    "random",
    "select",
    "selectors",
    "serial",
    "serialx",
    "socket",
    "subprocess",
    "threading",
    "time",
}
"""What no pure floor imports: wires, clocks, chance and the operating system."""

MOST_LINES = 400
MOST_LINES_OF_A_FUNCTION = 60


def room(module: str) -> str:
    """The package or module right below multidrop that a module is in."""
    return module.split(".")[1] if "." in module else ""


def imports(module: str, source: str) -> Iterator[tuple[int, str]]:
    """Line and full name of everything that a module imports, wherever in it that stands."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, name.name) for name in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            for name in node.names:
                full = f"{node.module}.{name.name}"
                inside = node.module == "multidrop" and name.name in FLOORS
                yield node.lineno, full if inside else str(node.module)


def imports_point_down(module: str, source: str) -> list[str]:
    own = room(module)
    if own not in FLOORS:
        return [f"{module} stands on no floor: say in FLOORS which is its own"]
    wrong = []
    for line, name in imports(module, source):
        if name.split(".")[0] != "multidrop" or room(name) == own:
            continue
        below = room(name) in FLOORS and FLOORS[room(name)] < FLOORS[own]
        if not below and not {own, room(name)} <= GROUND:
            wrong.append(f"{module}:{line} imports {name}, which is not below it")
    return wrong


def protocols_are_strangers(module: str, source: str) -> list[str]:
    own = module.split(".")[:3]
    return [
        f"{module}:{line} imports another protocol, {name}"
        for line, name in imports(module, source)
        if room(module) == room(name) == "protocols"
        and len(own) == 3
        and name.count(".") > 1
        and name.split(".")[:3] != own
    ]


def pure_floors_know_no_world(module: str, source: str) -> list[str]:
    return [
        f"{module}:{line} imports {name}"
        for line, name in imports(module, source)
        if room(module) in PURE and name.split(".")[0] in WORLD
    ]


def imports_are_absolute(module: str, source: str) -> list[str]:
    return [
        f"{module}:{node.lineno} imports relatively"
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.ImportFrom) and node.level
    ]


def nobody_above_knows_a_protocol_by_name(module: str, source: str) -> list[str]:
    """Only a protocol itself and its simulation compare with its name or import it."""
    if room(module) in ("protocols", "sim", "profiles"):
        return []
    compared: list[ast.expr] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Compare):
            compared += [node.left, *node.comparators]
        elif isinstance(node, ast.MatchValue):
            compared.append(node.value)
    wrong = [
        f"{module}:{item.lineno} asks for {item.value!r}"
        for expression in compared
        for item in ast.walk(expression)
        if isinstance(item, ast.Constant) and item.value in set(PROTOCOLS)
    ]
    return wrong + [
        f"{module}:{line} imports {name}"
        for line, name in imports(module, source)
        if room(name) == "protocols" and name.count(".") > 1
    ]


def files_and_functions_are_short(module: str, source: str) -> list[str]:
    lines = len(source.splitlines())
    wrong = [f"{module} has {lines} lines"] if lines > MOST_LINES else []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            length = (node.end_lineno or node.lineno) - node.lineno + 1
            if length > MOST_LINES_OF_A_FUNCTION:
                wrong.append(f"{module}:{node.lineno} {node.name} has {length} lines")
    return wrong


def digits_are_0_to_9(module: str, source: str) -> list[str]:
    r"""`\d`, isdecimal and plain int options take the digits of every script: `multidrop.numerals` does not."""
    wrong = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            found = r"\d" in node.value
        elif isinstance(node, ast.Attribute):
            found = node.attr in ("isdecimal", "isnumeric", "IntRange", "FloatRange")
        elif isinstance(node, ast.keyword) and node.arg == "type":
            found = isinstance(node.value, ast.Name) and node.value.id in ("int", "float")
        else:
            continue
        if found and module != "multidrop.cli.numbers":
            wrong.append(f"{module}:{node.lineno} reads digits of every script")
    return wrong


Rule = Callable[[str, str], list[str]]

RULES: list[Rule] = [
    imports_point_down,
    protocols_are_strangers,
    pure_floors_know_no_world,
    imports_are_absolute,
    nobody_above_knows_a_protocol_by_name,
    files_and_functions_are_short,
    digits_are_0_to_9,
]

VIOLATIONS: list[tuple[Rule, str, str]] = [
    (imports_point_down, "multidrop.exchange", "from multidrop.protocols import slink3"),
    (imports_point_down, "multidrop.exchange", "from multidrop.io.line import Line"),
    (imports_point_down, "multidrop.exchange", "from multidrop import io"),
    (imports_point_down, "multidrop.exchange", "from multidrop import connect"),
    (imports_point_down, "multidrop.exchange", "def f():\n    import multidrop.cli.main"),
    (imports_point_down, "multidrop.protocols.slink3.frame", "import multidrop.io.line"),
    (imports_point_down, "multidrop.protocols.slink3.frame", "import multidrop.catalog"),
    (imports_point_down, "multidrop.io.line", "from multidrop.sim.line import SimulatedLine"),
    (imports_point_down, "multidrop.io.line", "from multidrop.cli import main"),
    (imports_point_down, "multidrop.sim.line", "from multidrop.tools.scan.scan import scan"),
    (imports_point_down, "multidrop.passports.drift", "from multidrop.tools.scan.scan import scan"),
    (imports_point_down, "multidrop.passports.drift", "from multidrop.sim.line import Line"),
    (
        imports_point_down,
        "multidrop.tools.scan.scan",
        "from multidrop.gateway.poller import Poller",
    ),
    (imports_point_down, "multidrop.gateway.web", "import multidrop.tools.scan.scan"),
    (imports_point_down, "multidrop.gateway.web", "from multidrop import cli"),
    (imports_point_down, "multidrop.cli.main", "from multidrop import connect"),
    (imports_point_down, "multidrop.helpers", ""),
    (imports_point_down, "multidrop.io.line", "import multidrop.helpers"),
    (
        protocols_are_strangers,
        "multidrop.protocols.datalink.frame",
        "from multidrop.protocols.slink3.frame import Frame",
    ),
    (
        protocols_are_strangers,
        "multidrop.protocols.datalink.frame",
        "if x:\n    import multidrop.protocols.ultra3000",
    ),
    (pure_floors_know_no_world, "multidrop.exchange", "import time"),
    (pure_floors_know_no_world, "multidrop.exchange", "import os.path"),
    (pure_floors_know_no_world, "multidrop.protocols.slink3.frame", "from asyncio import Lock"),
    (pure_floors_know_no_world, "multidrop.decoder", "def f():\n    from random import random"),
    (imports_are_absolute, "multidrop.exchange", "from . import decoder"),
    (imports_are_absolute, "multidrop.io.line", "from .ports import Port"),
    (nobody_above_knows_a_protocol_by_name, "multidrop.cli.main", "if p == 'slink3': pass"),
    (nobody_above_knows_a_protocol_by_name, "multidrop.io.line", "x = 'slink3' != p.name"),
    (nobody_above_knows_a_protocol_by_name, "multidrop.tools.scan.scan", "p in ('a', 'slink3')"),
    (nobody_above_knows_a_protocol_by_name, "multidrop.exchange", "p.name == 'slink3'"),
    (
        nobody_above_knows_a_protocol_by_name,
        "multidrop.gateway.web",
        "match p:\n    case 'slink3' | 'other':\n        pass",
    ),
    (
        nobody_above_knows_a_protocol_by_name,
        "multidrop.cli.main",
        "from multidrop.protocols.slink3 import Frame",
    ),
    (files_and_functions_are_short, "multidrop.exchange", "x = 1\n" * 401),
    (files_and_functions_are_short, "multidrop.exchange", "def f():\n" + "    x = 1\n" * 60),
    (files_and_functions_are_short, "multidrop.io.line", "async def f():\n" + "    x = 1\n" * 60),
    (digits_are_0_to_9, "multidrop.naming", r"re.fullmatch(r'[+-]?\d+', text)"),
    (digits_are_0_to_9, "multidrop.naming", r"re.compile(rf'\d{most}')"),
    (digits_are_0_to_9, "multidrop.io.captured", "text.isdecimal()"),
    (digits_are_0_to_9, "multidrop.cli.scan", "click.option('--baud', type=int)"),
    (digits_are_0_to_9, "multidrop.cli.scan", "click.option('--every', type=click.FloatRange(0))"),
]

ALLOWED: list[tuple[Rule, str, str]] = [
    (imports_point_down, "multidrop.exchange", "from multidrop import conversation as steps"),
    (imports_point_down, "multidrop.points", "from multidrop.profile import PointDescription"),
    (imports_point_down, "multidrop.protocols.slink3.frame", "import multidrop.decoder"),
    (imports_point_down, "multidrop.cli.main", "from multidrop.gateway.web.part import serve"),
    (imports_point_down, "multidrop.gateway.web", "from multidrop.passports.folder import x"),
    (imports_point_down, "multidrop", "from multidrop.io.connection import connect"),
    (imports_point_down, "multidrop.io.line", "import asyncio"),
    (protocols_are_strangers, "multidrop.protocols.slink3.device", "import multidrop.protocols"),
    (protocols_are_strangers, "multidrop.protocols", "import multidrop.protocols.slink3"),
    (protocols_are_strangers, "multidrop.sim.slink3", "import multidrop.protocols.datalink"),
    (pure_floors_know_no_world, "multidrop.io.line", "import time"),
    (pure_floors_know_no_world, "multidrop.exchange", "from multidrop import timing"),
    (nobody_above_knows_a_protocol_by_name, "multidrop.cli.main", "print('slink3')"),
    (nobody_above_knows_a_protocol_by_name, "multidrop.sim.plant", "p == 'slink3'"),
    (nobody_above_knows_a_protocol_by_name, "multidrop.cli.main", "import multidrop.protocols"),
    (files_and_functions_are_short, "multidrop.exchange", "x = 1\n" * 400),
    (files_and_functions_are_short, "multidrop.exchange", "def f():\n" + "    x = 1\n" * 59),
    (digits_are_0_to_9, "multidrop.naming", "re.fullmatch(r'[0-9]+', text) and text.isdigit()"),
    (digits_are_0_to_9, "multidrop.cli.scan", "click.option('--baud', type=Whole())"),
]


def modules() -> list[tuple[str, Path]]:
    found = []
    for path in sorted(SRC.rglob("*.py")):
        parts = ("multidrop", *path.relative_to(SRC).with_suffix("").parts)
        found.append((".".join(part for part in parts if part != "__init__"), path))
    return found


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
def test_rule(rule: Rule) -> None:
    wrong = [line for module, path in modules() for line in rule(module, path.read_text("utf-8"))]
    assert wrong == []


@pytest.mark.parametrize(("rule", "module", "source"), VIOLATIONS)
def test_the_rule_finds_a_violation(rule: Rule, module: str, source: str) -> None:
    assert len(rule(module, source)) == 1


@pytest.mark.parametrize(("rule", "module", "source"), ALLOWED)
def test_the_rule_lets_pass_what_is_allowed(rule: Rule, module: str, source: str) -> None:
    assert rule(module, source) == []


def test_every_rule_has_been_seen_to_fail() -> None:
    assert {rule for rule, _, _ in VIOLATIONS} == set(RULES)


def test_all_of_the_source_is_read() -> None:
    assert {"multidrop", "multidrop.exchange", "multidrop.protocols.slink3.frame"} <= dict(
        modules()
    ).keys()
