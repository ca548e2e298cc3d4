"""Takes from labels to another rig: label, solve, retarget, ground, clean, plot, align, score."""

from __future__ import annotations

import html
import json
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from posing._program import DataError, PosingError, call, flags
from posing._takes import (
    Floats,
    StrPath,
    Take,
    archive_of,
    is_path,
    load,
    read,
    report,
    skeleton_beside,
)

if TYPE_CHECKING:
    from posing._takes import Data


@dataclass(eq=False, repr=False)
class Recorded(Take):
    """A take that `label`, `clean` or `ground` returns.

    Attributes
    ----------
    record : dict
        What was done, as ``--json`` or ``--report`` has it: posing-json(5) says the names.
    """

    record: dict[str, Any]


@dataclass(eq=False, repr=False)
class Motion(Recorded):
    """A take of joints with its skeleton, that `solve`, `retarget` or `ground` returns.

    Attributes
    ----------
    bvh : str
        Skeleton and motion as a BVH file, centimeters. ``motion[10:50]`` has the motion
        of these frames; whoever changes ``xyz`` does not change it.
    sd : float64 array, shape (frames, joints), or None
        Standard deviation of a coordinate of each joint, in centimeters. Of `solve`.
    """

    bvh: str
    sd: Floats | None

    def __getitem__(self, key: Any) -> Any:
        part = super().__getitem__(key)
        if isinstance(part, Motion) and len(part.names) == len(self.names):
            head, rows = self.bvh.split("\nMOTION", 1)
            shown = np.array(rows.rstrip("\n").split("\n")[3:])[key].tolist()
            step = float(rows.split("Frame Time:")[1].split()[0])
            if self.fps and part.fps:
                step *= self.fps / part.fps
            top = f"\nMOTION\nFrames: {len(shown)}\nFrame Time: {step:.10f}"
            part.bvh = "\n".join([head + top, *shown, ""])
        return part


class Page(str):
    """A page or a picture as text, which a notebook shows.

    Attributes
    ----------
    notes : list of str
        What the program remarked on.
    """

    notes: list[str]

    def __repr__(self) -> str:
        return f"<Page: {len(self)} characters>"

    def _repr_html_(self) -> str:
        if not self.startswith("<!"):
            return str(self)
        style = "width: 100%; height: 640px; border: 0"
        return f'<iframe srcdoc="{html.escape(self)}" style="{style}"></iframe>'


FOR_FILES = "output is for files; write(output, ...) writes a take"


def _check_one(data: Any) -> None:
    several = isinstance(data, (list, tuple)) and any(is_path(one) for one in data)
    if several or (is_path(data) and os.path.isdir(data)):
        raise ValueError("expected one take; clean(files, output=folder) is for several")


@contextmanager
def _files(
    *data: Any, names: Sequence[str] | None = None, fps: float | None = None, turned: bool = False
) -> Iterator[tuple[Path, list[Path]]]:
    """A temporary folder, and the files of what was given: its own, or one in the folder.

    Where rotations count (``turned``), a motion becomes a BVH file.
    """
    with tempfile.TemporaryDirectory(prefix="posing-") as folder:
        files = []
        for i, one in enumerate(data):
            if is_path(one):
                file = Path(one)
            else:
                file = Path(folder, f"take{i + 1 if len(data) > 1 else ''}")
                of_bvh = turned and isinstance(one, Motion)
                file.write_bytes(one.bvh.encode() if of_bvh else archive_of(one, names, fps))
            files.append(file)
        yield Path(folder), files


def label(
    xyz: Data,
    names: Sequence[str] | None = None,
    fps: float | None = None,
    *,
    units: str | None = None,
    up: str | None = None,
    output: StrPath | None = None,
    like: StrPath | Sequence[StrPath] | None = None,
    same_person: bool = False,
    from_nothing: bool = False,
    set: str | StrPath | None = None,
    sure: float | None = None,
    **options: Any,
) -> Recorded:
    """Put labels right: markers that changed places, pieces without a label.

    No position changes: each moves to its label, or leaves it. What is not sure stays
    as it was, and is told.

    Parameters
    ----------
    xyz : path, Take, DataFrame, or array of shape (frames, points, 3)
        A take of markers; a file of any format, also without labels.
    names : list of str, optional
        Names of the points of an array.
    fps : float, optional
        Frames per second of an array, or of a file that does not say it.
    units : {"cm", "m", "mm", "in", "asf"}, optional
        Unit of the array, or of a file that does not say it.
    up : {"x", "y", "z", "-x", "-y", "-z"}, optional
        Axis that points up in the array, or in a file that does not say it.
    output : str or path, optional
        Also write the result, in the format of the file, with all else that it says.
        Beside it stand its record and, where something changed, a page.
    like : path or list of paths, optional
        Labeled takes to compare the labels with.
    same_person : bool
        The labeled takes are of the same person.
    from_nothing : bool
        Name the markers of a take without any labels, as those of ``set`` or ``like``.
    set : str or path, optional
        With ``from_nothing``: the marker set, ``"cmu41"``, ``"pig"``, ``"rajagopal"``,
        ``"opencap"``, ``"motive"``, ``"isb"``, ``"sprint"``, or a file of one.
    sure : float, optional
        Confidence from which on a label is given, 0.5 to 1. Default: 0.9.
    **options
        Further flags of ``posing label``.

    Returns
    -------
    Recorded
        The take, in centimeters, y up; ``record["labels"]`` has ``"changes"`` and
        what is ``"unsure"``.

    Raises
    ------
    ValueError, FileNotFoundError
        As for `complete`.

    Examples
    --------
    >>> take = posing.label("raw.c3d", output="labeled.c3d")
    >>> for change in take.record["labels"]["changes"]:
    ...     print(change["kind"], change["from"], change["to"], change["frames"])
    """
    given = flags(
        like=like, same_person=same_person, from_nothing=from_nothing, set=set, sure=sure, **options
    )
    return _recorded("label", xyz, names, fps, units, up, output, given)


@overload
def clean(
    xyz: Data,
    names: Sequence[str] | None = None,
    fps: float | None = None,
    *,
    output: None = None,
    **options: Any,
) -> Recorded: ...
@overload
def clean(
    xyz: StrPath | Sequence[StrPath],
    names: None = None,
    fps: float | None = None,
    *,
    output: StrPath,
    **options: Any,
) -> dict[str, Any]: ...
def clean(
    xyz: Any,
    names: Sequence[str] | None = None,
    fps: float | None = None,
    *,
    units: str | None = None,
    up: str | None = None,
    output: StrPath | None = None,
    max_gap: float | None = None,
    noise_limit: float | str | None = None,
    no_smooth: bool = False,
    no_labels: bool = False,
    self: bool = False,
    model: StrPath | None = None,
    map: StrPath | None = None,
    **options: Any,
) -> Recorded | dict[str, Any]:
    """Clean takes: name tracks, put labels right, fill gaps, replace outliers, remove noise.

    Parameters
    ----------
    xyz : path, list of paths, Take, DataFrame, or array of shape (frames, points, 3)
        Files of any format and folders, with ``output``; or one take.
    names, fps, units, up
        As for `label`.
    output : str or path, optional
        The file of the result of one file; the folder of the results of several or of a
        folder. Each is in the format of its file, with all else that this says. Beside
        each stands its record, in the folder the page ``clean.html``.
    max_gap : float, optional
        Longest gap to fill, in seconds. Default: no limit.
    noise_limit : float or str, optional
        Noise over which a take is denoised, in centimeters or with a unit (``"1mm"``);
        for rotations in degrees (``"0.5deg"``). Default: 0.1 cm, 0.25 degrees.
    no_smooth : bool
        Remove no noise.
    no_labels : bool
        Leave labels as they are.
    self, model, map
        As for `complete`.
    **options
        Further flags of ``posing clean``: ``solve=True`` also writes skeletons, ``like``
        and ``set`` name tracks without names, ``exchange=["LSHO:LELB"]`` exchanges points.

    Returns
    -------
    Recorded or dict
        Without ``output`` the clean take, in centimeters, y up, with its ``record``. With
        it what ``posing clean --json`` prints: ``"files"``, a dict for each file with its
        ``"outcome"``, ``"findings"`` and their ``"places"`` in frames and seconds,
        ``"named_by"`` (what named tracks without names), ``"put_right"`` (changes of
        labels of each kind) and ``"people"`` with the ``"file"`` of each skeleton. A
        file that failed has an ``"error"``, if others could be cleaned.

    Raises
    ------
    ValueError, FileNotFoundError
        As for `complete`.

    Examples
    --------
    >>> take = posing.clean("gaps.c3d")
    >>> take.record["filled"], take.record["outliers"]
    (20, 0)
    >>> night = posing.clean("captures/", output="cleaned/", up="y")
    >>> [file["file"] for file in night["files"] if file["findings"]]
    """
    given = flags(
        max_gap=max_gap,
        noise_limit=noise_limit,
        no_smooth=no_smooth,
        no_labels=no_labels,
        self=self,
        model=model,
        map=map,
        **options,
    )
    if output is None:
        return _recorded("clean", xyz, names, fps, units, up, None, given)
    files = [xyz] if is_path(xyz) else list(xyz)
    if not all(is_path(file) for file in files):
        raise ValueError(FOR_FILES)
    given += flags(units=units, up=up, fps=fps, output=os.fspath(output))
    given += ["--json", "--", *(os.fspath(file) for file in files)]
    done = report("clean", given, lambda found: found and found["files"])
    return dict(json.loads(done))


def _recorded(
    command: str,
    data: Any,
    names: Sequence[str] | None,
    fps: float | None,
    units: str | None,
    up: str | None,
    output: StrPath | None,
    given: list[str],
) -> Recorded:
    """What label or clean makes of a take, read again."""
    if output is not None and not is_path(data):
        raise ValueError(FOR_FILES)
    _check_one(data)
    with _files(data, names=names, fps=fps) as (folder, (file,)):
        of_file: dict[str, Any] = {"units": units, "up": up, "fps": fps if is_path(data) else None}
        out = Path(output) if output is not None else folder / f"out{file.suffix}"
        given += flags(**of_file, output=out, json=folder / "json")
        done = call(command, *given, "--", file, folder=folder)
        if out.is_dir():
            out /= file.name
        (record,) = json.loads((folder / "json").read_bytes())["files"]
        if file.suffix.lower() == ".amc":
            of_file["asf"] = skeleton_beside(file)
        try:
            take = read(out, **of_file)
        except PosingError:  # a rate is for files that do not say it
            take = read(out, **{**of_file, "fps": None})
    take.notes[:0] = done.notes
    return Recorded(**vars(take), record=record)


def solve(
    xyz: Data,
    names: Sequence[str] | None = None,
    fps: float | None = None,
    *,
    units: str | None = None,
    up: str | None = None,
    joints: str | None = None,
    set: str | StrPath | None = None,
    map: StrPath | None = None,
    static: StrPath | None = None,
    asf: StrPath | None = None,
    bvh: StrPath | None = None,
    **options: Any,
) -> Motion:
    """Turn labeled markers into joints, a skeleton and its motion.

    Parameters
    ----------
    xyz, names, fps, units, up
        As for `label`; the markers have labels.
    joints : {"23", "anatomical"}, optional
        The 23 joints of CMU, each at the *end* of the bone that names it: the left knee
        is ``lfemur``. Or the centers of hips, knees, ankles, shoulders, elbows and
        wrists: ``LHJC``, ``LKJC``, ``LAJC``, ``LSJC``, ``LEJC``, ``LWJC``, and
        those of the right side with R. Default: ``"23"``.
    set : str or path, optional
        Marker set, as for `label`. Default: ``"auto"``, that whose names cover most
        of the markers.
    map : path, optional
        A TOML file that says which landmark each marker is.
    static : path, optional
        A static take of the person.
    asf : path, optional
        Skeleton of the person, whose lengths are kept.
    bvh : str or path, optional
        Also write skeleton and motion to this file.
    **options
        Further flags of ``posing solve``: ``angles="walk.mot"``, ``amc``.

    Returns
    -------
    Motion
        Joints, in centimeters, y up, with ``bvh``, ``sd`` and ``record``. A joint
        without evidence is NaN; ``notes`` says so.

    Raises
    ------
    ValueError, FileNotFoundError
        As for `complete`; no marker set fits.

    Examples
    --------
    A C3D file becomes a BVH file; then the flexion of the left knee, in degrees:

    >>> centers = posing.solve("gait.c3d", joints="anatomical", bvh="gait.bvh")
    >>> flexion = 180 - centers.angle("LHJC", "LKJC", "LAJC")    # shape (frames,)
    >>> flexion.max(), centers.time[flexion.argmax()]

    From arrays, without a file:

    >>> motion = posing.solve(xyz, names=names, fps=100, units="cm", up="y")
    >>> hero = posing.retarget(motion, "hero.bvh")
    """
    with _files(xyz, names=names, fps=fps) as (folder, (file,)):
        motion = Path(bvh) if bvh is not None else folder / "motion.bvh"
        given = flags(
            units=units,
            up=up,
            fps=fps if is_path(xyz) else None,
            joints=joints,
            set=set,
            map=map,
            static=static,
            asf=asf,
            bvh=motion,
            json=folder / "json",
            output=folder / "out",
            **options,
        )
        form = ["--sd", "--to=npz"]
        done = call("solve", *form, *given, "--", file, folder=folder)
        more = {"record": json.loads((folder / "json").read_bytes()), "bvh": motion.read_text(encoding="utf-8")}
        return load(Motion, (folder / "out").read_bytes(), notes=done.notes, **more)


def retarget(
    xyz: Data,
    to: StrPath | Motion,
    names: Sequence[str] | None = None,
    fps: float | None = None,
    *,
    up: str | None = None,
    out_up: str | None = None,
    map_from: str | StrPath | None = None,
    map_to: str | StrPath | None = None,
    asf: StrPath | None = None,
    no_feet: bool = False,
    **options: Any,
) -> Motion:
    """Carry motion to another skeleton: other proportions, names and rest pose.

    Parameters
    ----------
    xyz : path, Motion, Take, DataFrame, or array of shape (frames, points, 3)
        A BVH or AMC file, a motion of `solve` or `retarget`, or joints in
        centimeters, y up, which are fitted first.
    to : path or Motion
        The rig, a BVH file, whose hierarchy, channels and proportions the result has.
    names : list of str, optional
        Names of the joints of an array.
    fps : float, optional
        Frames per second of an array or an AMC file.
    up : {"x", "y", "z", "-x", "-y", "-z"}, optional
        Axis that points up in a BVH file. Default: that along which the figure stands.
    out_up : {"x", "y", "z", "-x", "-y", "-z"}, optional
        Axis that points up in the rig, and so in ``bvh``. Default: y.
    map_from : str or path, optional
        Names of the joints of the source: ``"mixamo"``, ``"cmu"`` or a TOML file.
        Default: those that fit.
    map_to : str or path, optional
        Names of the joints of the rig, likewise.
    asf : path, optional
        Skeleton of an AMC file. Default: the file beside it.
    no_feet : bool
        Do not plant the feet.
    **options
        Further flags of ``posing retarget``.

    Returns
    -------
    Motion
        The joints of the rig, in centimeters, y up; ``bvh`` is the file.

    Raises
    ------
    ValueError, FileNotFoundError
        As for `complete`.

    Examples
    --------
    >>> hero = posing.retarget("walk.bvh", "hero.bvh")
    >>> posing.write("hero-walk.bvh", hero)
    >>> hero.record["scale"]
    """
    _check_one(xyz)
    with _files(xyz, to, names=names, fps=fps, turned=True) as (folder, (file, rig)):
        if not (is_path(xyz) or isinstance(xyz, Motion)):
            file.write_bytes(call("xyz2bvh", input=file.read_bytes()).stdout)
        given = flags(
            to=rig,
            up=up,
            out_up=out_up,
            fps=fps if is_path(xyz) else None,
            map_from=map_from,
            map_to=map_to,
            asf=asf,
            no_feet=no_feet,
            json=folder / "json",
            output=folder / "out.bvh",
            **options,
        )
        done = call("retarget", *given, "--", file, folder=folder)
        take = read(folder / "out.bvh", up=out_up)
        (record,) = json.loads((folder / "json").read_bytes())["files"]
        take.notes[:] = done.notes
        return Motion(**vars(take), record=record, bvh=(folder / "out.bvh").read_text(), sd=None)


def ground(
    xyz: Data,
    names: Sequence[str] | None = None,
    fps: float | None = None,
    *,
    units: str | None = None,
    up: str | None = None,
    map: str | StrPath | None = None,
    level_only: bool = False,
    asf: StrPath | None = None,
    **options: Any,
) -> Recorded:
    """Put a take on a level floor: no floating, slope or sinking, no sliding feet.

    Parameters
    ----------
    xyz : path, Motion, Take, DataFrame, or array of shape (frames, points, 3)
        A BVH, FBX or AMC file or a motion of `solve` or `retarget`, whose feet are held
        where they stand; or points in centimeters, y up, which are leveled alone.
    names : list of str, optional
        Names of the points of an array.
    fps : float, optional
        Frames per second of an array, or of a file that does not say it.
    units : {"cm", "m", "mm", "in", "asf"}, optional
        Unit of length of a file that does not say it.
    up : {"x", "y", "z", "-x", "-y", "-z"}, optional
        Axis that points up in a file that does not say it.
    map : str or path, optional
        Names of the joints: ``"mixamo"``, ``"cmu"`` or a TOML file. Default: those that
        fit, else the shape of the skeleton.
    level_only : bool
        Do not hold feet.
    asf : path, optional
        Skeleton of an AMC file. Default: the file beside it.
    **options
        Further flags of ``posing ground``.

    Returns
    -------
    Motion or Recorded
        The take, in centimeters, y up; of rotations a `Motion`, whose ``bvh`` is the
        file. ``record`` has the floor and the contacts in seconds; its ``standing`` is
        ``"never"`` or ``"no-plane"`` for takes that are left as they are.

    Raises
    ------
    ValueError, FileNotFoundError
        As for `complete`.

    Examples
    --------
    >>> walk = posing.ground("walk.bvh")
    >>> posing.write("walk-ground.bvh", walk)
    >>> [(c["foot"], c["start"], c["end"]) for c in walk.record["contacts"]]
    """
    _check_one(xyz)
    with _files(xyz, names=names, fps=fps, turned=True) as (folder, (file,)):
        given = flags(
            units=units,
            up=up,
            fps=fps if is_path(xyz) else None,
            map=map,
            level_only=level_only,
            asf=asf,
            report=folder / "json",
            output=folder / "out",
            **options,
        )
        done = call("ground", *given, "--", file, folder=folder)
        record = json.loads((folder / "json").read_bytes())
        out = folder / "out"
        is_motion = out.read_bytes()[:9] == b"HIERARCHY"
        of_file: dict[str, Any] = {"up": up} if is_motion else {"units": units, "up": up}
        take = read(out, **(of_file if is_path(xyz) else {}))
        take.notes[:] = done.notes
        if is_motion:
            return Motion(**vars(take), record=record, bvh=out.read_text(), sd=None)
        return Recorded(**vars(take), record=record)


def plot(
    *takes: Data,
    output: StrPath | None = None,
    to: str | None = None,
    names: Sequence[str] | None = None,
    bones: str | Sequence[str] | None = None,
    title: str | None = None,
    frames: Sequence[int] | None = None,
    every: int | None = None,
    **options: Any,
) -> Page:
    """Draw takes: a page that plays them, or a picture.

    Two takes are drawn over each other, and their page tells how far apart they are.

    Parameters
    ----------
    *takes : path, Take, DataFrame, or array of shape (frames, 23, 3)
        Takes in centimeters, y up, more than two of the same frames and points; BVH files
        and motions are drawn with their own bones. Files of meshes, too.
    output : str or path, optional
        Also write it to this file, ``.html`` or ``.svg``.
    to : {"svg", "html"}, optional
        A picture of some frames, or a page that plays all. Default: as ``output`` ends,
        else ``"html"``.
    names : list of str, optional
        Names of the figures.
    bones : list of str, optional
        Points to connect: ``["LKNE-LANK", "LANK-LTOE"]``. Default: those of joints
        whose names are known.
    title : str, optional
        Heading.
    frames : list of int, optional
        Frames that a picture shows, from 0. Default: six.
    every : int, optional
        Show every n-th frame.
    **options
        Further flags of ``posing plot``.

    Returns
    -------
    Page
        A str, the text of the page or picture, that a notebook shows.

    Raises
    ------
    ValueError, FileNotFoundError
        As for `complete`.

    Examples
    --------
    >>> posing.plot(posing.solve("gait.c3d"))                  # in a notebook
    >>> posing.plot(gaps, whole, names=["gaps", "whole"], output="gaps.html")
    """
    given = flags(
        to=to or (None if output else "html"),
        names=names,
        bones=bones,
        title=title,
        frames=frames,
        every=every,
        **options,
    )
    with _files() as (folder, _):

        def draw(*takes: Any) -> Page:
            files = []
            for number, take in enumerate(takes, 1):
                file = Path(take) if is_path(take) else folder / f"take{number}"
                if isinstance(take, Motion):
                    file.write_text(take.bvh)
                elif not is_path(take):
                    archive = archive_of(take, status=True)
                    file.write_bytes(call("trim", "--to=csv", input=archive).stdout)
                files.append(file)
            out = Path(output) if output is not None else folder / "out"
            done = call("plot", *given, *flags(output=out), "--", *files, folder=folder)
            page = Page(out.read_text(encoding="utf-8"))
            page.notes = done.notes
            return page

        try:
            return draw(*takes)
        except PosingError as error:  # plot reads tables, files of motion and meshes alone
            try:
                return draw(*(read(take) if is_path(take) else take for take in takes))
            except PosingError:
                raise error from None


def align(
    first: Data,
    second: Data,
    names: Sequence[str] | None = None,
    fps: float | None = None,
    *,
    drift: bool = False,
    map: str | StrPath | None = None,
    **options: Any,
) -> Recorded:
    """Lay a recording beside another of the same performance, in time.

    Parameters
    ----------
    first, second : path, Take, DataFrame, or array of shape (frames, points, 3)
        The recording whose frames and clock the result has, and the one that is put on
        them. Where they stand and which way they face does not matter.
    names : list of str, optional
        Names of the points of arrays.
    fps : float, optional
        Frames per second of arrays and files that do not say it.
    drift : bool
        Also find how much faster one clock runs.
    map : str or path, optional
        Which points are the same: a shipped map or a TOML file. Default: those of one
        name.
    **options
        Further flags of ``posing align``.

    Returns
    -------
    Recorded
        ``second`` on the frames of ``first``; ``record`` has ``"shift"`` and its standard
        deviation ``"shift_sd"``, seconds, ``"drift"`` and ``"correlation"``.

    Raises
    ------
    ValueError, FileNotFoundError
        As for `complete`; they share no motion.

    Examples
    --------
    >>> later = posing.align(take, take[30:])    # half a second at 60 frames a second
    >>> round(later.record["shift"], 3)
    0.5
    """
    takes = [read(take, fps=fps) if is_path(take) else take for take in (first, second)]
    with _files(*takes, names=names, fps=fps) as (folder, (one, other)):
        out, told = folder / "out.npz", folder / "json"
        given = flags(drift=drift, map=map, json=told, output=out, **options)
        done = call("align", *given, "--", one, other, folder=folder)
        record = json.loads(told.read_bytes())
        if not record["found"]:
            raise DataError(done.notes[-1], done.code, done.notes[:-1])
        return load(Recorded, out.read_bytes(), notes=done.notes, record=record)


def score(
    truth: Data,
    result: Data,
    names: Sequence[str] | None = None,
    fps: float | None = None,
    *,
    damaged: Data | None = None,
    units: str | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Compare a take with the truth.

    Parameters
    ----------
    truth, result : path, Take, DataFrame, or array of shape (frames, points, 3)
        Takes of the same frames; points are matched by name.
    names : list of str, optional
        Names of the points of arrays.
    fps : float, optional
        Frames per second of arrays and files that do not say it.
    damaged : as truth, optional
        What ``result`` was restored from: adds the errors where it was missing, by the
        length of the gap, observed and changed.
    units : {"cm", "m", "mm", "in", "asf"}, optional
        Unit of the errors. Default: cm.
    **options
        Further flags of ``posing score``.

    Returns
    -------
    dict
        What ``posing score --json`` prints: ``"all"`` and ``"by_point"`` with ``"rms"``
        of a coordinate and ``"mean_distance"`` of a point, bones, accelerations.

    Raises
    ------
    ValueError, FileNotFoundError
        As for `complete`.

    Examples
    --------
    >>> found = posing.score(truth, posing.complete(gaps), damaged=gaps)
    >>> found["all"]["rms"]    # cm
    """
    takes = [take for take in (truth, result, damaged) if take is not None]
    takes = [read(take, fps=fps) if is_path(take) else take for take in takes]
    with _files(*takes, names=names, fps=fps) as (folder, (one, other, *before)):
        given = flags(units=units, damaged=before[0] if before else None, **options)
        done = call("score", "--json", *given, "--", one, other, folder=folder)
        return dict(json.loads(done.stdout))
