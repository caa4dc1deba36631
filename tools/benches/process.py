"""Runs a command and says what it took: wall time, CPU time of the whole process, most memory."""

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from environment import ROOT


@dataclass
class Usage:
    """What a finished process took."""

    wall_s: float
    # User and system time of all its threads [s].
    cpu_s: float
    peak_bytes: int
    status: int
    stdout: str
    stderr: str


def run(command: list, env: dict | None = None) -> Usage:
    """Runs `command` to its end."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        start = time.monotonic()
        child = subprocess.Popen([str(c) for c in command], stdin=subprocess.DEVNULL, stdout=out, stderr=err, env=env, cwd=ROOT)
        _, status, usage = os.wait4(child.pid, 0)
        wall = time.monotonic() - start
        child.returncode = os.waitstatus_to_exitcode(status)
        texts = []
        for file in (out, err):
            file.seek(0)
            texts.append(file.read())
    unit = 1 if sys.platform == "darwin" else 1024
    return Usage(wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * unit, child.returncode, *texts)


def program() -> Path:
    """The release build of `lumel`."""
    return Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release" / "lumel"
