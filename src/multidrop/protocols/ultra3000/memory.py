"""Working, non-volatile and default values: copies between them, and what differs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from multidrop.conversation import Conversation
from multidrop.device import Copy, Memory
from multidrop.errors import (
    DeviceError,
    NoReply,
    NotApplied,
    OutcomeUnknown,
    ProtocolError,
    UsageError,
)
from multidrop.points import Sample, shown_value
from multidrop.profile import Profile
from multidrop.protocols.ultra3000.frame import Frame
from multidrop.protocols.ultra3000.master import Master
from multidrop.protocols.ultra3000.messages import Function
from multidrop.protocols.ultra3000.points import ParameterPoint, View, parse_point
from multidrop.writing import Outcome, Written


def points_offering(profile: Profile, function: Function) -> Iterator[ParameterPoint]:
    """The points of a profile that list a function, arrays element by element."""
    for name in profile.points:
        point = parse_point(name, profile, whole=True)
        if point.offers(function):
            yield from elements(point)


def elements(point: ParameterPoint) -> Iterator[ParameterPoint]:
    """The point itself, or every element of an array that was named without one."""
    if point.elements is None or point.element is not None:
        yield point
        return
    for element in range(point.elements):
        yield point.of(point.view, element)


def sample(master: Master, point: ParameterPoint) -> Conversation[Frame, Sample]:
    """Read one value, also of a point that the profile calls write-only: the drive decides."""
    return master.read_as(point.sample, point.parameter, point.element, point.view.read)


def prepare_copy(profile: Profile, text: str, save: bool, force: bool) -> Copy:
    """Functions 4 and 5 carry no data, so an array is copied as a whole."""
    point = parse_point(text, profile, whole=True)
    what = "saved" if save else "loaded"
    if point.element is not None:
        raise UsageError(f"{text}: an array is {what} as a whole: {point.name or point.text}")
    if point.view is not View.WORKING:
        raise UsageError(f"{text}: a point is {what} without @{point.view}")
    if not point.offers(_function(save)) and not force:
        raise UsageError(f"{point} cannot be {what}; --force asks the drive")
    changed = point.of(View.NV) if save else point
    return Copy(point, save, tuple(elements(changed)))


def _function(save: bool) -> Function:
    if save:
        return Function.COPY_WORKING_TO_NON_VOLATILE
    return Function.COPY_NON_VOLATILE_TO_WORKING


def copy(master: Master, copy: Copy, verify: bool) -> Conversation[Frame, list[Written]]:
    """Read both values, copy once, read back. Raises `NoReply` where nothing was sent."""
    assert isinstance(copy.point, ParameterPoint)
    yield from master.learn_echo()
    wanted, records = [], []
    for point in copy.points:
        assert isinstance(point, ParameterPoint)
        source = yield from sample(master, point.of(View.WORKING if copy.save else View.NV))
        old = yield from sample(master, point)
        wanted.append(source)
        records.append(Written(point, point.physical(source.value), Outcome.UNVERIFIED, old))
    try:
        yield from master.copy(copy.point.parameter, _function(copy.save))
    except DeviceError as refusal:
        return [replace(record, outcome=Outcome.NOT_APPLIED, error=refusal) for record in records]
    except (NoReply, ProtocolError) as failure:
        word = "save" if copy.save else "load"
        unknown = OutcomeUnknown(
            f"{copy.point}: the {word} went out and its answer did not come ({failure})", step=word
        )
        records = [replace(record, outcome=Outcome.UNKNOWN, error=unknown) for record in records]
    if not verify:
        return records
    found = []
    for record, source in zip(records, wanted, strict=True):
        found.append((yield from _read_back(master, record, source)))
    return found


def _read_back(master: Master, record: Written, wanted: Sample) -> Conversation[Frame, Written]:
    point = record.point
    assert isinstance(point, ParameterPoint)
    try:
        found = yield from sample(master, point)
    except (DeviceError, NoReply, ProtocolError) as failure:
        return record if record.error is not None else replace(record, error=failure)
    if found.value == wanted.value:
        return replace(record, found=found, outcome=Outcome.CONFIRMED, error=None)
    if record.outcome is Outcome.UNKNOWN:
        return replace(record, found=found)
    differs = NotApplied(
        f"{point}: {shown_value(record.asked)} was copied, {shown_value(point.physical(found.value))} is read back",
        found=found.value,
    )
    return replace(record, found=found, outcome=Outcome.DIFFERS, error=differs)


def compare(master: Master, point: ParameterPoint) -> Conversation[Frame, Memory]:
    """The working, non-volatile and default value of a point."""
    found = []
    for view in (View.WORKING, View.NV, View.DEFAULT):
        found.append((yield from _sample_or_none(master, point.of(view))))
    return Memory(point, *found)


def _sample_or_none(master: Master, point: ParameterPoint) -> Conversation[Frame, Sample | None]:
    if not point.offers(point.view.read):
        return None
    try:
        return (yield from sample(master, point))
    except DeviceError:
        return None
