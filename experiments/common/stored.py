"""Stored results: a command that is run again with the same options, on unchanged inputs and with
unchanged code, prints what it printed before.

When a command has ended, what it printed and digests of the files that it read are added to the
manifest of its results. Without them, as after a kill, there is no stored result.
"""

import contextlib
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final, TextIO

from experiments.common.manifest import CODE, code_digest, versions
from experiments.common.plain_json import plain
from experiments.common.results import REPORT_FILE
from experiments.common.results_folder import amend_manifest, manifest_of
from experiments.common.streams import PrintableOutput
from trackslip.bags.open import bags_in
from trackslip.errors import OutputError, TrackslipError
from trackslip.inputs import Inputs, content_digest, listing_digest, recorded
from trackslip.replacement import listed_files

STORED: Final = "stored"
"""Key of a manifest with what the command printed, and what its results depend on."""
_AGAIN: Final = "--overwrite runs it again"
_OF_THE_FOLDER: Final = ("out", "overwrite")
"""Options that don't change a result: its folder may be named by another path, or have moved."""
_DIFFERENCES: Final = 3  # largest number of changed options or files that a refusal names


@dataclass(frozen=True)
class StoredResult:
    """What a command printed, and how it ended."""

    out: Path
    created: datetime
    printed: str
    warnings: list[str]
    exit_code: int

    def print(self) -> None:
        """Print what the command printed and, on standard error, when that was."""
        for line in self.warnings:
            print(f"warning: {line}", file=sys.stderr)
        print(self.printed, end="", flush=True)
        page = self.out / REPORT_FILE
        shown = page if page.is_file() else self.out
        print(f"{shown}: from {_time(self.created)}, {_AGAIN}", file=sys.stderr)


class RecordedOutput(PrintableOutput):
    """A stream that keeps the text that it passes on, even if nobody reads it any more."""

    def __init__(self, stream: TextIO) -> None:
        super().__init__(stream)
        self.parts: list[str] = []
        self._failure: OSError | None = None

    def write(self, text: str) -> int:
        """Keep text, and pass it on until that fails; `finish` reports a failure."""
        self.parts.append(text)
        if self._failure is None:
            try:
                super().write(text)
            except OSError as error:
                self._failure = error
        return len(text)

    def flush(self) -> None:
        """Flush the stream."""
        if self._failure is None:
            try:
                super().flush()
            except OSError as error:
                self._failure = error

    def finish(self) -> None:
        """Flush the stream; raises OSError if anything couldn't be written."""
        self.flush()
        if self._failure is not None:
            raise self._failure


def stored_result(command: str, config: Any) -> StoredResult | None:
    """The stored result of a command with these options; None if its folder has none, or has one of
    another command.

    Raises OutputError, which names what changed, for a result of other options, code or inputs.
    """
    out = Path(config.out)
    manifest = _manifest(out)
    if manifest.get("command") != command or STORED not in manifest:
        return None
    about = manifest[STORED]
    _require_whole(out, manifest)
    _require_same_options(out, manifest["config"], config)
    _require_same_code(out, manifest["versions"], about["code"])
    _require_same_inputs(out, about["inputs"])
    created = datetime.fromisoformat(manifest["created"])
    return StoredResult(out, created, about["printed"], about["warnings"], about["exit_code"])


@contextlib.contextmanager
def storing(config: Any, warnings: list[str], ignored: Path) -> Iterator[None]:
    """Add what a command prints in a block, and what it reads, to the results that it writes.

    Args:
        config: the command's options.
        warnings: the warnings that were printed, when the block ends.
        ignored: a folder of temporary files, which are no inputs.
    """
    out = Path(config.out)
    code = code_digest()
    inputs = Inputs((out, ignored, *CODE))
    output = RecordedOutput(sys.stdout)
    exit_code = 0
    with recorded(inputs), contextlib.redirect_stdout(output):
        try:
            yield
        except SystemExit as stop:  # a check failed; anything else that fails isn't stored
            if stop.code != 1:
                raise
            exit_code = 1
    about = {
        "code": code,
        "inputs": inputs.digests,
        "printed": "".join(output.parts),
        "warnings": warnings,
        "exit_code": exit_code,
    }
    # the results are whole without it; they are then not printed again
    with contextlib.suppress(OSError, TrackslipError):
        amend_manifest(out, inputs.id, {STORED: about})
    output.finish()
    if exit_code:
        sys.exit(exit_code)


def _manifest(out: Path) -> Mapping[str, Any]:
    """The manifest in a folder; empty if there is none that can be read, which the command then
    reports.
    """
    try:
        return manifest_of(out)
    except (OSError, TrackslipError):
        return {}


def _require_whole(out: Path, manifest: Mapping[str, Any]) -> None:
    """Raise OutputError if one of a result's files is missing or has another size."""
    for path, size in (listed_files(manifest) or {}).items():
        file = out / path
        if not file.is_file():
            raise OutputError(f"{out} holds a result without its {path}; {_AGAIN}")
        if file.stat().st_size != size:
            about = f"contains {path}, which has changed since a command wrote it"
            raise OutputError(f"out = {str(out)!r}: {about}; move it away")


def _require_same_options(out: Path, then: Mapping[str, Any], config: Any) -> None:
    """Raise OutputError unless a result has these options."""
    before = dict(_values(then))
    now = dict(_values(plain(config)))
    changes = [
        f"{name} was {_shown(before.get(name))} and is {_shown(now.get(name))}"
        for name in {**now, **before}
        if before.get(name) != now.get(name) and name not in _OF_THE_FOLDER
    ]
    if changes:
        what = _listed(changes)
        raise OutputError(
            f"{out} holds a result of other options: {what}; --overwrite replaces it, --out "
            "chooses another folder"
        )


def _require_same_code(out: Path, then: Mapping[str, Any], code: str) -> None:
    """Raise OutputError unless a result was computed with this code and these libraries."""
    for package, version in versions().items():
        if then.get(package) != version:
            change = f"{package} was {then.get(package)} and is {version}"
            raise OutputError(f"{out} holds a result of other software: {change}; {_AGAIN}")
    if code != code_digest():
        raise OutputError(
            f"{out} holds a result of other software: the code of trackslip has changed since; "
            f"{_AGAIN}"
        )


def _require_same_inputs(out: Path, inputs: Mapping[str, str]) -> None:
    """Raise OutputError unless the files that a result was computed from have the same content."""
    changes = []
    for name, digest in inputs.items():
        found = _digest(Path(name))
        if found is None:
            changes.append(f"{name} is gone")
        elif found != digest:
            changes.append(f"{name} has changed since")
    if changes:
        what = _listed(changes)
        raise OutputError(f"{out} holds a result of other inputs: {what}; {_AGAIN}")


def _digest(path: Path) -> str | None:
    """The digest of a file's content, or of the bags in a folder; None if it can't be read."""
    try:
        return listing_digest(bags_in(path)) if path.is_dir() else content_digest(path)
    except OSError:
        return None


def _values(options: Mapping[str, Any], group: str = "") -> Iterator[tuple[str, Any]]:
    """Names and values of all options, those in groups with the group's name and a dot."""
    for name, value in options.items():
        if isinstance(value, Mapping):
            yield from _values(value, f"{group}{name}.")
        else:
            yield f"{group}{name}", value


def _shown(value: Any) -> str:
    """An option's value, for messages."""
    if value is None:
        return "not given"
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)


def _listed(changes: list[str]) -> str:
    """The first changes, and the number of those left out."""
    more = len(changes) - _DIFFERENCES
    return ", ".join([*changes[:_DIFFERENCES], *([f"and {more} more"] if more > 0 else [])])


def _time(created: datetime) -> str:
    """A time of today, or the date and time of an earlier day, by this machine's clock."""
    local = created.astimezone()
    is_today = local.date() == datetime.now().astimezone().date()
    return f"{local:%H:%M}" if is_today else f"{local:%Y-%m-%d %H:%M}"
