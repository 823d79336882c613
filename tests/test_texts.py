"""Texts and pictures: what they show is what runs, what they point to is there."""

import re

import numpy as np
import pytest
from conftest import ROOT

import constraints as c
from curriculum.ch3_4_constraints import make
from curriculum.ch3_4_constraints.pages import texts
from curriculum.ch3_4_constraints.pictures import make_pictures
from curriculum.ch3_4_constraints.studies import speed_vs_error

CHAPTER = texts.HERE / "README.md"
EVERY = [ROOT / "README.md", *sorted(ROOT.glob("curriculum/**/README.md"))]  # and no user's notes
FENCED = re.compile(r"^```.*?^```$", re.S | re.M)
NEEDED = {  # to make it
    make.short(make.PAGE): ["markdown_it", "mdit_py_plugins", "latex2mathml", "pygments"],
    make.short(make.STUDIES): ["llvmlite", "heyoka", "mujoco"],
    "speed_vs_error": ["llvmlite", "mujoco"],
}


@pytest.mark.parametrize("name", [*make.MADE, *make.SLOW])
def test_what_is_made_is_what_would_be_made_now_times_aside(name):
    for module in NEEDED.get(name, []):
        pytest.importorskip(module, reason="an extra: pip install -e '.[fast,peers,site]'")
    assert make.stale(name) == [], make.__doc__


def test_each_text_in_which_something_is_made_is_made_again():
    made = [path for path in EVERY if re.search(texts.COMMENT, path.read_text(encoding="utf-8"))]
    assert {*map(make.short, made)} <= {*make.MADE}


DRAWN_BY_HAND = {"drift", "jacobian", "question", "soft", "solve", "tangent"}


def test_a_picture_is_made_or_drawn_by_hand_or_by_a_study():
    studys = {f"work_precision_{scene}" for scene in speed_vs_error.SCENES}
    made = {path.stem for path in make.drawn()}
    assert {path.stem for path in make_pictures.FOLDER.glob("*.svg")} == (
        made | DRAWN_BY_HAND | studys
    )


def test_all_pictures_are_in_one_style():
    for path in make_pictures.FOLDER.glob("*.svg"):
        assert make_pictures.STYLE in path.read_text(encoding="utf-8"), path.name


def test_each_picture_stands_in_a_text():
    shown = set()
    for path in EVERY:
        shown |= {*re.findall(r"\]\(\s*(?:\S*/)?(\w+\.svg)\s*\)", path.read_text("utf-8"))}
    assert {path.name for path in make_pictures.FOLDER.glob("*.svg")} == shown


BLOCK = """
# A text

<!-- printed by: {} -->
```text
{}
```
"""


def test_a_block_that_differs_in_times_only_is_left_alone(tmp_path):
    script = tmp_path / "prints.py"
    script.write_text("print('rk4   3 m  12.5 µs  ratio 0.50')", encoding="utf-8")
    text = BLOCK.format(f"python {script}", "rk4   3 m  9.5 µs  ratio 0.62")
    assert texts.filled(text) == text
    other = text.replace("3 m", "4 m")
    assert texts.filled(other) == other.replace("4 m  9.5", "3 m  12.5").replace("0.62", "0.50")


TABLE = """\
               worst    a step
method                      us
none            38 cm     1.38
baumgarte     2.3 cm      2.11
  149,000 (31.6 µs): rk4 at 40 ms
it is past its limit 0.828"""


@pytest.mark.parametrize(
    ("there", "now", "differs"),
    [
        ("    1.38", "    12.4", False),
        ("31.6 µs", "1,390 µs", False),
        ("149,000", "149,001", True),
        ("38 cm     1.38", "37 cm     1.38", True),
        ("baumgarte     2.3 cm", "impulse       2.3 cm", True),
        ("baumgarte     2.3 cm      2.11", "baumgarte   lost at 3.2 s", True),
        ("limit 0.828", "limit 0.9", True),
    ],
)
def test_only_the_times_of_a_table_and_below_it_may_differ(there, now, differs):
    assert there in TABLE
    assert texts.differs(TABLE, TABLE.replace(there, now)) == differs


def test_of_times_to_an_error_names_and_errors_are_compared():
    old = "\n".join(
        [
            "double, 5 s; two ways to the reference are 1e-14 m apart",
            "            m off at 5 ms   ms of computing / ms a step, to be right to",
            "            worst    rods        1 cm        1 mm",
            "rk4 none     5e-06   4e-06    0.028/20    0.048/10",
            "rk4 project  2e-07   1e-16    0.043/20           -",
            "to 1 cm: rk4 none 0.028/20, rk4 project 0.043/20",
            "machine code took 1 s to build, which is in no time above",
        ]
    )
    for there, now, differs in [
        ("0.048/10", "     1/5", False),
        ("0.043/20           -", "0.043/20      4.5/20", False),
        ("rk4 none 0.028/20,", "gauss none 0.02/20,", False),
        ("took 1 s", "took 11 s", False),
        ("2e-07", "3e-07", True),
        ("1e-16", "1e-10", True),
        ("rk4 project  ", "rk4 impulse  ", True),
        ("1e-14 m apart", "1e-11 m apart", True),
    ]:
        assert there in old
        assert texts.differs(old, old.replace(there, now)) == differs, there


def test_shares_of_starts_are_no_times():
    assert texts.differs("spin  11/20  0.02", "spin  12/20  0.02")


def test_a_table_of_methods_follows_them():
    comment = "<!-- table: methods -->\n"
    made = texts.filled(f"before\n\n{comment}| old |\n|---|\n| old |\n\nafter\n")
    rows = [f"| `{name}` | {method.words} |" for name, method in c.make_methods().items()]
    assert made.startswith(f"before\n\n{comment}| method |") and made.endswith("|\n\nafter\n")
    assert made.splitlines()[5:-2] == rows
    assert texts.filled(made) == made and "old" not in made


def test_blocks_of_python_share_names_and_lines_above_are_the_last_ones():
    first = "```python\nx = 1\nprint(x)\n```\n"
    text = first + "\n```python\nprint(x + 1)\n```\n" + BLOCK.format("lines above", 0)
    assert texts.filled(text) == text.replace("\n0\n", "\n2\n")


def test_python_of_a_text_that_fails_names_its_line():
    with pytest.raises(OSError, match="the Python from line 3 on: NameError: name 'x' is not"):
        texts.filled("text\n\n```python\nprint(x)\n```\n")


# --- the command ---
@pytest.fixture
def one_text(monkeypatch, tmp_path):
    """A text of its own with a block that is stale, as all that is made."""
    monkeypatch.setattr(texts, "ROOT", tmp_path)
    path = tmp_path / "TEXT.md"
    path.write_text("```python\nprint(3)\n```\n" + BLOCK.format("lines above", 2), "utf-8")
    monkeypatch.setattr(make, "MADE", {"TEXT.md": lambda: make.text(path)})
    monkeypatch.setattr(make, "SLOW", {})
    return path


def test_check_names_what_is_stale_and_writes_nothing_and_without_it_is_made(one_text, capsys):
    before = one_text.read_text(encoding="utf-8")
    assert make.main(["--check"]) == 1
    assert capsys.readouterr().out == "stale: TEXT.md\n"
    assert one_text.read_text(encoding="utf-8") == before
    assert make.main([]) == 0
    assert capsys.readouterr().out == "made: TEXT.md\n"
    assert one_text.read_text(encoding="utf-8") == before.replace("\n2\n", "\n3\n")
    assert make.main(["--check"]) == make.main([]) == 0
    assert capsys.readouterr().out == ""


def test_a_file_that_is_not_there_is_stale_and_made(one_text, monkeypatch, capsys):
    path = one_text.with_name("NEW.md")
    monkeypatch.setattr(make, "MADE", {"NEW.md": lambda: {path: "new"}})
    assert make.main(["--check"]) == 1 and make.main(["NEW.md"]) == 0
    assert capsys.readouterr().out == "stale: NEW.md\nmade: NEW.md\n"
    assert path.read_text(encoding="utf-8") == "new"


@pytest.mark.parametrize(
    ("names", "what"),
    [
        (["TEXTS.md"], "there is no 'TEXTS.md': choose from TEXT.md"),
        (["--chek"], "unrecognized arguments: --chek"),
    ],
)
def test_a_name_that_is_not_there_is_answered_by_those_that_are(one_text, names, what, capsys):
    with pytest.raises(SystemExit, match="2"):
        make.main(names)
    assert capsys.readouterr().err.endswith(f"error: {what}\n")


def test_an_extra_that_is_missing_is_told_and_how_to_get_it(one_text, monkeypatch, capsys):
    def needs_it():
        raise ModuleNotFoundError(name="pygments")

    monkeypatch.setitem(make.MADE, "page", needs_it)
    with pytest.raises(SystemExit, match="2"):
        make.main([])
    told = "error: page needs pygments: pip install -e '.[fast,peers,site]'\n"
    assert capsys.readouterr().err.endswith(told)


STUDY = """
import sys
print("coarse" if "--quick" in sys.argv else "")
print("name   0.1  2 µs")
if "--quick" not in sys.argv:
    print("other  0.2  3 µs")
if "--draw" in sys.argv:
    open({!r}, "w").close()
"""


@pytest.fixture
def slow_study(monkeypatch, tmp_path):
    """A text with the block of a study that is slow, as if it had been made."""
    (tmp_path / "x" / "studies").mkdir(parents=True)
    study = STUDY.format(str(tmp_path / "drawn"))
    (tmp_path / "x" / "studies" / "__main__.py").write_text(study, encoding="utf-8")
    monkeypatch.setattr(texts, "ROOT", tmp_path)
    monkeypatch.setattr(texts, "SLOW", {"slow": "--draw"})
    return BLOCK.format("python -m x.studies slow", "\nname   0.1  12 µs\nother  0.2  13 µs")


def test_a_slow_block_is_stale_if_it_lacks_a_line_of_quick_times_aside(slow_study):
    assert not texts.is_outdated(slow_study, "slow")
    assert not texts.is_outdated(slow_study.replace("0.2", "0.3"), "slow")  # quick has it not
    assert texts.is_outdated(slow_study.replace("0.1", "0.3"), "slow")
    assert texts.is_outdated(slow_study.replace("name ", "nome "), "slow")


def test_a_slow_block_is_made_with_its_pictures_only_if_its_study_is_named(slow_study, tmp_path):
    old = slow_study.replace("0.2", "0.3")
    assert texts.filled(old) == old and not (tmp_path / "drawn").exists()
    assert texts.filled(old, ["slow"]) == old.replace("12 µs", "2 µs").replace("0.3  13", "0.2  3")
    assert (tmp_path / "drawn").exists()
    assert texts.filled(slow_study, ["slow"]) == slow_study  # but for times it is as it was


# --- what stands in them ---
def test_each_region_of_the_file_stands_in_the_chapter_in_order():
    source = (ROOT / "constraints.py").read_text(encoding="utf-8")
    names = re.findall(r"^# --- region: (\w+) ---$", source, re.M)
    assert re.findall(r"^<!-- region: (\w+) -->$", CHAPTER.read_text("utf-8"), re.M) == names


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


def test_a_decimal_in_the_chapter_stands_in_a_block_or_formula_of_its_section():
    """As it is or in cm, mm or per cent: a figure is printed, or worked out, beside the words."""
    formulas = re.compile(r"```.*?```|\$\$.*?\$\$|\$[^$]+\$", re.S)
    _, *sections = re.split("^## ", CHAPTER.read_text(encoding="utf-8"), flags=re.M)
    for text in sections:
        known = re.findall(r"(?<![\w.])\d+\.?\d*(?:e[-+]\d+)?", " ".join(formulas.findall(text)))
        scaled = np.outer([1.0, 100.0, 1000.0], [float(x) for x in known])
        prose = re.sub(r"`[^`]*`|^\|.*$", "", formulas.sub("", text), flags=re.M)
        for decimal in set(re.findall(r"(?<![\w.])\d+\.\d+", prose)) - {"3.3", "3.4", "3.5"}:
            digits = len(decimal.partition(".")[2])
            assert decimal in {f"{x:.{digits}f}" for x in scaled.flat}, decimal
