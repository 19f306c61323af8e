"""A robot that is not there, behind the interfaces of a UR controller: `-m tests.loop.rtde_server HOST RING RING`.

Written from Universal Robots' "Real-Time Data Exchange (RTDE) Guide" (packages of 2 bytes of size, 1 of type,
big-endian, on port 30004), the dashboard server (29999), and what a program sent to port 30003 does that takes commands
from input registers, as ur_rtde's: register 0 is a command's number, output register 0 is 1 while it waits for one, 2
when one is done. Its joints follow speeds with an acceleration, `DELAY` late; it stops like a UR where its program's
watchdog is not kicked in time. What is so it tells in a ring.
"""

import selectors
import socket
import struct
import sys
import time
from collections import deque

import numpy as np

from rehab_opt.loop.shared_ring import SharedRing

TRUTH = np.dtype(
    [("position", "<f8", (6,)), ("velocity", "<f8", (6,)), ("running", "<u8"), ("watchdog", "<u8"), ("packages", "<u8")]
)
ORDERS = np.dtype([("deaf", "<u8"), ("protective_stop", "<u8"), ("slowed", "<f8")])
RATE = 500.0
DELAY = 0.012
"""[s] from a package of commands to the motion."""
TYPES = {
    "timestamp": "DOUBLE", "actual_q": "VECTOR6D", "actual_qd": "VECTOR6D", "actual_TCP_force": "VECTOR6D",
    "speed_scaling": "DOUBLE", "target_speed_fraction": "DOUBLE",
    "runtime_state": "UINT32", "robot_status_bits": "UINT32", "safety_status_bits": "UINT32",
}  # fmt: skip
NO_COMMAND, SPEEDJ, SPEED_STOP, SET_WATCHDOG, WATCHDOG, STOP_SCRIPT = 0, 9, 15, 35, 99, 255
READY, DONE = 1, 2
START = (0.0, -1.2, 1.5, -1.8, -1.57, 0.0)


def type_of(name: str) -> str:
    if "int_register" in name:
        return "INT32"
    return "DOUBLE" if "double_register" in name else TYPES.get(name, "NOT_FOUND")


class Robot:
    """Six joints and the program that moves them."""

    def __init__(self, truth: SharedRing, orders: SharedRing) -> None:
        self.q, self.qd = np.array(START), np.zeros(6)
        self.target, self.acceleration = np.zeros(6), 10.0
        self.underway: deque[tuple[float, np.ndarray, float]] = deque()
        self.running, self.state, self.watchdog, self.kicked = False, 0, 0.0, 0.0
        self.truth, self.orders, self.tripped, self.packages = truth, orders, 0, 0

    def command(self, registers: dict[str, float]) -> None:
        self.kicked = time.monotonic()
        number = int(registers["input_int_register_0"])
        numbers = [registers.get(f"input_double_register_{i}", 0.0) for i in range(8)]
        if not self.running or number == WATCHDOG:
            return
        if number == NO_COMMAND:
            self.state = READY
        elif number == SPEEDJ:
            self.underway.append((self.kicked + DELAY, np.array(numbers[:6]), numbers[6]))
            self.packages += 1
        else:
            self.state = DONE
            if number == SPEED_STOP:
                self.underway.append((self.kicked + DELAY, np.zeros(6), numbers[0]))
            elif number == SET_WATCHDOG:
                self.watchdog = 1.0 / numbers[0]
            elif number == STOP_SCRIPT:
                self.halt()

    def start(self) -> None:
        self.running, self.state, self.watchdog = True, READY, 0.0

    def halt(self) -> None:
        self.running, self.state = False, 0
        self.underway.clear()
        self.target, self.acceleration = np.zeros(6), 10.0

    def step(self, now: float, dt: float) -> None:
        if self.running and self.watchdog and now - self.kicked > self.watchdog:
            self.tripped = 1
            self.halt()
        if self.stopped:
            self.halt()
        while self.underway and self.underway[0][0] <= now:
            _, self.target, self.acceleration = self.underway.popleft()
        change = self.acceleration * dt
        self.qd = self.qd + np.clip(self.slider * self.target - self.qd, -change, change)
        self.q = self.q + self.qd * dt
        self.truth.write(
            position=self.q, velocity=self.qd, running=self.running, watchdog=self.tripped, packages=self.packages
        )

    @property
    def deaf(self) -> bool:
        return self.order("deaf")

    @property
    def slider(self) -> float:
        newest = self.orders.latest()
        return 1.0 - (0.0 if newest is None else float(newest.record["slowed"]))

    @property
    def stopped(self) -> bool:
        return self.order("protective_stop")

    def order(self, name: str) -> bool:
        newest = self.orders.latest()
        return newest is not None and bool(newest.record[name])

    def output(self, name: str, begin: float) -> bytes:
        values = {
            "timestamp": (time.monotonic() - begin,), "actual_q": self.q, "actual_qd": self.qd,
            "actual_TCP_force": (1.0, 2.0, 3.0, 0.0, 0.0, 0.0), "runtime_state": (2 if self.running else 1,),
            "robot_status_bits": (1 | (2 if self.running else 0),),
            "safety_status_bits": (4 if self.stopped else 1,), "output_int_register_0": (self.state,),
            "speed_scaling": (1.0,), "target_speed_fraction": (self.slider,),
        }.get(name, (0,))  # fmt: skip
        code = {"DOUBLE": ">d", "VECTOR6D": ">6d", "UINT32": ">I", "INT32": ">i"}[type_of(name)]
        return struct.pack(code, *values)


class Rtde:
    """One connection to port 30004."""

    def __init__(self, connection: socket.socket, robot: Robot) -> None:
        self.connection, self.robot, self.begin = connection, robot, time.monotonic()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.received, self.outputs, self.inputs = b"", list[str](), dict[int, list[str]]()
        self.started, self.every, self.count = False, 1, 0

    def heard(self, data: bytes) -> None:
        self.received += data
        while len(self.received) >= 3:
            size, kind = struct.unpack_from(">HB", self.received)
            if len(self.received) < size:
                return
            payload, self.received = self.received[3:size], self.received[size:]
            self.package(chr(kind), payload)

    def package(self, kind: str, payload: bytes) -> None:
        if kind == "V":
            self.answer(kind, b"\1" if payload == b"\0\2" else b"\0")
        elif kind == "v":
            self.answer(kind, struct.pack(">4I", 5, 12, 0, 0))
        elif kind == "O":
            self.outputs = [each for each in payload[8:].decode().split(",") if each]
            self.every = max(1, round(RATE / struct.unpack(">d", payload[:8])[0]))
            self.answer(kind, b"\1" + ",".join(map(type_of, self.outputs)).encode())
        elif kind == "I":
            names = [each for each in payload.decode().split(",") if each]
            self.inputs[len(self.inputs) + 1] = names
            self.answer(kind, bytes([len(self.inputs)]) + ",".join(map(input_type, names)).encode())
        elif kind in "SP":
            self.started = kind == "S"
            self.answer(kind, b"\1")
        elif kind == "U" and not self.robot.deaf:
            names = self.inputs[payload[0]]
            code = ">" + "".join(
                {"INT32": "i", "DOUBLE": "d", "UINT8": "B", "UINT32": "I"}[input_type(each)] for each in names
            )
            self.robot.command(
                dict(zip(names, struct.unpack(code, payload[1 : 1 + struct.calcsize(code)]), strict=True))
            )

    def answer(self, kind: str, payload: bytes) -> None:
        self.connection.sendall(struct.pack(">HB", 3 + len(payload), ord(kind)) + payload)

    def tell(self) -> None:
        self.count += 1
        if self.started and self.count % self.every == 0 and not self.robot.deaf:
            try:
                self.answer("U", b"\1" + b"".join(self.robot.output(each, self.begin) for each in self.outputs))
            except ConnectionError:
                self.started = False


def input_type(name: str) -> str:
    if "register" in name:
        return type_of(name)
    if "mask" in name and "slider" in name:
        return "UINT32"
    return (
        "DOUBLE"
        if "slider" in name or name.startswith(("standard_analog_output_0", "standard_analog_output_1", "external"))
        else "UINT8"
    )


def dashboard(connection: socket.socket, data: bytes, robot: Robot) -> None:
    for line in data.decode().splitlines():
        if line == "stop":
            robot.halt()
        answers = {
            "PolyscopeVersion": "URSoftware 5.12.0.1101319 (Mar 22 2022)", "get serial number": "20225500001",
            "is in remote control": "true", "stop": "Stopped",
        }  # fmt: skip
        connection.sendall((answers.get(line, "unknown command: " + line) + "\n").encode())


class Server:
    """Whoever has connected."""

    def __init__(self, address: str, robot: Robot) -> None:
        self.robot, self.select, self.rtde = robot, selectors.DefaultSelector(), dict[socket.socket, Rtde]()
        for port in (29999, 30003, 30004):
            self.select.register(socket.create_server((address, port)), selectors.EVENT_READ, (self.accept, port))

    def accept(self, listening: socket.socket, port: int) -> None:
        connection, _ = listening.accept()
        if port == 30004:
            self.rtde[connection] = Rtde(connection, self.robot)
        if port == 29999:
            connection.sendall(b"Connected: Universal Robots Dashboard Server\n")
        self.select.register(connection, selectors.EVENT_READ, (self.hear, port))

    def hear(self, connection: socket.socket, port: int) -> None:
        try:
            data = connection.recv(65536)
        except ConnectionError:
            data = b""
        if not data:
            self.select.unregister(connection)
            connection.close()
            self.rtde.pop(connection, None)
        elif port == 29999:
            dashboard(connection, data, self.robot)
        elif port == 30004:
            self.rtde[connection].heard(data)
        elif b"def " in data:
            self.robot.start()

    def run(self) -> None:
        deadline = time.monotonic()
        while True:
            for key, _ in self.select.select(max(0.0, deadline - time.monotonic())):
                act, port = key.data
                act(key.fileobj, port)
            if time.monotonic() >= deadline:
                self.robot.step(deadline, 1 / RATE)  # what this process was too late for is made up for
                deadline = max(deadline + 1 / RATE, time.monotonic() - 1.0)
                for each in self.rtde.values():
                    each.tell()


if __name__ == "__main__":
    Server(sys.argv[1], Robot(SharedRing.attach(sys.argv[2]), SharedRing.attach(sys.argv[3]))).run()
