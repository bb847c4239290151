"""Every code block of the README and of docs/ does what it says, and prints what is shown, to the digit."""

import importlib
import re
import sys

import pytest
from page_runner import PageRunner
from pages import PAGES, ROOT, arguments, blocks, commands, links

from experiments.cli import parse

FIRST = (ROOT / "README.md", ROOT / "docs" / "quick_start.md")
"""The pages whose blocks run in the fast tests."""


def ids(page):
    return str(page.relative_to(ROOT))


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    """An empty folder to run a page in, whose modules are forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr("experiments.common.sweep.processors", lambda: 1)  # others would take longer to start
    importlib.invalidate_caches()
    yield tmp_path
    for name, module in list(sys.modules.items()):
        if str(getattr(module, "__file__", None) or "").startswith(str(tmp_path)):
            del sys.modules[name]


@pytest.fixture
def runner(workplace, capsys):
    def captured():
        found = capsys.readouterr()
        return found.out + found.err

    return PageRunner(workplace, captured)


def run(page, runner):
    for block in blocks(page.read_text(encoding="utf-8")):
        try:
            runner.run(block)
        except BaseException as error:
            raise AssertionError(f"{ids(page)}, line {block.line}: {error!r}") from error
    if runner.missing:
        pytest.skip(f"the rest runs; {', '.join(runner.missing)}: not installed")


@pytest.mark.parametrize("page", [page for page in PAGES if page not in FIRST], ids=ids)
def test_every_command_and_its_options_are_there(page):
    for block in blocks(page.read_text(encoding="utf-8")):
        if block.language == "sh" and block.directive not in ("refused", "not run"):
            for words in map(arguments, commands(block.text)):
                parse(words)


@pytest.mark.parametrize("page", FIRST, ids=ids)
def test_blocks_of_the_first_pages_run(page, runner):
    run(page, runner)


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_every_block_runs(page, runner):
    runner.slow = True
    run(page, runner)


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_files_and_links_lead_somewhere_and_are_used(page):
    text = page.read_text(encoding="utf-8")
    for link in links(text):
        assert (page.parent / link).exists(), link
    for path in re.findall(r"`((?:trackslip|sim|experiments|models|tests|examples)/[^` ]*)`", text):
        assert (ROOT / path).exists(), path
    found = blocks(text)
    for k, block in enumerate(found):
        if block.directive == "file":
            later = "".join(other.text for other in found[k + 1 :] if other.language in ("sh", "python"))
            assert block.about.removesuffix(".py") in later, f"{block.about} is not used"
    assert not re.findall(r"^    trackslip .*", text, re.MULTILINE), "commands stand in blocks"


def test_the_index_lists_every_page_once():
    listed = links((ROOT / "docs" / "README.md").read_text(encoding="utf-8"))
    pages = {page.name for page in PAGES if page.parent.name == "docs"} - {"README.md"}
    assert sorted(name for name in listed if name.endswith(".md") and "/" not in name) == sorted(pages)
    site = re.findall(r"^ +- .*?(\S+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(name for name in site if "/" not in name) == sorted([*pages, "README.md"])


def test_most_commands_are_run():
    found = [block for page in PAGES for block in blocks(page.read_text(encoding="utf-8")) if block.language == "sh"]
    run = [block for block in found if block.directive in ("", "refused", "slow", "needs")]
    assert len(run) >= 2 * (len(found) - len(run))


def test_the_readme_is_short_and_all_its_commands_are_run():
    page = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(page.splitlines()) <= 180
    for block in blocks(page):
        assert block.language != "sh" or block.directive in ("", "slow", "needs"), f"line {block.line}"


# the runner of pages itself


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("```bash\nx\n```\n", "language 'bash'"),
        ("```python\nx\n", "without an end"),
        ("```toml\na = 1\n```\n", "a file without a name"),
        ("<!-- skipped: why -->\n```sh\nls\n```\n", "'skipped', must be one of"),
        ("<!-- not run -->\n```sh\nls\n```\n", "needs a reason"),
    ],
)
def test_pages_that_cannot_be(text, message):
    with pytest.raises(ValueError, match=message):
        blocks(text)


PRINTS = "```python\nprint('a 1.0 b')\nprint('c')\n```\n```text\n{}\n```\n"
SLOW = "<!-- slow: hours -->\n```python\nassert False\n```\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("```python\nassert 1 == 2\n```\n", None),
        ("```sh\ntrackslip grid --radius 1\n```\n", "radius"),
        ("<!-- refused -->\n```sh\ntrackslip predict --out out\n```\n", "predict"),
        (PRINTS.format("a 1.1"), "not printed: a 1.1"),
        (PRINTS.format("c\na 1.0 b"), "not printed: a 1.0"),
        (SLOW, None),
    ],
)
def test_blocks_that_are_wrong_fail(text, message, runner):
    *before, last = blocks(text)
    for block in before:
        runner.run(block)
    runner.slow = True
    with pytest.raises(AssertionError, match=message):
        runner.run(last)


def test_blocks_that_are_right_pass(runner):
    read = "```python\nfrom pathlib import Path\nassert Path('b.toml').read_text() == 'c = 1\\n'\n```\n"
    refused = "<!-- refused -->\n```sh\ntrackslip grid --radius 1\n```\n"
    for block in blocks(
        PRINTS.format("a 1.0 …\nc") + "<!-- file: b.toml -->\n```toml\nc = 1\n```\n" + read + refused + SLOW
    ):
        runner.run(block)
