#!/usr/bin/env python3
"""Drives the simulated UR controller with a client that is not ours: all four interfaces of ur_rtde 1.6.5.

    pip install ur-rtde==1.6.5
    .ci/ur_rtde_conformance.py target/release/screed sim ur

Starts the given command as a server, once as an e-Series controller of software 5.x and once as a CB3 of software 3.15, and
does with each what a user of ur_rtde does: RTDEReceiveInterface, RTDEIOInterface, RTDEControlInterface (whose own URScript
program runs on the controller), DashboardClient. Poses are compared with forward kinematics computed here, to 1e-9. Exit
code 0: all of it came out as the client's documentation says.
"""

import importlib.metadata
import json
import math
import os
import signal
import subprocess
import sys
import time

import dashboard_client
import rtde_control
import rtde_io
import rtde_receive
from ur10e import forward, pose_error

HOST = "127.0.0.1"
PORT = 30004  # ur_rtde knows no other
CELL = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "fixtures", "cells", "demo.toml")
PATIENCE = 20  # s
TOLERANCE = 1e-9
UNLOCK_AFTER = 5  # s, as on a real robot
START_DEG = [15, -90, -90, -90, 90, -30]


def farthest(p, q):
    return max(abs(a - b) for a, b in zip(p, q))


def until(what, condition, patience=PATIENCE):
    end = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < end, f"{what}: not within {patience} s"
        time.sleep(0.005)


def expect(what, found, wanted, tolerance=0.0):
    fits = farthest(found, wanted) <= tolerance if isinstance(wanted, list) else found == wanted
    assert fits, f"{what}: {found}, expected {wanted}"


def check_dashboard(robot, dashboard, cb3):
    """Power, brakes, program, popups; what the robot says of itself meanwhile."""
    version = dashboard.polyscopeVersion()
    assert version.startswith("3.15." if cb3 else "5."), version
    if not cb3:
        assert dashboard.getSerialNumber().isdigit() and dashboard.getRobotModel() == "UR10"
        # Remote control is not chosen: everybody may command.
        assert dashboard.isInRemoteControl() is False
    expect("robot mode", (dashboard.robotmode(), robot.getRobotMode()), ("Robotmode: POWER_OFF", 3))
    dashboard.powerOn()
    until("power", lambda: dashboard.robotmode() == "Robotmode: IDLE" and robot.getRobotMode() == 5)
    dashboard.brakeRelease()
    until("brakes", lambda: dashboard.robotmode() == "Robotmode: RUNNING" and robot.getRobotMode() == 7)
    expect("safety", (dashboard.safetymode(), dashboard.safetystatus()), ("Safetymode: NORMAL", "Safetystatus: NORMAL"))
    assert not dashboard.running()
    program = dashboard.getLoadedProgram()
    assert dashboard.programState().startswith("STOPPED"), dashboard.programState()
    dashboard.loadURP(program.removeprefix("Loaded program: "))
    dashboard.play()
    until("the program", lambda: robot.getRuntimeState() == 2 and dashboard.running())
    assert dashboard.programState().startswith("PLAYING")
    dashboard.pause()
    until("the pause", lambda: robot.getRuntimeState() == 4)
    assert dashboard.programState().startswith("PAUSED")
    dashboard.play()
    until("going on", lambda: robot.getRuntimeState() == 2)
    dashboard.stop()
    until("the stop", lambda: robot.getRuntimeState() == 1 and not dashboard.running())
    dashboard.popup("hello")
    dashboard.closePopup()
    dashboard.closeSafetyPopup()
    dashboard.addToLog("a line")
    assert dashboard.isProgramSaved() in (True, False)


def check_receive(robot, tool, rate):
    """Exact cycle stamps, joints and pose that belong together."""
    stamps, worst, begin = [], 0.0, time.monotonic()
    while len(stamps) < 100:
        assert time.monotonic() < begin + PATIENCE, f"only {len(stamps)} states"
        before, q, target, pose = robot.getTimestamp(), robot.getActualQ(), robot.getTargetQ(), robot.getActualTCPPose()
        if robot.getTimestamp() == before and (not stamps or before > stamps[-1]):
            stamps.append(before)
            assert q == target
            worst = max(worst, pose_error(pose, q, tool))
        time.sleep(0.003)
    for first, second in zip(stamps, stamps[1:]):
        cycles = (second - first) * rate
        assert abs(cycles - round(cycles)) < 1e-6 and cycles > 0.5, f"{first} and {second}"
    assert worst <= TOLERANCE, f"TCP pose differs by {worst}"
    expect("start", robot.getActualQ(), [math.radians(joint) for joint in START_DEG], 1e-12)


def check_io(robot, io):
    """What is written comes back in the robot's state."""
    for output in (1, 6):
        for level in (True, False, True):
            assert io.setStandardDigitalOut(output, level)
            until(f"digital output {output}", lambda: robot.getDigitalOutState(output) == level)
    assert io.setConfigurableDigitalOut(2, True)
    until("configurable output", lambda: robot.getDigitalOutState(8 + 2))
    assert io.setToolDigitalOut(1, True)
    until("tool output", lambda: robot.getDigitalOutState(16 + 1))
    assert io.setSpeedSlider(0.25)
    until("speed slider", lambda: robot.getTargetSpeedFraction() == 0.25)
    assert io.setSpeedSlider(1.0)
    until("speed slider", lambda: robot.getTargetSpeedFraction() == 1.0)
    assert io.setAnalogOutputVoltage(0, 0.5)
    until("analog voltage", lambda: abs(robot.getStandardAnalogOutput0() - 5.0) < 1e-9)
    assert io.setAnalogOutputCurrent(1, 0.25)
    until("analog current", lambda: abs(robot.getStandardAnalogOutput1() - 0.008) < 1e-9)
    assert io.setInputIntRegister(20, 123) and io.setInputDoubleRegister(20, 1.5)


def check_control(robot, control, tool, rate):
    """Everything ur_rtde's own program does on this controller without touching the safety system."""
    assert control.isProgramRunning() and control.isConnected()
    start = robot.getActualQ()
    target = [joint + 0.1 for joint in start]
    assert control.moveJ(target, 1.0, 2.0)
    expect("moveJ", robot.getActualQ(), target, 1e-9)

    step = 1.0 / rate
    goal = list(target)
    for _ in range(500):
        begin = control.initPeriod()
        goal = [joint + 0.05 * step for joint in goal]
        assert control.servoJ(goal, 0.0, 0.0, step, 0.1, 300)
        control.waitPeriod(begin)
    until("servoJ", lambda: farthest(robot.getActualQ(), goal) < 1e-4)
    assert control.servoStop()
    until("servoStop", lambda: robot.getActualQd() == [0.0] * 6 and control.isSteady())

    pose = robot.getActualTCPPose()
    expect("forward kinematics", control.getForwardKinematics(), pose, 1e-9)
    expect("inverse kinematics", control.getInverseKinematics(pose), robot.getActualQ(), 1e-8)
    assert control.getInverseKinematicsHasSolution(pose)
    assert not control.getInverseKinematicsHasSolution([5.0, *pose[1:]])
    pose[2] += 0.05
    assert control.moveL(pose, 0.25, 0.5)
    expect("moveL", robot.getActualTCPPose()[:3], pose[:3], 1e-9)
    assert pose_error(robot.getActualTCPPose(), robot.getActualQ(), tool) <= TOLERANCE

    speeds = [0.1, 0.0, -0.05, 0.0, 0.0, 0.2]
    assert control.speedJ(speeds, 1.0, 0.5)
    until("speedJ", lambda: robot.getActualQd() == speeds)
    assert control.speedStop()
    until("speedStop", lambda: robot.getActualQd() == [0.0] * 6)
    assert control.moveJ(start, 1.0, 2.0, True)
    until("the asynchronous move", lambda: max(map(abs, robot.getActualQd())) > 0.05)
    control.stopJ(4.0)
    until("stopJ", lambda: robot.getActualQd() == [0.0] * 6)
    assert farthest(robot.getActualQ(), start) > 1e-3, "stopJ came too late"

    offset = control.getTCPOffset()
    expect("TCP offset", offset, [0, 0, tool, 0, 0, 0], 1e-12)
    assert control.setTcp([0, 0, 0.1, 0, 0, 0])
    until("the tool", lambda: pose_error(robot.getActualTCPPose(), robot.getActualQ(), 0.1) <= TOLERANCE)
    assert control.setTcp(offset) and control.setPayload(1.5, [0, 0, 0.1])
    until("payload", lambda: robot.getPayload() == 1.5 and robot.getPayloadCog() == [0, 0, 0.1])
    assert control.isJointsWithinSafetyLimits(start) and not control.isJointsWithinSafetyLimits([7.0] * 6)
    assert control.moveJ(start, 1.0, 2.0)
    expect("moveJ back", robot.getActualQ(), start, 1e-9)


def check_stops(robot, control, dashboard):
    """Watchdog, protective stop and unlock, the script's end."""
    assert control.setWatchdog(10.0)
    for _ in range(20):
        assert control.kickWatchdog()
        time.sleep(0.02)
    assert control.isProgramRunning()
    until("the watchdog", lambda: robot.getRuntimeState() == 1 and not control.isProgramRunning(), 2)
    assert control.reuploadScript()
    until("the program", control.isProgramRunning)

    control.triggerProtectiveStop()
    until("the protective stop", robot.isProtectiveStopped)
    expect("safety", (robot.getSafetyMode(), dashboard.safetystatus()), (3, "Safetystatus: PROTECTIVE_STOP"))
    assert robot.getSafetyStatusBits() & 1 == 0 and robot.getRuntimeState() != 2 and not robot.isEmergencyStopped()
    try:
        dashboard.unlockProtectiveStop()
        raise AssertionError("unlocked at once")
    except RuntimeError as refused:
        assert "until 5s" in str(refused), refused
    time.sleep(UNLOCK_AFTER + 0.2)
    dashboard.closeSafetyPopup()
    dashboard.unlockProtectiveStop()
    until("the unlock", lambda: not robot.isProtectiveStopped() and robot.getSafetyMode() == 1)
    assert robot.getRuntimeState() != 2, "nothing goes on by itself"
    assert control.reuploadScript()
    until("the program", control.isProgramRunning)
    assert control.moveJ([joint + 0.02 for joint in robot.getActualQ()], 1.0, 2.0)

    # Too far for any arm: a stop, not a motion.
    far = [joint + 1.0 for joint in robot.getActualQ()]
    before = robot.getActualQ()
    control.servoJ(far, 0.0, 0.0, 0.01, 0.1, 300)
    until("the protective stop", robot.isProtectiveStopped)
    assert farthest(robot.getActualQ(), before) < 0.05
    time.sleep(UNLOCK_AFTER + 0.2)
    dashboard.unlockProtectiveStop()
    until("the unlock", lambda: not robot.isProtectiveStopped())
    # The last servoJ still stands in the registers; a new connection of ur_rtde clears them before it uploads.
    control.disconnect()
    control = rtde_control.RTDEControlInterface(HOST)
    assert control.isProgramRunning()
    control.stopScript()
    until("the script's end", lambda: not control.isProgramRunning() and robot.getRuntimeState() == 1)
    dashboard.powerOff()
    until("no power", lambda: robot.getRobotMode() == 3)
    control.disconnect()


def check(command, generation, rate, tool):
    options = ["--model", "ur10e", "--host", HOST, "--port", str(PORT), "--json", "--cell", CELL]
    options += ["--controller", generation, "--power-off", "--start-deg", ",".join(map(str, START_DEG))]
    server = subprocess.Popen([*command, *options], stdout=subprocess.PIPE, text=True)
    try:
        line = server.stdout.readline()
        assert line and json.loads(line)["listening"] == f"{HOST}:{PORT}", "the server did not start"
        robot = rtde_receive.RTDEReceiveInterface(HOST)
        dashboard = dashboard_client.DashboardClient(HOST)
        dashboard.connect()
        check_receive(robot, tool, rate)
        check_dashboard(robot, dashboard, generation == "cb3")
        check_io(robot, rtde_io.RTDEIOInterface(HOST))
        control = rtde_control.RTDEControlInterface(HOST)
        check_control(robot, control, tool, rate)
        check_stops(robot, control, dashboard)
        robot.disconnect()
        dashboard.quit()
        assert server.poll() is None, "the server ended"
        server.send_signal(signal.SIGINT)
        summary = json.loads(server.communicate(timeout=PATIENCE)[0])
    finally:
        server.kill()
    print(f"{generation}: all four interfaces in {summary['cycles']} cycles, {summary['stalls']} stalls of the machine")


def main():
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    version = importlib.metadata.version("ur_rtde")
    assert version == "1.6.5", version
    import tomllib

    with open(CELL, "rb") as file:
        *aside, along_mm = tomllib.load(file)["tool"]["xyz_mm"]
    assert not any(aside), "a straight tool is expected"
    for generation, rate in (("e-series", 500), ("cb3", 125)):
        check(sys.argv[1:], generation, rate, along_mm * 1e-3)
    print(f"ur_rtde {version}: receive, IO, control and dashboard as documented")


if __name__ == "__main__":
    main()
