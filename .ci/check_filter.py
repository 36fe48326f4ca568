#!/usr/bin/env python3
"""Holds the kernel's filter against filterpy's ExtendedKalmanFilter (dense, Joseph's form) on a recorded tape.

    .ci/check_filter.py              fresh tapes; the seed is printed
    .ci/check_filter.py --seed N     those of that seed

The tape (kernel/examples/ekf_tape.rs) has inputs and the kernel's results; kinematics and noise are written anew here, in numpy.
Needs `pip install filterpy` and cargo. Exit code 0: all agree, and a spoilt tape is noticed.
"""

import secrets
import subprocess
import pathlib
import sys
from importlib.metadata import version

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

ROOT = pathlib.Path(__file__).resolve().parent.parent
TICKS = 1000
# Of the state in standard deviations, of the covariance in products of two, of the normalised innovation squared as a share.
TOLERANCES = (1e-6, 1e-7, 1e-6)
N = 6
# Of the UR10e, standard Denavit-Hartenberg: a, d (m), alpha (quarters of a turn); published by Universal Robots.
DH = [(0, 0.1807, 1), (-0.6127, 0, 0), (-0.57155, 0, 0), (0, 0.17415, 1), (0, 0.11985, -1), (0, 0.11655, 0)]


def flange(theta):
    """The flange in the base frame as a 4 by 4 matrix, and each joint's axis and a point on it."""
    pose, axes = np.eye(4), []
    for (a, d, quarters), angle in zip(DH, theta):
        axes.append((pose[:3, 2].copy(), pose[:3, 3].copy()))
        c, s = np.cos(angle), np.sin(angle)
        ca, sa = 1 - abs(quarters), quarters
        pose = pose @ [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
    return pose, axes


def turn(rotation):
    """Axis times angle, by the eigenvector of the eigenvalue 1 of the symmetric part where the angle is large."""
    half = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]) / 2
    sine, cosine = np.linalg.norm(half), (np.trace(rotation) - 1) / 2
    angle = np.arctan2(sine, cosine)
    if sine > 1e-3:
        return half * angle / sine
    if cosine > 0:
        return half * (1 + sine**2 / 6)
    sys.exit("a turn of half a circle: not on these tapes")


def matrix(rows):
    return np.vstack([np.reshape(rows, (3, 4)), [0, 0, 0, 1]])


class Peer:
    """filterpy's filter, moved by the lines of a tape."""

    def __init__(self, numbers):
        self.density = numbers[0]
        self.filter = ExtendedKalmanFilter(dim_x=3 * N, dim_z=N)
        self.filter.x = np.array(numbers[1:19])
        self.filter.P = np.diag(np.square(numbers[19:]))

    def predict(self, numbers):
        t, jerk = numbers[0], np.array(numbers[1:])
        m = np.kron(np.diag([1.0, 1.0], 1), np.eye(N))
        gain = [t**3 / 6, t**2 / 2, t]
        white = [[t**5 / 20, t**4 / 8, t**3 / 6], [t**4 / 8, t**3 / 3, t**2 / 2], [t**3 / 6, t**2 / 2, t]]
        self.filter.F = np.eye(3 * N) + t * m + t * t / 2 * m @ m
        self.filter.Q = self.density * np.kron(white, np.eye(N))
        self.filter.B = np.kron(np.reshape(gain, (3, 1)), np.eye(N))
        self.filter.predict(jerk)

    def pose(self, numbers):
        measured, base, mount = (matrix(numbers[12 * k : 12 * k + 12]) for k in range(3))
        deviations = numbers[36:]
        z = np.linalg.inv(base) @ measured

        def expected(x):
            return flange(x[:N])[0] @ mount

        def jacobian(x):
            pose, axes = flange(x[:N])
            target = (pose @ mount)[:3, 3]
            h = np.zeros((N, 3 * N))
            for joint, (axis, point) in enumerate(axes):
                h[:3, joint], h[3:, joint] = np.cross(axis, target - point), axis
            return h

        def residual(z, hx):
            return np.concatenate([z[:3, 3] - hx[:3, 3], turn(z[:3, :3] @ hx[:3, :3].T)])

        # What the pose bends away from its tangent (docs/estimation.md).
        h = jacobian(self.filter.x)
        spread = h @ self.filter.P @ h.T
        way, angle = np.trace(spread[:3, :3]), np.trace(spread[3:, 3:])
        variances = np.repeat(np.square(deviations) + [way * angle / 4, angle**2 / 4], 3)
        return z, jacobian, expected, np.diag(variances), residual

    def direct(self, numbers, first):
        h = np.zeros((N, 3 * N))
        h[:, first : first + N] = np.eye(N)
        noise = np.diag(np.square(numbers[N:]))
        return np.array(numbers[:N]), lambda x: h, lambda x: h @ x, noise, np.subtract

    def update(self, measurement, gate):
        """The normalised innovation squared, and whether it was believed."""
        z, jacobian, expected, noise, residual = measurement
        h, y = jacobian(self.filter.x), residual(z, expected(self.filter.x))
        nis = y @ np.linalg.solve(h @ self.filter.P @ h.T + noise, y)
        if nis <= gate:
            self.filter.update(z, jacobian, expected, R=noise, residual=residual)
        return nis, nis <= gate


def compare(tape):
    """The largest differences, and how many measurements were taken and gated."""
    worst, counts = np.zeros(3), [0, 0]
    peer = measurement = None
    for line in tape.splitlines():
        head, *numbers = line.split()
        numbers = [float(number) for number in numbers]
        match head:
            case "start":
                peer = Peer(numbers)
            case "predict":
                peer.predict(numbers)
            case "pose":
                measurement = peer.pose(numbers)
            case "rates":
                measurement = peer.direct(numbers, N)
            case "encoders":
                measurement = peer.direct(numbers, 0)
            case "verdict":
                taken, nis, gate = numbers
                other, believed = peer.update(measurement, gate)
                if bool(taken) != believed:
                    sys.exit(f"taken by one filter only: NIS {nis} and {other}, gate {gate}")
                counts[not believed] += 1
                worst[2] = max(worst[2], abs(nis - other) / (1 + nis))
            case "state":
                sigma = np.sqrt(np.diag(peer.filter.P))
                worst[0] = max(worst[0], (np.abs(peer.filter.x - numbers) / sigma).max())
            case "covariance":
                sigma = np.sqrt(np.diag(peer.filter.P))
                miss = np.abs(peer.filter.P - np.reshape(numbers, (3 * N, 3 * N))) / np.outer(sigma, sigma)
                worst[1] = max(worst[1], miss.max())
    return worst, counts


def record(noise, seed):
    command = ["cargo", "run", "--release", "--quiet", "--locked", "-p", "screed-kernel", "--example", "ekf_tape", "--"]
    done = subprocess.run([*command, noise, str(seed), str(TICKS)], cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"the kernel's program failed: {done.stderr}")
    return done.stdout


def check(seed):
    for noise in ("tracker", "paper"):
        tape = record(noise, seed)
        worst, (taken, gated) = compare(tape)
        state, covariance, nis = worst
        print(f"  {noise:8} {taken} taken, {gated} gated: state {state:.1e} σ, covariance {covariance:.1e} σσ, NIS {nis:.1e}")
        if not (worst <= TOLERANCES).all() or taken < TICKS or gated == 0 and noise == "tracker":
            sys.exit(f"seed {seed}: the kernel's filter is not filterpy's; at most {TOLERANCES}")
    lines = tape.splitlines()
    last = lines[-1].split()
    spoilt = "\n".join([*lines[:-1], " ".join([last[0], repr(float(last[1]) * (1 + 1e-6)), *last[2:]])])
    if (compare(spoilt)[0] <= TOLERANCES).all():
        sys.exit("a difference of 1e-6 would not be noticed")
    print(f"{TICKS} ticks at either noise as filterpy {version('filterpy')} has them (seed {seed})")


if __name__ == "__main__":
    match sys.argv[1:]:
        case []:
            check(secrets.randbelow(2**32))
        case ["--seed", seed]:
            check(int(seed))
        case _:
            sys.exit(__doc__)
