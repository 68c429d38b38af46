"""What the bench scripts share: running klasktron and measuring it."""

import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def target_dir():
    """Where cargo builds."""
    return Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))


def default_binary():
    """The release binary of this working tree."""
    return target_dir() / "release" / "klasktron"


@dataclass
class Measured:
    """Outcome of one command."""

    seconds: float
    peak_mb: float
    status: int


def run_measured(command, accepted=(0,)):
    """Run `command`; its wall time, peak memory (MB) and exit status."""
    start = time.perf_counter()
    child = subprocess.Popen(
        [str(part) for part in command], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    # The output is short; it is read before waiting so that the child never blocks on it.
    message = child.stderr.read().decode(errors="replace")
    child.stderr.close()
    _, status, usage = os.wait4(child.pid, 0)
    seconds = time.perf_counter() - start
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode not in accepted:
        line = " ".join(str(part) for part in command)
        sys.exit(f"{line}\nended with status {child.returncode}:\n{message}")
    # Linux reports kilobytes, macOS bytes.
    unit = 1e6 if sys.platform == "darwin" else 1e3
    return Measured(seconds, usage.ru_maxrss / unit, child.returncode)


def machine():
    """Processor and load, so that figures can be judged."""
    name = "unknown"
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        lines = cpuinfo.read_text(encoding="utf-8").splitlines()
        names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
        name = names[0] if names else name
    return {
        "processor": name,
        "cores": os.cpu_count(),
        "load_average": [round(load, 2) for load in os.getloadavg()],
    }
