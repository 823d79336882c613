"""A four-bar in its flat pose: of two ways on, a coupler that is a little longer leaves only one.

Two cranks of CRANK m turn about anchors GROUND m apart, and a coupler ties their ends. Were it as
long as GROUND, the cranks could stay parallel or cross each time all rods are in one line. It is
longer, and they have to cross.
"""

from functools import partial
from importlib.util import find_spec

import numpy as np

import constraints as c
from curriculum.common.tracing import fori_loop, vmap

CRANK, GROUND = 1.0, 0.5  # m
EXTRA = 1e-2, 1e-3, 1e-4, 1e-5  # m, of the coupler beyond GROUND
DT, SECONDS, STARTS = 0.005, 2.0, 100
WRONG = 0.1  # the sine of an angle in which a crank is clearly on the other side


def four_bar(extra):
    """The system without a start: q, v (2, 3) are of the ends of the two cranks."""
    return {
        "m": np.ones((2, 1)),
        "pairs": [(0, -1), (1, 0), (1, -2)],
        "lengths": np.array([CRANK, GROUND + extra, CRANK]),
        "anchors": np.array([[0.0, 0.0, 0.0], [GROUND, 0.0, 0.0]]),
    }


def second_angle(first, extra):
    """The second crank's angle in rad for the first's (K,), by the triangle with the coupler.

    The arccos stays above 0 and below pi if `extra` is above 0. So, seen from the second anchor,
    the second crank is always to the right of the first one's end: that is the only way.
    """
    x, y = CRANK * np.cos(first) - GROUND, CRANK * np.sin(first)
    far, coupler = np.hypot(x, y), GROUND + extra
    cosine = (far * far + CRANK * CRANK - coupler * coupler) / (2.0 * far * CRANK)
    return np.arctan2(y, x) - np.arccos(cosine)


def ends(first, second):
    """Where cranks at these angles (K,) end: (K, 2, 3) in m."""
    angles = np.stack([first, second], axis=-1)
    q = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=-1)
    return CRANK * q + four_bar(0.0)["anchors"]


def to_the_left(q):
    """The sine (...) of the angle from the first end to the second, seen from the second anchor."""
    q = q - np.array([GROUND, 0.0, 0.0])
    (x1, y1), (x2, y2) = (q[..., 0, 0], q[..., 0, 1]), (q[..., 1, 0], q[..., 1, 1])
    return (x1 * y2 - y1 * x2) / np.sqrt((x1 * x1 + y1 * y1) * (x2 * x2 + y2 * y2))


def shares_right(step, first):
    """For each EXTRA the share of starts at rest that step(system, q, v, dt) takes right.

    `first` (K,): the first crank's angle in rad.
    """

    def noted(q, v, extra, most):
        q, v = step(four_bar(extra), q, v, DT)
        return q, v, extra, np.maximum(most, to_the_left(q))

    q = np.concatenate([ends(first, second_angle(first, extra)) for extra in EXTRA])
    extra, most = np.repeat(EXTRA, len(first)), np.full(len(q), -1.0)
    *_, most = fori_loop(round(SECONDS / DT), vmap(noted), q, np.zeros_like(q), extra, most)
    return np.mean(most.reshape(len(EXTRA), -1) < WRONG, axis=1)  # which NaN is not


def mujoco_model(extra):
    """Hinges, and the coupler's end at the second crank's by `connect`.

    Half of a mass of 1 kg is at the end of its crank, the other half at that of the coupler.
    """
    import mujoco

    coupler = GROUND + extra
    hinge = '<joint type="hinge" axis="0 0 1"/>'
    crank = f'{hinge}<inertial pos="{CRANK} 0 0" mass="0.5" diaginertia="1e-9 1e-9 1e-9"/>'
    spread = coupler * coupler / 4.0  # kg m^2
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
        <option gravity="0 {c.GRAVITY[1]} 0" timestep="{DT}"/>
        <worldbody>
          <body>{crank}
            <body pos="{CRANK} 0 0">{hinge}<site name="a" pos="{coupler} 0 0"/>
              <inertial pos="{coupler / 2} 0 0" mass="1" diaginertia="1e-9 {spread} {spread}"/>
            </body>
          </body>
          <body pos="{GROUND} 0 0">{crank}<site name="b" pos="{CRANK} 0 0"/></body>
        </worldbody>
        <equality><connect site1="a" site2="b"/></equality></mujoco>""")


def mujoco_shares_right(first):
    """The same of MuJoCo."""
    import mujoco
    from mujoco.rollout import rollout

    shares = []
    for extra in EXTRA:
        model, second = mujoco_model(extra), second_angle(first, extra)
        d = np.diff(ends(first, second), axis=1)[:, 0]
        start = np.zeros((len(first), 1 + model.nq + model.nv))  # the time, angles, their rates
        start[:, 1:4] = np.stack([first, np.arctan2(d[:, 1], d[:, 0]) - first, second], axis=-1)
        state, _ = rollout(model, mujoco.MjData(model), start, nstep=round(SECONDS / DT))
        shares.append(np.mean(to_the_left(ends(state[..., 1], state[..., 3])).max(axis=1) < WRONG))
    return shares


def show(steps):
    """Print the share of STARTS that each step of {title: step} takes right."""
    first = np.random.default_rng(0).uniform(0.3, 1.2, STARTS)  # rad: above, to fall to the right
    print(f"\nfour-bar, {SECONDS:g} s by {DT:g} s: % of {STARTS} starts that cross where they must")
    print(f"{'the coupler is longer by':24}" + "".join(f"{1e3 * x:8g} mm" for x in EXTRA))
    rows = {title: partial(shares_right, step) for title, step in steps.items()}
    if find_spec("mujoco"):
        rows["MuJoCo connect"] = mujoco_shares_right
    else:
        print("mujoco is not installed and left out: pip install -e '.[peers]'")
    for title, shares in rows.items():
        print(f"{title:24}", end="", flush=True)
        try:
            print("".join(f"{100.0 * x:11.0f}" for x in shares(first)))
        except Exception as why:
            print(f"   failed: {why}")
