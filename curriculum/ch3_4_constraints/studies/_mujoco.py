"""Systems of rods as models of MuJoCo: particles with tendons, or bodies with hinges.

Sites s0, s1, ... are the particles, and s-1, s-2, ... the anchors, as pairs have them. Bodies p0,
p1, ... are where the loads of the particles pull.
"""

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.rods.systems import differences
from curriculum.common.errors import Refused

HARD = 'solref="{} 1" solimp="0.9999 0.9999 0.001 0.5 2"'  # for a constraint; {} is two steps in s
point = "{} {} {}".format  # (3,) as a file has it
AT_ITS_PLACE = '<inertial pos="0 0 0" mass="0" diaginertia="0 0 0"/>'  # of a body that bears a load


def started(system, model_of, constraint, dt, options=""):
    """MuJoCo's model and data of a system at its start, for steps of dt s.

    `model_of` is tendons or linkage, which return the model's parts, as XML, its coordinates in m
    or rad, and their rates. `constraint` and `options` are attributes in XML: of each equality
    constraint, and of the model's options.
    """
    import mujoco

    load = np.zeros_like(system["q0"]) + system.get("load", 0.0)
    known = system["m"] * c.GRAVITY + load
    if not np.allclose(c.external_force(system, system["q0"], np.ones_like(load)), known):
        allowed = "gravity and the system's load"
        raise Refused(f"external_force: MuJoCo's peers have {allowed} only")
    parts, qpos, qvel = model_of(system, constraint)
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
        <option gravity="{point(*c.GRAVITY)}" timestep="{dt}" {options}/>{parts}</mujoco>""")
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    data.qvel[:] = qvel
    for k, force in enumerate(load):
        data.xfrc_applied[model.body(f"p{k}").id, :3] = force
    return model, data


def tendons(system, constraint):
    """Particles that slide along each axis from where they start, and rods as tendons.

    The parts; coordinates, which are 0; and rates (3N,) in m/s.
    """
    slides = "".join(f'<joint type="slide" axis="{x}"/>' for x in ("1 0 0", "0 1 0", "0 0 1"))
    bodies = ""
    ropes = ""
    equalities = ""
    for k, anchor in enumerate(system["anchors"]):
        bodies += f'<site name="s{-1 - k}" pos="{point(*anchor)}"/>'
    for k, (q, m) in enumerate(zip(system["q0"], system["m"][:, 0], strict=True)):
        bob = f'<inertial pos="0 0 0" mass="{m}" diaginertia="1 1 1"/><site name="s{k}"/>'
        bodies += f'<body name="p{k}" pos="{point(*q)}">{slides}{bob}</body>'
    missing = system["lengths"] - c.rod_lengths(system, system["q0"])  # MuJoCo adds it to those
    for k, (i, j) in enumerate(system["pairs"]):
        ropes += f'<spatial name="t{k}"><site site="s{j}"/><site site="s{i}"/></spatial>'
        equalities += f'<tendon tendon1="t{k}" polycoef="{missing[k]} 0 0 0 0" {constraint}/>'
    parts = f"""<worldbody>{bodies}</worldbody>
        <tendon>{ropes}</tendon><equality>{equalities}</equality>"""
    return parts, 0.0, system["v0"].ravel()


def linkage(system, constraint):
    """A body for each rod of a plane system, hinged where its partner is; loops by `connect`.

    The parts; coordinates (C,) in rad, each from the body before; and their rates in rad/s.
    """
    pairs = system["pairs"]
    lengths = system["lengths"]
    share = shares(system)
    turns = turns_of_rods(system)
    first = {}  # {particle: the rod that bears it}
    for k, (i, _) in enumerate(pairs):
        first.setdefault(i, k)
    state = []
    equalities = []

    def body(k, place, near, turn):
        """Rod k along its own x axis, and the rods that hang on its end.

        It begins at a place of the rod before it, which has that turn, with a mass `near`.
        """
        i, _ = pairs[k]
        state.append(turns[k] - turn)
        end = f"{lengths[k]} 0 0"
        if k != first[i]:
            site = f"end{k}"
            rest = ""
            equalities.append(f'<connect site1="{site}" site2="s{i}" {constraint}/>')
        else:
            site = f"s{i}"
            rest = f'<body name="p{i}" pos="{end}">{AT_ITS_PLACE}</body>'
            for other, (_, j) in enumerate(pairs):
                if j == i:
                    rest += body(other, end, share[i], turns[k])
        return f"""<body pos="{place}"><joint type="hinge" axis="0 0 1"/>
            {inertial(near, share[i], lengths[k])}<site name="{site}" pos="{end}"/>{rest}</body>"""

    bodies = ""
    for k, (_, j) in enumerate(pairs):
        if j < 0:
            bodies += body(k, point(*c.anchor(system, j)), 0.0, np.zeros(2))
    parts = f"<worldbody>{bodies}</worldbody><equality>{''.join(equalities)}</equality>"
    return parts, *np.transpose(state)


def shares(system):
    """The mass in kg at the end of each rod that meets in a particle, (N,).

    A particle's mass is shared by those ends, so that the whole moves as the particles would.
    """
    ends = np.ravel(system["pairs"])
    meet = np.bincount(ends[ends >= 0])  # how many rods do, in each particle
    return system["m"][:, 0] / meet


def inertial(near, far, length):
    """Two masses in kg at the ends of a rod, whose length is in m."""
    whole = near + far
    spread = max(near * far / whole * length**2, 1e-14)  # kg m^2
    place = f"{far / whole * length} 0 0"
    return f'<inertial pos="{place}" mass="{whole}" diaginertia="1e-14 {spread} {spread}"/>'


def turns_of_rods(system):
    """How far each rod has turned from the x axis and how fast it turns, (C, 2): rad and rad/s."""
    pairs = system["pairs"]
    x, y, _ = differences(system["q0"], system["anchors"], pairs).T
    x_dot, y_dot, _ = differences(system["v0"], 0.0 * system["anchors"], pairs).T
    rates = (x * y_dot - y * x_dot) / (x * x + y * y)
    return np.stack([np.arctan2(y, x), rates], axis=1)
