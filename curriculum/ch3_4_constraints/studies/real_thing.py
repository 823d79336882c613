"""What do engines do with a rod?  MuJoCo's names for what we compute, and other engines' rows.

(a) `soft` is MuJoCo's equality constraint of a tendon: each quantity of a chain at one state, and
the largest gap. (b) Who has Jdot v: MuJoCo's `connect` has, its tendon has not. (c) Box2D, Jolt and
Drake as rows of `stabilizations`, read in their sources, each solved exactly here; and XPBD.
"""

from functools import partial
from importlib.util import find_spec

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.solving import solve
from curriculum.ch3_4_constraints.xpbd import xpbd_step
from curriculum.common import cli

DT = 0.005  # s
M_G_L = -4.0 * c.GRAVITY[1]  # J, of the double pendulum
WIDTH = 35  # columns


# --- (a) the same quantity, two names ---
def random_chain(rng, count):
    """A chain of `count` rods, its particles a few per cent off the rods and moving anyhow."""
    unit, lengths = rng.normal(size=(count, 3)), rng.uniform(0.5, 2.0, count)
    off = lengths * (1.0 + 0.03 * rng.normal(size=count))
    d = unit / np.linalg.norm(unit, axis=1, keepdims=True) * off[:, None]
    return {
        "q0": np.cumsum(d, axis=0),
        "v0": rng.normal(size=(count, 3)),
        "m": rng.uniform(0.3, 3.0, (count, 1)),
        "pairs": [(k, k - 1) for k in range(count)],
        "lengths": lengths,
    }


def ours(system):
    """[(what it is called here, MuJoCo's field, its value)] of `soft`.

    MuJoCo's row of J is ours over |d|, and its force ours times |d|: in newtons.
    """
    q, v = system["q0"], system["v0"]
    soft = c.stabilizations(DT)["soft"]
    jac, _, gdot, _ = c.constraint_terms(system, q, v)
    _, A, _ = c.constraint_equation(system, q, v, soft)  # the regularization included
    size, error = c.rod_lengths(system, q), c.rod_errors(system, q)
    share = soft.regularization / (1.0 + soft.regularization)  # of A's diagonal
    target = -soft.damping * gdot / size - soft.stiffness * error
    a = c.make_force(system, soft)(q, v) / system["m"]
    return [
        ("J / |d|", "efc_J", jac / size[:, None]),
        ("|d| - L", "efc_pos", error),
        ("gdot / |d|", "efc_vel", gdot / size),
        ("-(damping gdot + stiffness g) / |d|", "efc_aref", target),
        ("regularization diag A / |d|^2", "efc_R", share * np.diag(A) / size**2),
        ("lambda |d|", "efc_force", -c.tensions(system, q, v, soft)),
        ("acceleration", "qacc", a.ravel()),
    ]


def mujoco_data(xml, qpos, qvel):
    """MuJoCo's data of a model at one state, all computed."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(f"<mujoco>{xml}</mujoco>")
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(model, data)
    return data


def mujoco_tendons(system):
    """MuJoCo's data of the same state: particles that slide along three axes, rods as tendons."""
    slides = "".join(f'<joint type="slide" axis="{x}"/>' for x in ("1 0 0", "0 1 0", "0 0 1"))
    bodies, ropes, equal = '<site name="s-1"/>', "", ""
    for k, (m, length) in enumerate(zip(system["m"][:, 0], system["lengths"], strict=True)):
        bob = f'<inertial pos="0 0 0" mass="{m}" diaginertia="1 1 1"/><site name="s{k}"/>'
        bodies += f"<body>{slides}{bob}</body>"
        ropes += f'<spatial name="t{k}"><site site="s{k - 1}"/><site site="s{k}"/></spatial>'
        equal += f'<tendon tendon1="t{k}" polycoef="{length} 0 0 0 0" '
        equal += 'solref="0.02 1" solimp="0.95 0.95 0.001 0.5 2"/>'
    xml = f"""
        <option gravity="0 {c.GRAVITY[1]} 0" timestep="{DT}" tolerance="0" jacobian="dense"/>
        <worldbody>{bodies}</worldbody>
        <tendon>{ropes}</tendon><equality>{equal}</equality>"""
    return mujoco_data(xml, system["q0"].ravel(), system["v0"].ravel())


def same_names():
    """Print each quantity of a chain, and how far the two are apart."""
    system = random_chain(np.random.default_rng(0), 3)
    data = mujoco_tendons(system)
    print(f"(a) {'ours':{WIDTH - 4}}  MuJoCo's   largest gap, relative")
    for name, field, x in ours(system):
        its = getattr(data, field).reshape(x.shape)
        print(f"{name:{WIDTH}}  {field:10} {np.abs(x - its).max() / np.abs(x).max():.1e}")


# --- (b) who has Jdot v ---
def beyond_the_spring(data):
    """What efc_aref has beside MuJoCo's spring, -B vel - K I pos, in m/s^2, of each row."""
    k, b, impedance, _ = data.efc_KBIP.reshape(-1, 4).T
    return data.efc_aref + b * data.efc_vel + k * impedance * data.efc_pos


def who_has_jdotv():
    """Print how much of Jdot v MuJoCo's connect asks for, at the end of a turning arm, and tendons.

    The arm is 1 m long, and its end is connected to the point (1, 0, 0).
    """
    xml = """
        <worldbody>
          <site name="a" pos="1 0 0"/>
          <body>
            <joint type="hinge" axis="0 0 1"/><site name="b" pos="1 0 0"/>
            <inertial pos="1 0 0" mass="1" diaginertia="1 1 1"/>
          </body>
        </worldbody>
        <equality><connect site1="b" site2="a"/></equality>"""
    angle, rate = 1.0, 3.0  # rad, rad/s
    jdotv = -(rate**2) * np.array([np.cos(angle), np.sin(angle), 0.0])  # towards the hinge
    share = -beyond_the_spring(mujoco_data(xml, angle, rate)) @ jdotv / (jdotv @ jdotv)
    chain = mujoco_tendons(random_chain(np.random.default_rng(0), 3))
    tendon = np.abs(beyond_the_spring(chain)).max()
    print(f"(b) Jdot v: connect has {100.0 * share:.10g} % of it, a tendon {tendon:.0e} m/s^2")


# --- (c) other engines' rods ---
def velocity_sweep(system, q_start, q, v, dt):
    """Box2D's second sweep: J v = 0, and q stays."""
    m = np.repeat(system["m"], 3)
    jac, _, gdot, _ = c.constraint_terms(system, q, v)
    nu = solve(system, (jac / m) @ jac.T, gdot)
    return q, v - (jac.T @ nu / m).reshape(q.shape)


def position_sweeps(system, q_start, q, v, dt):
    """Jolt's sweeps over positions: two times a fifth of the error is taken back, v stays."""
    m = np.repeat(system["m"], 3)
    for _ in range(2):
        jac, _, _, _ = c.constraint_terms(system, q, v)
        error = c.rod_lengths(system, q) * c.rod_errors(system, q)
        mu = solve(system, (jac / m) @ jac.T, 0.2 * error)
        q = q - (jac.T @ mu / m).reshape(q.shape)
    return q, v


def engines(h):
    """{engine at a tag: its row}, for steps (of Box2D: sub-steps) of h s.

    All work at velocity level, as `impulse` does: J v_next = -bias g - regularization lambda.
    """
    w = 2.0 * np.pi * min(60.0, 0.25 / h)  # rad/s; Box2D v3.1.1, src/joint.c, b2PrepareJoint
    stiff = w / (4.0 + h * w)  # 1/s; src/solver.h, b2MakeSoft, damping ratio 2
    level = partial(c.Stabilization, use_jdotv=0.0, damping=1.0 / h)
    return {
        "ours, impulse": c.stabilizations(h)["impulse"],
        "Box2D v3.1.1": level(  # src/distance_joint.c, b2SolveDistanceJoint
            stiffness=stiff / h, regularization=stiff / (h * w * w), post_step=velocity_sweep
        ),
        "Jolt v5.5.0": level(post_step=position_sweeps),  # ConstraintPart/AxisConstraintPart.h
        "Drake v1.56.0": level(  # contact_solvers/sap/sap_holonomic_constraint.cc, beta = 0.1
            stiffness=0.5 / (h * h), regularization=0.01 / (4.0 * np.pi**2)
        ),
        "ours, soft (MuJoCo)": c.stabilizations(h)["soft"],
    }


def rows(steps):
    """Print each engine's row, and what it makes of the double pendulum; XPBD has none."""
    system, made = c.build_system("double"), {}
    for name, row in engines(DT).items():
        step = c.stabilized(c.semi_implicit_step, system, row)
        run = c.simulate(step, system, c.make_force(system, row), DT, steps)
        cells = DT * row.damping, DT * DT * row.stiffness, row.regularization
        made[name] = "{:9.2g} {:13.2g} {:14.2g}".format(*cells), run
    for substeps in 1, 20:

        def step(q, v, m, force, dt, substeps=substeps):
            return xpbd_step(system, q, v, dt, substeps)

        made[f"XPBD x{substeps}"] = "", c.simulate(step, system, None, DT, steps)
    print(
        f"(c) rows for h = {DT} s, and what each makes of {DT * steps:g} s of the double pendulum"
    )
    print(f"{'':20}h damping h^2 stiffness regularization rods, mm energy, %")
    for name, (cells, run) in made.items():
        off = np.abs(run.energies - run.energies[0]).max() / M_G_L
        print(f"{name:20}{cells:38} {1e3 * run.violations.max():8.2g} {100.0 * off:9.2g}")


def main(argv=None):
    """Print the tables."""
    parser = cli.Parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="(c) over 2 s")
    args = parser.parse_args(argv)
    if find_spec("mujoco"):
        try:
            same_names()
            who_has_jdotv()
        except Exception as why:
            print(f"failed: {why}")
    else:
        print("mujoco is not installed and left out: pip install -e '.[peers]'")
    rows(400 if args.quick else 4000)
