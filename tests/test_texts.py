"""Texts and pictures: what they show is what runs, what they point to is there."""

import re

import pytest
from conftest import ROOT

import constraints as c
from curriculum.ch3_4_constraints.pages import texts
from curriculum.ch3_4_constraints.pictures import make_pictures

CHAPTER = texts.HERE / "README.md"
PICTURES = make_pictures.FOLDER
EVERY = [ROOT / "README.md", *sorted(ROOT.glob("curriculum/**/README.md"))]  # and no user's notes
FENCED = re.compile(r"^```.*?^```$", re.S | re.M)


def masked(text):
    """Text without what belongs to the machine: the times of tables, and the banner's."""
    text = re.sub(r"^(ch3\.4 constraints \| device cpu).*$", r"\1", text, flags=re.M)
    rows = "|".join(c.make_methods(dt=1.0))
    return re.sub(rf"^((?:{rows})\b.*?) +[\d.e+-]+$", r"\1", text, flags=re.M)


@pytest.mark.parametrize("path", texts.TEXTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_text_shows_the_code_that_runs_and_what_its_commands_and_lines_print(path):
    text = path.read_text(encoding="utf-8")
    assert masked(texts.filled(text)) == masked(text), texts.__doc__


def test_each_region_of_the_file_stands_in_the_chapter_in_order():
    source = (ROOT / "constraints.py").read_text(encoding="utf-8")
    names = re.findall(r"^# --- region: (\w+) ---$", source, re.M)
    assert re.findall(r"^<!-- region: (\w+) -->$", CHAPTER.read_text("utf-8"), re.M) == names
    assert " ".join(names) == "setup systems constraints integrators simulate methods report"


@pytest.mark.parametrize("path", EVERY, ids=lambda path: str(path.relative_to(ROOT)))
def test_what_a_text_points_to_is_there(path):
    prose = FENCED.sub("", path.read_text(encoding="utf-8"))
    for link in re.findall(r"\]\(\s*(?!https?:)([^)\s]+)\s*\)", prose):
        target, _, heading = link.partition("#")
        found = path.parent / target if target else path
        assert found.exists(), link
        if heading:
            titles = re.findall(r"^#+ (.*)$", found.read_text(encoding="utf-8"), re.M)
            anchors = [re.sub(r"[^\w\- ]", "", x.lower()).replace(" ", "-") for x in titles]
            assert heading in anchors, link


def test_a_decimal_in_the_chapter_stands_in_one_of_its_blocks_or_formulas():
    """As it is or in cm, mm or per cent: a figure is printed, or worked out, beside the words."""
    formulas = re.compile(r"```.*?```|\$\$.*?\$\$|\$[^$]+\$", re.S)
    text = CHAPTER.read_text(encoding="utf-8")
    known = re.findall(r"(?<![\w.])\d+\.?\d*(?:e[-+]\d+)?", "\n".join(formulas.findall(text)))
    prose = re.sub(r"`[^`]*`|^\|.*$", "", formulas.sub("", text), flags=re.M)
    for decimal in set(re.findall(r"(?<![\w.])\d+\.\d+", prose)) - {"3.3", "3.4", "3.5"}:
        digits = len(decimal.partition(".")[2])
        printed = {f"{k * float(x):.{digits}f}" for x in known for k in (1.0, 100.0, 1000.0)}
        assert decimal in printed, decimal


def test_pictures_are_what_the_code_makes_or_drawn_in_its_style(tmp_path, monkeypatch):
    monkeypatch.setattr(make_pictures, "FOLDER", tmp_path)
    make_pictures.main()
    for path in PICTURES.glob("*.svg"):
        made, text = tmp_path / path.name, path.read_text(encoding="utf-8")
        same = made.read_text("utf-8") == text if made.exists() else make_pictures.STYLE in text
        assert same, make_pictures.__doc__
