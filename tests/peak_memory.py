"""What a program has used of memory at the most."""

from __future__ import annotations

import resource
from pathlib import Path


def peak_of_this_process_mb() -> float:
    """Peak of the resident memory, MB. `getrusage` would also count the process that started this one."""
    status = Path("/proc/self/status")
    if not status.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) / 1024
