#!/usr/bin/env python3
"""Asks the simulated UR controller for faults, as a person does, and looks at the wire.

    .ci/ur_faults.py target/release/screed sim ur

Starts the given command as a server with faults on its command line and lines on its standard input, and reads RTDE with a
client of a few lines that knows the protocol only (Python's standard library). Exit code 0: every fault came, and looked on
the wire as it has to.
"""

import atexit
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import time

CELL = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "fixtures", "cells", "demo.toml")
PATIENCE = 20  # s
FIELDS = "timestamp,robot_mode,safety_mode,safety_status_bits,runtime_state,actual_digital_input_bits"
LAYOUT = ">diiIIQ"


class Rtde:
    """Protocol 2, one output recipe."""

    def __init__(self, port, rate):
        self.socket = socket.create_connection(("127.0.0.1", port), PATIENCE)
        self.buffer = b""
        self.ask(b"V", struct.pack(">H", 2))
        self.ask(b"O", struct.pack(">d", rate) + FIELDS.encode())
        assert self.ask(b"S") == b"\x01"

    def send(self, kind, payload=b""):
        self.socket.sendall(struct.pack(">H", 3 + len(payload)) + kind + payload)

    def ask(self, kind, payload=b""):
        self.send(kind, payload)
        while True:
            found, content = self.package()
            if found == kind:
                return content

    def package(self):
        while True:
            if len(self.buffer) >= 3:
                size = struct.unpack(">H", self.buffer[:2])[0]
                if len(self.buffer) >= size:
                    package, self.buffer = self.buffer[:size], self.buffer[size:]
                    return package[2:3], package[3:]
            more = self.socket.recv(4096)
            if not more:
                raise EOFError
            self.buffer += more

    def state(self):
        """Stamp, robot mode, safety mode, safety bits, runtime state, digital inputs."""
        while True:
            kind, content = self.package()
            if kind == b"U":
                found = struct.unpack(LAYOUT, content[1:])
                self.last = found[0]
                return found

    def until(self, what, condition):
        end = time.monotonic() + PATIENCE
        while not condition(state := self.state()):
            assert time.monotonic() < end, f"{what}: not within {PATIENCE} s, last {state}"
        return state

    def gap(self, what, least, most):
        """Reads on until two stamps are that far apart, the last one that was read included."""
        before, end = self.last, time.monotonic() + PATIENCE
        while (after := self.state()[0]) - before < least - 1e-6:
            assert time.monotonic() < end, what
            before = after
        assert after - before <= most + 1e-6, f"{what}: {after - before} s"


class Server:
    def __init__(self, command, *options):
        command = [*command, "--port", "0", "--json", "--cell", CELL, "--control", *options]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        atexit.register(self.process.kill)
        self.port = int(json.loads(self.process.stdout.readline())["listening"].rsplit(":", 1)[1])

    def line(self, text):
        """Sends a line; what the server says to it."""
        self.process.stdin.write(text + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def act(self, text):
        told = self.line(text)
        assert told.get("act") == text and told["done"], told

    def end(self):
        self.process.send_signal(signal.SIGINT)
        rest = self.process.communicate(timeout=PATIENCE)[0].splitlines()
        return json.loads(rest[-1])


def check_lines(command, generation, rate):
    """Stops, inputs, silence, skipped packages, reset and restart by lines on the standard input."""
    server = Server(command, "--controller", generation)
    robot = Rtde(server.port, rate)
    robot.until("a running program", lambda s: s[1:5] == (7, 1, 1, 2))
    server.act("protective-stop")
    robot.until("the protective stop", lambda s: s[2] == 3 and s[3] == 1 << 2 | 1 << 10 and s[4] == 4)
    assert "expected protective-stop" in server.line("explode")["error"]
    assert server.line("play")["done"] is False, "played in a protective stop"
    server.act("emergency-stop on")
    robot.until("the emergency stop", lambda s: s[1:5] == (3, 7, 1 << 6 | 1 << 7 | 1 << 10, 1))
    server.act("emergency-stop off")
    server.act("digital-input 5 on")
    robot.until("the digital input", lambda s: s[5] == 1 << 5)
    server.act("silence 0.3")
    robot.gap("the silence", 0.3, 0.3 + 2 / rate)
    server.act("skip 10")
    robot.gap("the packages left out", 9 / rate, 12 / rate)
    server.act("reset")
    try:
        while True:
            robot.package()
    except ConnectionResetError:
        pass
    robot = Rtde(server.port, rate)
    assert robot.state()[0] > 41
    server.act("restart 0.3")
    try:
        while True:
            robot.package()
    except (EOFError, ConnectionResetError):
        pass
    end = time.monotonic() + PATIENCE
    while True:
        try:
            robot = Rtde(server.port, rate)
            break
        except ConnectionRefusedError:
            assert time.monotonic() < end, "not back"
            time.sleep(0.02)
    assert robot.state()[0] < 20, "time did not begin anew"
    robot.until("power off after booting", lambda s: s[1] == 3)
    return server.end()


def check_options(command):
    """The same by options: half a package, a spoilt one, a fieldbus."""
    server = Server(command, "--fault", "half=0.5@1", "--fault", "safeguard-stop@0.5", "--fieldbus", "lower")
    robot = Rtde(server.port, 500)
    assert robot.ask(b"I", b"input_int_register_0,input_int_register_24") == b"\x00IN_USE,INT32"
    robot.until("the safeguard stop", lambda s: s[2] == 5)
    # Whole packages, one of which ends in its middle; the next one's header stands there.
    header = struct.pack(">HcB", 4 + struct.calcsize(LAYOUT), b"U", 1)
    size = 4 + struct.calcsize(LAYOUT)
    end = time.monotonic() + PATIENCE
    while True:
        while len(robot.buffer) < 2 * size:
            robot.buffer += robot.socket.recv(4096)
        assert robot.buffer.startswith(header), robot.buffer[:size]
        if robot.buffer[size : size + 4] != header:
            assert robot.buffer[size // 2 : size // 2 + 4] == header, robot.buffer[:size]
            break
        robot.buffer = robot.buffer[size:]
        assert time.monotonic() < end, "no half package"
    return server.end()


def main():
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    for generation, rate in (("e-series", 500), ("cb3", 125)):
        summary = check_lines(sys.argv[1:], generation, rate)
        print(f"{generation}: every fault by its line, {summary['cycles']} cycles")
    check_options(sys.argv[1:])
    print("faults by options: half a package, safeguard stop, a fieldbus's registers")


if __name__ == "__main__":
    main()
