import re
from pathlib import Path

import pytest
from command_runs import Result, ran
from plain_drives import identified_from, wandered

from experiments.cli import main


@pytest.fixture
def trackslip(tmp_path):
    """A function that runs a command, by default into a new folder, and returns its Result."""

    def run(*arguments: str) -> Result:
        given = list(arguments)
        folder = tmp_path / given[0]
        while folder.exists():
            folder = folder.with_name(f"{folder.name}_again")
        if "--out" in given:
            k = given.index("--out")
            folder = Path(given[k + 1])
            del given[k : k + 2]
        return ran(folder, *given)

    return run


@pytest.fixture
def failing(capsys, tmp_path, monkeypatch):
    """A function that runs a command and returns its error: exit code 2, no output, no files."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> str:
        before = sorted(tmp_path.rglob("*"))
        with pytest.raises(SystemExit) as stop:
            main(list(arguments))
        captured = capsys.readouterr()
        assert stop.value.code == 2
        assert sorted(tmp_path.rglob("*")) == before
        assert captured.out == ""
        return captured.err

    return run


@pytest.fixture
def with_figures():
    """Draw the figures of the pages that a test writes."""


@pytest.fixture(autouse=True)
def _quick_pages(request, monkeypatch):
    """Pages without their figures, which take most of the time, unless a test or a wider fixture
    draws them.
    """
    if "with_figures" not in request.fixturenames:
        monkeypatch.setattr("experiments.common.page.drawn_plot", lambda plot, pdf=False: ())


_PROGRESS = re.compile(r"[^:]+: [\d.]+( of [\d.]+)? \w+.*")


@pytest.fixture
def refused(failing):
    """A function that runs a command and returns its one-line refusal."""

    def run(*arguments: str) -> str:
        *progress, line = failing(*arguments).strip().splitlines()
        assert all(_PROGRESS.fullmatch(one) for one in progress)  # of a busy machine
        assert line.startswith("trackslip: ")
        return line.removeprefix("trackslip: ")

    return run


@pytest.fixture
def short(tmp_path, monkeypatch):
    """Options of a benchmark that takes seconds, run in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "bend.csv").write_text("x,y\n0,0\n0.7,0.1\n1.4,0.45\n")
    return (
        "--references",
        "bend.csv",
        "--starts",
        "zero",
        "--localization",
        "truth",
        "--jobs",
        "1",
    )


@pytest.fixture(scope="session")
def two_drives():
    return identified_from(
        wandered(outliers=4, duration=25.0), wandered(name="again", duration=15.0, seed=1)
    )
