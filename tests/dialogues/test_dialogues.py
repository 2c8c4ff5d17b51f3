"""Every dialogue on `Exchange` alone, and the rules of the dialogues' own format."""

from __future__ import annotations

import re

import pytest

from dialogues import Dialogue, ExchangeStage, Played, load_dialogues, parse, play
from dialogues.text import HERE, BadDialogue


def on_exchange(played: Played) -> ExchangeStage:
    return ExchangeStage(played.settings, played.options)


@pytest.mark.parametrize("dialogue", load_dialogues(), ids=str)
def test_dialogue(dialogue: Dialogue) -> None:
    play(dialogue, on_exchange)


GOOD = """\
device: flexmax:1
== the status word
run: status_word
> 01 01 00 08 00 23 00 2A
~ 20
< 01 01 00 0A 01 00 00 37 02 3F
= word: 567
"""


def played_well(text: str) -> bool:
    for dialogue in parse(text, "slink3", "a.txt"):
        play(dialogue, on_exchange)
    return True


def test_a_dialogue_that_holds() -> None:
    assert played_well(GOOD)


def test_the_example_of_the_readme_holds() -> None:
    lines = (HERE / "README.md").read_text(encoding="utf-8").splitlines()
    example = "\n".join(line[4:] for line in lines if line.startswith("    ") or not line)
    assert "not-applied" in example
    assert played_well(example)


@pytest.mark.parametrize(
    ("wrong", "right", "message"),
    [
        ("00 23 00 2A", "00 2F 00 26", "a.txt:4: the master sent 01 01 00 08 00 23 00 2A"),
        ("word: 567", "word: 568", "a.txt:7: it is '567'"),
        ("word: 567", "words: 567", "a.txt:7: there is no 'words'"),
        ("= word: 567", "! NoReply", "a.txt:7: the conversation returned StatusWord"),
        ("run: status_word", "run: status_word\n~ 10", "a.txt:5: after 0.0 ms, not 10..60 ms"),
        ("= word", "~ 5\n= word", "the end: after 0.0 ms, not 5..55 ms"),
        ("= word", "~ 5\n< 00\n= word", "a.txt:8: the conversation ended before this"),
        ("~ 20\n", "~ 1600\n", "a.txt:6: the master sent 01 01 04 08 00 23 00 2E"),
        ("< 01 01 00 0A 01 00 00 37 02 3F\n", "", "the end: the master sent 01 01 04 08 00 23"),
    ],
)
def test_a_dialogue_that_does_not_hold_names_its_line(wrong: str, right: str, message: str) -> None:
    assert wrong in GOOD
    with pytest.raises(AssertionError, match=re.escape(message)):
        played_well(GOOD.replace(wrong, right))


def test_an_error_where_a_result_was_expected() -> None:
    text = GOOD.replace("== ", "options: attempts=1\n== ").replace("~ 20\n<", "~ 1500\n#")
    with pytest.raises(AssertionError, match=r"a\.txt:8: the conversation raised NoReply"):
        played_well(text)


def test_a_late_request_is_seen() -> None:
    again = GOOD.replace("~ 20\n", "~ 1400..1450\n> 01 01 04 08 00 23 00 2E\n")
    with pytest.raises(AssertionError, match=r"a\.txt:6: after 1520\.0 ms, not 1400\.\.1450 ms"):
        played_well(again)


def test_an_error_with_another_message() -> None:
    text = "device: flexmax:1\n== no such type\nrun: read 8236:int8\n! UsageError no such point\n"
    with pytest.raises(AssertionError, match=r"a\.txt:4: .*flexmax has no type int8"):
        played_well(text)


@pytest.mark.parametrize(
    ("wrong", "right", "message"),
    [
        ("device: flexmax:1\n", "", "needs a device: and a run:"),
        ("run: status_word\n", "", "is not device:, options: or point:"),
        ("device:", "devise:", "is not device:, options: or point:"),
        ("> 01 01", "> 01 0", "is not hex bytes"),
        ("> 01 01", "> 01 !01", "a master sends no parity errors"),
        ("< 01 01", "< 01 !0", "is not hex bytes"),
        ("~ 20", "~ soon", "is not a time in ms"),
        ("~ 20", "% 20", "begins with none of"),
        ("= word: 567\n", "", "the last run: has no = and no !"),
        ("= word: 567\n", "= word: 567\n~ 20\n", "the last run: has no = and no !"),
        ("= word: 567\n", "= word: 567\n~ 20\n> 01\n", "nothing runs here"),
        ("= word: 567\n", "run: reset\n= none\n", "the run: before this one has no = and no !"),
    ],
)
def test_text_that_is_no_dialogue(wrong: str, right: str, message: str) -> None:
    assert wrong in GOOD
    with pytest.raises(BadDialogue, match=re.escape(message)):
        played_well(GOOD.replace(wrong, right))


def test_a_parity_error_spoils_a_frame() -> None:
    spoilt = GOOD.replace("device:", "options: attempts=1\ndevice:").replace("< 01 01", "< 01 !01")
    spoilt = spoilt.replace("= word", "~ 1400..1600\n= word")
    with pytest.raises(AssertionError, match=r"a\.txt:9: .* NoReply: .*damaged bytes came: 01 \|"):
        played_well(spoilt)


def test_what_a_dialogue_takes() -> None:
    (dialogue,) = parse(GOOD.replace("20", "20.5  # ms"), "slink3", "a.txt")
    assert dialogue.seconds == pytest.approx(0.0205)
    assert str(dialogue) == "slink3/a.txt: the status word"
