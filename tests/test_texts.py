"""The texts: what they say a command prints is what it prints, and what they point to is there."""

import importlib
import re
import shlex

import constraints
from curriculum.ch3_4_constraints.studies import figures

import pytest

TEXTS = {path.relative_to(figures.ROOT).as_posix(): path.read_text(encoding="utf-8") for path in figures.TEXTS}
BLOCKS = {block["command"]: block["body"] for text in TEXTS.values() for block in figures.BLOCK.finditer(text)}
QUICK = "python constraints.py", "python -m curriculum.ch3_4_constraints.studies.shown"  # the others: figures.py


def without_code(text):
    """The text between its fenced blocks."""
    return re.sub(r"^```.*?^```$", "", text, flags=re.S | re.M)


@pytest.mark.parametrize("command", [command for command in BLOCKS if command.startswith(QUICK)])
def test_a_figure_in_a_text_is_what_its_command_prints(command, tmp_path, capsys):
    words = shlex.split(command)[1:]
    if words[0] == "-m":
        importlib.import_module(words[1]).main(words[2:])
    else:
        constraints.main([*words[1:], "--no-rerun", "--out", str(tmp_path)])
    assert figures.machine_free(capsys.readouterr().out.lstrip("\n")) == figures.machine_free(BLOCKS[command])


def test_only_times_are_left_out_of_the_comparison():
    text = "wall-clock 1 s on X\n    m     us\n 1.25   3.50\n\n 1.25   3.50\nwrote here\n"
    assert figures.machine_free(text) == ["wall-clock", "    m", " 1.25", "", " 1.25   3.50"]


@pytest.mark.parametrize("name", TEXTS)
def test_a_text_has_figures_and_its_links_lead_somewhere(name):
    assert figures.BLOCK.search(TEXTS[name])
    folder = (figures.ROOT / name).parent
    for link in re.findall(r"\]\((?!https?:)([^)]+)\)", without_code(TEXTS[name])):
        target, _, heading = link.partition("#")
        path = (folder / target).resolve() if target else folder / "README.md"
        assert path.exists(), link
        titles = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.M) if heading else []
        anchors = [re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles]
        assert not heading or heading in anchors, link


@pytest.mark.parametrize("name", [name for name in TEXTS if "ch3_4" in name])
def test_a_text_of_the_chapter_fits_its_page(name):
    text = TEXTS[name] if name.endswith("ch3_4_constraints/README.md") else without_code(TEXTS[name])
    assert [line for line in text.splitlines() if len(line) > 100] == []


def test_what_the_chapter_names_in_the_file_is_there():
    text = TEXTS["curriculum/ch3_4_constraints/README.md"]
    names = set(re.findall(r"`(?:constraints\.)?([a-z]\w*)\(\)`", text))
    assert len(names) > 10
    assert [name for name in names if not hasattr(constraints, name)] == []
