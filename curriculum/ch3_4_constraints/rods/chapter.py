"""What a chapter's script gives to those that measure, show and record its runs."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Chapter(NamedTuple):
    """The functions of a script, as its reader has edited them.

    `q` and `v` are (N, 3), in m and m/s; `dt` is in s; a knob is an argument of make_methods.
    """

    gravity: np.ndarray  # (3,) in m/s^2
    integrators: dict  # {name: step(q, v, m, force, dt) -> (q, v)}
    make_methods: Callable  # (dt, **knobs) -> {name: Method}
    stabilized: Callable  # (step, system, method) -> step, which ends with the method's post_step
    external_force: Callable  # (system, q, v) -> (N, 3) in N
    make_force: Callable  # (system) -> force(q, v), (N, 3) in N, under which g-double-dot is 0
    project: Callable  # (system, q_start, q, v, dt) -> (q, v), back on the rods
    energy: Callable  # (system, q, v) -> J
    rod_lengths: Callable  # (system, q) -> (C,) in m
    constraint_violation: Callable  # (system, q) -> m
    tensions: Callable  # (system, q, v, force) -> (C,) in N
