"""Commands run in this process, and their results."""

import contextlib
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.cli import main


@dataclass(frozen=True)
class Result:
    folder: Path
    summary: dict[str, Any]
    manifest: dict[str, Any]
    printed: str


def ran(folder: Path, *arguments: str) -> Result:
    """Run a command into a folder and read its results; raises SystemExit if it fails."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        main([*arguments, "--out", str(folder)])
    summary = json.loads((folder / "summary.json").read_text())
    manifest = json.loads((folder / "manifest.json").read_text())
    return Result(folder, summary, manifest, printed.getvalue())
