"""The memory that a process has used."""

import re
import sys
from pathlib import Path

_STATUS = Path("/proc/self/status")


def peak_memory() -> float | None:
    """The most memory that this process has used so far [MB]; None where the system doesn't tell."""
    if sys.platform == "win32":
        return None
    import resource

    if _STATUS.exists():  # the kernel's other count begins with the memory of the process that started this one
        found = re.search(r"VmHWM:\s+(\d+) kB", _STATUS.read_text(encoding="utf-8"))
        if found is not None:
            return int(found[1]) * 1024 / 1e6
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1 if sys.platform == "darwin" else 1024) / 1e6  # Linux counts in KiB
