"""Run the code blocks of a page and compare what they print with what it shows.

`python tests/helpers/page_runner.py docs/validation.md` runs a page, slow commands included, and replaces the lines it
shows by those that are printed now.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import os
import re
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from pages import ROOT, Block, arguments, blocks, commands, missing_line

from experiments.cli import main, parse

OPTIONAL = ("pandas", "polars")
"""Libraries that readers may have; the extra `test` brings them."""
_NUMBER = re.compile(r"[-+]?\d[\d,]*\.?\d*(?:e[-+]?\d+)?")


@dataclass
class PageRunner:
    """Runs the blocks of a page, in order, and compares what they print with what it shows."""

    folder: Path
    """Where the page's files are written: the working directory."""
    captured: Callable[[], str]
    """Gives what was printed since the last call."""
    slow: bool = False
    """Whether slow blocks are run, too; their commands are parsed anyhow."""
    names: dict[str, Any] = field(default_factory=lambda: {"__name__": "__main__"})
    printed: str | None = None
    """By the block before, if it was run."""
    missing: list[str] = field(default_factory=list)
    """Optional libraries that aren't installed."""

    def __post_init__(self) -> None:
        (self.folder / "examples").symlink_to(ROOT / "examples")  # pages are read in a checkout

    def run(self, block: Block) -> None:
        """Run a block; raises AssertionError where a page shows what wasn't printed, or a command ends otherwise."""
        if block.language == "text":
            line = None if self.printed is None else missing_line(block.text, self.printed)
            assert line is None, f"not printed: {line}\nprinted was:\n{self.printed}"
            return
        runs = self._runs(block)
        if block.directive == "file":
            (self.folder / block.about).write_text(block.text, encoding="utf-8")
        if block.language == "python" and runs:
            self._python(block)
        elif block.language == "sh" and block.directive != "not run":
            for words in map(arguments, commands(block.text)):
                self._command(words, block.directive) if runs else parse(words)
        self.printed = self.captured() if runs else None

    def _runs(self, block: Block) -> bool:
        if block.directive == "needs":
            return importlib.util.find_spec(block.about) is not None
        return block.directive not in ("parsed only", "not run") and (self.slow or block.directive != "slow")

    def _python(self, block: Block) -> None:
        try:
            exec(compile(block.text, f"line {block.line}", "exec"), self.names)
        except ModuleNotFoundError as error:
            if error.name not in OPTIONAL:
                raise
            self.missing.append(error.name)

    def _command(self, given: list[str], directive: str) -> None:
        code = 0
        try:
            main(given)
        except SystemExit as stop:
            code = stop.code or 0
        assert code == (2 if directive == "refused" else 0), given


def refreshed(page: str, runner: PageRunner) -> str:
    """A page with the numbers that its blocks print now."""
    lines = page.splitlines()
    for block in blocks(page):
        if block.language == "text" and runner.printed is not None:
            printed = [line.rstrip() for line in runner.printed.splitlines() if line.strip()]
            for k in range(block.line, block.line + len(block.text.splitlines())):
                lines[k] = _as_printed(lines[k], printed)
        else:
            runner.run(block)
    return "\n".join(lines) + "\n"


def _as_printed(line: str, printed: list[str]) -> str:
    """The first printed line with the same words, else the most similar one; consumed lines leave `printed`."""
    words = line.removesuffix("…").split()
    cut = len(words) if line.endswith("…") else None

    def pattern(text: str) -> list[str]:
        return [_NUMBER.sub("#", word) for word in text.split()[:cut]]

    same = [found for found in printed if pattern(found) == pattern(" ".join(words))]
    nearest = same[:1] or get_close_matches(line, printed, 1, 0.7)
    if not words or not nearest:
        return line
    (found,) = nearest
    del printed[: printed.index(found) + 1]
    now = found.split()[:cut]
    return line if now == words else found if cut is None else " ".join(now) + " …"


def _refresh(path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), io.StringIO() as output:

        def captured() -> str:
            text = output.getvalue()
            output.seek(0)
            output.truncate()
            return text

        sys.path.insert(0, folder)
        runner = PageRunner(Path(folder), captured, slow=True)
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
            text = refreshed(path.read_text(encoding="utf-8"), runner)
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    os.environ["COLUMNS"] = "200"
    for name in [Path(name).resolve() for name in sys.argv[1:]]:
        _refresh(name)
