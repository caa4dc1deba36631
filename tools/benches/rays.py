"""Millions of rays a second, beside Embree's."""

import subprocess

from benches.bakes import REFERENCE
from environment import ROOT, python_of


def measure(only: str) -> None:
    libraries = sorted(python_of("checks").parent.parent.glob("lib/python*/site-packages/embreex.libs/libembree4*"))
    if not libraries:
        print("Embree is absent: `tools/test --setup` installs it")
    embree = ["--embree", libraries[0]] if libraries else []
    for name in ("atrium/scene.usdc", "living_room/scene.glb"):
        scene = REFERENCE / "reference" / name
        if not scene.is_file():
            print(f"\n{name}: skipped, {scene} is absent")
        elif only in name:
            print(f"\n{name}", flush=True)
            command = ["cargo", "bench", "--quiet", "--ignore-rust-version", "--bench", "rays", "--", scene, *embree]
            subprocess.run(command, cwd=ROOT, check=True)
