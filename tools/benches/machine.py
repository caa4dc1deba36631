"""What figures were measured on."""

import datetime
import os
import platform
import subprocess
from pathlib import Path

from benches.process import program

# Widest first; the flag as the kernel names it.
INSTRUCTION_SETS = [("avx512f", "AVX-512"), ("avx2", "AVX2"), ("asimd", "NEON"), ("sse4_2", "SSE 4.2")]


def describe() -> dict:
    """Processor, cores, instruction set, versions and the day."""
    return {
        "processor": _cpu_field("model name") or platform.processor() or platform.machine(),
        "instructions": instruction_set(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "system": platform.system(),
        "lumel": _first_line([program(), "--version"]),
        "rustc": _first_line(["rustc", "--version"]),
        "date": f"{datetime.date.today()}",
    }


def instruction_set() -> str:
    flags = (_cpu_field("flags") or _cpu_field("Features") or "").split()
    return next((name for flag, name in INSTRUCTION_SETS if flag in flags), platform.machine())


def _cpu_field(name: str) -> str | None:
    file = Path("/proc/cpuinfo")
    if not file.is_file():
        return None
    return next((line.split(":", 1)[1].strip() for line in file.read_text().splitlines() if line.startswith(name)), None)


def _first_line(command: list) -> str:
    found = subprocess.run([str(c) for c in command], capture_output=True, text=True).stdout
    return " ".join(found.split("\n")[0].split()[:2])
