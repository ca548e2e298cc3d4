"""Takes as NumPy arrays: read, write, complete, denoise, audit."""

from __future__ import annotations

import difflib
import html
import io
import json
import os
import re
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, Union, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from posing._program import PosingError, call, flags

if TYPE_CHECKING:
    from typing_extensions import TypeGuard

    import pandas  # type: ignore[import-untyped,unused-ignore]

    Data = Union["Take", pandas.DataFrame, ArrayLike, "os.PathLike[str]"]

Floats = NDArray[np.float64]
Texts = NDArray[np.str_]
StrPath = Union[str, "os.PathLike[str]"]
T = TypeVar("T", bound="Take")

WRITERS = {
    ".csv": "trim",
    ".npy": "trim",
    ".npz": "trim",
    ".c3d": "xyz2c3d",
    ".trc": "xyz2trc",
    ".bvh": "xyz2bvh",
    ".glb": "xyz2glb",
    ".amc": "xyz2amc",
}


def is_path(data: object) -> TypeGuard[StrPath]:
    return isinstance(data, (str, os.PathLike))


@dataclass(eq=False, repr=False)
class Take:
    """Positions of points over time, in centimeters, y up.

    ``take["RANK"]`` is a point, an array (frames, 3), or a further column, an array
    (frames,); ``take[["RANK", "LANK"]]`` the take of these points; ``take[10:50]``
    that of these frames, and so with a mask; ``take[10]`` a pose (points, 3);
    ``len(take)`` the number of frames. Points and slices are views, as NumPy's are.

    Attributes
    ----------
    xyz : float64 array, shape (frames, points, 3)
        Positions; NaN is missing.
    names : list of str
        Names of the points.
    fps : float or None
        Frames per second; None if the table has no times, or several rates.
    time : float64 array, shape (frames,), or None
        Times in seconds.
    take : str array, shape (frames,), or None
        Name of the take that each frame is from.
    columns : dict of str to array, shape (frames,)
        Further columns of the file, as they stand in it: angles, forces.
    notes : list of str
        What the program remarked on.

    Examples
    --------
    >>> take = posing.read("gait.c3d")
    >>> take["RANK"][:, 1].min()         # the least height of the ankle, cm
    >>> second = take[take.time >= 1.0]
    """

    xyz: Floats
    names: list[str]
    fps: float | None
    time: Floats | None
    take: Texts | None
    columns: dict[str, NDArray[Any]]
    notes: list[str]

    def __repr__(self) -> str:
        frames, points = self.xyz.shape[:2]
        missing = np.isnan(self.xyz).any(axis=2).mean() if self.xyz.size else 0.0
        return (
            f"<{type(self).__name__}: {frames} frames, {points} points, "
            f"{self.fps or 'unknown'} fps, {missing:.1%} missing>"
        )

    def _repr_html_(self) -> str:
        """The take in a notebook: a line, and what is missing of each point."""
        missing = np.isnan(self.xyz).any(axis=2).mean(axis=0) if len(self) else []
        rows = [
            f"<tr><td>{html.escape(name)}</td><td>{share:.1%}</td></tr>"
            for name, share in zip(self.names, missing)
        ]
        table = f"<table><tr><th>point</th><th>missing</th></tr>{''.join(rows)}</table>"
        return f"<details><summary>{html.escape(repr(self))}</summary>{table}</details>"

    @property
    def rate(self) -> float | None:
        """Frames per second: ``fps`` by its other name."""
        return self.fps

    def __len__(self) -> int:
        return len(self.xyz)

    def __contains__(self, name: object) -> bool:
        return name in self.names or name in self.columns

    @overload
    def __getitem__(self, key: str | int) -> NDArray[Any]: ...
    @overload
    def __getitem__(self: T, key: slice | list[str] | NDArray[Any]) -> T: ...
    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, str):
            return self.columns[key] if key in self.columns else self.xyz[:, self._point(key)]
        if isinstance(key, (int, np.integer)):
            return self.xyz[key]
        if isinstance(key, list) and key and all(isinstance(name, str) for name in key):
            points = [self._point(name) for name in key]
            of = {n: v[:, points] for n, v in self._arrays().items() if v.ndim > 1}
            return replace(self, names=list(key), **of)
        time = self.time
        if time is None and self.fps:
            time = np.arange(len(self)) / self.fps
        shown = {name: values[key] for name, values in self._arrays().items()}
        shown["time"] = None if time is None else time[key]
        fps = self.fps
        if fps and shown["time"] is not None and len(shown["time"]) > 1:  # every second frame, say
            fps /= max(1, round(abs(float(np.median(np.diff(shown["time"])))) * fps))
        columns = {name: values[key] for name, values in self.columns.items()}
        return replace(self, fps=fps, columns=columns, **shown)

    def _point(self, name: str) -> int:
        if name not in self.names:
            near = difflib.get_close_matches(name, self.names) or self.names[:5]
            raise KeyError(f"no point {name}; there are {', '.join(near)}, …")
        return self.names.index(name)

    def _arrays(self) -> dict[str, Any]:
        """The arrays with a row for each frame."""
        found = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: values for name, values in found.items() if isinstance(values, np.ndarray)}

    def angle(self, first: str, middle: str, last: str) -> Floats:
        """The angle at a point between two others, in degrees.

        Parameters
        ----------
        first, middle, last : str
            Names of points; the angle is at ``middle``.

        Returns
        -------
        float64 array, shape (frames,)
            0 to 180, 180 where the middle one is between the others; NaN where a point is missing.

        Examples
        --------
        Flexion of the left knee, from a C3D file of markers:

        >>> centers = posing.solve("gait.c3d", joints="anatomical")
        >>> flexion = 180 - centers.angle("LHJC", "LKJC", "LAJC")
        """
        one, other = self[first] - self[middle], self[last] - self[middle]
        across = np.linalg.norm(np.cross(one, other), axis=1)
        turns: Floats = np.degrees(np.arctan2(across, (one * other).sum(axis=1)))
        return turns

    def to_frame(self) -> pandas.DataFrame:
        """The positions as a pandas DataFrame, a row per frame.

        Columns have two levels, point and axis, so that ``df["LANK"]`` is a
        point, ``df["LANK", "y"]`` a coordinate, and ``df.xs("y", axis=1,
        level="axis")`` the height of every point. Further columns, such as
        ``knee.rx``, are split at their last dot. The index is the time in
        seconds; with the take before it if there are several; the frame, from
        0, if there are no times. `complete`, `denoise`, `audit` and `write` take
        such a frame.
        """
        import pandas as pd

        frames = len(self.xyz)
        data = {
            (n, a): self.xyz[:, i, k] for i, n in enumerate(self.names) for k, a in enumerate("xyz")
        }
        for name, values in self.columns.items():
            point, _, axis = name.rpartition(".")
            data[(point, axis) if point else (axis, "")] = values
        time = self.time
        if time is None and self.fps:
            time = np.arange(frames) / self.fps
        index = pd.RangeIndex(frames, name="frame") if time is None else pd.Index(time, name="time")
        if self.take is not None and time is not None and len(set(self.take)) > 1:
            index = pd.MultiIndex.from_arrays([self.take, time], names=["take", "time"])
        return pd.DataFrame(data, index).rename_axis(columns=["point", "axis"])

    @classmethod
    def from_frame(cls, frame: pandas.DataFrame) -> Take:
        """The inverse of `to_frame`; the rate then follows from the times."""
        if frame.columns.nlevels != 2:
            raise ValueError("the columns of the frame have not two levels, point and axis")
        names = [name for name, axis in frame.columns if axis == "x"]
        points = [(name, axis) for name in names for axis in "xyz"]
        xyz = frame[points].to_numpy(np.float64).reshape(len(frame), len(names), 3)
        index = frame.index.to_frame()
        time = index["time"].to_numpy(np.float64) if "time" in index else None
        take = index["take"].to_numpy(np.str_) if "take" in index else None
        more = frame.drop(columns=points).select_dtypes("number")
        columns = {".".join(filter(None, key)): more[key].to_numpy() for key in more.columns}
        return cls(xyz, names, None, time, take, columns, [])


@dataclass(eq=False, repr=False)
class Restored(Take):
    """A take that `complete` or `denoise` returns.

    Attributes
    ----------
    status : str array, shape (frames, points)
        observed (measured, unchanged), changed (measured, changed), inferred
        (was missing, filled), rejected (measured, an outlier) or unknown
        (missing, not filled).
    sd : float64 array, shape (frames, points)
        Standard deviation of a coordinate, in the unit of ``xyz``; NaN where the
        position is unknown.
    method : str array, shape (frames, points)
        How it was estimated: regression, pchip, model, contact or motion; empty where it
        was not.
    unlike : float64 array, shape (frames,)
        Novelty of the pose, in nats; 0 is like the training poses, NaN not known.
    """

    status: Texts
    sd: Floats
    method: Texts
    unlike: Floats


@overload
def read(path: StrPath, *, frame: Literal[True], **options: Any) -> pandas.DataFrame: ...
@overload
def read(
    path: StrPath,
    *,
    units: str | None = None,
    up: str | None = None,
    fps: float | None = None,
    asf: StrPath | None = None,
    joints: str | Sequence[str] | None = None,
    frame: Literal[False] = False,
    **options: Any,
) -> Take: ...
def read(
    path: StrPath,
    *,
    units: str | None = None,
    up: str | None = None,
    fps: float | None = None,
    asf: StrPath | None = None,
    joints: str | Sequence[str] | None = None,
    frame: bool = False,
    **options: Any,
) -> Take | pandas.DataFrame:
    """Read a file of any format: C3D, TRC, BVH, FBX, AMC, NPY, NPZ, tables.

    The first lines tell the format, not the name. Tables are those of posing,
    Motive, Vicon, Qualisys, Anipose, DeepLabCut and pandas; JSON has keypoints of
    MediaPipe or OpenPose. What a file does not say
    is asked for: the error names the keyword. BVH files, AMC files
    and tables of posing are in centimeters, y up, unless keywords say otherwise.

    Parameters
    ----------
    path : str or path
        The file; gzip and zstd are decompressed.
    units : {"cm", "m", "mm", "in", "asf"}, optional
        Unit of length of the file.
    up : {"x", "y", "z", "-x", "-y", "-z"}, optional
        Axis of the file that points up.
    fps : float, optional
        Frames per second; needed for AMC files.
    asf : str or path, optional
        Skeleton of an AMC file. Default: the file beside it whose name begins the
        take's, ``07.asf`` for ``07_01.amc``.
    joints : str or list of str, optional
        Names for an array: ``"23"``, ``"smpl"`` or a list. For AMC files the joints
        to read: ``"23"`` (the default), ``"all"`` or a list.
    frame : bool
        Return a pandas DataFrame, as `Take.to_frame` does.
    **options
        Further flags of the command of the format (c3d2xyz, trc2xyz, bvh2xyz,
        fbx2xyz, amc2xyz, csv2xyz; trim for tables): ``zeros_are_missing=True``.

    Returns
    -------
    Take or pandas.DataFrame
        Centimeters, y up.

    Raises
    ------
    FileNotFoundError
        The file is not there.
    ValueError
        The file cannot be read, or does not say what a keyword has to.

    Examples
    --------
    >>> take = posing.read("gait.c3d")
    >>> take.xyz.shape, take.fps, take.names[:3]
    ((158, 39, 3), 60.0, ['LFHD', 'RFHD', 'LBHD'])
    """
    file = os.fspath(path)
    to = ["--to=npz"]
    centimeters = ["--out-units=cm", "--out-up=y"]  # what other commands write anyway
    command = "trim"
    given = flags(units=units, up=up, fps=fps, joints=joints, asf=asf, **options)
    try:
        done = call(command, *to, *centimeters, "--", file)
    except PosingError as error:  # trim knows every format, and names its command
        named: list[str] = re.findall(r"\b[a-z0-9]+2xyz\b", str(error).replace(file, ""))
        command = named[-1] if named else command
        if not named and not given:
            raise
    if command == "amc2xyz" and asf is None:
        given += flags(asf=skeleton_beside(Path(file)))
    if command != "trim" or given:
        to += centimeters if command == "trim" else []
        done = call(command, *to, *given, "--", file)
    take = load(Take, done.stdout, notes=done.notes)
    if take.fps is None and fps is not None:
        take.fps = float(fps)
    return take.to_frame() if frame else take


def skeleton_beside(take: Path) -> Path | None:
    """The ASF file beside an AMC file, of the longest name that begins the take's."""
    beside = [f for f in take.parent.glob("*.[aA][sS][fF]") if take.name.startswith(f.stem)]
    return max(beside, key=lambda f: len(f.stem), default=None)


def write(
    path: StrPath,
    xyz: Data,
    names: Sequence[str] | None = None,
    fps: float | None = None,
    *,
    units: str | None = None,
    up: str | None = None,
    skeleton: StrPath | None = None,
    into: StrPath | None = None,
    **options: Any,
) -> list[str]:
    """Write a take; the extension tells the format.

    Parameters
    ----------
    path : str or path
        .csv, .npy, .npz, .c3d, .trc, .bvh, .glb or .amc. The file appears only
        when it is complete.
    xyz : Take, DataFrame, or array of shape (frames, points, 3)
        Positions in centimeters, y up; NaN is missing. Deviations and status are not
        written.
    names : list of str, optional
        Names of the points. Default: those of the take.
    fps : float, optional
        Frames per second. Default: that of the take.
    units : {"cm", "m", "mm", "in", "asf"}, optional
        Unit of the file. Default: cm; mm for C3D and TRC.
    up : {"x", "y", "z", "-x", "-y", "-z"}, optional
        Axis of the file that points up. Default: y; z for C3D.
    skeleton : str or path, optional
        ASF or BVH file to fit, for BVH and GLB. Default: measured from the take; a
        motion of `solve` or `retarget` is written to BVH with its own.
    into : str or path, optional
        C3D or BVH file whose points are replaced; all else in it is kept.
    **options
        Further flags of the command of the format (xyz2c3d, xyz2trc, xyz2bvh,
        xyz2glb, xyz2amc, which needs ``asf``; trim for tables).

    Returns
    -------
    list of str
        What the program remarked on: the error of the fit for BVH, for instance.

    Raises
    ------
    ValueError, PosingError
        As for `complete`; the extension is not known.

    Examples
    --------
    >>> posing.write("gait.trc", posing.read("gait.c3d"))
    >>> posing.write("walk.npz", xyz, names=names, fps=100)
    >>> posing.write("walk.bvh", posing.solve("gait.c3d"))
    """
    command = WRITERS.get(Path(path).suffix.lower())
    if command == "xyz2bvh" and hasattr(xyz, "bvh") and not (units or up or skeleton or into):
        Path(path).write_text(xyz.bvh, encoding="utf-8")
        return []
    if command is None:
        raise ValueError(f"{os.fspath(path)}: the extension is none of {' '.join(WRITERS)}")
    if command == "trim":
        given = flags(out_units=units, out_up=up, skeleton=skeleton, into=into, **options)
    else:
        given = flags(units=units, up=up, skeleton=skeleton, into=into, **options)
    given += flags(output=os.fspath(path))
    return call(command, *given, input=archive_of(xyz, names, fps)).notes


def complete(
    xyz: Data,
    names: Sequence[str] | None = None,
    fps: float | None = None,
    *,
    max_gap: float | None = None,
    observe: Sequence[str] | None = None,
    self: bool = False,
    model: StrPath | None = None,
    prior: StrPath | None = None,
    map: StrPath | None = None,
    units: str | None = None,
    up: str | None = None,
    **options: Any,
) -> Restored:
    """Fill gaps and missing points; measured values come back bit for bit.

    Parameters
    ----------
    xyz : Take, DataFrame, path, or array of shape (frames, points, 3)
        Positions; NaN is missing. A file is read as `read` does, with ``units``, ``up``
        and ``fps`` for what it does not say; its result is in centimeters, y up.
    names : list of str, optional
        Names of the points. Default: those of the take; the 23 joints of CMU for
        an array of 23 points.
    fps : float, optional
        Frames per second. Default: that of the take. Without a rate each frame is
        filled by itself.
    max_gap : float, optional
        Longest gap to fill, in seconds. Default: no limit.
    observe : list of str, optional
        Points to use; all others count as missing.
    self : bool
        Use no model: learn from the take's own frames. Takes points of any names.
    model : str or path, optional
        Model file. Default: the built-in model.
    prior : str or path, optional
        Library of motion, by ``posing prior-train --motion``: fills whole bodies
        that are missing for some time.
    map : str or path, optional
        Which points are which of the model's: a shipped map, such as
        ``"mixamo"``, or a TOML file. Default: the map that fits best.
    units : {"cm", "m", "mm", "in", "asf"}, optional
        Unit of ``xyz``, in which the result is too. Default: cm.
    up : {"x", "y", "z", "-x", "-y", "-z"}, optional
        Axis of ``xyz`` that points up, also in the result. Default: y.
    **options
        Further flags of ``posing complete``.

    Returns
    -------
    Restored
        The values that ``posing complete`` writes.

    Raises
    ------
    ValueError
        ``xyz`` is not (frames, points, 3) or has infinities; ``names`` or ``fps``
        do not fit; the program refused the data.
    FileNotFoundError
        A file is not there.

    Notes
    -----
    Where no known skeleton has the points, as with markers, they are filled from the
    take itself, as with ``self=True``; the first of ``notes`` says why.

    Examples
    --------
    >>> whole = posing.complete("gaps.c3d", max_gap=0.5)
    >>> whole.sd[whole.status == "inferred"].max()    # cm
    >>> whole = posing.complete(xyz, names=names, fps=120)
    """
    given = dict(
        max_gap=max_gap,
        observe=observe,
        self=self,
        model=model,
        prior=prior,
        map=map,
        **options,
    )
    return _restore("complete", xyz, names, fps, units, up, given)


def denoise(
    xyz: Data,
    names: Sequence[str] | None = None,
    fps: float | None = None,
    *,
    noise: float | str | None = None,
    outliers: str | None = None,
    fill: bool = False,
    self: bool = False,
    model: StrPath | None = None,
    map: StrPath | None = None,
    units: str | None = None,
    up: str | None = None,
    **options: Any,
) -> Restored:
    """Remove noise and outliers; missing points stay missing without ``fill``.

    Parameters
    ----------
    xyz, names, fps, self, model, map, units, up
        As for `complete`.
    noise : float or str, optional
        Standard deviation of a coordinate, in centimeters or with a unit
        (``"5mm"``). Default: ``"auto"``, estimated from the take.
    outliers : {"auto", "none"}, optional
        Whether to detect outliers. Default: ``"auto"``.
    fill : bool
        Also fill missing points.
    **options
        Further flags of ``posing denoise``.

    Returns
    -------
    Restored
        The values that ``posing denoise`` writes.

    Raises
    ------
    ValueError, FileNotFoundError
        As for `complete`.

    Examples
    --------
    >>> smooth = posing.denoise("gait.c3d", noise="1mm")
    >>> np.abs(smooth.xyz - posing.read("gait.c3d").xyz).max()    # cm
    """
    given = dict(
        noise=noise,
        outliers=outliers,
        fill=fill,
        self=self,
        model=model,
        map=map,
        **options,
    )
    return _restore("denoise", xyz, names, fps, units, up, given)


def audit(
    xyz: Data | StrPath | Sequence[StrPath],
    names: Sequence[str] | None = None,
    fps: float | None = None,
    *,
    units: str | None = None,
    up: str | None = None,
    like: StrPath | Sequence[StrPath] | None = None,
    max_gap: float | None = None,
    **options: Any,
) -> Any:
    """Find what is wrong in takes: rate, unit, gaps, swaps, jumps.

    Parameters
    ----------
    xyz : path, list of paths, Take, DataFrame, or array (frames, points, 3)
        Files of any format and folders, or a take in centimeters, y up.
    names : list of str, optional
        Names of the points of an array.
    fps : float, optional
        Frames per second of an array, or of files that do not say it.
    units : {"cm", "m", "mm", "in", "asf"}, optional
        Unit of the array, or of files that do not say it.
    up : {"x", "y", "z", "-x", "-y", "-z"}, optional
        Axis that points up in the array, or in files that do not say it.
    like : path or list of paths, optional
        Labeled takes to compare the labels with.
    max_gap : float, optional
        Longest gap, in seconds, that is no finding. Default: 0.5.
    **options
        Further flags of ``posing audit``.

    Returns
    -------
    list of dict
        What ``posing audit --json`` prints, a dict for each file. A file that could
        not be read has an ``"error"``, if others could be read.

    Raises
    ------
    ValueError, FileNotFoundError
        As for `complete`.

    Examples
    --------
    >>> for file in posing.audit("captures/", up="y"):
    ...     print(file["file"], [found["kind"] for found in file["takes"][0]["findings"]])
    """
    given = ["--json", *flags(max_gap=max_gap, like=like, **options)]
    files: Any = [xyz] if is_path(xyz) else xyz
    first = files[0] if isinstance(files, (list, tuple)) and files else None
    if not is_path(first):
        given += flags(units=units or "cm", up=up or "y")
        return json.loads(call("audit", *given, input=archive_of(files, names, fps)).stdout)
    given += [*flags(units=units, up=up, fps=fps), "--", *map(os.fspath, files)]
    return json.loads(report("audit", given, lambda found: found))


def report(command: str, given: list[str], files: Callable[[Any], Any]) -> bytes:
    """The report of a command, also where some of its files failed, but not all."""
    try:
        return call(command, *given).stdout
    except PosingError as error:
        found = files(json.loads(error.stdout or b"null")) or []
        if all(file.get("error") for file in found):
            raise
        return error.stdout


def _restore(
    command: str,
    data: Data,
    names: Sequence[str] | None,
    fps: float | None,
    units: str | None,
    up: str | None,
    options: dict[str, Any],
) -> Restored:
    if is_path(data):
        data = read(data, units=units, up=up, fps=fps)
        units = up = fps = None
    archive = archive_of(data, names, fps)
    given = ["--status", "--to=npz", *flags(units=units, up=up, **options)]
    try:
        done = call(command, *given, input=archive)
    except PosingError as error:
        if "use self=True" not in str(error) or options["model"] or options["map"]:
            raise
        done = call(command, "--self", *given, input=archive)
        done.notes.insert(0, str(error))
    return load(Restored, done.stdout, notes=done.notes)


def archive_of(
    data: Any, names: Sequence[str] | None = None, fps: float | None = None, status: bool = False
) -> bytes:
    """A take as an NPZ archive, which every command reads; checks shapes first."""
    more: dict[str, Any] = {}
    marks = ("status", "method") if status and isinstance(data, Restored) else ()
    marked = {key: getattr(data, key) for key in marks}
    if is_path(data):
        data, fps = read(data, fps=fps), None
    if hasattr(data, "iloc"):
        data = Take.from_frame(data)
    if isinstance(data, Take):
        names = names if names is not None else data.names or None
        for key, values in data.columns.items():
            if key in {"time", "take", "sd"}:
                raise ValueError(f"a column is called {key}, which names something else; rename it")
            more[key] = np.asarray(values)
            if more[key].dtype.kind in "bf":
                more[key] = more[key].astype(np.float64)
        more["time"] = data.time if fps is None else None
        more["take"] = data.take
        more["sd"] = getattr(data, "sd", None)
        fps = fps if fps is not None else data.fps
        data = data.xyz
    if isinstance(data, np.ma.MaskedArray):
        data = np.ma.filled(data.astype(np.float64), np.nan)
    xyz = np.ascontiguousarray(data, dtype=np.float64)
    if xyz.ndim != 3 or xyz.shape[2] != 3:
        raise ValueError(f"xyz has the shape {xyz.shape}; expected (frames, points, 3)")
    if np.isinf(xyz).any():
        row, point, _ = np.argwhere(np.isinf(xyz))[0]
        raise ValueError(f"xyz[{row}, {point}] is infinite; NaN is missing")
    taken = {"posing", "xyz", "names", "fps", "status", "method", "unlike", "columns", "notes"}
    for key in taken & more.keys():
        raise ValueError(f"a column is called {key}, which names something else; rename it")
    if names is not None and len(names) != xyz.shape[1]:
        raise ValueError(f"{len(names)} names for {xyz.shape[1]} points")
    if fps is not None and not 0 < float(fps) < np.inf:
        raise ValueError(f"fps is {fps}; expected a number above 0")
    for key, values in more.items():
        if values is not None and len(values) != len(xyz):
            raise ValueError(f"{key} has {len(values)} values for {len(xyz)} frames")
    more.update(marked)
    more["names"] = None if names is None else np.array(list(names), dtype=np.str_)
    more["fps"] = None if fps is None else np.float64(fps)
    more["posing"] = np.int32(1)  # says that it is a table, in centimeters, y up
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:  # numpy.savez takes no column called file
        for key, values in {"xyz": xyz, **more}.items():
            if values is not None:
                with archive.open(f"{key}.npy", "w", force_zip64=True) as entry:
                    np.lib.format.write_array(entry, np.asarray(values), allow_pickle=False)
    return file.getvalue()


def load(kind: type[T], archive: bytes, **more: Any) -> T:
    """The archive that a command wrote, as a take."""
    with np.load(io.BytesIO(archive)) as arrays:
        found: dict[str, Any] = {"fps": None, "time": None, "take": None, **arrays}
    found.pop("posing", None)
    own = {field.name for field in fields(kind)} - {"columns", *more}
    columns = {name: found.pop(name) for name in list(found) if name not in own}
    found["names"] = found["names"].tolist()
    found["fps"] = None if found["fps"] is None else float(found["fps"])
    return kind(**found, columns=columns, **more)
