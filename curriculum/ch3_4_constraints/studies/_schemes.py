"""Schemes beside those of the chapter: Gauss's rule as an integrator, and XPBD."""

from functools import partial

import constraints as c
from curriculum.ch3_4_constraints.rods.schemes import Scheme, schemes
from curriculum.ch3_4_constraints.studies.xpbd import xpbd_step
from curriculum.common.gauss import make_gauss

SUBSTEPS = 1, 4, 20  # of XPBD


def wider_chapter():
    """The chapter, with Gauss's rule of order 16 among its integrators."""
    integrators = {**c.INTEGRATORS, "gauss": make_gauss(8)}
    return c.this_chapter()._replace(integrators=integrators)


def all_schemes():
    """The chapter's Schemes, those of Gauss's rule, and XPBD in several sub-steps."""
    found = schemes(wider_chapter(), {})
    for count in SUBSTEPS:
        found.append(Scheme("XPBD", f"x{count}", partial(xpbd_step, substeps=count)))
    return found


def short(integrator):
    """What an integrator is called where there is little room."""
    return integrator.removesuffix("_implicit")
