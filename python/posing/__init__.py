"""Fill gaps in motion capture, remove its noise, and read and write its formats.

This package runs the program ``posing``, which the same wheel installs, and
passes takes through pipes as NumPy arrays.

>>> import posing
>>> take = posing.read("gait.trc", up="y")
>>> whole = posing.complete(take, max_gap=0.5)
>>> whole.sd[whole.status == "inferred"].max()
>>> posing.write("whole.c3d", whole)

Positions are ``xyz``, of shape (frames, points, 3): right-handed, centimeters,
y up. NaN is missing; 0 is a measurement.

Keywords are the flags of the program: ``max_gap=0.5`` is ``--max-gap 0.5``,
``per_frame=True`` is ``--per-frame``, and ``observe=["head", "root"]`` is
``--observe head,root``. ``posing complete --help`` lists them. All flags can be
given, also those that a function does not name.

What the program remarks on is in ``notes``. What it refuses raises
`PosingError`, with the program's line.
"""

from typing import TYPE_CHECKING

from posing._program import Finished, PosingError, program, run
from posing._takes import Restored, Take, audit, complete, denoise, read, write

__all__ = [
    "Finished",
    "PosingError",
    "Restored",
    "Take",
    "audit",
    "complete",
    "denoise",
    "program",
    "read",
    "run",
    "write",
]


__version__: str
"""Of the installed wheel, else of the program."""

if not TYPE_CHECKING:  # else every name would pass the checker

    def __getattr__(name):
        if name != "__version__":
            raise AttributeError(f"module 'posing' has no attribute {name!r}")
        from importlib import metadata

        try:
            return metadata.version("posing")
        except metadata.PackageNotFoundError:
            return run("--version").stdout.decode().split()[1]
