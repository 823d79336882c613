"""What a run is asked for: a Request, from the flags of a command line."""

import shlex
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from curriculum.ch3_4_constraints.report import files
from curriculum.ch3_4_constraints.rods.chapter import Chapter
from curriculum.ch3_4_constraints.rods.run import conserving
from curriculum.common.errors import Refused

MEMORY = 4e9  # bytes of states, at most
STATE = 96  # bytes of a particle: its q and v, and once more where they are computed


@dataclass(frozen=True)
class Request:
    """A run as its flags ask for it."""

    chapter: Chapter  # whose run it is
    scene: str  # the name or the file of the system
    system: dict
    seed: int
    integrator: str
    methods: list  # names of those that are run
    left_out: list  # names of those that would have been, but are not made for the integrator
    dt: float  # s
    steps: int
    knobs: dict  # of make_methods, {name: value}
    within: float | None  # m: the tolerance of --within
    plain: bool  # whether nothing is to be compiled
    device: str
    page: bool  # whether a page is to be written,
    rerun: bool  # and a recording
    out: Path  # the folder for both, and for metrics.json
    words: list  # the command line

    @cached_property
    def conserves(self):
        """f(q, v): whether external_force does only what energy counts, in states (S, N, 3)."""
        return conserving(self.system, self.chapter.external_force, self.chapter.energy)

    @property
    def name(self):
        """What the scene is called where there is little room."""
        return Path(self.scene).stem

    def command(self, changed):
        """This command line with other flags, {flag: value}; not what it writes.

        So it can be pasted: it is for all methods unless `changed` names one.
        """
        new = {"--out", "--within", "--stabilization", *changed}
        if "--steps" in new:
            new.add("--smoke")
        kept = []
        words = iter(self.words)
        for word in words:
            flag, has_value, _ = word.partition("=")
            if flag not in new:
                kept.append(word)
            elif not has_value and flag != "--smoke":
                next(words)  # its value
        for flag, value in changed.items():
            kept += [flag, value]
        return shlex.join(kept)


def request(args, chapter, system, every, knobs):
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
        chapter=chapter,
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
        out=args.out,
        words=args.command,
    )
