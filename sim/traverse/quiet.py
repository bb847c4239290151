"""MuJoCo's own log, kept quiet where what it says is handled."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco


@contextmanager
def quietly() -> Iterator[None]:
    """Neither print nor write to MUJOCO_LOG.TXT what the engine warns of inside: the caller looks at its counters."""
    before, quiet = mujoco.MjLogConfig.get(), mujoco.MjLogConfig.get()
    quiet.logto_console = quiet.logto_file = False
    quiet.set()
    try:
        yield
    finally:
        before.set()
