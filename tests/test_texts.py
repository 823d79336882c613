"""Texts and pictures: what they show is what runs, what they point to is there."""

import math
import re
from pathlib import Path

import pytest
from conftest import ROOT

import constraints as c
from curriculum.ch3_4_constraints import texts
from curriculum.ch3_4_constraints.pictures import make_pictures

CHAPTER = texts.HERE / "README.md"
PICTURES = Path(make_pictures.__file__).parent
FENCED = re.compile(r"^```.*?^```$", re.S | re.M)
EVERY = sorted(path for path in ROOT.rglob("*.md") if ".venv" not in path.parts)


def masked(text):
    """Text without what belongs to the machine: the times of tables, and the banner's."""
    text = re.sub(r"^(ch3\.4 constraints \| device cpu).*$", r"\1", text, flags=re.M)
    rows = "|".join(c.stabilizations(dt=1.0))
    return re.sub(rf"^((?:{rows})\b.*?) +[\d.e+-]+$", r"\1", text, flags=re.M)


@pytest.mark.parametrize("path", texts.TEXTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_text_shows_the_code_that_runs_and_what_its_commands_and_lines_print(path):
    text = path.read_text(encoding="utf-8")
    assert masked(texts.filled(text)) == masked(text), texts.__doc__


def test_each_region_of_the_file_stands_in_the_chapter_in_order():
    source = (ROOT / "constraints.py").read_text(encoding="utf-8")
    names = re.findall(r"^# --- region: (\w+) ---$", source, re.M)
    assert re.findall(r"^<!-- region: (\w+) -->$", CHAPTER.read_text("utf-8"), re.M) == names
    assert len(names) == 6


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


def test_names_in_the_chapter_are_names_of_the_file():
    prose = FENCED.sub("", CHAPTER.read_text(encoding="utf-8"))
    names = re.findall(r"`([a-z]\w+_\w+|[A-Z_]{4,})(?:\(.*?\))?`", prose)
    given = {name for name in names if not name.startswith(("efc_", "mj_", "metrics"))}
    assert len(given) > 5
    source = (ROOT / "constraints.py").read_text(encoding="utf-8")
    assert [name for name in given if name not in source] == []


def test_a_decimal_in_the_chapter_stands_in_one_of_its_blocks_or_formulas():
    """As it is or in cm, mm or per cent: a figure is printed, or worked out, beside the words."""
    text = CHAPTER.read_text(encoding="utf-8")
    blocks = "\n".join(FENCED.findall(text) + re.findall(r"^    .*$", text, re.M))
    known = [float(x) for x in re.findall(r"(?<![\w.])\d+\.?\d*(?:e[-+]\d+)?", blocks)]
    prose = re.sub(r"`[^`]*`|^    .*$|^\|.*$", "", FENCED.sub("", text), flags=re.M)
    worked_out = {"3.3", "3.4", "3.5", "0.196"}  # chapters; (1 - p) T^2 9.81, see soft.svg
    for decimal in set(re.findall(r"(?<![\w.])\d+\.\d+", prose)) - worked_out:
        digits = len(decimal.partition(".")[2])
        as_printed = {f"{scale * x:.{digits}f}" for x in known for scale in (1.0, 100.0, 1000.0)}
        assert decimal in as_printed, decimal


def test_no_line_within_code_begins_like_an_item_of_a_list():
    for path in EVERY:
        text = FENCED.sub("", path.read_text(encoding="utf-8"))
        for item in re.finditer(r"\n[-+*>#] ", text):
            assert text[: item.start()].rpartition("\n\n")[2].count("`") % 2 == 0, item


def test_texts_are_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 170
    prose = re.sub(r"<!--.*?-->", "", FENCED.sub("", CHAPTER.read_text(encoding="utf-8")))
    lines = [line for line in prose.splitlines() if not line.startswith(("    ", "|"))]
    assert len(" ".join(lines).split()) <= 3700


def test_pictures_and_pages_are_what_the_code_makes_or_drawn_in_its_style(tmp_path, monkeypatch):
    monkeypatch.setattr(make_pictures, "FOLDER", tmp_path)
    make_pictures.main()
    for path in PICTURES.glob("*.[sh]*"):
        made, text = tmp_path / path.name, path.read_text(encoding="utf-8")
        same = made.read_text("utf-8") == text if made.exists() else make_pictures.STYLE in text
        assert same, make_pictures.__doc__


def test_each_picture_and_page_is_shown_or_linked_somewhere():
    shown = "\n".join(path.read_text(encoding="utf-8") for path in EVERY)
    assert [x.name for x in PICTURES.glob("*.[sh]*") if f"{x.name})" not in shown] == []


def test_numbers_in_pictures_drawn_by_hand_are_right():
    """Pulls of a swing that began level; and stretches of 2 (1 - p) T^2 9.81, two bobs' load."""
    pulls = [f"{3.0 * 9.81 * math.cos(math.radians(x)):.2f}" for x in (90, 60, 30, 0)]
    stretches = [f"{2.0 * 0.05 * t**2 * 9.81 * 1e6:.2g}" for t in (0.01, 0.02, 0.03)]
    for name, unit, by_hand in ("question", "N", [*pulls, "9.81"]), ("soft", "um", stretches):
        words = re.findall(rf"([\d.]+) {unit}<", (PICTURES / f"{name}.svg").read_text("utf-8"))
        assert [float(x) for x in words] == [float(x) for x in by_hand]
