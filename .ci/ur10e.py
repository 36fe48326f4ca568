"""A UR10e's kinematics, for the checks: written for them alone, so that they judge by something else than what they check."""

import math

# UR10e, standard Denavit-Hartenberg, as published by the maker.
D = [0.1807, 0, 0, 0.17415, 0.11985, 0.11655]
A = [0, -0.6127, -0.57155, 0, 0, 0]
ALPHA = [math.pi / 2, 0, 0, math.pi / 2, -math.pi / 2, 0]


def multiply(p, q):
    return [[sum(p[i][k] * q[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def forward(q, tool):
    """base_from_tcp; the tool is straight, so that it adds to the last d."""
    pose = [[float(i == j) for j in range(4)] for i in range(4)]
    for theta, d, a, alpha in zip(q, [*D[:5], D[5] + tool], A, ALPHA):
        c, s, ca, sa = math.cos(theta), math.sin(theta), math.cos(alpha), math.sin(alpha)
        pose = multiply(pose, [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])
    return pose


def rotation(vector):
    """The matrix of a rotation vector, by Rodrigues' formula."""
    angle = math.sqrt(sum(v * v for v in vector))
    x, y, z = (v / angle for v in vector) if angle > 0 else (0, 0, 1)
    c, s, k = math.cos(angle), math.sin(angle), 1 - math.cos(angle)
    return [
        [c + x * x * k, x * y * k - z * s, x * z * k + y * s],
        [y * x * k + z * s, c + y * y * k, y * z * k - x * s],
        [z * x * k - y * s, z * y * k + x * s, c + z * z * k],
    ]


def pose_error(pose, q, tool):
    """How far a pose (m, rotation vector) is from that of the joints: the most of place and elements of the rotation."""
    expected, turned = forward(q, tool), rotation(pose[3:])
    worst = max(abs(pose[i] - expected[i][3]) for i in range(3))
    return max([worst] + [abs(turned[i][j] - expected[i][j]) for i in range(3) for j in range(3)])
