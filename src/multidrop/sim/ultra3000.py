"""A simulated Ultra3000: working and non-volatile values of all parameters of the profile, and a servo."""

from __future__ import annotations

from collections.abc import Callable

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.events import Damaged, FrameReceived
from multidrop.points import Value
from multidrop.profile import PointDescription, Profile
from multidrop.protocols.ultra3000 import Frame, Function, Refusal, Reply, Request, Slave
from multidrop.protocols.ultra3000.messages import (
    DEFINE_HOME,
    DRIVE_STATUS,
    FACTORY_RESET,
    FAULT_STATUS,
    PRODUCT_TYPE,
    RESET_FAULTS,
    RESET_SERIAL_PORT,
    RUN_STATUS,
    START_HOMING,
)
from multidrop.protocols.ultra3000.points import ParameterPoint, parse_point
from multidrop.protocols.ultra3000.values import INTEGERS, VERSION, encode_value
from multidrop.sim.faults import Fault
from multidrop.sim.servo import Servo

TRIP = 0x7FF
"""A parameter of the simulation alone: function 1 with 8 digits sets these bits of the fault status."""

DRIVE_ADDRESS, DRIVE_ENABLE, SETPOINT_VELOCITY, HOME_POSITION = 0x052, 0x06B, 0x06D, 0x0C9
MOTOR_POSITION, POSITION_COMMAND, VELOCITY_COMMAND, MOTOR_VELOCITY = 0x07E, 0x080, 0x084, 0x085
BUS_VOLTAGE, DRIVE_TEMPERATURE = 0x08B, 0x108

_COPIES = (Function.COPY_NON_VOLATILE_TO_WORKING, Function.COPY_WORKING_TO_NON_VOLATILE)
_WRITES = (Function.WRITE_WORKING, Function.WRITE_NON_VOLATILE, *_COPIES, Function.COPY_DEFAULT)


class Parameter:
    """Working and non-volatile digits of one parameter, for each element of an array."""

    def __init__(self, point: ParameterPoint) -> None:
        assert point.description is not None
        self.point = point
        self.description: PointDescription = point.description
        self.default = self._digits(self.description.default)
        count = point.elements or 1
        self.working = [self.default] * count
        self.saved = [self.default] * count

    def limit(self, function: Function) -> str:
        """The limit that the profile gives, else the type's."""
        low = function is Function.READ_MINIMUM
        limit = self.description.minimum if low else self.description.maximum
        if limit is None:
            return encode_value(self.point.kind, self.point.kind.limits[0 if low else 1])
        return self._digits(limit)

    def _digits(self, physical: Value | None) -> str:
        kind = self.point.kind
        if kind.name == "string":
            return encode_value(kind, str(physical or ""))
        if kind is VERSION:
            return "0110"
        if kind.name not in INTEGERS:
            return ""
        return encode_value(kind, self.description.unscaled(physical or 0))


class SimulatedUltra3000:
    """The drive at `address`. Address and serial settings act on a reset of the serial port."""

    def __init__(self, address: int, profile: Profile) -> None:
        self.slave = Slave(address, profile=profile)
        self.servo = Servo()
        points = (parse_point(name, profile, whole=True) for name in profile.points)
        self.parameters = {point.parameter: Parameter(point) for point in points}
        kind = self.parameters[DRIVE_ADDRESS].point.kind
        self._store(DRIVE_ADDRESS, encode_value(kind, address))
        self._store(DRIVE_ENABLE, "00")  # nobody has enabled it yet
        servo = self.servo
        self._measured: dict[int, Callable[[float], int]] = {
            PRODUCT_TYPE: lambda now: 0x0200_0005,  # 2 kW, 230 V, indexing
            DRIVE_STATUS: servo.drive_status,
            FAULT_STATUS: lambda now: servo.faults,
            RUN_STATUS: lambda now: servo.run_status(),
            MOTOR_POSITION: servo.position,
            POSITION_COMMAND: servo.position,
            VELOCITY_COMMAND: lambda now: servo.setpoint if servo.enabled else 0,
            MOTOR_VELOCITY: servo.velocity,
            BUS_VOLTAGE: lambda now: 325,
            DRIVE_TEMPERATURE: lambda now: 42 * 128,
        }
        self._actions: dict[int, Callable[[float], None]] = {
            FACTORY_RESET: lambda now: self._factory_reset(),
            RESET_FAULTS: servo.reset_faults,
            DEFINE_HOME: self._home,
            START_HOMING: self._home,
            RESET_SERIAL_PORT: lambda now: None,  # acts behind the answer
        }

    @property
    def address(self) -> int:
        return self.slave.address

    def receive(self, events: list[FrameReceived[Frame] | Damaged], now: float) -> list[bytes]:
        answers = []
        for request in self.slave.receive_events(events):
            reply = self._respond(request, now)
            answer = self.slave.answer(request, reply)
            if answer:
                answers.append(answer)
            if request.parameter == RESET_SERIAL_PORT and not reply.refusal:
                self._reset_serial_port()
        return answers

    def disguise(self, answer: bytes, fault: Fault) -> bytes:
        """The answer of the drive next door; there are no sequence numbers to be wrong."""
        frame = Frame.decode(answer)
        return frame._replace(address=(frame.address + 1) % 254).encode()

    def _respond(self, request: Request, now: float) -> Reply:
        if request.parameter == TRIP and request.function == Function.WRITE_WORKING:
            self.servo.trip(int(request.frame.data or "0", 16), now)
            return Reply()
        if request.settled is not None:
            return request.settled
        known = self.parameters[request.parameter]
        function = Function(request.function)
        enabled_forbids = Refusal.DRIVE_ENABLED in known.description.refusals
        if function in _WRITES and enabled_forbids and self.servo.enabled:
            return Reply(Refusal.DRIVE_ENABLED)
        if request.parameter in self._actions:
            self._actions[request.parameter](now)
            return Reply()
        if function in _WRITES:
            return self._write(known, function, request, now)
        return Reply(data=self._read(known, function, request, now))

    def _read(self, known: Parameter, function: Function, request: Request, now: float) -> str:
        element = request.element or 0
        if function is Function.READ_WORKING and request.parameter in self._measured:
            return encode_value(known.point.kind, self._measured[request.parameter](now))
        if function is Function.READ_WORKING:
            return known.working[element]
        if function is Function.READ_NON_VOLATILE:
            return known.saved[element]
        if function is Function.READ_DEFAULT:
            return known.default
        if function is Function.READ_INDEX_MINIMUM:
            return "00"
        if function is Function.READ_INDEX_MAXIMUM:
            return f"{len(known.working) - 1:02X}"
        return known.limit(function)

    def _write(self, known: Parameter, function: Function, request: Request, now: float) -> Reply:
        element = request.element or 0
        if function in _COPIES:  # of a whole array
            if function is Function.COPY_WORKING_TO_NON_VOLATILE:
                known.saved = list(known.working)
            else:
                known.working = list(known.saved)
        else:
            value = known.default if function is Function.COPY_DEFAULT else request.value
            known.working[element] = value
            if function is not Function.WRITE_WORKING:
                known.saved[element] = value
        self._act(request.parameter, known.working[element], now)
        return Reply()

    def _act(self, parameter: int, digits: str, now: float) -> None:
        """What a new working value does at once."""
        if parameter == DRIVE_ENABLE:
            self.servo.enable(digits != "00", now)
        elif parameter == SETPOINT_VELOCITY:
            value = int(digits, 16)
            self.servo.set_velocity(value - (1 << 32 if value >> 31 else 0), now)

    def _home(self, now: float) -> None:
        home = int(self.parameters[HOME_POSITION].working[0], 16)
        self.servo.define_home(home - (1 << 32 if home >> 31 else 0), now)

    def _factory_reset(self) -> None:
        for known in self.parameters.values():
            known.working = [known.default] * len(known.working)
            known.saved = list(known.working)

    def _reset_serial_port(self) -> None:
        self.slave.address = int(self.parameters[DRIVE_ADDRESS].saved[0], 16)

    def _store(self, parameter: int, digits: str) -> None:
        known = self.parameters[parameter]
        known.working = [digits]
        known.saved = [digits]


def simulated(profile: Profile, address: int, behind: str | None) -> SimulatedUltra3000:
    """The drive that a profile's name stands for. Raises `UsageError`."""
    if behind is not None:
        raise UsageError(f"{profile.name} has no {behind} behind it")
    return SimulatedUltra3000(address, load_profile("ultra3000"))


def unknown(question: Frame) -> bytes | None:
    """What a drive says to a question that it knows nothing about."""
    if question.is_refusal:
        return None
    return Slave(question.address).answer(Request(question), Reply(Refusal.INVALID_FUNCTION))
