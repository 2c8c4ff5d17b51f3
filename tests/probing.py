"""Conversations that identify a device, against answers of a test."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from multidrop.conversation import Ask, Conversation
from multidrop.probing import Identity


def identified(
    conversation: Conversation[Any, Identity], answer: Callable[[Any], Any]
) -> tuple[Identity, list[Any]]:
    """Who it is that answers so, and the frames that asked it. Every step is a read that may be repeated."""
    asked = []
    step = next(conversation)
    try:
        while True:
            assert isinstance(step, Ask)
            assert step.repeatable
            asked.append(step.frame)
            step = conversation.send(answer(step.frame))
    except StopIteration as stop:
        return stop.value, asked


def ran(
    conversation: Conversation[Any, Any], answer: Callable[[Any], Any]
) -> tuple[Any, list[Any]]:
    """What a conversation of reads returns to these answers, and the frames that it asked.

    An answer that is an exception is thrown into it.
    """
    asked = []
    try:
        step = next(conversation)
        while True:
            assert isinstance(step, Ask)
            assert step.repeatable
            asked.append(step.frame)
            found = answer(step.frame)
            step = (
                conversation.throw(found)
                if isinstance(found, Exception)
                else conversation.send(found)
            )
    except StopIteration as stop:
        return stop.value, asked
