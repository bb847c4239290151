"""Every code block of the README and of docs/ does what it says, and prints what is shown, to the digit."""

import importlib
import re
import sys

import pytest
from page_runner import PageRunner
from pages import PAGES, ROOT, arguments, blocks, commands, links

SLOW = [page for page in PAGES if any(block.directive == "slow" for block in blocks(page.read_text(encoding="utf-8")))]


def ids(page):
    return str(page.relative_to(ROOT))


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    """An empty folder to run a page in, whose modules are forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr("experiments.sweep.engine.processors", lambda: 1)  # others would take longer to start
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


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_every_block_runs(page, runner):
    run(page, runner)


@pytest.mark.slow
@pytest.mark.parametrize("page", SLOW, ids=ids)
def test_slow_blocks_run(page, runner):
    runner.slow = True
    run(page, runner)


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_every_command_stands_in_a_block(page):
    assert not re.findall(r"^    trackslip .*", page.read_text(encoding="utf-8"), re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_files_are_used(page):
    found = blocks(page.read_text(encoding="utf-8"))
    for k, block in enumerate(found):
        if block.directive == "file":
            later = "".join(other.text for other in found[k + 1 :] if other.language in ("sh", "python"))
            assert block.about.removesuffix(".py") in later, f"{ids(page)}: {block.about} is not used"


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_links_lead_somewhere(page):
    for link in links(page.read_text(encoding="utf-8")):
        assert (page.parent / link).exists(), link


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_files_and_folders_that_are_named_are_there(page):
    text = page.read_text(encoding="utf-8")
    for path in re.findall(r"`((?:trackslip|sim|experiments|models|tests|examples)/[^` ]*)`", text):
        assert (ROOT / path).exists(), path


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


# the collector itself

PAGE = """
Text with `code`.

```python
x = 1
```

<!-- file: a.toml -->
```toml
b = 2
```

<!-- parsed only: takes hours -->
```sh
# a comment
trackslip grid --radii 1 \\
    --speeds 0.1
```

```text
printed 1.0
```
"""


def test_blocks_are_found_with_what_is_said_about_them():
    found = blocks(PAGE)
    assert [(b.language, b.directive, b.about) for b in found] == [
        ("python", "", ""),
        ("toml", "file", "a.toml"),
        ("sh", "parsed only", "takes hours"),
        ("text", "", ""),
    ]
    assert found[0].line == 4
    assert found[1].text == "b = 2\n"
    assert [arguments(command) for command in commands(found[2].text)] == [
        ["grid", "--radii", "1", "--speeds", "0.1"],
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("```\nx\n```\n", "language ''"),
        ("```bash\nx\n```\n", "language 'bash'"),
        ("```python\nx\n", "without an end"),
        ("  ```python\nx\n  ```\n", "must start its line"),
        ("```toml\na = 1\n```\n", "a file without a name"),
        ("<!-- skipped: why -->\n```sh\nls\n```\n", "'skipped', must be one of"),
        ("<!-- not run -->\n```sh\nls\n```\n", "needs a reason"),
    ],
)
def test_pages_that_cannot_be(text, message):
    with pytest.raises(ValueError, match=message):
        blocks(text)


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("```python\nassert 1 == 2\n```\n", AssertionError, None),
        ("```python\nx = 1\n```\n```python\nassert x == 2\n```\n", AssertionError, None),
        ("```python\nimport nothing_of_that_name\n```\n", ModuleNotFoundError, "nothing_of_that_name"),
        ("```sh\ntrackslip grid --radius 1\n```\n", AssertionError, "radius"),
        ("<!-- parsed only: long -->\n```sh\ntrackslip grid --radius 1\n```\n", SystemExit, "2"),
        ("<!-- refused -->\n```sh\ntrackslip predict --out out\n```\n", AssertionError, "predict"),
        ("```sh\nls\n```\n", ValueError, "not a trackslip command"),
        ("```python\nprint('a 1.0')\n```\n```text\na 1.1\n```\n", AssertionError, "not printed: a 1.1"),
        ("```python\nprint('a 1.0')\n```\n```text\nb 1.0\n```\n", AssertionError, "not printed: b 1.0"),
        ("```python\nprint('a 1.0 b')\n```\n```text\na 1.0\n```\n", AssertionError, "not printed: a 1.0"),
        ("```python\nprint('a 1.0 b')\n```\n```text\na 1.1 …\n```\n", AssertionError, "not printed: a 1.1"),
        ("```python\nprint('a 1.269')\n```\n```text\na 1.268\n```\n", AssertionError, "not printed: a 1.268"),
        ("```python\nprint('a')\nprint('b')\n```\n```text\nb\na\n```\n", AssertionError, "not printed: a"),
    ],
)
def test_blocks_that_are_wrong_fail(text, error, message, runner):
    *before, last = blocks(text)
    for block in before:
        runner.run(block)
    with pytest.raises(error, match=message):
        runner.run(last)


def test_slow_blocks_are_only_run_by_slow_tests(runner):
    text = "<!-- slow: hours -->\n```python\nprint('a')\n```\n```text\nb\n```\n"
    command, output = blocks(text)
    runner.run(command)
    runner.run(output)
    runner.slow = True
    runner.run(command)
    with pytest.raises(AssertionError, match="not printed: b"):
        runner.run(output)


def test_blocks_that_are_right_pass(runner):
    text = (
        "```python\nx = 1\n```\n```python\nprint(f'a {x / 3:.4f} b')\n```\n```text\na 0.3333 …\n```\n"
        "<!-- file: b.toml -->\n```toml\nc = 1\n```\n"
        "```python\nfrom pathlib import Path\nassert Path('b.toml').read_text() == 'c = 1\\n'\n```\n"
        "<!-- refused -->\n```sh\ntrackslip grid --radius 1\n```\n"
    )
    for block in blocks(text):
        runner.run(block)
