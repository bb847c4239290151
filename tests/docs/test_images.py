"""The pictures of the README and the documentation are made by one command, and show what it finds.

Pixels differ between machines; what a picture shows is compared as text.
"""

import re

import make
import pytest
from pages import PAGES


def test_one_command_makes_every_picture_that_pages_show():
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    shown = set(re.findall(r"images/(\w+\.(?:png|gif))", text))
    assert shown == set(make.DRAWINGS) == set(make.made())
    assert all((make.FOLDER / name).stat().st_size < 500_000 for name in shown)


@pytest.mark.slow
@pytest.mark.filterwarnings("default::trackslip.errors.RobotWarning")  # commands print them
@pytest.mark.parametrize("name", make.DRAWINGS)
def test_no_picture_is_stale(name):
    """If this fails, run `python docs/images/make.py NAME` and look at the picture."""
    assert make.stale([name]) == []


def test_a_picture_of_another_content_is_stale(monkeypatch, tmp_path):
    monkeypatch.setattr(make, "FOLDER", tmp_path)
    monkeypatch.setattr(make, "MADE", tmp_path / "made.json")
    drawn = make.Drawing("1.9 mm", lambda file: file.write_bytes(b"a picture"))
    monkeypatch.setattr(make, "DRAWINGS", {"a.png": lambda: drawn})
    assert make.stale(["a.png"]) == ["a.png"]  # it is missing
    assert make.main(["a.png"]) == 0
    assert make.stale(["a.png"]) == []
    drawn = make.Drawing("2.0 mm", drawn.draw)
    assert make.stale(["a.png"]) == ["a.png"]
    assert make.main(["--check"]) == 1
