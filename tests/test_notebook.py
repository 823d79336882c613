"""The notebook: its cells are constraints.py, and an edit of one changes all below it."""

import ast
import base64
import html
import json
import re
import shutil
import sys
from pathlib import Path

import pytest
from conftest import ROOT

import constraints as c
from curriculum.common.notebook import show

NOTEBOOK = ROOT / "curriculum" / "ch3_4_constraints" / "chapter.ipynb"
DRAG = 0.5  # N s/m
FORCE = 'return system["m"] * GRAVITY'
PAGE = "outputs/ch3.4-constraints/play.html"
SHOWS = "\nshow("
ASKS = "import constraints\nprint(constraints.external_force is external_force)"


def kept():
    """The cells of the notebook, as it is kept."""
    return json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]


def code(cells):
    """The sources of the cells that are run."""
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]


def dragged(system, q, v):
    """external_force, as the notebook of these tests has it."""
    return -DRAG * v + system["m"] * c.GRAVITY + system.get("load", 0.0)


def functions(source):
    """{name: its lines} of the functions and classes of a script, in its order."""
    kinds = ast.FunctionDef, ast.ClassDef
    return {x.name: ast.unparse(x) for x in ast.parse(source).body if isinstance(x, kinds)}


def test_it_is_kept_without_outputs_and_each_line_of_the_script_is_in_a_cell_in_its_order():
    cells = kept()
    for cell in cells:
        assert not cell.get("outputs") and not cell.get("execution_count")
    theirs = functions("\n".join(code(cells)))
    ours = functions((ROOT / "constraints.py").read_text(encoding="utf-8"))
    assert [x for x in theirs.items() if x[0] in ours] == list(ours.items())


def test_below_the_force_that_can_be_edited_and_in_the_end_a_page_is_shown():
    sources = code(kept())
    (k,) = [k for k, source in enumerate(sources) if FORCE in source]
    assert SHOWS in sources[k + 1] and SHOWS in sources[-1]


@pytest.fixture(scope="module")
def edited(tmp_path_factory):
    """Code cells after a run in a copy of the project, with drag in external_force."""
    nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")
    nbformat = pytest.importorskip("nbformat", reason="nbformat is not installed")
    pytest.importorskip("ipykernel", reason="ipykernel is not installed")
    folder = tmp_path_factory.mktemp("project")
    shutil.copy(ROOT / "constraints.py", folder)
    without = shutil.ignore_patterns("pictures", "__pycache__")
    shutil.copytree(ROOT / "curriculum", folder / "curriculum", ignore=without)
    path = folder / NOTEBOOK.relative_to(ROOT)
    notebook = nbformat.read(path, nbformat.NO_CONVERT)
    for cell in notebook.cells:
        cell.source = cell.source.replace(FORCE, f"return -{DRAG} * v + {FORCE[7:]}")
    notebook.cells.append(nbformat.v4.new_code_cell(ASKS))
    place = {"metadata": {"path": str(path.parent)}}
    nbclient.NotebookClient(notebook, timeout=60, resources=place).execute()
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def printed(cell):
    """What a cell has printed."""
    return "".join(x.text for x in cell.outputs if x.output_type == "stream")


def below(edited, *flags):
    """(what it has printed, the frame that it shows) of each cell of a run with these flags."""
    start = f"main({json.dumps(['--no-rerun', *flags])})"
    for cell in edited:
        if cell.source.startswith(start):
            (frame,) = [x.data["text/html"] for x in cell.outputs if "data" in x]
            yield printed(cell), frame


def rows(text):
    """The cells of a table's rows, without the time of a step; and what is advised."""
    known = c.make_methods()
    words = [line.split() for line in text.splitlines() if line]
    return [row[:-1] for row in words if row[0] in known], re.findall("^Right to .*", text, re.M)


def test_an_edit_of_external_force_changes_table_answer_and_page(
    edited, monkeypatch, capsys, tmp_path
):
    def run(*flags):
        c.main(["--no-rerun", *flags])
        return rows(capsys.readouterr().out), Path(PAGE).read_text(encoding="utf-8")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["constraints.py"])  # the page names it
    usual, usual_page = run()
    monkeypatch.setattr(c, "external_force", dragged)
    expected, page = run()
    advised, _ = run("--within", "1mm")
    assert usual != expected and usual_page != page
    plain = list(below(edited))
    assert plain
    for said, frame in plain:
        assert rows(said) == expected
        assert html.escape(page) in frame
    ((said, _),) = below(edited, "--within", "1mm")
    assert rows(said) == advised


def test_whoever_imports_the_script_gets_the_cells(edited):
    assert printed(edited[-1]) == "True\n"


def test_a_page_is_shown_as_it_was_when_it_was_written_and_what_is_missing_is_said(tmp_path):
    path = tmp_path / "play.html"
    assert str(path) in show(path)._repr_html_()
    path.write_text("<p>first</p>", encoding="utf-8")
    shown = show(path)
    path.write_text("<p>second</p>", encoding="utf-8")
    assert html.escape("<p>first</p>") in shown._repr_html_()


@pytest.fixture
def maker(tmp_path):
    """A Maker of cells, from texts beside a picture; it draws pictures in capitals."""
    notebook = pytest.importorskip("curriculum.make.notebook", reason="nbformat is not installed")
    (tmp_path / "a.svg").write_text("<svg/>", encoding="utf-8")
    return notebook.Maker(tmp_path, ROOT / "constraints.py", PAGE, str.upper)


TEXT = """# Title

Words ![what is
drawn](a.svg)

<!-- region: setup -->
```python
one = 1
if __name__ == "__main__":
    command()
```

<details><summary>Folded</summary>

```python
two = 2
```

</details>

<!-- printed by: lines above -->
```text
left out
```

## Section

<!-- printed by: python constraints.py --steps 9 -->
```text
left out
```

<details><summary>Aside</summary>

Words that can wait.

</details>

<!-- printed by: python other.py -->
```text
stays
```

<!-- notebook: python constraints.py -->
"""


def test_code_and_commands_of_a_text_are_cells_in_their_order_and_its_words_stay(maker):
    maker.text(TEXT)
    cells = [(cell.cell_type, cell.source) for cell in maker.cells]
    sources = [source for kind, source in cells if kind == "code"]
    assert sources[:2] == ["one = 1", "two = 2"]
    assert [source.partition("\n")[0] for source in sources[2:]] == [
        'main(["--steps", "9"])',
        "main([])",
    ]
    words = "\n".join(source for kind, source in cells if kind == "markdown")
    assert "left out" not in words and "<!--" not in words
    parts = "# Title", "what is drawn", "**Folded**", "Section", "<summary>Aside<", "stays"
    places = [words.index(x) for x in parts]
    assert places == sorted(places)
    assert base64.b64encode(b"<SVG/>").decode() in words


def test_lines_of_the_text_that_would_replace_a_name_of_the_script_are_refused(maker):
    with pytest.raises(OSError, match="energy"):
        maker.text("```python\nfor energy in range(3):\n    pass\n```\n")
