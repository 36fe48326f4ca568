#!/usr/bin/env python3
"""Holds the kernel's registration against numpy's singular value decomposition.

    .ci/check_registration.py              fresh random cases; the seed is printed
    .ci/check_registration.py --seed N     those of that seed
    .ci/check_registration.py --fixture    prints fixtures/data/registration.json anew (seed in the file)

Needs `pip install numpy` and cargo. Exit code 0: all agree, and a spoilt answer is noticed.
"""

import json
import math
import pathlib
import secrets
import subprocess
import sys

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parent.parent
FIXTURE_SEED = 1988
TOLERANCE = 1e-12  # m, and in the elements of the rotation


def rotation(rng):
    """Uniform (a unit quaternion of normal numbers)."""
    w, x, y, z = (q := rng.normal(size=4)) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


FAMILIES = {
    # name: half sizes of the box of points (m), counts, noise (m), mirrored
    "block": ((1, 0.8, 0.5), (4, 40), 0, False),
    "block, tracker noise": ((1, 0.8, 0.5), (4, 40), 2e-5, False),
    "block, coarse": ((1, 0.8, 0.5), (4, 40), 0.1, False),
    "corner": ((1, 1, 1), (3, 4), 1e-4, False),
    "sheet": ((2, 1, 0), (4, 40), 1e-5, False),
    "rod": ((1, 0.1, 0.05), (4, 40), 1e-5, False),
    "large": ((10, 5, 2), (4, 40), 1e-4, False),
    "mirrored": ((1, 0.6, 0.3), (8, 40), 1e-4, True),
}


def cases(rng, each):
    """(family, outer, inner)"""
    for family, (size, counts, noise, mirrored) in FAMILIES.items():
        for _ in range(each):
            inner = rng.uniform(-1, 1, size=(rng.integers(*counts), 3)) * size + rng.uniform(-3, 3, size=3)
            outer = inner @ rotation(rng).T + rng.uniform(-5, 5, size=3) + rng.normal(size=inner.shape) * noise
            yield family, outer, inner * ([1, 1, -1] if mirrored else [1, 1, 1])


def solve(outer, inner):
    """Umeyama 1991 with numpy: rotation by rows, translation, levers, rms, rms of the mirror image, as one row."""
    q, p = outer - outer.mean(axis=0), inner - inner.mean(axis=0)
    u, sigma, vt = np.linalg.svd(q.T @ p)
    sign = round(np.linalg.det(u) * np.linalg.det(vt))
    rotations = [u @ np.diag([1, 1, s]) @ vt for s in (sign, -sign)]
    s1, s2, s3 = sigma * [1, 1, sign]
    levers = np.sqrt(np.array([s2 + s3, s1 + s3, s1 + s2]) / len(outer))
    rms = [math.sqrt(((q - p @ r.T) ** 2).sum() / len(outer)) for r in rotations]
    return np.concatenate([rotations[0].ravel(), outer.mean(axis=0) - rotations[0] @ inner.mean(axis=0), levers, rms])


def tolerance(answer):
    """Rounding turns the frame about its worst axis by as much more as that lever is shorter, squared."""
    short, _, long = answer[12:15]
    return TOLERANCE * max(1, 0.01 * (long / short) ** 2)


def fixture():
    rng = np.random.default_rng(FIXTURE_SEED)
    rows = []
    for family, outer, inner in cases(rng, 3):
        outer, inner = outer[:8], inner[:8]
        answer = solve(outer, inner)
        rows.append(
            {
                "family": family,
                "in_outer_m": outer.tolist(),
                "in_inner_m": inner.tolist(),
                "rotation": answer[:9].reshape(3, 3).tolist(),
                "translation_m": answer[9:12].tolist(),
                "levers_m": answer[12:15].tolist(),
                "residual_rms_m": answer[15],
                "mirrored_rms_m": answer[16],
                "tolerance": tolerance(answer),
            }
        )
    head = {"computed_with": f"numpy {np.__version__}, .ci/check_registration.py --fixture", "seed": FIXTURE_SEED}
    print("{")
    for key, value in head.items():
        print(f" {json.dumps(key)}: {json.dumps(value)},")
    print(' "cases": [\n  ' + ",\n  ".join(json.dumps(row) for row in rows) + "\n ]\n}")


def check(seed):
    data = list(cases(np.random.default_rng(seed), 500))
    text = "".join(" ".join(repr(float(x)) for x in np.hstack([o, i]).ravel()) + "\n" for _, o, i in data)
    command = ["cargo", "run", "--release", "--quiet", "--locked", "-p", "screed-kernel", "--example", "register"]
    done = subprocess.run(command, cwd=ROOT, input=text, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"the kernel's program failed: {done.stderr}")
    lines = done.stdout.splitlines()
    if len(lines) != len(data):
        sys.exit(f"{len(data)} cases, {len(lines)} answers")
    worst = dict.fromkeys(FAMILIES, 0.0)
    shares = dict.fromkeys(FAMILIES, 0.0)
    compared = 0
    for (family, outer, inner), line in zip(data, lines):
        expected = solve(outer, inner)
        if line.startswith("refused"):
            # Near a line, or round and mirrored: only where numpy's levers say the same.
            if expected[12] > 2e-4 * expected[14]:
                sys.exit(f"{family}: {line}, but the levers are {expected[12:15]}")
            continue
        miss = np.abs(np.array(line.split(), dtype=float) - expected).max()
        compared += 1
        worst[family] = max(worst[family], miss)
        shares[family] = max(shares[family], miss / tolerance(expected))
    for family in FAMILIES:
        print(f"  {family:22} largest difference {worst[family]:.1e}, {shares[family]:.2f} of what is allowed")
    if max(shares.values()) > 1 or compared < 0.99 * len(data):
        sys.exit(f"seed {seed}: the kernel's registration is not numpy's")
    spoilt = solve(data[0][1] + [1e-11, 0, 0], data[0][2])
    if np.abs(spoilt - solve(*data[0][1:])).max() <= tolerance(spoilt):
        sys.exit("a difference of 1e-11 m would not be noticed")
    print(f"{compared} cases as numpy {np.__version__} has them (seed {seed})")


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["--fixture"]:
            fixture()
        case ["--seed", seed]:
            check(int(seed))
        case []:
            check(secrets.randbits(32))
        case _:
            sys.exit(__doc__)
