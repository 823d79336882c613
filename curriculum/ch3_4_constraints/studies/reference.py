"""Where are the particles, really?  Writes reference.json, the truth for the simulator, from angles
alone.

No rod is a constraint here, and nothing has a multiplier: the unknowns are angles, so that no
length can drift. A particle on one rod has that rod's angle from +x for its own. A particle on two
rods, to points known before it, is the third corner of a triangle. What follows for all of them are
dz/dth (a column an angle) and the acceleration z'' at th'' = 0, called h. Then Lagrange's equations
are, with sums over particles of mass m,
    sum m dz/dth_i . (dz/dth_j th_j'' + h + g) = 0,   g = 9.81 m/s^2 up

mpmath integrates them by Taylor series. "error" in the file is the largest difference in any
coordinate, in m, from a second computation with fewer digits. A wrong term would spoil both alike;
the energy shows it, and is kept. Storing as double adds at most half a unit in the last place.
"""

import json

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import REFERENCE, G, study_parser
from curriculum.common.cli import writable
from curriculum.common.files import write_whole
from curriculum.common.progress import work

import numpy as np

NAMES = *c.SYSTEMS, "fourbar_coupler", "jansen_leg"
UP = 1j * G  # points and vectors (x, y) are complex numbers
TIMES = [0.25 * k for k in range(1, 21)]  # s, exact in binary
COARSE, FINE = 16, 19  # digits of the two computations
TOLERANCE = 1e-14  # m, for --check


def dot(a, b):
    """a . b of vectors that are complex numbers."""
    return (a.conjugate() * b).real


def linkage(system):
    """Angles at the start, and motion(angles, rates) -> z, dz/dt and the angles' accelerations."""
    from mpmath import mp

    points = np.concatenate([system["q0"], system["anchors"][::-1]])  # index -1: the first anchor
    start = [mp.mpc(x, y) for x, y, _ in points.tolist()]
    n, m = len(system["q0"]), [mp.mpf(x) for x in system["m"][:, 0].tolist()]
    rods = [[] for _ in range(n)]
    for (i, j), length in zip(system["pairs"], system["lengths"].tolist(), strict=True):
        rods[i].append((j, mp.mpf(length)))
    own = [k for k in range(n) if len(rods[k]) == 1]  # particles with an angle of their own
    angles = range(len(own))

    def motion(th, rate):
        z, speed, h = start[:], [mp.zero] * len(start), [mp.zero] * len(start)
        turn = [[mp.zero for _ in angles] for _ in start]  # dz/dth
        for k in range(n):
            (a, r), *other = rods[k]
            if not other:
                angle = own.index(k)
                arm = r * mp.expj(th[angle])
                z[k], h[k], turn[k] = z[a] + arm, h[a] - rate[angle] ** 2 * arm, turn[a][:]
                turn[k][angle] += 1j * arm
            for b, s in other:
                side = mp.sign(dot(1j * (start[b] - start[a]), start[k] - start[a]))
                base = z[b] - z[a]
                along = (1 + (r**2 - s**2) / dot(base, base)) / 2
                up = side * mp.sqrt(r**2 / dot(base, base) - along**2)
                z[k] = z[a] + base * mp.mpc(along, up)
                p, q = z[k] - z[a], z[k] - z[b]

                def corner(x, y, p=p, q=q):
                    """The vector u with p . u = x and q . u = y."""
                    return 1j * (y * p - x * q) / dot(1j * p, q)

                both = zip(turn[a], turn[b], strict=True)
                turn[k] = [corner(dot(p, x), dot(q, y)) for x, y in both]
            speed[k] = sum(w * x for w, x in zip(rate, turn[k], strict=True))
            for b, _ in other:  # both rods keep their lengths
                spin = [abs(speed[k] - speed[j]) ** 2 for j in (a, b)]
                h[k] = corner(dot(p, h[a]) - spin[0], dot(q, h[b]) - spin[1])
        bodies = list(zip(m, turn, h, strict=False))  # of the particles, not the anchors
        matrix = [[sum(w * dot(x[i], x[j]) for w, x, _ in bodies) for j in angles] for i in angles]
        right = [-sum(w * dot(x[i], y + UP) for w, x, y in bodies) for i in angles]
        return z[:n], speed[:n], list(mp.lu_solve(mp.matrix(matrix), mp.matrix(right)))

    return [mp.arg(start[k] - start[rods[k][0][0]]) for k in own], motion


def integrate(system, digits):
    """Positions (20, N, 2) as numbers of mpmath, and their largest energy error in J."""
    from mpmath import mp

    with mp.workdps(digits):
        (start, motion), m = linkage(system), system["m"][:, 0].tolist()
        n = len(start)

        def rates(_, y):
            return [*y[n:], *motion(y[:n], y[n:])[2]]

        flow = mp.odefun(rates, 0, [*start, *[mp.zero] * n])
        states = [motion(y[:n], y[n:])[:2] for y in map(flow, [0, *TIMES])]
        terms = [zip(m, *state, strict=True) for state in states]
        energy = [sum(w * (abs(v) ** 2 / 2 + dot(UP, x)) for w, x, v in t) for t in terms]
        q = np.array([[(x.real, x.imag) for x in z] for z, _ in states[1:]])
        return q, max(abs(x - energy[0]) for x in energy)


def main(argv=None):
    """Write the file, or compare with it; returns 1 if they differ."""
    quick, about = {"names": NAMES[:1], "check": True}, __doc__.partition("\n\n")[0]
    parser = study_parser("reference", about, quick, names=NAMES)
    parser.add_argument("--check", action="store_true", help="compare, exit 1 beyond 1e-14 m")
    args, cases = parser.parse_args(argv), {}
    if not args.check:
        parser.attempt("--check: without it", writable, str(REFERENCE))
    for name in work.through("digits", args.names):
        (coarse, _), (fine, drift) = (integrate(c.build_system(name), d) for d in (COARSE, FINE))
        assert drift < 10.0**-COARSE, f"{name}: energy error {float(drift):.1e} J"
        error = np.max(np.abs(fine - coarse))
        cases[name] = {"error": float(f"{error:.1e}"), "positions": fine.astype(float).tolist()}
        work.wipe()
        print(f"{name:15} error {error:.1e} m, energy error {float(drift):.1e} J", flush=True)
    if args.check:
        stored = json.loads(REFERENCE.read_text(encoding="utf-8"))["cases"]
        gaps = [np.subtract(stored[name]["positions"], cases[name]["positions"]) for name in cases]
        gap = max(np.max(np.abs(x)) for x in gaps)
        print(f"{REFERENCE.name}: largest difference {gap:.1e} m, {TOLERANCE:g} is allowed")
        return int(gap > TOLERANCE)
    what = "Particle positions (x, y) in m, at each of the times in s, of the chapter's systems "
    document = {"what": f"{what}and of two of its scenes."}
    document["made_by"] = f"python -m {__package__} reference"
    # "]], [[" stands between two samples and nowhere else: one line a sample
    text = json.dumps(document | {"times": TIMES, "cases": cases}).replace("]], [[", "]],\n[[")
    text = text.replace('"positions": [', '"positions": [\n') + "\n"
    write_whole(REFERENCE, text)
    return 0
