"""The texts: what they say a command prints is what it prints, and what they point to is there."""

import importlib
import re
import shlex

import constraints
from curriculum.ch3_4_constraints.studies import figures

import pytest

CODE = re.compile(r"^```.*?^```$", re.S | re.M)
TEXTS = {x.relative_to(figures.ROOT).as_posix(): x.read_text("utf-8") for x in figures.TEXTS}
BLOCKS = [block for text in TEXTS.values() for block in figures.BLOCK.finditer(text)]
SHOWN = "python -m curriculum.ch3_4_constraints.studies.shown"
QUICK = [b for b in BLOCKS if b["command"].startswith(("python constraints.py", SHOWN))]
QUICK = [b for b in QUICK if b["command"] != f"{SHOWN} hour"]  # the others: figures.py


@pytest.mark.parametrize("block", QUICK, ids=lambda b: b[2])
def test_a_figure_in_a_text_is_what_its_command_prints(block, tmp_path, capsys):
    words = shlex.split(block["command"])[1:]
    if words[0] == "-m":
        importlib.import_module(words[1]).main(words[2:])
    else:
        constraints.main([*words[1:], "--no-rerun", "--out", str(tmp_path)])
    printed, said = capsys.readouterr().out.strip("\n"), block["body"]
    assert figures.machine_free(printed) == figures.machine_free(said)


def test_only_times_are_left_out_and_a_block_says_the_command_that_printed_it():
    text = "ch3.4 | took 1 s on X\n    m     us\n 1.25   3.50\nas expected, 3\nwrote here\n"
    assert figures.machine_free(text) == [["m"], ["1.25"], ["as expected, 3"]]
    assert all(block[3] in (None, f"$ {block['command']}\n") for block in BLOCKS)


def test_figures_goes_on_after_a_failure_and_refuses_what_no_text_asks(tmp_path, monkeypatch):
    block = "<!-- printed by: {0} -->\n```text\n$ {0}\n{1}\n```\n"
    page, fails, works = tmp_path / "page.md", "python -c raise", "python -c print(1)"
    page.write_text(block.format(fails, "old") + block.format(works, "old"), encoding="utf-8")
    monkeypatch.setattr(figures, "TEXTS", [page])
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    assert figures.main([]) == 1
    assert page.read_text() == block.format(fails, "old") + block.format(works, "1")
    with pytest.raises(SystemExit):
        figures.main(["--only", "zzz"])


@pytest.mark.parametrize("name", TEXTS)
def test_a_text_has_figures_and_points_to_what_is_there(name):
    assert figures.BLOCK.search(TEXTS[name])
    for link in re.findall(r"\]\((?!https?:)([^)]+)\)", CODE.sub("", TEXTS[name])):
        target, _, heading = link.partition("#")
        path = figures.ROOT / name if not target else (figures.ROOT / name).parent / target
        assert path.exists(), link
        titles = re.findall(r"^#+ (.*)$", path.read_text("utf-8"), re.M) if heading else []
        anchors = [re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles]
        assert not heading or heading in anchors, link


def test_the_chapter_names_what_is_in_its_file():
    text = TEXTS[f"{constraints.CHAPTER}/README.md"]
    names = re.findall(r"`(?:([a-z]\w*)\(\)|([A-Z_]{4,}))`", text)
    assert len(names) > 10 and all(hasattr(constraints, a or b) for a, b in names)


@pytest.mark.parametrize("name", [name for name in TEXTS if "solutions" not in name])
def test_a_decimal_in_prose_stands_in_a_table_of_its_section(name):
    """To its digits, as it is or in cm, mm or per cent; tests above compare these tables."""
    given = {"3.11", "3.10", "3.3", "3.4", "0.6"}  # Python, MuJoCo, chapters; a sum done on paper
    decimal, number = r"(?<![\w.])\d+\.\d+", r"\d+\.?\d*(?:e[-+]\d+)?"
    for section in re.split(r"^(?=## )", TEXTS[name], flags=re.M):
        tables = "\n".join(block["body"] for block in QUICK if block["body"] in section)
        printed = [float(x) for x in re.findall(number, tables)]
        prose = re.sub(r"`[^`]*`|^    .*$", "", CODE.sub("", section), flags=re.M)
        for said in set(re.findall(decimal, prose)) - given:
            digits = len(said.partition(".")[2])
            as_said = {f"{scale * x:.{digits}f}" for x in printed for scale in (1.0, 100.0, 1000.0)}
            assert said in as_said, f"{said}: {section.splitlines()[0]}"
