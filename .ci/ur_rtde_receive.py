#!/usr/bin/env python3
"""Checks the simulated UR controller with a client that is not ours: RTDEReceiveInterface of ur_rtde 1.6.5.

    pip install ur-rtde==1.6.5
    .ci/ur_rtde_receive.py target/release/screed sim ur

Starts the given command as a server, streams a joint ramp to it over a second connection written here with nothing but
sockets, and compares what ur_rtde receives meanwhile: joints with the server's own record of the same cycle, bit by bit,
the TCP pose with forward kinematics computed here, to 1e-9. Exit code 0: all agree.
"""

import csv
import importlib.metadata
import json
import os
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import tomllib

from ur10e import pose_error

HOST = "127.0.0.1"
PORT = 30004  # ur_rtde knows no other
CELL = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "fixtures", "cells", "demo.toml")
SAMPLES = 200
PATIENCE = 30  # s
TOLERANCE = 1e-9

def package(kind, payload=b""):
    return struct.pack(">HB", len(payload) + 3, ord(kind)) + payload


def answer(stream, kind):
    """The payload of the next package of this kind."""
    while True:
        size, found = struct.unpack(">HB", exactly(stream, 3))
        payload = exactly(stream, size - 3)
        if chr(found) == kind:
            return payload


def exactly(stream, count):
    data = b""
    while len(data) < count:
        part = stream.recv(count - len(data))
        if not part:
            raise SystemExit("the server closed the connection")
        data += part
    return data


def cell():
    """First register and length of the tool (m) in the cell that the server is given."""
    with open(CELL, "rb") as file:
        found = tomllib.load(file)
    *aside, along_mm = found["tool"]["xyz_mm"]
    assert not any(aside) and not any(found["tool"]["rpy_deg"]), "a straight tool is expected"
    return found["link"].get("register_offset", 0), along_mm * 1e-3


def ramp(start, offset, stop):
    """Streams joint setpoints that move all joints by 0.2 rad/s, from `start`, until told to stop."""
    stream = socket.create_connection((HOST, PORT))
    stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    stream.sendall(package("V", struct.pack(">H", 2)))
    assert answer(stream, "V") == b"\x01"
    names = [f"input_double_register_{offset + joint}" for joint in range(6)] + [f"input_int_register_{offset}"]
    stream.sendall(package("I", ",".join(names).encode()))
    setup = answer(stream, "I")
    assert setup[1:] == b"DOUBLE,DOUBLE,DOUBLE,DOUBLE,DOUBLE,DOUBLE,INT32", setup
    number = 0
    begin = time.monotonic()
    while not stop.is_set():
        number += 1
        moved = 0.2 * (time.monotonic() - begin)
        joints = [joint + moved for joint in start]
        stream.sendall(package("U", struct.pack(">B6di", setup[0], *joints, number)))
        time.sleep(0.004)
    stream.close()


def receive(samples, offset):
    """Timestamps, joints and poses, all of the same cycle, as ur_rtde gives them."""
    import rtde_receive

    robot = rtde_receive.RTDEReceiveInterface(HOST, 500.0)
    assert robot.getRobotMode() == 7 and robot.getRuntimeState() == 2 and robot.getSafetyMode() == 1
    stop = threading.Event()
    writer = threading.Thread(target=ramp, args=(robot.getActualQ(), offset, stop))
    writer.start()
    found, begin = [], time.monotonic()
    while len(found) < samples and time.monotonic() < begin + PATIENCE:
        before = robot.getTimestamp()
        q, target, pose = robot.getActualQ(), robot.getTargetQ(), robot.getActualTCPPose()
        # A background thread of ur_rtde may have taken the next package in between.
        if robot.getTimestamp() == before and (not found or before > found[-1][0]):
            found.append((before, q, target, pose))
        time.sleep(0.005)
    stop.set()
    writer.join()
    robot.disconnect()
    assert len(found) == samples, f"only {len(found)} states in {PATIENCE} s"
    return found


def main():
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    version = importlib.metadata.version("ur_rtde")
    assert version == "1.6.5", version
    offset, tool = cell()
    with tempfile.TemporaryDirectory() as folder:
        record = os.path.join(folder, "record.csv")
        options = ["--model", "ur10e", "--host", HOST, "--port", str(PORT), "--json", "--record", record]
        options += ["--cell", CELL, "--exit-when-idle", "2"]
        server = subprocess.Popen(sys.argv[1:] + options, stdout=subprocess.PIPE, text=True)
        try:
            line = server.stdout.readline()
            if not line:
                raise SystemExit("the server did not start")
            assert json.loads(line)["listening"] == f"{HOST}:{PORT}"
            found = receive(SAMPLES, offset)
            server.wait(timeout=20)
        finally:
            server.kill()
        with open(record, newline="") as file:
            table = list(csv.DictReader(file))
        rows = {float(row["timestamp"]): [float(row[f"actual_q_{joint}"]) for joint in range(6)] for row in table}

    worst = moved = 0.0
    for timestamp, q, target, pose in found:
        assert q == rows[timestamp], f"joints at {timestamp}: {q}, the record has {rows[timestamp]}"
        assert target == q
        worst = max(worst, pose_error(pose, q, tool))
        moved = max(moved, abs(q[0] - found[0][1][0]))
    assert worst <= TOLERANCE, f"TCP pose differs by {worst}"
    assert moved > 0.05, f"the robot moved only by {moved} rad"
    print(f"ur_rtde {version}: {len(found)} states, joints equal, TCP pose within {worst:.1e}, moved {moved:.2f} rad")


if __name__ == "__main__":
    main()
