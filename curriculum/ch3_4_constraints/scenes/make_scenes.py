"""Writes scenes whose poses are computed: python -m curriculum.ch3_4_constraints.scenes.make_scenes

Every pose comes from + - * / and square roots, and from `direction` where an angle is given, so
that every machine writes the same bytes. The other scenes stand on whole numbers, and are typed.
"""

import json
from itertools import accumulate
from math import pi, sqrt
from pathlib import Path

from curriculum.ch3_4_constraints.scene_files import direction

SCENES = Path(__file__).resolve().parent
# Theo Jansen's numbers, here in m: each letter is a bar of the leg, a and l place its fixed pivot
BARS = 0.38, 0.415, 0.393, 0.401, 0.558, 0.394, 0.367, 0.657, 0.49, 0.5, 0.619, 0.078, 0.15
JANSEN = dict(zip("abcdefghijklm", BARS, strict=True))


def scene(points, rods, anchors=((0.0, 0.0),)):
    """A planar scene's JSON; a rod is (i, j) or (i, j, published length)."""
    particles = [{"position": (*point, 0.0)} for point in points]
    rods = [{"pair": rod[:2], "length": rod[2]} if rod[2:] else {"pair": rod} for rod in rods]
    return {"anchors": [(*p, 0.0) for p in anchors], "particles": particles, "rods": rods}


def cable(span):
    """Ten unit links between anchors `span` apart in an arc; bisection finds a joint's turn."""

    def right_half(cosine):  # from the lowest link on; the left one is its mirror image
        turn = complex(cosine, sqrt(1.0 - cosine * cosine))
        half = complex(sqrt(0.5 * (1.0 + cosine)), sqrt(0.5 * (1.0 - cosine)))
        return list(accumulate([turn] * 4, lambda link, turn: turn * link, initial=half))

    low, high = 0.0, 1.0
    while low < (middle := 0.5 * (low + high)) < high:
        reach = 2.0 * sum(link.real for link in right_half(middle))
        low, high = (middle, high) if reach < span else (low, middle)
    points = accumulate([z.conjugate() for z in right_half(high)[::-1]] + right_half(high)[:-1])
    rods = [(k, k - 1) for k in range(9)] + [(8, -2)]
    return scene([(z.real, z.imag) for z in points], rods, [(0.0, 0.0), (span, 0.0)])


def tight_cable(links, slack):
    """Unit links hung at rest between anchors in level, their sum longer than the span by `slack`.

    A joint takes its weight from the difference of two tensions: with H their level part, in such
    weights, link k points along (H, k - (links - 1) / 2). Newton's method finds the H for the span,
    from below, where the curve is concave and no step goes too far.
    """
    lifts, level, last = [k - 0.5 * (links - 1) for k in range(links)], 1.0, 0.0
    while level > last:
        last, joints = level, [(sqrt(level * level + y * y), y) for y in lifts]
        missing = links / (1.0 + slack) - sum(level / size for size, _ in joints)
        level += missing / sum(y * y / (size * size * size) for size, y in joints)
    left = list(accumulate(complex(last / size, y / size) for size, y in joints if y < 0.0))
    span = 2.0 * left[-1].real
    points = [(z.real, z.imag) for z in left] + [(span - z.real, z.imag) for z in left[-2::-1]]
    rods = [(k, k - 1) for k in range(links - 1)] + [(links - 2, -2)]
    return scene(points, rods, [(0.0, 0.0), (span, 0.0)])


def ring(n, speed):
    """`n` unit rods from the pivot clockwise and back to it, turning about it at `speed` rad/s."""
    links = [complex(*direction(-(2 * k + 1) * pi / n)[:2]) for k in range(n)]
    points = [(z.real, z.imag) for z in accumulate(links[:-1])]
    turning = scene(points, [(k, k - 1) for k in range(n - 1)] + [(n - 2, -1)])
    for particle, (x, y) in zip(turning["particles"], points, strict=True):
        particle["velocity"] = (-speed * y, speed * x, 0.0)
    return turning


def peaucellier(arm, side, angle):
    """Two arms and a rhombus, whose near corner is led on a circle through the arms' pivot."""
    pivot, (x, y, _) = (0.0, 0.0), direction(angle).tolist()
    near = (1.0 + x, y)
    left, right = meet(pivot, arm, near, side), meet(near, side, pivot, arm)
    points = [near, left, right, (left[0] + right[0] - near[0], left[1] + right[1] - near[1])]
    rods = [(0, -2, 1.0), (1, -1, arm), (2, -1, arm)]
    rods += [(i, j, side) for i, j in ((1, 0), (2, 0), (3, 1), (3, 2))]
    return scene(points, rods, [pivot, (1.0, 0.0)])


def meet(p, r, q, s):
    """The point r away from p and s away from q that lies to the left of the way from p to q."""
    x, y = q[0] - p[0], q[1] - p[1]
    d = sqrt(x * x + y * y)
    along = (r * r - s * s + d * d) / (2.0 * d)
    aside = sqrt(r * r - along * along)
    return p[0] + (along * x - aside * y) / d, p[1] + (along * y + aside * x) / d


def jansen_leg():
    """The leg with its crank up, as mostly drawn: upper triangle to the left, foot below."""
    n, pin, pivot = JANSEN, (0.0, JANSEN["m"]), (-JANSEN["a"], -JANSEN["l"])
    upper, lower = meet(pivot, n["b"], pin, n["j"]), meet(pin, n["k"], pivot, n["c"])
    corner = meet(pivot, n["d"], upper, n["e"])
    ankle = meet(lower, n["g"], corner, n["f"])
    points = [pin, upper, lower, corner, ankle, meet(lower, n["i"], ankle, n["h"])]
    bars = "m 0 -1, j 1 0, b 1 -2, k 2 0, c 2 -2, d 3 -2, e 3 1, f 4 3, g 4 2, h 5 4, i 5 2"
    rods = [(int(i), int(j), n[bar]) for bar, i, j in map(str.split, bars.split(","))]
    return scene(points, rods, [(0.0, 0.0), pivot])


def fourbar_coupler(bar, coupler):
    """Roberts' linkage hanging from its pivots, its tracing point up on the right-hand one."""
    pivot, left = (2.0 * coupler, 0.0), (0.5 * bar, -0.5 * bar * sqrt(3.0))
    right = meet(pivot, bar, left, coupler)
    rods = [(0, -1, bar), (1, -2, bar), (1, 0, coupler), (2, 0, bar), (2, 1, bar)]
    return scene([left, right, meet(left, bar, right, bar)], rods, [(0.0, 0.0), pivot])


MADE = {
    "cable": cable(9.0),
    "tight_cable": tight_cable(12, 0.001),
    "ring": ring(30, 1.0),
    "peaucellier": peaucellier(3.0, 1.5, 1.0),
    "jansen_leg": jansen_leg(),
    "fourbar_coupler": fourbar_coupler(0.4, 0.2),
}


def again(name):
    """The text of a scene's file, a particle or rod a line; the sentence `about` in it is kept."""
    path = SCENES / f"{name}.json"
    about = json.loads(path.read_bytes())["about"] if path.exists() else ""
    fields = [f'"about": {json.dumps(about)}']
    for key, entries in MADE[name].items():
        rows = ",\n  ".join(map(json.dumps, entries))
        fields.append(f'"{key}": [\n  {rows}\n]')
    return "{\n" + ",\n".join(fields) + "\n}\n"


if __name__ == "__main__":
    for name in MADE:
        (SCENES / f"{name}.json").write_bytes(again(name).encode())
