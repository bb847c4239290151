"""Every code block of the README and of docs/ does what it says, and prints what is shown, to the
digit.
"""

import re

import pytest
from pages import PAGES, ROOT, PageRunner, blocks, commands, links

from experiments.cli import parse

FIRST = (ROOT / "README.md", ROOT / "docs" / "quick_start.md")  # their blocks run in the fast tests


def ids(page):
    return str(page.relative_to(ROOT))


@pytest.fixture
def runner(workplace, capsys):
    return PageRunner(workplace, lambda: "".join(capsys.readouterr()))


def run(page, runner):
    for block in blocks(page.read_text(encoding="utf-8")):
        try:
            runner.run(block)
        except BaseException as error:
            raise AssertionError(f"line {block.line}: {error!r}") from error


@pytest.mark.parametrize("page", [page for page in PAGES if page not in FIRST], ids=ids)
def test_every_command_and_its_options_are_there(page):
    for block in blocks(page.read_text(encoding="utf-8")):
        if block.language == "sh" and block.directive not in ("refused", "not run"):
            for words in commands(block.text):
                parse(words)


@pytest.mark.parametrize("page", FIRST, ids=ids)
def test_blocks_of_the_first_pages_run(page, runner):
    run(page, runner)


@pytest.mark.slow
@pytest.mark.filterwarnings("default::trackslip.errors.RobotWarning")  # commands print them
@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_every_block_runs(page, runner):
    runner.slow = True
    run(page, runner)


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_files_and_links_lead_somewhere(page):
    text = page.read_text(encoding="utf-8")
    for link in links(text):
        assert (page.parent / link).exists(), link
    for path in re.findall(r"`((?:trackslip|sim|experiments|models|tests|examples)/[^` ]*)`", text):
        assert (ROOT / path).exists(), path


def test_the_index_lists_every_page_once():
    pages = sorted(page.name for page in PAGES if page.parent.name == "docs")
    index = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    listed = [link for link in links(index) if link.endswith(".md") and "/" not in link]
    assert sorted([*listed, "README.md"]) == pages
    site = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    of_site = re.findall(r"^ +- .*?(\S+\.md)$", site, re.MULTILINE)
    assert sorted(name for name in of_site if "/" not in name) == pages
