import math
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from matplotlib.figure import Figure

from experiments.common.page import Answer, Bullets, Page, Plot, Section
from experiments.common.results import FIGURES_FOLDER, REPORT_FILE
from experiments.common.table import (
    MISSING,
    Cell,
    Table,
    number,
    pair,
    percent,
    significant,
    span,
    stages_text,
)
from trackslip.laws.families import FAMILIES
from trackslip.views.symbols import symbol

pytestmark = pytest.mark.usefixtures("with_figures")


def drawn() -> Figure:
    figure = Figure(figsize=(2, 1))
    figure.subplots().plot([0, 1], [1, 0])
    return figure


def test_figures_are_the_same_files_each_time(tmp_path):
    page = Page("A page", "", {}, [Section("Figures", [Plot("slip", drawn(), "slip")])])
    for folder in (tmp_path / "a", tmp_path / "b"):
        folder.mkdir()
        page.write(folder, pdf=True)
        for file in (REPORT_FILE, f"{FIGURES_FOLDER}/slip.svg"):
            assert (folder / file).read_bytes() == (tmp_path / "a" / file).read_bytes()
        assert (folder / FIGURES_FOLDER / "slip.pdf").exists()


HOSTILE = "<script>alert('1')</script> & \"name\""
LAWS = Table(
    HOSTILE,
    ("law", "parameter", "value"),
    [
        (Cell("constant ICR", "icr", ("a / b",), "best"), "D", "−43 ± 2 mm"),
        ("", "ε", "nan"),
        (HOSTILE, "–", "1"),
    ],
    "llr",
    note="a note",
)


def elements(text):
    page = text.partition("<body>")[2].partition("</body>")[0]
    return ET.fromstring(re.sub(r"<svg.*?</svg>", "", f"<body>{page}</body>", flags=re.DOTALL))


def test_a_page_is_sections_of_blocks():
    plot = Plot("slip", [drawn(), drawn()], "Slip", "As driven.")
    slip = Section(
        "Slip", ["a paragraph", LAWS, None, Bullets(["one", "two"]), plot, Section("Inner", ["x"])]
    )
    text = Page("A page", "trackslip", {"seed": 1}, [slip, Section("Nothing", [None, ""])]).html()
    page = elements(text)
    assert [heading.text for heading in page.iter("h2")] == ["Slip"]
    assert [summary.text for summary in page.iter("summary")] == ["How it was made"]
    assert [heading.text for heading in page.iter("h3")] == ["Inner"]
    assert [item.text for item in page.iter("li")] == ["one", "two"]
    assert (
        " ".join("".join(page.find(".//figcaption").itertext()).split())
        == "Slip. As driven. seed 1 · trackslip"
    )
    first, second = page.iter("tbody")
    assert (first.get("class"), second.get("class")) == ("chosen", None)
    assert first.find("tr/th").get("rowspan") == "2"
    assert [cell.text for cell in first.iter("td")] == ["D", "−43 ± 2 mm", "ε", "–"]
    assert page.find(".//caption/span").text == second.find("tr/th").text == HOSTILE
    # no other file
    assert re.findall(r"(?:src|href)=\"(?!#)[^\"]*|url\((?!#)|@import|<link|<script", text) == []


def table_of(columns):
    return Table("Errors", [f"column {k}" for k in range(columns)], [["1"] * columns])


def test_tables_of_ten_columns_and_more_are_dense():
    classes = []
    for columns in (9, 10):
        text = Page("A page", "", {}, [Section("S", [table_of(columns)])]).html()
        (scrolled,) = [each for each in elements(text).iter("div") if each.get("role") == "region"]
        classes.append(scrolled.get("class"))
    assert classes == ["scroll", "scroll dense"]


def test_a_table_on_the_terminal_has_plain_text(capsys):
    LAWS.print()
    title, _, header, _, *rows = (line.rstrip() for line in capsys.readouterr().out.splitlines())
    assert title.strip() == HOSTILE
    assert header.split() == ["law", "parameter", "value"]
    assert [row.split()[-1] for row in rows[:3]] == ["mm", "-", "1"]
    assert rows[0].split() == ["icr", "D", "-43", "±", "2", "mm"]
    # text on the left, numbers on the right
    assert rows[0].startswith(" icr")
    assert len({len(row) for row in rows[:3]}) == 1


def test_names_are_escaped_everywhere():
    blocks = [
        HOSTILE,
        LAWS,
        Bullets([HOSTILE]),
        Plot("slip", drawn(), HOSTILE, HOSTILE),
        Section(HOSTILE, [HOSTILE]),
    ]
    answer = Answer(HOSTILE, [(HOSTILE, HOSTILE)], [HOSTILE], [HOSTILE], next=[HOSTILE])
    text = Page(
        HOSTILE, "", {HOSTILE: HOSTILE}, [Section(HOSTILE, blocks)], [HOSTILE], answer
    ).html()
    assert "<script" not in text
    assert text.count("&lt;script&gt;") == 22
    elements(text)


def test_alarms_stand_in_place_of_the_heading():
    answer = Answer("Best law: icr", alarms=["60 s are too few", HOSTILE])
    text = Page("Laws", "", {}, [], answer=answer).html()
    assert '<section class="answer alarm">\n<h2>60 s are too few</h2>' in text
    assert "<script" not in text
    assert "Best law" not in text


def test_no_symbol_stands_for_two_things_in_the_table_of_a_drive():
    for law in (name for name, family in FAMILIES.items() if family.of_drives):
        names = [*FAMILIES[law].names, "drift", "clock_offset", "gyro_bias", "gyro_scale", "lag"]
        symbols = [symbol(law, name) for name in names]
        assert len(set(symbols)) == len(symbols)


def test_a_number_that_rounds_to_zero_has_no_sign():
    assert number(-0.04, 1, "s/m") == "0.0 s/m"
    assert number(-0.06, 1, "s/m") == "−0.1 s/m"


def test_numbers_as_printed():
    for unknown in (None, math.nan, math.inf):
        assert number(unknown, 2, "mm") == significant(unknown, "mm") == percent(unknown) == MISSING
    assert number(-1.256, 2, "mm") == "−1.26 mm"
    assert [significant(value) for value in (0.0, 0.00123, 4.56, 12345.6)] == [
        "0",
        "0.0012",
        "4.6",
        "12,346",
    ]
    assert percent(0.0123) == "1.2 %"


def test_values_side_by_side_share_a_unit():
    assert pair(["1.2", "3.4"], "mm") == "1.2 | 3.4 mm"
    assert pair(["1.2", MISSING], "mm") == f"1.2 | {MISSING} mm"
    assert pair([MISSING, MISSING], "mm") == f"{MISSING} | {MISSING}"


def test_a_span_of_values_is_from_the_least_to_the_largest():
    assert span(np.array([2.0, 0.12345, 1.0]), "m") == "0.123 to 2 m"
    assert span(np.array([5.0, 5.0]), "m") == "5 m"
    assert span(np.array([5.0, 10.0]), "°") == "5 to 10°"
    assert span(np.array([5.0, 10.0])) == "5 to 10"


def test_stages_are_in_seconds():
    assert stages_text({"fit": 1.26, "draw": 0.1}) == "fit 1.3 s, draw 0.1 s"
