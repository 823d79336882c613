"""A Request, from the flags of a command line."""

from pathlib import Path

from curriculum.ch3_4_constraints.report import files
from curriculum.ch3_4_constraints.rods.request import Request
from curriculum.common.errors import Refused

MEMORY = 4e9  # bytes of states, at most
STATE = 96  # bytes of a particle: its q and v, and once more where they are computed


def request(args, system, every, knobs):
    """The Request of parsed flags for a system. `every`: the chapter's methods, by name.

    Raises Refused if it cannot be met, or if it would overwrite files that no run has written.
    """
    fits = [name for name, method in every.items() if method.fits(args.integrator)]
    left_out = [name for name in every if name not in fits]
    if args.stabilization != "all":
        if args.stabilization in left_out:
            made_for = every[args.stabilization].integrator
            why = f"{args.stabilization} is made for {made_for}, not for {args.integrator}"
            raise Refused(f"argument --stabilization: {why}")
        fits = [args.stabilization]
        left_out = []
    most = int(MEMORY / (STATE * len(system["m"]) * len(fits)))
    if args.steps > most:
        why = f"{args.steps} steps take more than {MEMORY / 1e9:g} GB; {most} fit"
        raise Refused(f"argument --steps: {why}")
    files.check(args.out)
    return Request(
        scene=args.system,
        system=system,
        seed=args.seed,
        integrator=args.integrator,
        methods=fits,
        left_out=left_out,
        dt=args.dt,
        steps=args.steps,
        knobs=knobs,
        within=args.within,
        plain=args.plain,
        device=args.device,
        page=args.page,
        rerun=args.rerun,
        out=Path(args.out),
        words=args.command,
    )
