from curriculum.ch3_4_constraints.studies import xpbd

substep = xpbd.xpbd_step  # the chapter's: it takes one sub-step, unless it is told more
