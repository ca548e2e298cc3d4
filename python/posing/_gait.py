"""Gait and forces from a laboratory's trials: gait, forces."""

from __future__ import annotations

import csv
import json
import os
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from posing._motion import Page
from posing._program import DataError, call, flags
from posing._takes import Floats, StrPath, is_path


@dataclass(eq=False, repr=False)
class Gait:
    """What `gait` computes of a person's trials.

    Attributes
    ----------
    trials : dict
        By a trial's name its curves: ``"time"`` in seconds, and by column an array of
        shape (frames,): ``trials["walk"]["LKneeAngles.rx"]``. NaN where it is not known.
        Degrees; centers in cm, y up; forces N/kg, moments N mm/kg, powers W/kg.
    cycles : dict
        By ``(trial, side, cycle)`` the curves without their side, of shape (101,):
        ``cycles["walk", "left", 1]["KneeAngles.rx"]``. The cycle is a number, ``"mean"``
        or ``"sd"``; with the trial ``""`` those over all trials.
    record : dict
        Parameters, events, values, findings and scores, as ``--json`` prints them:
        posing-json(5) says the names. Trials that could not be read are ``"failed"``.
    page : Page
        The page as text, which a notebook shows.
    notes : list of str
        What the program remarked on.
    """

    trials: dict[str, dict[str, Floats]]
    cycles: dict[tuple[str, str, int | str], dict[str, Floats]]
    record: dict[str, Any]
    page: Page
    notes: list[str]

    def __repr__(self) -> str:
        names = ", ".join(self.trials)
        whole = sum(isinstance(cycle, int) for _, _, cycle in self.cycles)
        return f"<Gait: {names}; {whole} cycles, {len(self.notes)} notes>"

    def _repr_html_(self) -> str:
        return self.page._repr_html_()


def _number(cell: str) -> float:
    return float(cell) if cell else np.nan


def _columns(table: Iterable[str], first: int = 0) -> dict[str, Floats]:
    head, *rows = csv.reader(table)
    values = np.array([[_number(cell) for cell in row[first:]] for row in rows]).T
    return dict(zip(head[first:], values, strict=True))


def _trial(path: Path) -> dict[str, Floats]:
    with path.open(newline="", encoding="utf-8") as file:
        return _columns(file, 1)


def _cycles(path: Path) -> dict[tuple[str, str, int | str], dict[str, Floats]]:
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    parts: dict[tuple[str, str, int | str], list[list[float]]] = {}
    for trial, side, cycle, _, _, _, *cells in rows:
        key = (trial, side, int(cycle) if cycle.isdigit() else cycle)
        parts.setdefault(key, []).append([_number(cell) for cell in cells])
    return {
        key: dict(zip(head[6:], np.array(values).T, strict=True)) for key, values in parts.items()
    }


def gait(
    trials: StrPath | Sequence[StrPath],
    static: StrPath | None = None,
    *,
    output: StrPath | None = None,
    events: str | None = None,
    norm: StrPath | None = None,
    make_norm: StrPath | None = None,
    parameters: dict[str, float] | None = None,
    **options: Any,
) -> Gait:
    """Compute gait from trials: angles, moments, events, values and a page.

    Parameters
    ----------
    trials : path or list of paths
        C3D trials of one person with the markers of Plug-in Gait.
    static : path, optional
        Trial of the person standing, for the offsets of feet and head.
    output : str or path, optional
        Folder to which all files are written: tables, OpenSim's, C3D, JSON and pages.
    events : {"auto", "plates", "markers", "file"}, optional
        What the events of the feet are from. Default: ``"auto"``.
    norm : path, optional
        Norm to compare with, for GVS and GPS.
    make_norm : str or path, optional
        Write the norm of these trials to this file.
    parameters : dict, optional
        Subject parameters by Plug-in Gait's names, in mm, kg or radians, without L and R
        for both sides: ``{"LegLength": 850, "Bodymass": 62}``. Those that a trial stores
        go before these.
    **options
        Further flags of ``posing gait``: ``flat_foot="no"``, ``marker_diameter=16``,
        ``sd=True``.

    Returns
    -------
    Gait
        Curves, cycles, record and page.

    Raises
    ------
    ValueError, FileNotFoundError
        As for `complete`; a trial has not the markers of the pelvis.

    Examples
    --------
    >>> session = posing.gait(["walk.c3d"], static="static.c3d")
    >>> knee = session.cycles["", "left", "mean"]["KneeAngles.rx"]    # 101 points, degrees
    >>> session.record["summary"]["left"]["walking_speed_m_per_s"]["mean"]
    """
    files = [trials] if is_path(trials) else list(trials)
    given = flags(
        static=static,
        events=events,
        norm=norm,
        make_norm=make_norm,
        parameter=[f"{name}={value}" for name, value in (parameters or {}).items()] or None,
        **options,
    )
    with tempfile.TemporaryDirectory(prefix="posing-") as temporary:
        folder = Path(output) if output is not None else Path(temporary, "gait")
        line = ["gait", *given, *flags(output=folder), "--", *files]
        notes: list[str] = []
        try:
            notes = call(*line, folder=temporary).notes
        except DataError as error:  # of several trials some could not be read
            if len(files) == 1 or not (folder / "gait.json").exists():
                raise
            notes = [*error.notes, str(error)]
        record = json.loads((folder / "gait.json").read_text(encoding="utf-8"))
        page = Page((folder / "index.html").read_text(encoding="utf-8"))
        page.notes = notes
        names = [trial["name"] for trial in record["trials"]]
        return Gait(
            trials={name: _trial(folder / f"{name}.csv") for name in names},
            cycles=_cycles(folder / "cycles.csv"),
            record=record,
            page=page,
            notes=notes,
        )


def forces(
    path: StrPath, *, units: str | None = None, up: str | None = None, **options: Any
) -> dict[str, Floats]:
    """Read what the force plates of a C3D file measured.

    Parameters
    ----------
    path : str or path
        The file, with force plates of types 1 to 4.
    units : {"cm", "m", "mm", "in", "asf"}, optional
        Unit of length of the file. Default: what it says.
    up : {"x", "y", "z", "-x", "-y", "-z"}, optional
        Axis of the file that points up. Default: what it says.
    **options
        Further flags of c3d2forces.

    Returns
    -------
    dict
        By column an array of shape (samples,): ``"time"`` in seconds, and of plate 1
        ``"FP1.fx"``, ``.fy``, ``.fz``, the force on the foot, N; ``.px`` and so on the
        center of pressure, cm; ``.mx`` and so on the moment about the middle of the
        plate, ``.tx`` and so on the free moment, N m. Y is up. Center and free moment are
        NaN below 10 N.

    Raises
    ------
    ValueError
        The file has no force plates, or one of another type.

    Examples
    --------
    >>> loads = posing.forces("walk.c3d")
    >>> loads["FP1.fy"].max()
    """
    given = flags(units=units, up=up, **options)
    table = call("c3d2forces", *given, "--", os.fspath(path)).stdout.decode()
    return _columns(table.splitlines())
