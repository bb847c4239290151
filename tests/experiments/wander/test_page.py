import pytest

from experiments.cli import parse
from experiments.simulate.world import World
from experiments.wander.drives import drive_contents, wander
from experiments.wander.page import page

pytestmark = pytest.mark.usefixtures("with_figures")


def page_of(*options):
    config = parse(["wander", "--duration", "4", *options])
    logs = wander(config, World.of(config), lambda seconds: None)
    contents = [drive_contents(log) for log in logs]
    return page(config, logs, contents, ["box has no motors"], {"seed": 0})


def test_the_page_has_the_paths_of_a_few_drives():
    found = page_of("--drives", "5")
    charts = next(block for block in found.blocks if getattr(block, "name", "") == "paths")
    paths = charts.figure()
    assert [chart.title for chart in paths] == [f"random {k}" for k in (1, 2, 3, 4)]
    for chart in paths:
        assert [curve.label for curve in chart.curves] == ["measured", "driven", "start"]
    assert charts.heading == "Paths of the first 4 drives"
    assert found.answer.heading.startswith("5 drives of 4 s, ")
    assert "Box has no motors." in found.answer.lines
    assert found.html().count('<div class="zoom">') == 6


def test_poses_without_headings_have_a_page():
    found = page_of("--source", "gnss", "--drives", "1")
    assert dict(found.answer.facts)["poses"].endswith(" by gnss, at 5 Hz")
    assert found.html().count('<div class="zoom">') == 3
