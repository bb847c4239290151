"""Names of several logs, for tables, figures and folders."""

from collections.abc import Sequence
from pathlib import Path

from trackslip.errors import require


def refuse_same_logs(logs: Sequence[Path]) -> None:
    """Raise InvalidValueError unless there is at least one log, and all are different."""
    require(logs, "logs", logs, "at least one log")
    different = {log.resolve() for log in logs}
    require(len(different) == len(logs), "logs", logs, "all different")


def log_names(logs: Sequence[Path]) -> list[str]:
    """Names (n,) of logs (n,): of files without endings, or of folders; with the folders above them
    as far as it takes to tell them apart.
    """
    paths = [log.resolve() for log in logs]
    whole = [path.with_suffix("") if path.is_file() else path for path in paths]
    names = [path.name for path in whole]
    depth = 1
    while len(set(names)) < len(names) and depth < max(len(path.parts) for path in whole):
        depth += 1
        names = ["/".join(path.parts[-depth:]) for path in whole]
    if len(set(names)) < len(names):  # files that differ only in their endings
        names = [str(path) for path in paths]
    return names
