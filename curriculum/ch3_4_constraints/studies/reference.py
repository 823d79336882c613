"""Where are the particles, really?  Writes reference.json, the truth for the simulator, from angles
alone.

No rod is a constraint here, and nothing has a multiplier: the unknowns are angles, so that no
length can drift.

Chains of N unit rods and masses have an angle th_i a rod, counted from +x. With mu_ij = N - max(i,
j), the mass that hangs on both rod i and rod j (rods from 0), Lagrange's equations are
    sum_j mu_ij [cos(th_i - th_j) th_j'' + sin(th_i - th_j) th_j'^2] = -g mu_ii cos(th_i)
Linkages of one degree of freedom have one angle, th of rod 0. Each particle z after the first is
the third corner of a triangle on two points known before it; dz/dth and its derivative follow from
theirs, as both rods keep their lengths. With M(th) = sum m |dz/dth|^2,
    M th'' + M'/2 th'^2 + sum m g dy/dth = 0

mpmath integrates them by Taylor series, to the digits it is asked for. "error" in the file is the
largest difference in any coordinate, in m, from a second computation with fewer digits. A wrong
term would spoil both alike; the energy shows it, and is kept. Storing as double adds at most half a
unit in the last place.
"""

import json
from itertools import accumulate, pairwise
from pathlib import Path

import constraints as c
from curriculum.common.cli import Parser, run_script
from curriculum.common.files import write_whole

import numpy as np
from mpmath import mp

FILE = Path(__file__).with_name("reference.json")
GRAVITY = mp.mpf(-c.GRAVITY[1].item())
TIMES = [0.25 * k for k in range(1, 21)]  # s, exact in binary
COARSE, FINE = 16, 19  # digits of the two computations
TOLERANCE = 1e-14  # m, for --check


def dot(a, b):
    """a . b of vectors that are complex numbers."""
    return (mp.conj(a) * b).real


def points(array):
    return [mp.mpc(x, y) for x, y, _ in array.tolist()]


def chain(system):
    """Angles at the start, and motion(angles, rates) -> z, dz/dt and the angles' accelerations."""
    n = len(system["q0"])
    mu = [[n - max(i, j) for j in range(n)] for i in range(n)]

    def motion(th, rate):
        e = [mp.expj(x) for x in th]
        turn = [[x * mp.conj(y) for y in e] for x in e]  # cos(th_i - th_j) + i sin(th_i - th_j)
        matrix, right = mp.matrix(n, n), mp.matrix(n, 1)
        for i in range(n):
            right[i] = -mu[i][i] * (GRAVITY * e[i].real)
            for j in range(n):
                matrix[i, j] = mu[i][j] * turn[i][j].real
                right[i] -= mu[i][j] * turn[i][j].imag * rate[j] ** 2
        velocities = accumulate(1j * w * x for w, x in zip(rate, e, strict=True))
        return list(accumulate(e)), list(velocities), list(mp.lu_solve(matrix, right))

    return [mp.arg(b - a) for a, b in pairwise([0, *points(system["q0"])])], motion


def linkage(system):
    """The same for a system whose particle 0 hangs on one rod, each further one on two, to points
    before it."""
    start = points(system["q0"]) + points(system["anchors"])[::-1]  # index -1: the first anchor
    n, m = len(system["q0"]), [mp.mpf(x) for x in system["m"][:, 0].tolist()]
    (_, pivot), *pairs = system["pairs"]
    length, *lengths = map(mp.mpf, system["lengths"].tolist())
    sizes = list(zip(pairs, lengths, strict=True))
    rods = [[(j, size) for (i, j), size in sizes if i == k] for k in range(n)]

    def motion(angle, rate):
        z, (first, second) = start[:], ([mp.zero] * len(start) for _ in range(2))  # d/dth, d2/dth2
        arm = length * mp.expj(angle[0])
        z[0], first[0], second[0] = z[pivot] + arm, 1j * arm, -arm
        for k in range(1, n):
            (a, r), (b, s) = rods[k]
            side = mp.sign(dot(1j * (start[b] - start[a]), start[k] - start[a]))
            base = z[b] - z[a]
            along = (1 + (r**2 - s**2) / dot(base, base)) / 2
            z[k] = z[a] + base * mp.mpc(along, side * mp.sqrt(r**2 / dot(base, base) - along**2))
            p, q = z[k] - z[a], z[k] - z[b]

            def corner(x, y, p=p, q=q):
                """The vector u with p . u = x and q . u = y."""
                return 1j * (y * p - x * q) / dot(1j * p, q)

            first[k] = corner(dot(p, first[a]), dot(q, first[b]))
            spin = [abs(first[k] - first[j]) ** 2 for j in (a, b)]
            second[k] = corner(dot(p, second[a]) - spin[0], dot(q, second[b]) - spin[1])
        terms = list(zip(m, first, second, strict=False))  # of the particles, not the anchors
        pull = sum(w * (rate[0] ** 2 * dot(x, y) + GRAVITY * x.imag) for w, x, y in terms)
        speeds = [rate[0] * x for _, x, _ in terms]
        return z[:n], speeds, [-pull / sum(w * dot(x, x) for w, x, _ in terms)]

    return [mp.arg(start[0] - start[pivot])], motion


def integrate(model, system, digits):
    """Positions (20, N, 2) as numbers of mpmath, and their largest energy error in J."""
    with mp.workdps(digits):
        (start, motion), m = model(system), system["m"][:, 0].tolist()
        n = len(start)

        def rates(_, y):
            return [*y[n:], *motion(y[:n], y[n:])[2]]

        flow = mp.odefun(rates, 0, [*start, *[mp.zero] * n])
        states = [motion(y[:n], y[n:])[:2] for y in map(flow, [0, *TIMES])]
        terms = [zip(m, *state, strict=True) for state in states]
        energy = [sum(w * (abs(v) ** 2 / 2 + GRAVITY * x.imag) for w, x, v in t) for t in terms]
        q = np.array([[(x.real, x.imag) for x in z] for z, _ in states[1:]])
        return q, max(abs(x - energy[0]) for x in energy)


def compute():
    """The whole document; prints a line a case."""
    systems = dict.fromkeys(c.SYSTEMS, chain)
    systems |= dict.fromkeys(("fourbar_coupler", "jansen_leg"), linkage)
    cases = {}
    for name, model in systems.items():
        both = (integrate(model, c.build_system(name), digits) for digits in (COARSE, FINE))
        (coarse, _), (fine, drift) = both
        assert drift < 10.0**-COARSE, f"{name}: energy error {mp.nstr(drift, 2)} J"
        error = float(np.max(np.abs(fine - coarse)))
        cases[name] = {"error": float(f"{error:.1e}"), "positions": fine.astype(float).tolist()}
        print(f"{name:15} error {error:.1e} m, energy error {mp.nstr(drift, 2)} J")
    what = "Particle positions (x, y) in m, at each of the times in s, of the chapter's systems "
    made_by = "python -m curriculum.ch3_4_constraints.studies.reference"
    what = {"what": f"{what}and of two of its scenes.", "made_by": made_by}
    return what | {"times": TIMES, "cases": cases}


def main(argv=None):
    """Write the file, or compare with it; returns 1 if they differ."""
    parser = Parser(prog="reference", description=__doc__.partition("\n\n")[0])
    parser.add_argument("--check", action="store_true", help="compare, exit 1 beyond 1e-14 m")
    check, document = parser.parse_args(argv).check, compute()
    if check:
        stored, gap = json.loads(FILE.read_text(encoding="utf-8"))["cases"], 0.0
        for name, case in document["cases"].items():
            off = np.subtract(stored[name]["positions"], case["positions"])
            gap = max(gap, float(np.max(np.abs(off))))
        print(f"{FILE.name}: largest difference {gap:.1e} m, {TOLERANCE:g} is allowed")
        return int(gap > TOLERANCE)
    # "]], [[" stands between two samples and nowhere else: one line a sample
    text = json.dumps(document).replace("]], [[", "]],\n[[") + "\n"
    text = text.replace('"positions": [', '"positions": [\n')
    write_whole(FILE, lambda aside: aside.write_text(text, encoding="utf-8"))
    return 0


if __name__ == "__main__":
    run_script(main)
