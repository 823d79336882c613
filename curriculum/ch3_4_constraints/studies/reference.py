"""Where are the particles of a planar pendulum chain, really?  Writes reference.json, the ruler for the simulator.

N = 1, 2, 3 unit rods and unit masses, released at rest; gravity g along -y, pivot at the origin. No rod is a constraint
here: the unknowns are the angles th_i of the rods, counted from +x, so that the lengths cannot drift. Lagrange's
equations for the n-pendulum, with mu_ij = N - max(i, j) the mass that hangs on both rod i and rod j (rods from 0):

    sum_j mu_ij [cos(th_i - th_j) th_j'' + sin(th_i - th_j) th_j'^2] = -g mu_ii cos(th_i)

They are integrated by Taylor series in mpmath: with e_j = exp(i th_j) every term is a product of known series, so each
coefficient follows from the earlier ones by convolution (Jorba and Zou, Experimental Mathematics 14, 2005, for the
recurrences and the choice of the step). The single pendulum needs no integrator (DLMF 22.19(i)): with phi the angle
from straight down, phi_0 at release and k = sin(phi_0 / 2), sin(phi / 2) = k cd(sqrt(g) t, k), where cd is one of
Jacobi's elliptic functions.

"error" in the file is the largest difference in any coordinate, in m, from a second computation: a coarser run with
fewer digits, a lower order and other steps; for the single pendulum, the Taylor series against the closed form.
Storing as double adds at most half a unit in the last place, 2.3e-16 m.
"""

import argparse
import json
import math
from itertools import accumulate
from pathlib import Path

import numpy as np
from mpmath import mp

GRAVITY, SEED = 9.81, 0
TIMES = [0.25 * k for k in range(1, 21)]  # s, exact in binary
FINE, COARSE = 44, 34  # digits asked of one Taylor step; also the order of the series
GUARD = 10  # digits carried beyond those asked, against rounding in the convolutions
TOLERANCE = 1e-14  # m, for --check


def start_angle():
    """Angle of all rods at release, rad: the exact direction of the doubles (c, s) that the simulator starts from."""
    tilt = np.random.default_rng(SEED).uniform(-0.05, 0.05)
    return mp.atan2(math.sin(-tilt), math.cos(-tilt))


def closed_form(digits):
    """Positions [20][1] of the single pendulum, complex x + iy."""
    with mp.workdps(digits + GUARD):
        k = mp.sin((start_angle() + mp.pi / 2) / 2)
        half = [k * mp.ellipfun("cd", mp.sqrt(GRAVITY) * t, k=k) for t in TIMES]  # sin(phi / 2)
        # |phi| stays under pi, hence cos(phi / 2) > 0 and the positive root is the right one
        return [[mp.mpc(2 * s * mp.sqrt(1 - s * s), 2 * s * s - 1)] for s in half]


def convolve(a, b, k):
    """Coefficient k of the product of the series a and b."""
    return mp.fdot(a[: k + 1], b[k::-1])


def taylor(theta, omega, order):
    """Series of the angles and of their rates about now: lists [N][order + 1]."""
    rods = range(len(theta))
    mu = [[len(theta) - max(i, j) for j in rods] for i in rods]
    th, w, e = [[x] for x in theta], [[x] for x in omega], [[mp.expj(x)] for x in theta]
    turn = [[[] for _ in rods] for _ in rods]  # e_i conj(e_j) = cos(th_i - th_j) + i sin(th_i - th_j)
    p = [[] for _ in rods]  # th_j'' - i th_j'^2, so that Re(turn_ij p_j) is the bracket above
    inverse = mp.matrix([[mu[i][j] * (e[i][0] * mp.conj(e[j][0])).real for j in rods] for i in rods]) ** -1
    for k in range(order):
        conj = [[mp.conj(x) for x in e[j]] for j in rods]
        for j in rods:
            p[j].append(mp.mpc(0, -convolve(w[j], w[j], k)))  # th_j'' not known yet: it is what we solve for
        for i in rods:
            for j in rods:
                turn[i][j].append(convolve(e[i], conj[j], k))
        # g times a coefficient first: g * mu_ii would be a product of doubles, rounded to 16 digits
        weight = [mu[i][i] * (GRAVITY * e[i][k]) for i in rods]
        known = [weight[i] + sum(mu[i][j] * convolve(turn[i][j], p[j], k) for j in rods) for i in rods]
        accel = inverse * mp.matrix([-x.real for x in known])
        for j in rods:
            p[j][k] += accel[j]
            th[j].append(w[j][k] / (k + 1))
            e[j].append(1j * convolve(w[j], e[j], k) / (k + 1))
            w[j].append(accel[j] / (k + 1))
    return th, w


def integrate(n, digits):
    """Positions [20][n], complex x + iy, of the chain of n rods, and its largest energy error in J."""
    with mp.workdps(digits + GUARD):
        theta, omega, now = [start_angle()] * n, [mp.zero] * n, mp.zero
        positions, energies = [], [GRAVITY * mp.sin(theta[0]) * n * (n + 1) / 2]
        for t in TIMES:
            while now < t:
                th, w = taylor(theta, omega, digits)
                # the step at which the last two terms kept fall to the digits asked
                reach = [(max(abs(x[k]) for x in w) * mp.mpf(10) ** digits, k) for k in (digits - 1, digits)]
                h = min([t - now] + [size ** (mp.mpf(-1) / k) for size, k in reach if size])
                theta, omega = ([mp.polyval(x[::-1], h) for x in series] for series in (th, w))
                now = t if h == t - now else now + h
            rods = [mp.expj(x) for x in theta]
            positions.append(list(accumulate(rods)))
            velocities = accumulate(1j * x * rod for x, rod in zip(omega, rods, strict=True))
            energies.append(sum(abs(v) ** 2 / 2 for v in velocities) + GRAVITY * sum(z.imag for z in positions[-1]))
        return positions, max(abs(x - energies[0]) for x in energies)


def compute():
    """The whole document; prints one line a case."""
    cases = {}
    for n, name in enumerate(("pendulum", "double", "triple"), 1):
        fine, drift = integrate(n, FINE)
        best, other = (closed_form(FINE), fine) if n == 1 else (fine, integrate(n, COARSE)[0])
        # a wrong term would spoil both runs alike, their difference would not show it; the energy does
        assert drift < 10.0**-COARSE, f"{name}: energy error {mp.nstr(drift, 2)} J"
        gaps = [a - b for row, twin in zip(best, other, strict=True) for a, b in zip(row, twin, strict=True)]
        error = max(max(abs(z.real), abs(z.imag)) for z in gaps)
        positions = [[[float(z.real), float(z.imag)] for z in row] for row in best]
        cases[name] = {"error": float(mp.nstr(error, 2)), "positions": positions}
        print(f"{name:9} error {mp.nstr(error, 2)} m, energy error of the Taylor run {mp.nstr(drift, 2)} J")
    what = "Particle positions (x, y) in m, at each of the times in s, of planar chains of 1, 2, 3 unit rods."
    made_by = "python -m curriculum.ch3_4_constraints.studies.reference"
    return {"what": what, "made_by": made_by, "gravity": GRAVITY, "seed": SEED, "times": TIMES, "cases": cases}


def agree(a, b):
    """Two JSON documents of one structure whose numbers differ by no more than TOLERANCE."""
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(agree(a[key], b[key]) for key in a)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(agree, a, b))
    return a == b or (isinstance(a, float) and isinstance(b, float) and abs(a - b) <= TOLERANCE)


def main(argv=None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Path(__file__).with_name("reference.json")
    parser.add_argument("--out", type=Path, default=default, help="the file to write, or to check (default: beside me)")
    parser.add_argument("--check", action="store_true", help="write nothing; compare, exit 1 beyond 1e-14")
    args = parser.parse_args(argv)
    if args.out.is_dir() or not (args.out.is_file() if args.check else args.out.parent.is_dir()):
        parser.error(f"--out {args.out}: must be a file{'' if args.check else ' in an existing folder'}")
    stored = json.loads(args.out.read_text(encoding="utf-8")) if args.check else None
    document = compute()
    if args.check:
        ok = agree(stored, document)
        print(f"{args.out.name} {'agrees to' if ok else 'DIFFERS by more than'} {TOLERANCE:g}")
        return 0 if ok else 1
    # "]], [[" stands between two samples and nowhere else: one line a sample
    text = json.dumps(document).replace("]], [[", "]],\n[[").replace('"positions": [', '"positions": [\n')
    beside = args.out.with_name(args.out.name + ".part")
    try:
        beside.write_text(text + "\n", encoding="utf-8")
        beside.replace(args.out)
    finally:
        beside.unlink(missing_ok=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
