"""Texts and pictures: what they show is what runs, what they point to is there."""

import re

import numpy as np
import pytest
from conftest import ROOT

from curriculum.make import __main__ as make
from curriculum.make import texts

FOLDER = ROOT / "curriculum" / "ch3_4_constraints"
CHAPTER = FOLDER / "README.md"
EVERY = [ROOT / "README.md", *sorted(ROOT.glob("curriculum/**/*.md"))]  # and no user's notes
FENCED = re.compile(r"^```.*?^```$", re.S | re.M)
QUICK, SLOW_ONES = make.everything()


@pytest.mark.parametrize("name", [*QUICK, *SLOW_ONES])
def test_what_is_made_is_what_would_be_made_now_times_aside(name):
    if name.endswith(".md") or name in SLOW_ONES:
        for peer in "llvmlite", "heyoka", "mujoco":
            pytest.importorskip(peer, reason="a peer: pip install -e '.[fast,peers]'")
    try:
        stale = SLOW_ONES[name][1]() if name in SLOW_ONES else [*make.fresh(QUICK[name])]
    except ModuleNotFoundError as why:
        pytest.skip(f"{why.name} is not installed: pip install -e '.[site]'")
    assert stale == [], make.__doc__


def test_each_text_in_which_something_is_made_is_made_again():
    made = [path for path in EVERY if re.search(texts.COMMENT, path.read_text(encoding="utf-8"))]
    assert {*map(make.short, made)} <= {*QUICK}


def test_each_picture_stands_in_a_text():
    shown = set()
    for path in EVERY:
        shown |= {*re.findall(r"\]\(\s*(?:\S*/)?(\w+\.svg)\s*\)", path.read_text("utf-8"))}
    assert {path.name for path in FOLDER.glob("pictures/*.svg")} == shown


def test_each_region_of_the_file_stands_in_the_chapter_in_order():
    source = (ROOT / "constraints.py").read_text(encoding="utf-8")
    names = re.findall(r"^# --- region: (\w+) ---$", source, re.M)
    assert re.findall(r"^<!-- region: (\w+) -->$", CHAPTER.read_text("utf-8"), re.M) == names


@pytest.mark.parametrize("path", EVERY, ids=make.short)
def test_what_a_text_points_to_is_there(path):
    prose = FENCED.sub("", path.read_text(encoding="utf-8"))
    for link in re.findall(r"\]\(\s*(?!https?:)([^)\s]+)\s*\)", prose):
        target, _, heading = link.partition("#")
        found = path.parent / target if target else path
        assert found.exists(), link
        if heading and found.suffix == ".md":
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


# --- what is left as it is ---
PRINTED = """\
               worst    a step
method                      us
none            38 cm     1.38
baumgarte     2.3 cm      2.11
it is past its limit 0.828
rk4 none 0.028/20, rk4 project 43/20
spin  11/20  0.02
ours: 25.7 µs  heyoka: 65.4 µs  ratio 0.39"""


@pytest.mark.parametrize(
    ("there", "now", "differs"),
    [
        ("    1.38", "    12.4", False),
        ("    1.38", "       -", True),
        ("38 cm     1.38", "37 cm     1.38", True),
        ("baumgarte     2.3 cm", "impulse       2.3 cm", True),
        ("baumgarte     2.3 cm      2.11", "baumgarte   lost at 3.2 s", True),
        ("limit 0.828", "limit 0.9", True),
        ("0.028/20,", "1,390/20,", False),
        ("0.028/20,", "0.028/10,", True),
        ("11/20  0.02", "11/20  0.01", True),
        ("65.4 µs", "7 µs", False),
        ("ratio 0.39", "ratio 1.2", False),
    ],
)
def test_blocks_that_differ_in_times_only_are_the_same(there, now, differs):
    assert there in PRINTED
    assert texts.differs(PRINTED, PRINTED.replace(there, now)) == differs


# --- a chapter of its own ---
BLOCK = """
# A text

<!-- {} -->
```text
{}
```
"""
SCRIPT = """
# --- region: one ---
x = 1
# --- endregion ---
"""
STUDY = """
import sys
print("a title")
print("name   0.1  2 µs")
if "--quick" not in sys.argv:
    print("other  0.2  3 µs")
"""
SLOW = "python -m curriculum.toy.studies slow"


@pytest.fixture
def toy(monkeypatch, tmp_path):
    """write(name, text) -> its path: a file of a chapter that `make` finds alone."""

    def write(name, text):
        path = folder / name
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_text(text, encoding="utf-8")
        return path

    def slow(commands):
        return dict.fromkeys(commands, texts.printed(SLOW)), {folder / "drawn.svg": "<svg/>"}

    folder = tmp_path / "curriculum" / "toy"
    write("../__init__.py", "")
    write("studies/__main__.py", STUDY)
    study = BLOCK.format(f"printed by: {SLOW}", f"$ {SLOW}\na title\nname 0.1 9 µs\nother 0.2 9 µs")
    another = "python -c 'print(5)'"
    write("studies/README.md", study + BLOCK.format(f"printed by: {another}", f"$ {another}\n5"))
    script = write("script.py", SCRIPT)
    passages = {"words": lambda: "new words"}
    quick = {"pictures": dict}
    chapter = make.Chapter(folder, script, passages, quick, {"slow": slow})
    monkeypatch.setattr(texts, "ROOT", tmp_path)
    monkeypatch.setattr(make, "README", write("../../README.md", "nothing is made\n"))
    monkeypatch.setattr(make, "SAID", tmp_path / "said")
    monkeypatch.setattr(make, "chapters", lambda: [chapter])
    texts.printed.cache_clear()
    yield write
    texts.printed.cache_clear()


def made(path):
    """A text after it has been made; made again, it stays."""
    name = make.short(path)
    assert make.main(["--check", name]) == 1 and make.main([name]) == 0
    assert make.main(["--check", name]) == 0
    return path.read_text(encoding="utf-8")


def test_each_kind_of_block_is_made(toy):
    script = toy("prints.py", "import sys; print(f'{sys.argv[1]} 12.5 µs')")
    region = "<!-- region: one -->\n```python\n{}\n```\n"
    passage = "<!-- passage: words -->\n{}\n<!-- end of passage -->\n\nafter\n"
    python = "```python\nx = 1\nprint(x)\n```\n\n```python\nprint(x + 1)\n```\n"
    command = f"python {script} 'a b'"
    printed = BLOCK.format(f"printed by: {command}", f"$ {command}\n{{}} µs")
    path = toy("A.md", "")
    above = "printed by: lines above"
    text = "\n".join([region, passage, python, BLOCK, printed]).format
    path.write_text(text("old", "old", above, 3, "a c 9"), encoding="utf-8")
    found = made(path)
    assert found.split() == text("x = 1", "new words", above, 2, "a b 12.5").split()
    path.write_text(found.replace("12.5 µs", "9 µs"), encoding="utf-8")
    assert make.main(["--check", make.short(path)]) == 0  # which differs in a time only


def test_what_cannot_be_made_names_the_text_and_the_line(toy, capfd):
    toy("A.md", "text\n\n```python\nprint(x)\n```\n")
    toy("B.md", BLOCK.format("printed by: python -c 'exit(3)'", ""))
    with pytest.raises(OSError, match=r"toy/A\.md: .* line 3 .*NameError"):
        make.main(["curriculum/toy/A.md"])
    with pytest.raises(OSError, match=r"toy/B\.md: `python -c 'exit\(3\)'`"):
        make.main(["curriculum/toy/B.md"])


def test_check_names_what_is_stale_and_writes_nothing(toy, capsys):
    path = toy("A.md", "```python\nprint(3)\n```\n" + BLOCK.format("printed by: lines above", 2))
    before = path.read_text(encoding="utf-8")
    assert make.main(["--check"]) == 1
    assert capsys.readouterr().out == "stale: curriculum/toy/A.md\n"
    assert path.read_text(encoding="utf-8") == before
    assert make.main([]) == 0
    assert capsys.readouterr().out == "made: curriculum/toy/A.md\n"
    assert path.read_text(encoding="utf-8") == before.replace("\n2\n", "\n3\n")
    assert make.main(["--check"]) == make.main([]) == 0
    assert capsys.readouterr().out == ""


def test_what_tests_expect_commands_to_say_is_made(toy):
    command = "$ python -c 'print(\"3 m  7 µs\")'\n"
    path = toy("../../said/one.txt", command + "3 m  9 µs\n")
    assert make.main(["--check", "said"]) == 0
    path.write_text(command + "4 m  9 µs\n", encoding="utf-8")
    assert make.main(["--check", "said"]) == 1 and make.main(["said"]) == 0
    assert path.read_text(encoding="utf-8") == command + "3 m  7 µs\n"


def test_a_slow_block_is_stale_if_it_lacks_a_line_of_quick_and_made_if_it_is_named(toy, capsys):
    (chapter,) = make.chapters()
    path = chapter.folder / "studies" / "README.md"
    good = path.read_text(encoding="utf-8")
    assert make.main(["--check"]) == 0
    path.write_text(good.replace("0.1", "0.3"), encoding="utf-8")
    assert make.main(["--check"]) == make.main([]) == 1
    assert "slow" in capsys.readouterr().out
    assert make.main(["slow"]) == 0
    lines = path.read_text(encoding="utf-8").split()
    assert "name 0.1 2 µs other 0.2 3 µs" in " ".join(lines) and lines.count("name") == 1
    assert (chapter.folder / "drawn.svg").exists()
    path.write_text(good.replace("0.2", "0.4"), encoding="utf-8")
    assert make.main(["--check", "slow"]) == 0  # --quick does not print it


def test_a_name_that_is_not_there_is_answered_by_those_that_are(toy, capsys):
    with pytest.raises(SystemExit, match="2"):
        make.main(["TEXTS.md"])
    assert re.search("'TEXTS.md': .*README.md.* slow\n$", capsys.readouterr().err)


def test_an_extra_that_is_missing_is_told_and_how_to_get_it(toy, monkeypatch, capsys):
    def needs_it():
        raise ModuleNotFoundError(name="pygments")

    (chapter,) = make.chapters()
    monkeypatch.setattr(make, "chapters", lambda: [chapter._replace(made={"pictures": needs_it})])
    with pytest.raises(SystemExit, match="2"):
        make.main([])
    assert re.search("pictures needs pygments: pip install .*site", capsys.readouterr().err)
