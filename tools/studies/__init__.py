"""The studies of `tools/study`: each module bakes one scene in several ways and says what came out.

A module has `FULL` and `LIGHT`, the sizes of its page and of the check; `measure(bench, size)`, which returns the numbers, the
same each time, and the times measured on the way; and `page(bench, size, numbers, measured)`, which draws the pictures and
returns the text.
"""

from importlib import import_module

NAMES = ["box_1984", "box_1985", "convergence", "factory", "meshes", "museum", "table"]
# Made when asked for by name: minutes a picture. No page of it is kept, and no check holds its numbers.
ASKED = ["methods"]


def load(name: str):
    return import_module(f"studies.{name}")
