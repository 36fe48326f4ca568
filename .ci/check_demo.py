#!/usr/bin/env python3
"""Judges what the simulated robot received in `screed demo` and `screed print`, with nothing of Screed's own.

    .ci/check_demo.py            in virtual time: the demo at 125 and 500 Hz, stops on its way, and the larger model
    .ci/check_demo.py --timed    the demo in real time at 125 and 500 Hz (four minutes each), against virtual time

Needs `pip install ifcopenshell numpy` and the programs in target/release. Exit code 0: all holds. Everything is
computed here: forward kinematics from the maker's table (first held against fixtures/data/kinematics), curves from the
entities of the IFC file (ifc_curves.py), frames from the cell file, the fingerprint of the path from the log. The judge
is shown spoilt copies of the first sound run; if it takes one of them, its word is worth nothing and it fails.
"""

import contextlib
import copy
import csv
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import tomllib

import ifc_curves
import numpy as np
from ur10e import ALPHA, A, D

ROOT = pathlib.Path(__file__).resolve().parent.parent
PROGRAMS = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release"
DEMO_CELL = ROOT / "fixtures/cells/demo.toml"
LARGER_CELL = ROOT / "fixtures/cells/fim_fixture.toml"
LARGER_MODEL = ROOT / "fixtures/data/FIM_fixture_IFC4.ifc"
LAYERS = 3

CYCLE_HZ = 500  # the robot's own
ACCELERATION = 0.25  # m/s²
ROUNDING = 1.001
VELOCITY = 0.25  # m/s
JOINT_VELOCITY = np.radians([120, 120, 180, 180, 180, 180])  # the data sheet's
CONTOUR = 10e-6  # m
BACKWARD = 1e-7  # m: how far a setpoint may lie behind the one before it, for rounding
LAYER_TIME, LAYER_TIME_ERROR = 70.0, 0.005  # s
BEAD = 0.024 * 0.015  # m²: width and height in both models
KINEMATICS = 1e-9  # m, and in the elements of the rotation


class Violation(Exception):
    """Something that had to hold does not."""


def hold(condition, message):
    if not condition:
        raise Violation(message)


@contextlib.contextmanager
def about(name):
    """Says what a violation is about."""
    try:
        yield
    except Violation as violation:
        raise Violation(f"{name}: {violation}") from None


def forward(q):
    """base_from_flange for each row of joints (rad)."""
    pose = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for joint in range(6):
        c, s = np.cos(q[:, joint]), np.sin(q[:, joint])
        ca, sa, zero = math.cos(ALPHA[joint]), math.sin(ALPHA[joint]), np.zeros(len(q))
        rows = [
            [c, -s * ca, s * sa, A[joint] * c],
            [s, c * ca, -c * sa, A[joint] * s],
            [zero, zero + sa, zero + ca, zero + D[joint]],
            [zero, zero, zero, zero + 1],
        ]
        pose = pose @ np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return pose


def check_kinematics():
    """Holds `forward` against figures of another program."""
    data = json.loads((ROOT / "fixtures/data/kinematics/ur10e.json").read_text())
    samples = data["samples"]
    poses = forward(np.array([sample["q"] for sample in samples]))
    worst = 0.0
    for pose, sample in zip(poses, samples):
        w, x, y, z = sample["quaternion_wxyz"]
        rotation = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
        worst = max(worst, np.abs(pose[:3, 3] - sample["position_m"]).max(), np.abs(pose[:3, :3] - rotation).max())
    hold(worst <= KINEMATICS, f"forward kinematics: {worst:.1e} from {data['computed_with']}")
    return f"forward kinematics of {len(samples)} poses within {worst:.1e}"


class Cell:
    """The frames of a cell file."""

    def __init__(self, path):
        cell = tomllib.loads(path.read_text())
        self.flange_from_tcp = self.pose(cell["tool"])
        self.part_from_base = np.linalg.inv(self.pose(cell["part"])) @ self.pose(cell["base"])
        self.rate = cell["link"]["rate_hz"]

    @staticmethod
    def pose(section):
        """Turns about the outer frame's x, then y, then z."""
        (cr, sr), (cp, sp), (cy, sy) = [(math.cos(a), math.sin(a)) for a in np.radians(section["rpy_deg"])]
        pose = np.eye(4)
        about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
        about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
        pose[:3, :3] = about_z @ about_y @ about_x
        pose[:3, 3] = np.array(section["xyz_mm"]) * 1e-3
        return pose

    def tcp(self, q):
        """The nozzle's tip in the part frame."""
        return (self.part_from_base @ forward(q) @ self.flange_from_tcp)[:, :3, 3]


class Run:
    """What a run of the program said, what the robot received and what the log has."""

    def __init__(self, name, arguments, folder, timed=False):
        self.name, self.timed = name, timed
        record, log, table = (folder / f"{name.replace(' ', '_')}.{kind}" for kind in ("record", "log", "csv"))
        command = [PROGRAMS / "screed", *arguments, "--json", "--record", record, "--log", log]
        done = subprocess.run(command, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True)
        hold(done.returncode == 0, f"{name}: exit code {done.returncode}: {done.stderr.strip()}")
        self.table = json.loads(done.stdout)
        subprocess.run([PROGRAMS / "screed", "log", log, "--csv", table], check=True)
        self.read_record(record)
        self.read_log(table)
        for file in (record, log, table):
            file.unlink()

    def read_record(self, path):
        """A row for each cycle of the robot."""
        with open(path) as file:
            names = file.readline().strip().split(",")
            rows = np.loadtxt(file, delimiter=",", ndmin=2)
        column = {name: index for index, name in enumerate(names)}
        self.cycle = rows[:, column["cycle"]].astype(int)
        self.timestamp = rows[:, column["timestamp"]]
        self.packages = rows[:, column["packages"]].astype(int)
        self.seq = rows[:, column["seq"]].astype(int)
        first = column["register_0"]
        self.registers = rows[:, first : first + 6]

    def read_log(self, path):
        """A row for each cycle of the link."""
        with open(path, newline="") as file:
            rows = list(csv.DictReader(file))
        joints = [f"commanded_{joint}_rad" for joint in range(1, 7)]
        self.tick = np.array([int(row["tick"]) for row in rows])
        self.robot_timestamp = np.array([float(row["robot_timestamp_s"]) for row in rows])
        self.mode = np.array([row["mode"] for row in rows])
        self.path_seq = np.array([int(row["seq"]) for row in rows])
        self.deposit = np.array([row["deposit"] == "1" for row in rows])
        self.layer = np.array([int(row["layer"]) for row in rows])
        self.flow = np.array([float(row["flow_m3_s"]) for row in rows])
        self.commanded = np.array([[float(row[joint]) for joint in joints] for row in rows])

    def spoilt(self, change):
        """A copy that `change` has laid hands on."""
        other = copy.deepcopy(self)
        change(other)
        return other


class Received:
    """The distinct setpoints that the robot received, in sequence."""

    def __init__(self, run):
        rate = run.table["rate_hz"]
        self.period = 1 / rate
        fresh = run.packages > 0
        self.seq, self.joints = run.seq[fresh], run.registers[fresh]
        self.cycle, self.timestamp = run.cycle[fresh], run.timestamp[fresh]
        hold(len(self.seq) > 100, f"only {len(self.seq)} setpoints received")
        hold(np.isfinite(self.joints).all(), "a setpoint is not finite")
        hold((np.diff(run.cycle) == 1).all(), "the record leaves out cycles")
        hold((np.diff(self.seq) == run.packages[fresh][1:]).all(), "packages and their numbers disagree")
        # Two packages in one cycle of the robot: it never saw the first.
        overtaken = int((run.packages > 1).sum())
        hold(overtaken == 0, f"{overtaken} times a setpoint was overtaken on its way to the robot")
        changed = (np.diff(run.registers, axis=0) != 0).any(axis=1)
        hold(not (changed & ~fresh[1:]).any(), "registers changed without a package")
        self.grid = CYCLE_HZ // rate
        self.late = int((np.diff(self.cycle) != self.grid).sum())
        hold(run.timed or self.late == 0, f"{self.late} setpoints off the grid in virtual time")


def check_table(run, layers):
    """Every waypoint accounted for; returns how the run describes itself."""
    table = run.table
    lines = ["contour of the commanded path", "lag", "contour of the actual path"]
    spreads = [table[key] for key in ("commanded_contour", "following", "actual_contour")]
    for line, spread in zip(lines, spreads):
        hold(spread["samples"] > 0 and math.isfinite(spread["max_m"]) and math.isfinite(spread["rms_m"]), f"no {line}")
    hold(table["outcome"] == "complete", f"outcome {table['outcome']}")
    hold(table["layers"] == [0, layers], f"layers {table['layers']}")
    hold(table["sent"] == table["planned"] > 0, f"{table['sent']} of {table['planned']} waypoints sent")
    hold(table["skipped"] == 0, f"{table['skipped']} waypoints skipped")
    hold(table["unrecorded"] == 0, f"{table['unrecorded']} cycles not recorded")
    own = table["commanded_contour"]["max_m"]
    hold(own <= CONTOUR, f"contour {own} m by its own account")
    if not run.timed:
        hold(table["doubled"] == table["stalls"] == 0, "late cycles in virtual time")


def check_motion(run, cell, received):
    """Speed, acceleration and joint speeds between setpoints that follow each other."""
    period, points = received.period, cell.tcp(received.joints)
    velocity = np.diff(points, axis=0) / period
    speed = np.linalg.norm(velocity, axis=1)
    step = np.linalg.norm(np.diff(velocity, axis=0), axis=1)
    joint_speed = np.abs(np.diff(received.joints, axis=0)) / period / JOINT_VELOCITY
    # The velocity vector changes by no more than the acceleration allows in a period: it never steps.
    acceleration = step / period
    worst = int(np.argmax(acceleration))
    where = f"at setpoint {received.seq[worst + 1]}"
    hold(acceleration.max() <= ACCELERATION * ROUNDING, f"{acceleration.max():.6f} m/s² {where}")
    hold(speed.max() <= VELOCITY * ROUNDING, f"{speed.max():.6f} m/s")
    hold(joint_speed.max() <= 1, f"a joint at {joint_speed.max():.3f} of its highest speed")
    return {"acceleration": acceleration.max(), "speed": speed.max(), "joints": joint_speed.max()}


def check_layer(index, curve, points, halfway, received):
    """The setpoints from the start of the layer's curve to its end follow it, in its time; returns the contour error."""
    to_start, to_end = (np.linalg.norm(points - end, axis=1) for end in (curve.start, curve.end))
    # A dwell would have several setpoints there: the last at the start, the first at the end.
    begin = np.nonzero(to_start <= to_start.min() + 1e-9)[0][-1]
    end = np.nonzero(to_end <= to_end.min() + 1e-9)[0][0]
    where = f"layer {index}"
    for name, nearest in (("start", to_start[begin]), ("end", to_end[end])):
        hold(nearest <= CONTOUR, f"{where}: no setpoint at its {name}, the nearest is {nearest:.2e} m away")
    hold(begin < end, f"{where}: its end comes before its start")
    s, distance, segment = curve.follow(points[begin : end + 1], CONTOUR)
    worst = int(np.argmax(distance))
    number = received.seq[begin + worst]
    hold(distance.max() <= CONTOUR, f"{where}: setpoint {number} is {distance.max():.3e} m from the curve")
    _, between, _ = curve.follow(halfway[begin:end], CONTOUR)
    hold(between.max() <= CONTOUR, f"{where}: {between.max():.3e} m from the curve between two setpoints")
    back = -np.diff(s).min()
    hold(back <= BACKWARD, f"{where}: {back:.3e} m backwards")
    ahead = np.diff(s).max()
    hold(ahead <= VELOCITY * ROUNDING * received.period, f"{where}: {ahead:.3e} m of the curve in one period")
    hold(set(segment) == set(range(len(curve.segments))), f"{where}: segments left out")
    time = (end - begin) * received.period
    hold(abs(time - LAYER_TIME) <= LAYER_TIME_ERROR, f"{where}: {time:.3f} s")
    return max(distance.max(), between.max()), time


def check_layers(run, cell, curves, received):
    points = cell.tcp(received.joints)
    halfway = cell.tcp((received.joints[1:] + received.joints[:-1]) / 2)
    figures = [check_layer(index, curve, points, halfway, received) for index, curve in enumerate(curves)]
    length = sum(curve.length for curve in curves)
    told = run.table["path_length_m"]
    hold(abs(told - length) <= 1e-6, f"path of {told} m, the curves have {length} m")
    return {"contour": max(contour for contour, _ in figures), "times": [time for _, time in figures]}


def check_log(run, curves, received):
    """The log has a row a cycle, what it commands is what the robot received, and its fingerprint is the table's."""
    rate = run.table["rate_hz"]
    hold(len(run.tick) == run.table["cycles"], f"{len(run.tick)} rows, {run.table['cycles']} cycles")
    hold((np.diff(run.tick) == 1).all(), "the log leaves out cycles")
    cycles = np.diff(run.robot_timestamp) * rate
    on_grid = np.abs(cycles - np.round(cycles)) < 1e-3
    hold((on_grid & (np.round(cycles) >= 1)).all(), "stamps of the robot off its grid")
    if not run.timed:
        hold((np.round(cycles) == 1).all(), "the log misses cycles of the robot in virtual time")
    # The first package that the robot has after a row's stamp answers that row.
    sent = np.nonzero(run.mode != "unready")[0]
    first = received.seq[received.timestamp > run.robot_timestamp[sent[0]] + 1e-4][0]
    row_of = received.seq - first
    both = (row_of >= 0) & (row_of < len(sent))
    # The last is on its way when the log ends.
    hold(both.sum() >= len(sent) - 1, f"the robot received {both.sum()} of the {len(sent)} setpoints in the log")
    rows = sent[row_of[both]]
    different = np.nonzero((run.commanded[rows] != received.joints[both]).any(axis=1))[0]
    hold(len(different) == 0, f"{len(different)} rows of the log differ from what the robot received")
    check_waypoints(run)
    moving = np.nonzero(np.isin(rows, np.nonzero(run.mode == "moving")[0]))[0]
    # Periods of the motion in which the robot received nothing new; at its ends one may count differently.
    doubled = round(np.ptp(received.cycle[both][moving]) / received.grid) - (len(moving) - 1)
    told = run.table["doubled"]
    hold(abs(doubled - told) <= run.timed, f"{told} waypoints doubled by its own account, the robot had {doubled} twice")
    for index, curve in enumerate(curves):
        check_flow(run, index, curve)
    hold((run.flow[~run.deposit] == 0).all(), "flow without deposit")


def check_waypoints(run):
    """The log has the plan's waypoints, each once and in order, and its fingerprint is the table's."""
    fresh = np.nonzero(np.diff(run.path_seq, prepend=0) != 0)[0]
    in_order = np.array_equal(run.path_seq[fresh], np.arange(1, len(fresh) + 1))
    planned = run.table["planned"]
    hold(in_order and len(fresh) >= planned, "the log's setpoints are not those of the plan, each once, in order")
    resting = run.commanded[fresh[planned:]] == run.commanded[fresh[planned - 1]]
    hold(resting.all(), "the arm moves after the last waypoint")
    hold(f"{fingerprint(run, fresh[:planned]):016x}" == run.table["hash"], "the log's fingerprint is not the table's")


def check_flow(run, index, curve):
    """A layer's flow lasts as long as the layer and makes its bead."""
    of_layer = run.deposit & (run.layer == index)
    time = of_layer.sum() / run.table["rate_hz"]
    hold(abs(time - LAYER_TIME) <= LAYER_TIME_ERROR, f"layer {index}: deposits for {time:.3f} s by the log")
    volume, expected = run.flow[of_layer].sum() / run.table["rate_hz"], BEAD * curve.length
    in_ml = f"{volume * 1e6:.1f} ml, expected {expected * 1e6:.1f} ml"
    hold(abs(volume - expected) <= 1e-3 * expected, f"layer {index}: {in_ml}")


def fingerprint(run, rows):
    """FNV-1a (64 bit) over sequence number, joints and flow of these rows."""
    parts = np.empty(len(rows), dtype=[("seq", "<u4"), ("joints", "<f8", 6), ("flow", "<f8")])
    parts["seq"], parts["joints"], parts["flow"] = run.path_seq[rows], run.commanded[rows], run.flow[rows]
    value = 0xCBF29CE484222325
    for byte in parts.tobytes():
        value = (value ^ byte) * 0x100000001B3 & 0xFFFFFFFFFFFFFFFF
    return value


def judge(run, cell, curves):
    """All of it; the figures."""
    with about(run.name):
        check_table(run, len(curves))
        received = Received(run)
        figures = check_motion(run, cell, received)
        figures |= check_layers(run, cell, curves, received)
        check_log(run, curves, received)
    return figures | {"setpoints": len(received.seq), "late": received.late}


def spoil_row(run, joint, by):
    row = int(0.3 * len(run.registers))
    same = (run.registers == run.registers[row]).all(axis=1)
    run.registers[same, joint] += by


def bulge(run):
    """Leaves the path by 30 µrad, so slowly that no acceleration shows it."""
    rows = slice(len(run.registers) * 9 // 20, len(run.registers) * 3 // 5)  # of the second layer
    # Only where packages arrive, so that the registers stay as they are in between.
    arrived = np.cumsum(run.packages)[rows]
    share = (arrived - arrived[0]) / (arrived[-1] - arrived[0])
    run.registers[rows, 0] += 3e-5 * np.sin(np.pi * share) ** 2


def lose_package(run):
    row = np.nonzero(run.packages)[0][int(0.4 * run.packages.sum())]
    run.registers[row : row + 4] = run.registers[row - 1]
    run.packages[row], run.seq[row:] = 0, run.seq[row:] - 1


def overtake(run):
    row = np.nonzero(run.packages)[0][1000]
    run.packages[row], run.seq[row:] = 2, run.seq[row:] + 1


def boast(run):
    run.timed = True
    run.table.update(doubled=5)


def dwell(run):
    """One setpoint more, where the tool rests in a corner of the second layer."""
    fresh = np.nonzero(run.packages)[0]
    middle = fresh[len(fresh) * 2 // 5 : len(fresh) // 2]
    moved = np.abs(np.diff(run.registers[middle], axis=0)).max(axis=1)
    row = middle[np.argmin(moved)]
    rows = np.concatenate([np.arange(row + 4), np.arange(row, len(run.cycle))])
    for name in ("packages", "registers"):
        setattr(run, name, getattr(run, name)[rows])
    run.cycle = np.arange(1, len(rows) + 1)
    run.timestamp = run.timestamp[0] + (run.cycle - 1) / CYCLE_HZ
    run.seq = np.cumsum(run.packages)


# What is done to a sound run at 125 Hz, and what the judge must say of it.
SPOILT = [
    ("one setpoint 50 µrad aside", lambda run: spoil_row(run, 0, 5e-5), "m/s²"),
    ("all setpoints aside", lambda run: np.add.at(run.registers, (slice(None), 0), 2e-5), "no setpoint at its"),
    ("a bulge of 30 µrad", bulge, "m from the curve"),
    ("a setpoint not finite", lambda run: spoil_row(run, 3, math.nan), "finite"),
    ("a setpoint too many", dwell, "layer 1: 70.008 s"),
    ("a package lost", lose_package, "off the grid"),
    ("a wrong rate", lambda run: run.table.update(rate_hz=500), "off the grid"),
    ("a joint of the log altered", lambda run: np.add.at(run.commanded, (9000, 2), 1e-15), "differ"),
    ("a flow altered", lambda run: np.add.at(run.flow, 9000, 1e-12), "fingerprint"),
    ("a package overtaken", overtake, "overtaken"),
    ("a late cycle", lambda run: run.table.update(stalls=1), "late cycles"),
    ("doublings that the robot does not know", boast, "doubled by its own account"),
    ("a waypoint skipped", lambda run: run.table.update(skipped=1), "skipped"),
    ("a waypoint not sent", lambda run: run.table.update(sent=run.table["sent"] - 1), "waypoints sent"),
]


def self_test(run, cell, curves):
    """The judge must refuse every spoilt copy of a sound run, for the right reason."""
    cases = [(name, run.spoilt(change), curves, word) for name, change, word in SPOILT]
    backwards = [ifc_curves.Path([segment.reversed() for segment in reversed(curve.segments)]) for curve in curves]
    cases.append(("curves run backwards", run, backwards, "comes before its start"))
    for name, spoilt, against, word in cases:
        try:
            judge(spoilt, cell, against)
        except Violation as violation:
            hold(word in str(violation), f"self-test, {name}: refused for another reason: {violation}")
        else:
            raise Violation(f"self-test: the judge takes a run with {name}")
    return f"{len(cases)} spoilt runs refused"


def show(run, figures):
    table, own = run.table, run.table["commanded_contour"]["max_m"]
    times = ", ".join(f"{time:.2f}" for time in figures["times"])
    print(
        f"{run.name}: {figures['setpoints']} setpoints received, hash {table['hash']}, {table['scheduling']}\n"
        f"  waypoints planned {table['planned']}, sent {table['sent']},"
        f" doubled {table['doubled']}, skipped {table['skipped']}\n"
        f"  late cycles {table['stalls']} of {table['cycles']};"
        f" at the robot {figures['late']} setpoints off the grid\n"
        f"  acceleration {figures['acceleration']:.5f} m/s², speed {figures['speed']:.4f} m/s,"
        f" joints {figures['joints']:.1%} of their limits\n"
        f"  contour {figures['contour'] * 1e6:.3f} µm (by its own account {own * 1e6:.3f} µm), layers {times} s",
        flush=True,
    )


def judge_stop(run, cell, curve):
    """Asked to stop within a layer it comes to rest on the curve, within the limits, in a second, and without flow."""
    hold(run.table["outcome"] == "stopped", f"outcome {run.table['outcome']}")
    received = Received(run)
    figures = check_motion(run, cell, received)
    time = (run.mode == "stopping").sum() / run.table["rate_hz"]
    hold(0 < time <= 1, f"{time:.3f} s to come to rest")
    hold(np.abs(np.diff(received.joints[-2:], axis=0)).max() < 1e-6, "not at rest")
    hold(run.flow[-1] == 0, "flow at rest")
    place = cell.tcp(received.joints[-1:])
    distance = min(segment.project(place)[1][0] for segment in curve.segments)
    hold(distance <= CONTOUR, f"rests {distance:.3e} m from the curve")
    return time, figures["acceleration"], distance


def judge_stops(curve, cell, folder):
    random, figures = np.random.default_rng(2023), []
    for rate in (125, 500):
        for instant in random.uniform(20, 75, 5):
            name, options = f"stop at {instant:.3f} s, {rate} Hz", ["--rate", str(rate), "--for", f"{instant:.3f}"]
            run = Run(name, ["demo", "--layers", "1", "--fast", *options], folder)
            with about(name):
                figures.append(judge_stop(run, cell, curve))
    time, acceleration, distance = np.max(figures, axis=0)
    print(
        f"{len(figures)} stops within a layer: at rest after {time:.3f} s at most,"
        f" acceleration {acceleration:.5f} m/s², {distance * 1e9:.3f} nm from the curve"
    )


def check_pace(run, rate):
    """A hundred thousand paced ticks at 500 Hz; where real time was granted, nothing taken from memory after the start."""
    table = run.table
    hold(rate != 500 or table["cycles"] >= 100_000, f"only {table['cycles']} cycles")
    hold(table["slots_missed"] >= table["overruns"], f"{table['overruns']} overruns, {table['slots_missed']} slots missed")
    memory, wire = table["memory"], table["sensor_to_wire"]
    print(
        f"  overruns {table['overruns']}, slots missed {table['slots_missed']}, counter at most"
        f" {table['overrun_counter_max']}; {memory['allocations']} allocations, page faults"
        f" {memory['faults_minor']} minor, {memory['faults_major']} major\n"
        f"  sensor in to wire out: median {wire['median_us']} µs, p99 {wire['p99_us']} µs, max {wire['max_us']} µs",
        flush=True,
    )
    hold(memory["allocations"] == 0, f"{memory['allocations']} allocations after the start")
    if table["scheduling"] == "real time":
        hold(not any(memory.values()), f"page faults after the start: {memory}")


def judge_demo(timed, folder):
    """The demo at both rates."""
    model = folder / "model.ifc"
    with model.open("wb") as out:
        subprocess.run([PROGRAMS / "screed-fixtures", "quarter-circle"], stdout=out, check=True)
    curves, cell = ifc_curves.Reader(model).layers()[:LAYERS], Cell(DEMO_CELL)
    for rate in (125, 500):
        options = ["demo", "--layers", str(LAYERS), "--rate", str(rate)]
        fast = Run(f"demo {rate} Hz in virtual time", [*options, "--fast"], folder)
        figures = judge(fast, cell, curves)
        if rate == 125:
            print(self_test(fast, cell, curves))
        show(fast, figures)
        if timed:
            run = Run(f"demo {rate} Hz in real time", options, folder, timed=True)
            show(run, judge(run, cell, curves))
            check_pace(run, rate)
            hashes = run.table["hash"], fast.table["hash"]
            hold(hashes[0] == hashes[1], f"{rate} Hz: hash {hashes[0]} in real time, {hashes[1]} in virtual time")
    if not timed:
        judge_stops(curves[0], cell, folder)


def judge_larger_model(folder):
    options = ["print", LARGER_MODEL, "--cell", LARGER_CELL, "--yes", "--fast"]
    run = Run("larger model in virtual time", options, folder)
    show(run, judge(run, Cell(LARGER_CELL), ifc_curves.Reader(LARGER_MODEL).layers()))


def main(arguments):
    if arguments not in ([], ["--timed"]):
        raise SystemExit(__doc__)
    try:
        print(check_kinematics())
        with tempfile.TemporaryDirectory() as name:
            judge_demo(bool(arguments), pathlib.Path(name))
            if not arguments:
                judge_larger_model(pathlib.Path(name))
    except Violation as violation:
        print(f"error: {violation}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
