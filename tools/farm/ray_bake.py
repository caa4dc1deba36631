#!/usr/bin/env python3
"""Bakes a plan on a Ray cluster: a task for each shard, done again where it dies, and then the merge.

    ray_bake.py PLAN.json [-o DIR] [--scene FILE] [--cache DIR] [--lumel PROGRAM] [--address ADDRESS] [--cpus N] [--retries N]

Exit code: that of `lumel merge`, or 1 where a shard failed as often as it may.
"""

import argparse
import ctypes
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

try:
    import ray
except ImportError:
    sys.exit("ray_bake.py: Ray is missing: pip install -r tools/farm/requirements.txt")

# How often a task looks after its shard [s].
PAUSE = 0.2
# Lines of a shard's last words that are shown.
LAST_LINES = 5


class ShardFailed(Exception):
    """A shard ended without having done its part."""


def death_follows() -> Callable[[], None] | None:
    """What a shard does first so that it doesn't outlive the worker that started it, and do what another has been given by then."""
    if sys.platform != "linux":
        return None
    # Found before the process forks: a child of several threads must not load libraries.
    prctl, PR_SET_PDEATHSIG = ctypes.CDLL(None).prctl, 1
    return lambda: prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def bake_shard(command: list[str]) -> str:
    """Runs one shard to its end, on whichever machine Ray has chosen, and returns what it says of its work."""
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, preexec_fn=death_follows()
    )
    _, said = process.communicate()
    lines = said.strip().splitlines()
    if process.returncode != 0:
        raise ShardFailed(f"exit {process.returncode}: {'; '.join(lines[-LAST_LINES:])}")
    return next((line for line in lines if line.startswith("did ")), "")


def main() -> int:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("plan", type=Path, help="what `lumel plan` wrote")
    ap.add_argument("-o", "--output", type=Path, help="folder for the result [default: as the plan has it]")
    ap.add_argument("--scene", type=Path, help="the scene, where it isn't where the plan has it")
    ap.add_argument("--cache", type=Path, help="the folder that shards share, where it isn't where the plan has it")
    ap.add_argument("--lumel", default="lumel", help="the program on each machine [default: lumel]")
    ap.add_argument("--address", default="local", help="cluster to join: auto, HOST:PORT or ray://HOST:PORT [default: local, one on this machine]")
    ap.add_argument("--cpus", type=int, default=1, help="threads of a shard [default: 1]")
    ap.add_argument("--retries", type=int, default=3, help="how often a shard that dies is begun anew [default: 3]")
    a = ap.parse_args()
    try:
        shards = json.loads(a.plan.read_text())["shards"]
    except (OSError, ValueError, KeyError, TypeError) as e:
        sys.exit(f"ray_bake.py: {a.plan} is no plan of a bake ({e}); `lumel plan` makes one")
    program = shutil.which(a.lumel)
    if program is None:
        sys.exit(f"ray_bake.py: {a.lumel} is no program; --lumel says where it is")
    # Workers stand in other folders.
    lumel = os.path.abspath(program) if os.sep in a.lumel else a.lumel
    scene = [str(a.scene.absolute())] if a.scene else []
    cache = ["--cache", str(a.cache.absolute())] if a.cache else []
    plan = str(a.plan.absolute())

    def command(k: int) -> list[str]:
        return [lumel, "bake", *scene, "--plan", plan, *cache, "--shard", f"{k}/{shards}", "--threads", str(a.cpus)]

    own = {"include_dashboard": False} if a.address == "local" else {}
    ray.init(address=a.address, log_to_driver=False, **own)
    print(f"{shards} shards on {len(ray.nodes())} machine(s) of {ray.cluster_resources().get('CPU', 0):.0f} processors", flush=True)
    # Ray does a task again whose worker or machine dies, and, as it is told, one whose shard fails.
    task = ray.remote(num_cpus=a.cpus, max_retries=a.retries, retry_exceptions=True)(bake_shard)
    start = time.monotonic()
    names = {task.options(name=f"shard {k}").remote(command(k)): k for k in range(1, shards + 1)}
    left, failed = list(names), 0
    while left:
        done, left = ray.wait(left, timeout=PAUSE)
        for one in done:
            try:
                said = ray.get(one)
            except Exception as e:  # what Ray raises for a task that is lost has many names
                failed += 1
                said = f"failed: {str(e).strip().splitlines()[-1]}"
            print(f"[{time.monotonic() - start:7.1f} s] shard {names[one]}/{shards}: {said}", flush=True)
    ray.shutdown()
    if failed:
        print(f"ray_bake.py: {failed} of {shards} shards failed; what they did is kept: run this again", file=sys.stderr)
        return 1
    output = ["-o", str(a.output)] if a.output else []
    return subprocess.run([lumel, "merge", plan, *scene, *cache, *output], stdin=subprocess.DEVNULL).returncode


if __name__ == "__main__":
    sys.exit(main())
