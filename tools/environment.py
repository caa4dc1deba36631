"""The Python environments of the harness: where they lie, and how a script gets into one."""

import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = {"checks": ROOT / ".venv-checks", "blender": ROOT / ".venv-blender"}


def python_of(name: str) -> Path:
    """The interpreter of environment `name`, which need not exist yet."""
    return FOLDERS[name] / "bin" / "python"


def enter(name: str, needs: list[str]) -> None:
    """Goes on in environment `name` where this interpreter lacks one of the modules `needs`; ends with a line where neither has them."""
    from importlib.util import find_spec

    missing = [m for m in needs if find_spec(m) is None]
    if not missing:
        return
    python = python_of(name)
    script = Path(sys.argv[0]).name
    if python.exists() and Path(sys.prefix) != FOLDERS[name]:
        os.execv(python, [str(python), *sys.argv])
    sys.exit(f"{script}: Python modules {', '.join(missing)} are missing; `tools/test --setup` installs them")
