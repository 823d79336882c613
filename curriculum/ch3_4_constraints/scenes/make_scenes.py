"""Writes the chapter's hard scenes: python -m curriculum.ch3_4_constraints.scenes.make_scenes

Every pose comes from + - * / and square roots, and from `direction` where an angle is given, so
that every machine writes the same bytes.
"""

import json
from itertools import accumulate, zip_longest
from math import pi, sqrt
from pathlib import Path

from curriculum.ch3_4_constraints.scene_files import direction

SCENES = Path(__file__).resolve().parent
# Theo Jansen's numbers, here in m: each letter is a bar of the leg, a and l place its fixed pivot
BARS = 0.38, 0.415, 0.393, 0.401, 0.558, 0.394, 0.367, 0.657, 0.49, 0.5, 0.619, 0.078, 0.15
JANSEN = dict(zip("abcdefghijklm", BARS, strict=True))


def scene(about, points, rods, anchors=((0.0, 0.0),), more=()):
    """A planar scene's JSON; a rod is (i, j) or (i, j, published length), `more` a dict each."""
    pairs = zip_longest(points, more, fillvalue={})
    particles = [{"position": (*point, 0.0)} | extra for point, extra in pairs]
    rods = [{"pair": rod[:2], "length": rod[2]} if rod[2:] else {"pair": rod} for rod in rods]
    anchors = [(*point, 0.0) for point in anchors]
    return {"about": about, "anchors": anchors, "particles": particles, "rods": rods}


def chain(about, links, x=1.0, y=0.0, more=()):
    """`links` unit rods from the pivot, all in the direction (x, y)."""
    points = [(k * x, k * y) for k in range(1, links + 1)]
    return scene(about, points, [(k, k - 1) for k in range(links)], more=more)


def windows(about, n):
    """`n` square four-bars side by side: n + 1 uprights, each on an anchor, and crossbars."""
    tops, feet = ([(float(k), y) for k in range(n + 1)] for y in (1.0, 0.0))
    rods = [(k, -1 - k) for k in range(n + 1)] + [(k, k - 1) for k in range(1, n + 1)]
    return scene(about, tops, rods, feet, [{"velocity": (1.0, 0.0, 0.0)}] * (n + 1))


def net(about, n):
    """`n` x `n` particles, tied to neighbours, hung by both upper corners: for the benchmark."""
    points = [(float(k % n), -float(k // n)) for k in range(n * n)]
    rods = [(k, k - 1) for k in range(n * n) if k % n] + [(k, k - n) for k in range(n, n * n)]
    return scene(about, points, [*rods, (0, -1), (n - 1, -2)], [(0.0, 1.0), (n - 1.0, 1.0)])


def cable(about, span):
    """Ten unit links between anchors `span` apart in an arc; bisection finds a joint's turn."""
    low, high = 0.0, 1.0  # its cosine
    while low < (middle := 0.5 * (low + high)) < high:
        half = [arc(middle, k).real for k in range(5)]
        low, high = (middle, high) if 2.0 * sum(half) < span else (low, middle)
    links = [arc(high, k) for k in (4, 3, 2, 1, 0)] + [arc(high, k).conjugate() for k in range(4)]
    points = [(z.real, z.imag) for z in accumulate(links)]
    rods = [(k, k - 1) for k in range(9)] + [(8, -2)]
    return scene(about, points, rods, [(0.0, 0.0), (span, 0.0)])


def tight_cable(about, links, slack):
    """Unit links hung at rest between anchors in level, their sum longer than the span by `slack`.

    A joint takes its weight from the difference of two tensions: with H their level part, in
    weights of a joint, link k points along (H, k - (links - 1) / 2). Newton's method finds the H
    for the span, from below, where the curve is concave and no step goes too far.
    """
    lifts = [k - 0.5 * (links - 1) for k in range(links)]
    level, last = 1.0, 0.0
    while level > last:
        last, sizes = level, [sqrt(level * level + y * y) for y in lifts]
        missing = links / (1.0 + slack) - sum(level / size for size in sizes)
        level += missing / sum(y * y / size**3 for y, size in zip(lifts, sizes, strict=True))
    links = [(last / size, y / size) for size, y in zip(sizes, lifts, strict=True)]
    left = list(accumulate(links[: len(lifts) // 2], lambda p, q: (p[0] + q[0], p[1] + q[1])))
    span = 2.0 * left[-1][0]
    points = [*left, *((span - x, y) for x, y in left[-2::-1])]
    rods = [(k, k - 1) for k in range(len(points))] + [(len(points) - 1, -2)]
    return scene(about, points, rods, [(0.0, 0.0), (span, 0.0)])


def arc(cosine, k):
    """Direction x + iy of the link k joints left of the lowest point: half a turn and k turns."""
    turn = complex(cosine, -sqrt(1.0 - cosine * cosine))
    half = complex(sqrt(0.5 * (1.0 + cosine)), -sqrt(0.5 * (1.0 - cosine)))
    return half if k == 0 else turn * arc(cosine, k - 1)


def ring(about, n, speed):
    """`n` unit rods from the pivot clockwise and back to it, turning about it at `speed` rad/s."""
    links = [complex(*direction(-(2 * k + 1) * pi / n)[:2]) for k in range(n)]
    points = [(z.real, z.imag) for z in accumulate(links[:-1])]
    turning = [{"velocity": (-speed * y, speed * x, 0.0)} for x, y in points]
    return scene(about, points, [(k, k - 1) for k in range(n - 1)] + [(n - 2, -1)], more=turning)


def peaucellier(about, arm, side, angle):
    """Two arms and a rhombus, whose near corner is led on a circle through the arms' pivot."""
    pivot, (x, y, _) = (0.0, 0.0), direction(angle).tolist()
    near = (1.0 + x, y)
    left, right = meet(pivot, arm, near, side), meet(near, side, pivot, arm)
    points = [near, left, right, (left[0] + right[0] - near[0], left[1] + right[1] - near[1])]
    rods = [(0, -2, 1.0), (1, -1, arm), (2, -1, arm)]
    rods += [(i, j, side) for i, j in ((1, 0), (2, 0), (3, 1), (3, 2))]
    return scene(about, points, rods, [pivot, (1.0, 0.0)])


def meet(p, r, q, s):
    """The point r away from p and s away from q that lies to the left of the way from p to q."""
    x, y = q[0] - p[0], q[1] - p[1]
    d = sqrt(x * x + y * y)
    along = (r * r - s * s + d * d) / (2.0 * d)
    aside = sqrt(r * r - along * along)
    return p[0] + (along * x - aside * y) / d, p[1] + (along * y + aside * x) / d


def jansen_leg(about):
    """The leg with its crank up, as mostly drawn: upper triangle to the left, foot below."""
    n, pin, pivot = JANSEN, (0.0, JANSEN["m"]), (-JANSEN["a"], -JANSEN["l"])
    upper, lower = meet(pivot, n["b"], pin, n["j"]), meet(pin, n["k"], pivot, n["c"])
    corner = meet(pivot, n["d"], upper, n["e"])
    ankle = meet(lower, n["g"], corner, n["f"])
    points = [pin, upper, lower, corner, ankle, meet(lower, n["i"], ankle, n["h"])]
    bars = "m 0 -1, j 1 0, b 1 -2, k 2 0, c 2 -2, d 3 -2, e 3 1, f 4 3, g 4 2, h 5 4, i 5 2"
    rods = [(int(i), int(j), n[bar]) for bar, i, j in map(str.split, bars.split(","))]
    return scene(about, points, rods, [(0.0, 0.0), pivot])


def fourbar_coupler(about, bar, coupler):
    """Roberts' linkage hanging from its pivots, its tracing point up on the right-hand one."""
    pivot, left = (2.0 * coupler, 0.0), (0.5 * bar, -0.5 * bar * sqrt(3.0))
    right = meet(pivot, bar, left, coupler)
    rods = [(0, -1, bar), (1, -2, bar), (1, 0, coupler), (2, 0, bar), (2, 1, bar)]
    return scene(about, [left, right, meet(left, bar, right, bar)], rods, [(0.0, 0.0), pivot])


# fmt: off
MADE = {
    "long_chain": chain("100 links let go level: a bend runs out along them and the tip cracks like a whip.", 100),
    "heavy_tip": chain("A tonne on links of 1 kg, level: 30 kN make them buzz.", 5, more=[{}] * 4 + [{"mass": 1000.0}]),
    "light_tip": chain("A gram on links of 1 kg, level: A has 1/kg and 1000/kg.", 5, more=[{}] * 4 + [{"mass": 0.001}]),
    "spin": chain("Joint and tip thrown opposite ways: Jdot v is 3600 m^2/s^2 where gravity adds 10, and who leaves "
        "it out loses the rods.", 2, more=[{"velocity": (0.0, y, 0.0)} for y in (30.0, -30.0)]),
    "upright": chain("Balanced on rods that push: the least rounding error sideways would fell it.", 2, 0.0, 1.0),
    "windows": windows("1 degree of freedom, 11 with all bars flat: the N four-bar mechanism of the IFToMM multibody "
        "benchmark (M. Gonzalez et al., Multibody Syst. Dyn. 16 (2006) 179-190), N = 10, its mass at the joints.", 10),
    "braced": scene("A square with both diagonals, hung by a corner: one rod too many, so that A is always singular.",
        [(1.0, 0.0), (0.0, -1.0), (1.0, -1.0)], [(0, -1), (1, -1), (2, 0), (2, 1), (2, -1), (1, 0)]),
    "cable": cable("Ten links in an arc between two anchors, let go: a loop through the ground.", 9.0),
    "tonne": scene("A tonne under a braced square, let go: its weight divides over one rod too many.",
        [(1.0, 0.0), (0.0, -1.0), (1.0, -1.0), (0.5, -2.0)],
        [(0, -1), (1, -1), (2, 0), (2, 1), (2, -1), (1, 0), (3, 1), (3, 2)], more=[{}] * 3 + [{"mass": 1000.0}]),
    "ring": ring("30 links from a joint and back to it, turning about it: waves run round them both ways and meet.",
        30, 1.0),
    "peaucellier": peaucellier("Peaucellier's linkage (1864), let go: its last joint draws a straight line down to the "
        "end of its reach. There arms and rhombus lie in line, two rods too many, and the arms change sides.",
        3.0, 1.5, 1.0),
    "taut_cable": cable("Ten links in a straight line between two anchors: no finite tension holds them up.", 10.0),
    "tight_cable": tight_cable("Twelve links, 0.1 % longer than their span, at rest: level tensions of 76 weights, "
        "and an A with eigenvalues near zero that carry them.", 12, 0.001),
    "jansen_leg": jansen_leg("A leg of Theo Jansen's Strandbeest with his 'holy numbers' (strandbeest.com), 1 kg at "
        "each joint, let go with the crank up: five loops, one degree of freedom."),
    "fourbar_coupler": fourbar_coupler("Roberts' straight-line linkage as in A. B. Kempe, How to Draw a Straight Line "
        "(1877), p. 10, its tracing point last: two loops, and a point that must run level.", 0.4, 0.2),
}
# fmt: on


def text(document):
    """The JSON of a scene, one particle or rod a line."""
    fields = [f'"about": {json.dumps(document["about"])}']
    for key in ("anchors", "particles", "rods"):
        rows = ",\n  ".join(map(json.dumps, document[key]))
        fields.append(f'"{key}": [\n  {rows}\n]')
    return "{\n" + ",\n".join(fields) + "\n}\n"


def main():
    """Write all the files."""
    for name, document in MADE.items():
        (SCENES / f"{name}.json").write_bytes(text(document).encode())


if __name__ == "__main__":
    main()
