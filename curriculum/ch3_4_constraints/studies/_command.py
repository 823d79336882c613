"""The command line of a study: python -m curriculum.ch3_4_constraints.studies NAME [flags]."""

import argparse
import textwrap

from curriculum.common.cli import Parser


class Preset(argparse.Action):
    """A flag that stands for several; what is given after it counts."""

    def __call__(self, parser, namespace, values, option_string=None):
        vars(namespace).update(self.const)


def study_parser(name, doc, quick=None, **usual):
    """The Parser of the study `name`; `usual`: what else it goes by, as attributes, without flags.

    `quick`: what --quick has instead, of these or of its flags; a study without is quick enough.
    """
    about = "\n\n".join(textwrap.fill(paragraph, 80) for paragraph in doc.split("\n\n"))
    parser = Parser(prog=f"python -m {__package__} {name}", description=about)
    parser.set_defaults(**usual)
    if quick:
        told = "a small one, to see what it prints; its figures mean little"
        parser.add_argument("--quick", action=Preset, nargs=0, const=quick, help=told)
    return parser
