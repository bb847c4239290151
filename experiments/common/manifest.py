"""Manifests: everything needed to reproduce a result, from options and versions to the git
state.
"""

import contextlib
import functools
import hashlib
import importlib.metadata
import json
import platform
import shlex
import subprocess
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from experiments.common.plain_json import plain
from trackslip.files import FORMAT
from trackslip.inputs import content_digest, recording
from trackslip.logs.runlog import RunLog

CODE: Final = tuple(
    Path(__file__).parents[2] / package for package in ("trackslip", "sim", "experiments", "models")
)
"""The folders of trackslip's code."""
RECORDING: Final = "recording"
"""Key of a manifest with the id of the recording of its inputs."""
_PACKAGES: Final = ("trackslip", "mujoco", "numpy", "scipy", "pyarrow", "matplotlib")


def make_manifest(command: str, config: Any, wall_s: float, **more: Any) -> dict[str, Any]:
    """Everything needed to reproduce a result: resolved options, versions, git state, and
    `more`.
    """
    return {
        "format": FORMAT,
        "command": command,
        "arguments": sys.argv[1:],
        "config": plain(config),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "wall_s": round(wall_s, 3),
        "versions": versions(),
        "platform": platform.platform(),
        "git": _git_state(),
        **_recording_id(),
        **plain(more),
    }


def _recording_id() -> dict[str, str]:
    """The id of what records the files that are read, by which a stored result finds its run."""
    inputs = recording()
    return {} if inputs is None else {RECORDING: inputs.id}


def origin(logs: Sequence[RunLog]) -> dict[str, Any]:
    """Seed, model hash and ground, each only if all runs share it; empty for runs of a real
    robot.
    """
    first = logs[0].metadata if logs else {}
    keys = [key for key in ("seed", "model_sha256", "ground") if first.get(key) is not None]
    return {
        key: first[key] for key in keys if all(log.metadata.get(key) == first[key] for log in logs)
    }


@functools.cache
def versions() -> dict[str, str | None]:
    """Versions of Python and of the packages that results depend on; None for those that aren't
    installed.
    """
    installed: dict[str, str | None] = {
        "python": platform.python_version(),
        **dict.fromkeys(_PACKAGES),
    }
    for package in _PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            installed[package] = importlib.metadata.version(package)
    return installed


@functools.cache
def code_digest() -> str:
    """A hash of trackslip's code: its version, for those who don't change it."""
    files = [file for folder in CODE for file in folder.rglob("*") if file.is_file()]
    contents = {
        str(file): content_digest(file) for file in files if "__pycache__" not in file.parts
    }
    return digest(contents)


def command_line(command: str) -> str:
    """The command line as the user typed it."""
    return shlex.join(["trackslip", *(sys.argv[1:] or [command])])


def digest(value: Any) -> str:
    """A short hash of `value`, which must be storable as JSON."""
    return hashlib.sha256(json.dumps(plain(value), sort_keys=True).encode()).hexdigest()[:32]


def content(path: Path) -> str | None:
    """SHA-256 of a file; None if there is no file."""
    return content_digest(path) if path.is_file() else None


@functools.cache
def _git_state() -> dict[str, Any] | None:
    """Commit of trackslip's checkout, and whether its files were changed; None without a checkout
    or git.
    """
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return None
    git = functools.partial(subprocess.check_output, text=True, cwd=root, stderr=subprocess.DEVNULL)
    try:
        commit = git(["git", "rev-parse", "HEAD"]).strip()
        # locks would outlive an interrupt
        changed = git(["git", "--no-optional-locks", "status", "--porcelain"])
    except (OSError, subprocess.CalledProcessError):
        return None
    return {"commit": commit, "dirty": bool(changed)}
