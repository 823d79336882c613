"""The texts: what they say a command prints is what it prints."""

import pytest

from curriculum.ch3_4_constraints.studies import figures

# left to figures.py: the studies of speed, whose tables belong to the machine, and a linkage, whose last digits do
QUICK = ("python constraints.py", "exercises.drag", "studies.hard_cases")
LEFT = "--system curriculum"
BLOCKS = [(path, block) for path in figures.TEXTS for block in figures.BLOCK.finditer(path.read_text(encoding="utf-8"))]


@pytest.mark.parametrize(
    ("path", "block"),
    [
        pytest.param(*pair, id=pair[1]["command"])
        for pair in BLOCKS
        if any(word in pair[1]["command"] for word in QUICK) and LEFT not in pair[1]["command"]
    ],
)
def test_a_figure_in_a_text_is_what_its_command_prints(path, block, tmp_path):
    command = block["command"] + (f" --out {tmp_path}" if "constraints.py" in block["command"] else "")
    lines = [figures.machine_free(text) for text in (figures.printed(command), block["body"])]
    found, written = ([line for line in text if not line.startswith(("wrote", "look"))] for text in lines)
    assert found == written


def test_every_text_has_figures():
    assert {path for path, _ in BLOCKS} == set(figures.TEXTS)
