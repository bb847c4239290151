"""A page's figures as files, and what its captions say of how it was made."""

import re
import xml.etree.ElementTree as ET

import pytest
from matplotlib.figure import Figure

from experiments.report.page import Bullets, Page, Plot, Section, conditions, warnings
from experiments.report.table import Cell, Table
from experiments.storage.plain_json import write_json
from experiments.storage.results import FIGURES_FOLDER, MANIFEST_FILE, REPORT_FILE, results_folder
from trackslip.errors import OutputError


def drawn() -> Figure:
    figure = Figure(figsize=(2, 1))
    figure.subplots().plot([0, 1], [1, 0])
    return figure


def write(out, *names):
    with results_folder(out) as folder:
        Page("A page", "", {}, [Section("Figures", [Plot(name, drawn(), name) for name in names])]).write(
            folder, pdf=True
        )
        write_json(folder / MANIFEST_FILE, {})


def names_in(out):
    return sorted(file.name for file in (out / FIGURES_FOLDER).iterdir())


def test_figures_are_files_of_their_own_and_the_same_each_time(tmp_path):
    write(tmp_path / "a", "slip", "paths")
    write(tmp_path / "b", "slip", "paths")
    assert names_in(tmp_path / "a") == ["paths.pdf", "paths.svg", "slip.pdf", "slip.svg"]
    for name in ("paths.svg", "slip.svg"):
        text = (tmp_path / "a" / FIGURES_FOLDER / name).read_text(encoding="utf-8")
        assert ET.fromstring(text).tag.endswith("svg")
        assert text == (tmp_path / "b" / FIGURES_FOLDER / name).read_text(encoding="utf-8")
    pages = [(tmp_path / name / REPORT_FILE).read_text(encoding="utf-8") for name in ("a", "b")]
    assert pages[0] == pages[1]


@pytest.mark.parametrize("with_manifest", [True, False])
def test_figures_that_are_not_ours_are_never_deleted(tmp_path, with_manifest):
    mine = tmp_path / FIGURES_FOLDER / ("mine.svg" if not with_manifest else "thesis.tex")
    mine.parent.mkdir()
    mine.write_text("mine")
    if with_manifest:
        write_json(tmp_path / MANIFEST_FILE, {})
    with pytest.raises(OutputError, match="figures there contains files that aren't part of results"):
        write(tmp_path, "slip")
    assert mine.read_text() == "mine"


HOSTILE = "<script>alert('1')</script> & \"name\""
LAWS = Table(
    HOSTILE,
    ("law", "parameter", "value"),
    [(Cell("constant ICR", "icr", ("a / b",), "best"), "D", "−43 ± 2 mm"), ("", "ε", "nan"), (HOSTILE, "–", "1")],
    "llr",
    note="a note",
)


def elements(text):
    """A page as a tree, which it is only if all its elements are closed."""
    page = text.partition("<body>")[2].partition("</body>")[0]
    return ET.fromstring(re.sub(r"<svg.*?</svg>", "", f"<body>{page}</body>", flags=re.DOTALL))


def test_a_page_is_sections_of_blocks():
    blocks = [
        "a paragraph",
        LAWS,
        None,
        Bullets(["one", "two"]),
        Plot("slip", [drawn(), drawn()], "Slip", "As driven."),
    ]
    empty = Section("Nothing", [None, ""])
    page = elements(
        Page("A page", "trackslip", {"seed": 1}, [Section("Slip", [*blocks, Section("Inner", ["x"])]), empty]).html()
    )
    assert [heading.text for heading in page.iter("h2")] == ["Slip", "How it was made"]
    assert [heading.text for heading in page.iter("h3")] == ["Inner"]
    assert [item.text for item in page.iter("li")] == ["one", "two"]
    assert page.find(".//figure").get("id") == "slip"
    assert " ".join("".join(page.find(".//figcaption").itertext()).split()) == "Slip. As driven. seed 1 · trackslip"


def test_a_table_has_its_rows_on_the_page():
    page = elements(Page("A page", "", {}, [Section("Laws", [LAWS])]).html())
    first, second = page.iter("tbody")
    assert (first.get("class"), second.get("class")) == ("chosen", None)
    assert first.find("tr/th").get("rowspan") == "2"
    assert [cell.text for cell in first.iter("td")] == ["D", "−43 ± 2 mm", "ε", "–"]
    assert [cell.get("class") for cell in second.iter("td")] == ["l", "r"]
    assert page.find(".//caption").text == second.find("tr/th").text == HOSTILE


def test_the_same_table_on_the_terminal(capsys):
    LAWS.print()
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    for row in (["icr", "D", "-43", "±", "2", "mm"], ["ε", "-"], [*HOSTILE.split(), "-", "1"], HOSTILE.split()):
        assert row in lines


def test_names_are_escaped_everywhere():
    blocks = [HOSTILE, LAWS, Bullets([HOSTILE]), Plot("slip", drawn(), HOSTILE, HOSTILE), Section(HOSTILE, [HOSTILE])]
    text = Page(HOSTILE, "", {HOSTILE: HOSTILE}, [Section(HOSTILE, blocks), warnings([HOSTILE])], [HOSTILE]).html()
    assert "<script" not in text
    assert text.count("&lt;script&gt;") == 17
    elements(text)


def test_a_page_needs_no_other_file():
    text = Page("A page", "", {}, [Section("Laws", [LAWS, Plot("slip", drawn(), "Slip")])]).html()
    assert re.findall(r"(?:src|href)=\"(?!#)[^\"]*|url\((?!#)|@import|<link|<script", text) == []


def test_captions_state_seed_ground_and_command():
    stone = {"along": 0.7, "across": 0.778, "slope": 0.0, "patches": [], "changes": []}
    assert conditions({"seed": 3, "ground": stone}, "trackslip grid --seed 3") == (
        "seed 3 · ground: friction 0.7 along, 0.778 across · trackslip grid --seed 3"
    )
    tilted = stone | {"slope": 0.1, "uphill": 1.57, "patches": [{}, {}]}
    line = conditions({"seed": [0, 1], "ground": {"stone": stone, "hill": tilted}}, "trackslip benchmark")
    assert line.startswith("seeds 0, 1 · stone ground: friction 0.7 along, 0.778 across; hill ground: friction 0.7")
    assert "slope 0.1 rad, uphill 1.57 rad, 2 patches" in line
    assert conditions({}, "trackslip evaluate a.csv") == "trackslip evaluate a.csv"
