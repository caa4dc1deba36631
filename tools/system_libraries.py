"""What the checks take from the system, and the Debian packages that hold it: libraries for Blender's module, a browser for three.js.

Run by itself it prints the packages that are missing here, one line, empty where all is well.
"""

import ctypes
import shutil
import sys

PACKAGE_OF = {
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libX11.so.6": "libx11-6",
    "libXext.so.6": "libxext6",
    "libXi.so.6": "libxi6",
    "libXrender.so.1": "libxrender1",
    "libXfixes.so.3": "libxfixes3",
    "libXxf86vm.so.1": "libxxf86vm1",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libSM.so.6": "libsm6",
    "libICE.so.6": "libice6",
}


def missing() -> list[str]:
    """Packages whose library can't be loaded here."""
    out = []
    for library, package in PACKAGE_OF.items():
        try:
            ctypes.CDLL(library)
        except OSError:
            out.append(package)
    return out


def missing_programs() -> list[str]:
    """Packages of programs that aren't here; checks that need one skip without it."""
    return [] if any(map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))) else ["chromium"]


def advice(packages: list[str]) -> str:
    """What to run."""
    return f"apt-get install -y --no-install-recommends {' '.join(packages)}"


if __name__ == "__main__" and sys.platform == "linux":
    print(" ".join(missing() + missing_programs()))
