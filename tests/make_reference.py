"""Where are the particles, really? Writes reference.json, which the tests compare runs with.

    python -m tests.make_reference            all of it, in some 15 minutes
    python -m tests.make_reference pendulum   one system: print how far the file is from it

No rod is a constraint here, and nothing has a multiplier. The unknowns are angles, so that no
length can drift. A particle on one rod has that rod's angle from +x for its own. A particle on two
rods, to points known before it, is the third corner of a triangle. What follows for all of them are
dz/dth, with a column for each angle, and h, the acceleration z'' where th'' = 0. Then Lagrange's
equations are, with sums over particles of mass m,

    sum m dz/dth_i . (sum_j dz/dth_j th_j'' + h + g) = 0,   g = 9.81 m/s^2 up

mpmath integrates them by Taylor series. "error" in the file is the largest difference of any
coordinate, in m, from a second computation with fewer digits. A wrong term would spoil both alike,
but the energy would show it. To store a number as a double adds at most half a unit of its last
place.
"""

import json
from pathlib import Path

import numpy as np
from mpmath import mp

import constraints as c
from curriculum.common import cli
from curriculum.common.files import write_together

FILE = Path(__file__).with_name("reference.json")
NAMES = *c.CHAINS, "fourbar_coupler", "jansen_leg"
UP = 1j * -float(c.GRAVITY[1])  # points and vectors (x, y) are complex numbers
TIMES = [0.25 * k for k in range(1, 21)]  # s, exact in binary
COARSE = 16  # digits of the one computation
FINE = 19  # and of the other
WHAT = (
    "Particle positions (x, y) in m, at each of the times in s, of the chapter's systems and of "
    "two of its scenes."
)
HOW = (
    f"tests/make_reference.py, with mpmath: Taylor series in joint angles, with {FINE} digits; "
    f"error is the gap to {COARSE} digits, in m"
)


def dot(a, b):
    """a . b of vectors that are complex numbers."""
    return (a.conjugate() * b).real


def corner(p, q, x, y):
    """The vector u with p . u = x and q . u = y."""
    return 1j * (y * p - x * q) / dot(1j * p, q)


class Linkage:
    """A plane system in the angles of those rods that alone bear a particle."""

    def __init__(self, system):
        points = np.concatenate([system["q0"], system["anchors"][::-1]])  # [-1]: the first anchor
        self.points = [mp.mpc(x, y) for x, y, _ in points.tolist()]
        self.m = [mp.mpf(x) for x in system["m"][:, 0].tolist()]
        self.rods = [[] for _ in self.m]  # of each particle, to points before it
        for (i, j), length in zip(system["pairs"], system["lengths"].tolist(), strict=True):
            self.rods[i].append((j, mp.mpf(length)))
        self.own = [k for k, rods in enumerate(self.rods) if len(rods) == 1]
        self.start = []  # the angles
        for k in self.own:
            ((j, _),) = self.rods[k]
            self.start.append(mp.arg(self.points[k] - self.points[j]))

    def motion(self, th, rate):
        """z and dz/dt of all particles, and the accelerations th'' of all angles."""
        z = self.points[:]
        speed = [mp.zero for _ in z]
        h = [mp.zero for _ in z]
        turn = [[mp.zero for _ in th] for _ in z]  # dz/dth
        for k, rods in enumerate(self.rods):
            if len(rods) == 1:
                ((j, length),) = rods
                angle = self.own.index(k)
                arm = length * mp.expj(th[angle])
                z[k] = z[j] + arm
                turn[k] = turn[j][:]
                turn[k][angle] += 1j * arm
                h[k] = h[j] - rate[angle] ** 2 * arm
                speed[k] = along(rate, turn[k])
            else:
                (a, _), (b, _) = rods
                z[k] = self.third_corner(k, z)
                p = z[k] - z[a]
                q = z[k] - z[b]
                for angle in range(len(th)):  # both rods keep their lengths
                    x = dot(p, turn[a][angle])
                    y = dot(q, turn[b][angle])
                    turn[k][angle] = corner(p, q, x, y)
                speed[k] = along(rate, turn[k])
                x = dot(p, h[a]) - abs(speed[k] - speed[a]) ** 2
                y = dot(q, h[b]) - abs(speed[k] - speed[b]) ** 2
                h[k] = corner(p, q, x, y)
        n = len(self.m)
        return z[:n], speed[:n], self.accelerations(turn, h)

    def third_corner(self, k, z):
        """Where particle k is on its two rods, on the side where it began."""
        (a, r), (b, s) = self.rods[k]
        at_start = self.points
        side = mp.sign(dot(1j * (at_start[b] - at_start[a]), at_start[k] - at_start[a]))
        base = z[b] - z[a]
        share = (1 + (r**2 - s**2) / dot(base, base)) / 2
        up = side * mp.sqrt(r**2 / dot(base, base) - share**2)
        return z[a] + base * mp.mpc(share, up)

    def accelerations(self, turn, h):
        """th'', by Lagrange's equations."""
        angles = range(len(self.own))
        matrix = mp.zeros(len(angles))
        right = mp.zeros(len(angles), 1)
        for k, m in enumerate(self.m):
            for i in angles:
                right[i] -= m * dot(turn[k][i], h[k] + UP)
                for j in angles:
                    matrix[i, j] += m * dot(turn[k][i], turn[k][j])
        return list(mp.lu_solve(matrix, right))

    def energy(self, z, speed):
        """In J."""
        terms = zip(self.m, z, speed, strict=True)
        return sum(m * (abs(v) ** 2 / 2 + dot(UP, x)) for m, x, v in terms)


def along(rate, turn):
    """dz/dt of a particle, from the angles' rates and its dz/dth."""
    return sum(w * x for w, x in zip(rate, turn, strict=True))


def integrate(system, digits):
    """Positions (20, N, 2) as numbers of mpmath, and their largest energy error in J."""
    with mp.workdps(digits):
        linkage = Linkage(system)
        n = len(linkage.start)

        def rates(_, y):
            _, _, acceleration = linkage.motion(y[:n], y[n:])
            return [*y[n:], *acceleration]

        flow = mp.odefun(rates, 0, [*linkage.start, *[mp.zero] * n])
        places = []
        energies = []
        for t in [0, *TIMES]:
            y = flow(t)
            z, speed, _ = linkage.motion(y[:n], y[n:])
            places.append([(x.real, x.imag) for x in z])
            energies.append(linkage.energy(z, speed))
        return np.array(places[1:]), max(abs(x - energies[0]) for x in energies)


def case(name):
    """What the file says of a system: {"error": m, "positions": (20, N, 2) in m}."""
    system = c.build_system(name)
    coarse, _ = integrate(system, COARSE)
    fine, drift = integrate(system, FINE)
    if drift > 10.0**-COARSE:
        raise ArithmeticError(f"{name}: the energy is off by {float(drift):.1e} J")
    error = np.max(np.abs(fine - coarse))
    print(f"{name:15} error {float(error):.1e} m, energy error {float(drift):.1e} J", flush=True)
    return {"error": float(f"{float(error):.1e}"), "positions": fine.astype(float).tolist()}


def as_text(cases):
    """The file: a line for each of the times."""
    text = json.dumps({"what": WHAT, "made_by": HOW, "times": TIMES, "cases": cases})
    text = text.replace("]], [[", "]],\n[[")  # which stands between two times only
    return text.replace('"positions": [', '"positions": [\n') + "\n"


def main():
    """Write the file, or compare it with the systems that are named."""
    parser = cli.Parser(__doc__)
    parser.usage = "%(prog)s [NAME ...]"
    help_text = f"compare the file with these only: {', '.join(NAMES)}"
    parser.add_argument("names", nargs="*", metavar="NAME", help=help_text)
    args = parser.parse_args()
    for name in args.names:
        if name not in NAMES:
            parser.error(f"there is no {name!r}: choose from {', '.join(NAMES)}")
    cases = {name: case(name) for name in args.names or NAMES}
    if not args.names:
        write_together(FILE.parent, {FILE.name: as_text(cases)})
        return 0
    stored = json.loads(FILE.read_text(encoding="utf-8"))["cases"]
    for name, made in cases.items():
        gap = np.max(np.abs(np.subtract(stored[name]["positions"], made["positions"])))
        print(f"{name:15} {FILE.name} is off by {gap:.1e} m")
    return 0


if __name__ == "__main__":
    cli.run_script(main)
