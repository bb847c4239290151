"""Options of `trackslip completion`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import tyro


@dataclass(frozen=True)
class CompletionConfig:
    """Print a script that lets a shell complete commands, options and their values."""

    shell: tyro.conf.Positional[Literal["bash", "zsh", "fish"]]
    """For which shell."""
