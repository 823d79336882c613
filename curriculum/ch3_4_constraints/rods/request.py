"""What a run is asked for."""

import shlex
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Request:
    """A run as its flags ask for it."""

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
            elif not has_value and flag not in SWITCHES:
                next(words, None)
        for flag, value in changed.items():
            kept += [flag, value]
        return shlex.join(kept)


SWITCHES = {"--smoke", "--plain", "--no-page", "--no-rerun", "--page", "--rerun"}
