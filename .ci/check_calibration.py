#!/usr/bin/env python3
"""Holds `screed calibrate` against measurements made here, with nothing of Screed's own.

    .ci/check_calibration.py [--seed N]

Needs `pip install numpy` and target/release/screed. Files are written with full digits and read by the program; what it says as JSON is
held against numpy's least squares (frame, tool centre point), against planted frames (target) and against an arm every link of which
was displaced in all six directions (arm), by forward kinematics from the table that the program gives. Exit code 0: all holds.
"""

import json
import os
import pathlib
import secrets
import subprocess
import sys
import tempfile

import numpy as np
from check_registration import rotation, solve

ROOT = pathlib.Path(__file__).resolve().parent.parent
SCREED = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release/screed"

# UR10e, standard Denavit-Hartenberg, as published by the maker: theta, d, a, alpha.
UR10E = [
    [0, 0.1807, 0, np.pi / 2],
    [0, 0, -0.6127, 0],
    [0, 0, -0.57155, 0],
    [0, 0.17415, 0, np.pi / 2],
    [0, 0.11985, 0, -np.pi / 2],
    [0, 0.11655, 0, 0],
]
# A tracker's noise: half the published maximum permissible error; rotation 0.01 degrees.
POSITION, PER_METRE, ROTATION = 7.5e-6, 3e-6, np.radians(0.01)
POSES = 60
ACCURACY = 5e-5  # m


def hold(condition, message):
    if not condition:
        raise SystemExit(f"does not hold: {message}")


def pose(rotation, translation):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix


def small(rng, metres, radians):
    """A displacement in all six directions (Rodrigues)."""
    x, y, z = turn = rng.normal(size=3) * radians
    angle = np.linalg.norm(turn)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    first, second = (np.sin(angle) / angle, (1 - np.cos(angle)) / angle**2) if angle else (1, 0.5)
    return pose(np.eye(3) + first * cross + second * cross @ cross, rng.normal(size=3) * metres)


def link(theta, d, a, sine, cosine):
    c, s = np.cos(theta), np.sin(theta)
    return np.array(
        [[c, -s * cosine, s * sine, a * c], [s, c * cosine, -c * sine, a * s], [0, sine, cosine, d], [0, 0, 0, 1]]
    )


def forward(table, q, displaced=None):
    """base_from_flange of one set of joints; `displaced` comes after each link."""
    result = np.eye(4)
    for k, (theta, d, a, sine, cosine) in enumerate(table):
        result = result @ link(theta + q[k], d, a, sine, cosine)
        if displaced is not None:
            result = result @ displaced[k]
    return result


def nominal():
    return [(theta, d, a, round(np.sin(alpha)), round(np.cos(alpha))) for theta, d, a, alpha in UR10E]


def measured(rng, target, noise):
    """A target's pose as the tracker sees it."""
    sigma = (POSITION + PER_METRE * np.linalg.norm(target[:3, 3])) * noise
    seen = small(rng, 0, ROTATION * noise)[:3, :3] @ target[:3, :3]
    return pose(seen, target[:3, 3] + rng.normal(size=3) * sigma)


def numbers(values):
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def quaternion(matrix):
    """w, x, y, z by the eigenvector of Bar-Itzhack's matrix."""
    r = matrix
    k = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]],
            [r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], r[1, 2] + r[2, 1], r[0, 2] - r[2, 0]],
            [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    x, y, z, w = np.linalg.eigh(k)[1][:, -1]
    return w, x, y, z


def toml_pose(matrix):
    return f"{{ xyz_mm = {numbers(matrix[:3, 3] * 1e3)}, quaternion_wxyz = {numbers(quaternion(matrix[:3, :3]))} }}"


def calibrate(kind, text, folder, code=0):
    """What the program says of a file: JSON, or its complaint."""
    path = folder / f"{kind}.toml"
    path.write_text(text)
    done = subprocess.run([SCREED, "calibrate", kind, path, "--json"], capture_output=True, text=True)
    hold(done.returncode == code, f"calibrate {kind}: exit code {done.returncode}, not {code}: {done.stderr}")
    return json.loads(done.stdout) if code == 0 else done.stderr


def matrix_of(said):
    return pose(np.array(said["rotation"]), np.array(said["translation_m"]))


def check_frame(rng, folder):
    inner = rng.uniform(-1, 1, size=(12, 3))
    outer = inner @ rotation(rng).T + rng.uniform(-3, 3, size=3) + rng.normal(size=inner.shape) * 2e-5
    pairs = [f"[[pair]]\nouter_mm = {numbers(o * 1e3)}\ninner_mm = {numbers(i * 1e3)}\n" for o, i in zip(outer, inner)]
    said = calibrate("frame", 'outer = "tracker"\ninner = "part"\nsigma_um = 20\n' + "".join(pairs), folder)
    expected = solve(outer, inner)
    miss = np.abs(matrix_of(said["outer_from_inner"])[:3] - np.c_[expected[:9].reshape(3, 3), expected[9:12]]).max()
    hold(miss < 1e-12, f"frame: {miss:.1e} from numpy")
    hold(abs(said["fit"]["chi_squared"] - 12 * (expected[15] / 2e-5) ** 2) < 1e-6, "frame: chi squared")
    return f"frame within {miss:.1e} of numpy's"


def check_tcp(rng, folder):
    tip, point = rng.normal(size=3) * 0.2, rng.normal(size=3)
    poses = []
    for _ in range(10):
        turn = small(rng, 0, 0.5)[:3, :3]
        poses.append(pose(turn, point - turn @ tip + rng.normal(size=3) * 5e-5))
    touches = [f"[[touch]]\nflange = {toml_pose(p)}\n" for p in poses]
    said = calibrate("tcp", "sigma_um = 50\n" + "".join(touches), folder)
    design = np.vstack([np.hstack([p[:3, :3], -np.eye(3)]) for p in poses])
    known = np.concatenate([-p[:3, 3] for p in poses])
    expected = np.linalg.lstsq(design, known, rcond=None)[0]
    miss = np.abs(np.array(said["tip_in_flange_m"] + said["point_in_base_m"]) - expected).max()
    hold(miss < 1e-12, f"tcp: {miss:.1e} m from numpy")
    covariance = np.linalg.inv(design.T @ design) * 5e-5**2
    hold(np.abs(said["covariance"] / covariance - 1).max() < 1e-6, "tcp: covariance")
    still = "".join([f"[[touch]]\nflange = {toml_pose(pose(np.eye(3), p[:3, 3]))}\n" for p in poses])
    hold("never turned" in calibrate("tcp", still, folder, code=3), "tcp: a flange that never turns is refused")
    return f"tool centre point within {miss:.1e} m of numpy's"


def cell(rng):
    """tracker_from_base and flange_from_target."""
    return pose(rotation(rng), [3, 1, 0.5]), pose(rotation(rng), [0.15, -0.1, 0.12])


def sights(rng, tracker_from_base, flange_from_target, arm, count, noise):
    """The file's measurements, and the joints."""
    joints = rng.uniform(-1.5, 1.5, size=(count, 6))
    text = 'robot = "ur10e"\n[noise]\n'
    text += f"position_um = {POSITION * 1e6}\nposition_um_per_m = {PER_METRE * 1e6}\nrotation_deg = 0.01\n"
    for q in joints:
        target = measured(rng, tracker_from_base @ arm(q) @ flange_from_target, noise)
        text += f"[[pose]]\njoints_deg = {numbers(np.degrees(q))}\ntarget = {toml_pose(target)}\n"
    return text


def check_target(rng, folder):
    frames = cell(rng)
    arm = lambda q: forward(nominal(), q)
    said = calibrate("target", sights(rng, *frames, arm, 20, 0), folder)
    found = [matrix_of(said["tracker_from_base"]), matrix_of(said["flange_from_target"])]
    exact = max(np.abs(a - b).max() for a, b in zip(found, frames))
    hold(exact < 1e-12, f"target: {exact:.1e} from what was planted")
    said = calibrate("target", sights(rng, *frames, arm, 20, 1), folder)
    found = [matrix_of(said["flange_from_target"]), matrix_of(said["tracker_from_base"])]
    errors = []
    for there, here in zip(frames[::-1], found):
        turn = there[:3, :3] @ here[:3, :3].T
        vector = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
        errors += [there[:3, 3] - here[:3, 3], np.array(vector) / 2]
    errors = np.concatenate(errors)
    squared = errors @ np.linalg.solve(np.array(said["covariance"]), errors)
    # Chi squared with 12 degrees of freedom is larger once in a million runs.
    hold(squared < 50.8, f"target: normalised squared error {squared:.1f} of 12")
    return f"tracker and target exact within {exact:.1e}, with noise at a normalised squared error of {squared:.1f} of 12"


def check_arm(rng, folder):
    frames = cell(rng)
    displaced = [small(rng, 1e-4, 1e-4) for _ in range(6)]
    arm = lambda q: forward(nominal(), q, displaced)

    def tip_error(said):
        """At other poses, of a tip 0.3 m from the target: root mean square (m)."""
        table = [tuple(row[key] for key in ("theta_rad", "d_m", "a_m", "sin_alpha", "cos_alpha")) for row in said["dh"]]
        base, target = matrix_of(said["tracker_from_base"]), matrix_of(said["flange_from_target"])
        tip = np.array([0.2, -0.1, 0.2, 1])
        misses = [
            base @ forward(table, q) @ target @ tip - frames[0] @ arm(q) @ frames[1] @ tip
            for q in rng.uniform(-1.5, 1.5, size=(200, 6))
        ]
        return float(np.sqrt((np.array(misses) ** 2).sum(axis=1).mean()))

    exact = tip_error(calibrate("arm", sights(rng, *frames, arm, POSES, 0), folder))
    hold(exact < 1e-9, f"arm: {exact:.1e} m left without noise")
    said = calibrate("arm", sights(rng, *frames, arm, POSES, 1), folder)
    error = tip_error(said)
    before = float(np.sqrt(np.mean([residual["position_m"] ** 2 for residual in said["residuals_before"]])))
    hold(error < ACCURACY, f"arm: {error:.1e} m left")
    low, high = said["fit"]["noise_ratio_band"]
    ratio = said["fit"]["noise_ratio"]
    # Six standard deviations on either side: this is run again and again.
    hold(abs(ratio - 1) < 1.5 * (high - low), f"arm: residuals {ratio:.3f} times the noise")
    together = {tuple(group["held"]): group["with"] for group in said["cannot_be_told_apart"]}
    hold(together[("d3", "d4")] == ["d2"] and len(together) == 7, f"arm: {together}")
    return f"arm: {before * 1e3:.3f} mm become {error * 1e3:.3f} mm at other poses; {exact:.1e} m without noise"


def main():
    match sys.argv[1:]:
        case ["--seed", seed]:
            seed = int(seed)
        case []:
            seed = secrets.randbits(32)
        case _:
            sys.exit(__doc__)
    print(f"seed {seed}")
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        for check in (check_frame, check_tcp, check_target, check_arm):
            print(check(rng, pathlib.Path(folder)))


if __name__ == "__main__":
    main()
