"""Every code block of the README and of docs/ does what it says."""

from __future__ import annotations

import importlib
import re
import sys

import numpy as np
import pytest
from pages import PAGES, ROOT, arguments, blocks, commands, indented, links

from experiments.cli import main, parse
from trackslip.errors import TrackslipError

OPTIONAL = ("pandas", "polars")
"""Libraries that readers may have; those who test have them by the extra `test`."""
NUMBER = re.compile(r"[-+]?\d[\d,]*\.?\d*(?:e[-+]?\d+)?")


def ids(page):
    return str(page.relative_to(ROOT))


def undrawn(figure, file, **_):
    """In place of drawing, which would take most of the time and has tests of its own."""
    file.write("<svg></svg>")


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    """An empty folder to run a page in, whose modules are forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", undrawn)
    for module in ("experiments.commands.grid", "experiments.benchmark.jobs"):  # others would take longer to start
        monkeypatch.setattr(f"{module}.processors", lambda: 1)
    importlib.invalidate_caches()
    yield tmp_path
    for name, module in list(sys.modules.items()):
        if str(getattr(module, "__file__", None) or "").startswith(str(tmp_path)):
            del sys.modules[name]


class Runner:
    """Runs the blocks of a page, in order."""

    def __init__(self, folder, capsys):
        self.folder, self.capsys = folder, capsys
        self.names = {"__name__": "__main__"}
        self.printed = None  # by the block before, if it was run
        self.missing = []  # libraries that only the documentation asks for

    def run(self, block):
        if block.language == "text":
            if self.printed is not None:
                require_printed(block.text, self.printed)
            return
        self.printed = None
        if block.directive == "file":
            (self.folder / block.about).write_text(block.text, encoding="utf-8")
        if block.language == "python":
            try:
                exec(compile(block.text, f"line {block.line}", "exec"), self.names)
            except ModuleNotFoundError as error:
                if error.name not in OPTIONAL:
                    raise
                self.missing.append(error.name)
        elif block.language == "sh":
            if block.directive == "not run":
                return
            for command in commands(block.text):
                self.command(arguments(command), block.directive)
            if block.directive == "parsed only":
                return
        captured = self.capsys.readouterr()
        self.printed = captured.out + captured.err

    def command(self, given, directive):
        if directive == "parsed only":
            parse(given)
            return
        code = 0
        try:
            main(given)
        except SystemExit as stop:
            code = stop.code or 0
        assert code == (2 if directive == "refused" else 0), given


def require_printed(shown, printed):
    """Every line that is shown was printed, in order; after a … anything may follow."""
    there = iter([line.split() for line in printed.splitlines() if line.strip()])
    for line in filter(None, map(str.strip, shown.splitlines())):
        words = line.removesuffix("…").split()
        if not any(alike(words, found[: len(words)] if line.endswith("…") else found) for found in there):
            raise AssertionError(f"not printed: {line}")


def alike(words, found):
    """Whether words are the same, numbers to within what another processor may change."""
    one, other = " ".join(words), " ".join(found)
    if NUMBER.sub("#", one) != NUMBER.sub("#", other):
        return False
    values, reference = ([float(n.replace(",", "")) for n in NUMBER.findall(text)] for text in (one, other))
    return np.allclose(values, reference, rtol=0.02, atol=2e-4)


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_every_block_runs(page, workplace, capsys):
    runner = Runner(workplace, capsys)
    for block in blocks(page.read_text(encoding="utf-8")):
        try:
            runner.run(block)
        except BaseException as error:
            raise AssertionError(f"{ids(page)}, line {block.line}: {error!r}") from error
    if runner.missing:
        pytest.skip(f"the rest runs; {', '.join(runner.missing)}: not installed")


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_indented_commands_parse(page):
    for command in indented(page.read_text(encoding="utf-8")):
        assert parse(arguments(command)) is not None


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_files_are_used(page):
    text = page.read_text(encoding="utf-8")
    found = blocks(text)
    for k, block in enumerate(found):
        if block.directive == "file":
            later = "".join(other.text for other in found[k + 1 :] if other.language in ("sh", "python"))
            module = block.about.removesuffix(".py")
            assert module in later + "".join(indented(text)), f"{ids(page)}: {block.about} is not used"


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_links_lead_somewhere(page):
    for link in links(page.read_text(encoding="utf-8")):
        assert (page.parent / link).exists(), link


def test_the_index_lists_every_page_once():
    listed = links((ROOT / "docs" / "README.md").read_text(encoding="utf-8"))
    pages = {page.name for page in PAGES if page.parent.name == "docs"} - {"README.md"}
    assert sorted(name for name in listed if name.endswith(".md") and "/" not in name) == sorted(pages)


def test_most_commands_are_run():
    found = [block for page in PAGES for block in blocks(page.read_text(encoding="utf-8")) if block.language == "sh"]
    run = [block for block in found if block.directive in ("", "refused")]
    assert len(run) >= 2 * (len(found) - len(run))


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
eval "$(trackslip completion bash)"
mpiexec -n 3 python -m mpi4py.futures -m experiments grid --executor mpi
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
        ["completion", "bash"],
        ["grid", "--executor", "mpi"],
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("```\nx\n```\n", "language ''"),
        ("```bash\nx\n```\n", "language 'bash'"),
        ("```python\nx\n", "without an end"),
        ("  ```python\nx\n  ```\n", "line's begin"),
        ("```toml\na = 1\n```\n", "a file without a name"),
        ("<!-- skipped: why -->\n```sh\nls\n```\n", "'skipped', must be one of"),
        ("<!-- not run -->\n```sh\nls\n```\n", "or why"),
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
        ("<!-- parsed only: long -->\n```sh\ntrackslip grid --radius 1\n```\n", TrackslipError, "radius"),
        ("<!-- refused -->\n```sh\ntrackslip completion bash\n```\n", AssertionError, "completion"),
        ("```sh\nls\n```\n", ValueError, "not a command"),
        ("```python\nprint('a 1.0')\n```\n```text\na 1.1\n```\n", AssertionError, "not printed: a 1.1"),
        ("```python\nprint('a 1.0')\n```\n```text\nb 1.0\n```\n", AssertionError, "not printed: b 1.0"),
        ("```python\nprint('a 1.0 b')\n```\n```text\na 1.0\n```\n", AssertionError, "not printed: a 1.0"),
        ("```python\nprint('a 1.0 b')\n```\n```text\na 1.1 …\n```\n", AssertionError, "not printed: a 1.1"),
    ],
)
def test_blocks_that_are_wrong_fail(text, error, message, workplace, capsys):
    *before, last = blocks(text)
    runner = Runner(workplace, capsys)
    for block in before:
        runner.run(block)
    with pytest.raises(error, match=message):
        runner.run(last)


def test_blocks_that_are_right_pass(workplace, capsys):
    runner = Runner(workplace, capsys)
    text = (
        "```python\nx = 1\n```\n```python\nprint('a', x / 3, 'b')\n```\n```text\na 0.3333 …\n```\n"
        "<!-- file: b.toml -->\n```toml\nc = 1\n```\n"
        "```python\nfrom pathlib import Path\nassert Path('b.toml').read_text() == 'c = 1\\n'\n```\n"
        "<!-- refused -->\n```sh\ntrackslip grid --radius 1\n```\n"
    )
    for block in blocks(text):
        runner.run(block)
