"""Clean motion capture: labels, gaps, noise, joints, another rig; every format.

This package runs the program ``posing``, which the same wheel installs, and
passes takes as NumPy arrays.

>>> import posing
>>> take = posing.read("gaps.c3d")                # C3D, TRC, BVH, AMC, CSV, NPY, NPZ
>>> take["LANK"], take[10:50], len(take), take.fps
>>> whole = posing.complete(take, max_gap=0.5)
>>> whole.sd[whole.status == "inferred"].max()
>>> posing.write("whole.c3d", whole)

From markers to joints, to the flexion of a knee, to another rig:

>>> centers = posing.solve("gait.c3d", joints="anatomical", bvh="gait.bvh")
>>> flexion = 180 - centers.angle("LHJC", "LKJC", "LAJC")    # degrees
>>> hero = posing.retarget(posing.solve("gait.c3d"), "hero.bvh")
>>> posing.write("hero-gait.bvh", hero)

A take is a path, a `Take`, a pandas table, or an array with ``names`` and ``fps``.
Positions are ``xyz``, of shape (frames, points, 3): right-handed, centimeters,
y up. NaN is missing; 0 is a measurement.

============  ================================================================
`read`        a file as a take
`write`       a take as a file
`audit`       what is wrong in takes
`label`       labels put right
`complete`    gaps filled
`denoise`     noise and outliers removed
`clean`       all of these, of a take or a folder
`solve`       joints, skeleton and motion of labeled markers
`retarget`    motion on another skeleton
`ground`      a take on a level floor, with feet that stand
`gait`        angles, moments, events and a page of a laboratory's trials
`forces`      forces and centers of pressure of force plates
`plot`        a page that plays takes, or a picture
`align`       two recordings of one performance, in time
`score`       a take against the truth
`run`         any other command
============  ================================================================

Keywords are the flags of the program: ``max_gap=0.5`` is ``--max-gap 0.5``,
``per_frame=True`` is ``--per-frame``, and ``observe=["head", "root"]`` is
``--observe head,root``. ``posing complete --help`` lists them. All flags can be
given, also those that a function does not name.

What the program remarks on is in ``notes``. What it refuses raises `ValueError`,
a file that is not there `FileNotFoundError`; both are also a `posing.Error`.
"""

from typing import TYPE_CHECKING

from posing._gait import Gait, forces, gait
from posing._motion import Motion, Page, Recorded, align, clean, ground, label, plot, retarget, score, solve
from posing._program import Finished, PosingError, program, run
from posing._takes import Restored, Take, audit, complete, denoise, read, write

Error = PosingError

__all__ = [
    "Error",
    "Finished",
    "Gait",
    "Motion",
    "Page",
    "PosingError",
    "Recorded",
    "Restored",
    "Take",
    "align",
    "audit",
    "clean",
    "complete",
    "denoise",
    "forces",
    "gait",
    "ground",
    "label",
    "plot",
    "program",
    "read",
    "retarget",
    "run",
    "score",
    "solve",
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
