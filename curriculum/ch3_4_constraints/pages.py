"""A page to touch for each scene, and an index of them:

python -m curriculum.ch3_4_constraints.pages [NAME ...] [--out DIR]
"""

import html
from functools import partial
from pathlib import Path

import constraints as c
from curriculum.ch3_4_constraints.play import page
from curriculum.ch3_4_constraints.scene_files import about
from curriculum.ch3_4_constraints.systems import SceneError
from curriculum.common.cli import Parser, one_of, run_script, writable
from curriculum.common.files import write_together
from curriculum.common.tape import Untraceable

INDEX = "index.html"
# as a default run has them
RULE, DT = "semi_implicit", 0.005  # s
REMEDIES = 20.0, 0.02, 0.95  # w in rad/s, T in s, impedance


def main(argv=None):
    """Write the pages of the scenes that `argv` names, or of all, and an index."""
    told = about(c.SYSTEMS, c.HERE / c.CHAPTER)
    parser = Parser(prog="pages", description=__doc__)
    names = {"nargs": "*", "metavar": "NAME", "type": one_of(told)}
    parser.add_argument("names", **names, help=f"some of {', '.join(told)}")
    folder_type = partial(writable, names=(INDEX,))
    parser.add_argument("--out", type=folder_type, default=Path("outputs/pages"), help="a folder")
    args = parser.parse_args(argv)
    files = {}
    lines = [
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>Scenes to touch</title>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        '<meta name="color-scheme" content="light dark">\n<h1>Scenes to touch</h1>\n<ul>',
    ]
    for name in dict.fromkeys(args.names or told):
        try:
            system = c.build_system(name)
            files[f"{name}.html"] = page(c, name, system, RULE, c.INTEGRATORS[RULE], DT, REMEDIES)
        except (Untraceable, SceneError) as why:
            print(f"{name} left out: {why}")
        else:
            shown, text = html.escape(name), html.escape(told[name])
            lines.append(f'<li><a href="{shown}.html">{shown}</a>: {text}')
    files[INDEX] = "\n".join([*lines, "</ul>\n"])
    write_together(args.out, files)
    count = len(files) - 1
    print(f"wrote {args.out / INDEX} and {count} page{'s' * (count != 1)}")


if __name__ == "__main__":
    run_script(main)
