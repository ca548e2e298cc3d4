"""Labels, joints, rigs, pages: the functions against the program's own files."""

import dataclasses
import doctest
import html
import inspect
import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

import posing
from posing._program import in_python

ROOT = Path(__file__).resolve().parents[2]
GAIT = ROOT / "testdata/examples/biomechanist/gait.c3d"
CASE = ROOT / "testdata/examples/gait"
RIG = ROOT / "testdata/examples/animator/goblin.bvh"
AMC = ROOT / "testdata/cmu/07/07_01.amc"


@pytest.fixture(autouse=True)
def no_file_is_left(tmp_path_factory, monkeypatch):
    folder = tmp_path_factory.mktemp("temporary")
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    yield
    assert not list(folder.iterdir())


@pytest.fixture(scope="module")
def gait():
    return posing.read(GAIT)


@pytest.fixture(scope="module")
def gaps(gait):
    take = dataclasses.replace(gait, xyz=gait.xyz.copy())
    take["LANK"][40:60] = np.nan
    return take


@pytest.fixture(scope="module")
def motion():
    return posing.solve(GAIT)


def test_a_take_is_indexed_by_names_and_frames(gait):
    assert len(gait) == 158 and gait.rate == gait.fps == 60
    ankle = gait.names.index("LANK")
    assert np.shares_memory(gait["LANK"], gait.xyz) and "LANK" in gait and "lank" not in gait
    assert np.array_equal(gait["LANK"], gait.xyz[:, ankle]) and gait[7].shape == (39, 3)
    part = gait[["RANK", "LANK"]]
    assert part.names == ["RANK", "LANK"] and np.array_equal(part.xyz[:, 1], gait["LANK"])
    middle = gait[10:50]
    assert np.array_equal(middle.xyz, gait.xyz[10:50]) and middle.time[0] == gait.time[10]
    assert np.array_equal(gait[gait.time >= 1].time, gait.time[60:])
    assert gait[::2].fps == 30 and gait[-10:].fps == 60 and len(gait[5:5]) == 0
    with pytest.raises(KeyError, match="LANK"):
        gait["LNK"]


def test_a_part_of_a_take_goes_on(gaps):
    whole = posing.complete(gaps)
    part = whole[30:70][["LANK", "LTOE"]]
    assert part.status.shape == part.sd.shape == (40, 2) and part.unlike.shape == (40,)
    assert set(part.status[10:30, 0]) == {"inferred"}
    (found,) = posing.audit(gaps[::2])
    assert found["takes"][0]["rate"] == 30
    untimed = dataclasses.replace(gaps, time=None)[::2]
    assert untimed.fps == 30 and untimed.time[1] == 1 / 30


def test_a_take_shows_what_is_missing(gaps):
    shown = dataclasses.replace(gaps, names=["<b>", *gaps.names[1:]])._repr_html_()
    assert "<td>&lt;b&gt;</td>" in shown and "<td>LANK</td><td>12.7%</td>" in shown


def test_joints_are_those_of_the_command(gait, motion, tmp_path):
    out = tmp_path / "joints.npz"
    posing.run("solve", GAIT, "--sd", "-o", out, "--bvh", tmp_path / "walk.bvh")
    with np.load(out) as joints:
        assert np.array_equal(joints["xyz"], motion.xyz) and np.array_equal(joints["sd"], motion.sd)
    assert motion.bvh == (tmp_path / "walk.bvh").read_text()
    assert motion.record["frames"] == 158
    assert motion.notes == [f"solve: {GAIT}: 39 markers of the set pig"]
    for same in (
        posing.solve(gait),
        posing.solve(gait.xyz, gait.names, gait.fps),
        posing.solve(gait.xyz[:, :, [0, 2, 1]] * [10, -10, 10], gait.names, 60, units="mm", up="z"),
    ):
        assert np.allclose(same.xyz, motion.xyz, rtol=0, atol=1e-9) and same.fps == 60
        assert same.notes == ["solve: take: 39 markers of the set pig"]


def test_a_c3d_file_becomes_a_bvh_file_and_a_knee_angle(tmp_path):
    centers = posing.solve(GAIT, joints="anatomical", bvh=tmp_path / "gait.bvh")
    flexion = 180 - centers.angle("LHJC", "LKJC", "LAJC")
    assert flexion.shape == (158,) and 0 < flexion.min() < 15 and 50 < flexion.max() < 80
    back = posing.read(tmp_path / "gait.bvh")
    thigh, shin = back["lfemur"] - back["ltibia"], back["lfoot"] - back["ltibia"]
    cosine = (thigh * shin).sum(1) / np.linalg.norm(thigh, axis=1) / np.linalg.norm(shin, axis=1)
    assert np.allclose(180 - np.degrees(np.arccos(cosine)), flexion, atol=6)
    square = posing.Take(np.eye(3)[None], list("abc"), None, None, None, {}, [])
    assert square.angle("a", "b", "c") == pytest.approx(60)


def test_what_no_marker_shows_is_missing(gait):
    arms = ("UPA", "ELB", "FRM", "WRA", "WRB", "FIN", "SHO")
    body = gait[[name for name in gait.names if name[1:] not in arms]]
    legs = posing.solve(body, joints="anatomical")
    assert np.isnan(legs["LWJC"]).all() and np.isfinite(legs["LKJC"]).all()
    assert any("left arm" in note for note in legs.notes)


def test_a_motion_goes_on_another_rig(motion, tmp_path):
    posing.write(tmp_path / "walk.bvh", motion)
    posing.run("retarget", "--to", RIG, "-o", tmp_path / "hero.bvh", tmp_path / "walk.bvh")
    hero = posing.retarget(motion, RIG)
    assert hero.bvh == (tmp_path / "hero.bvh").read_text() and hero.sd is None
    assert posing.retarget(tmp_path / "walk.bvh", RIG).bvh == hero.bvh
    assert hero.record["scale"] == pytest.approx(0.65, abs=0.01) and "Hips" in hero
    back = posing.retarget(hero, motion)
    assert back.names == posing.read(tmp_path / "walk.bvh").names
    joints = posing.retarget(motion.xyz, RIG, motion.names, 60)
    assert np.abs(joints["LeftLeg"] - hero["LeftLeg"]).max() < 3
    assert len(posing.retarget(AMC, RIG, fps=120)) == 316


def test_a_recording_comes_onto_the_frames_of_another():
    walk = posing.read(AMC, fps=120)
    late = dataclasses.replace(walk[30:], time=walk.time[: len(walk) - 30])
    found = posing.align(walk, late)
    assert found.record["shift"] == pytest.approx(0.25, abs=1e-4) and len(found) == len(walk)
    assert np.isnan(found.xyz[:30]).all() and np.allclose(found.xyz[31:], walk.xyz[31:], atol=0.01)
    run = posing.read(AMC.parents[1] / "09/09_06.amc", fps=120)
    with pytest.raises(ValueError, match="share 23 points") as error:
        posing.align(walk, run)
    assert error.value.code == 3


def test_a_motion_stands_on_its_floor(motion, tmp_path):
    posing.write(tmp_path / "walk.bvh", motion)
    posing.run("ground", "-o", tmp_path / "level.bvh", tmp_path / "walk.bvh")
    level, walk = posing.ground(motion), posing.read(tmp_path / "walk.bvh")
    assert level.bvh == (tmp_path / "level.bvh").read_text() and level.names == walk.names
    assert level.record["standing"] == "on-floor" and level.record["slide"][1] < 0.3
    feet = {contact["foot"] for contact in level.record["contacts"]}
    assert feet == {"left", "right"} and len(posing.ground(AMC, fps=120)) == 316
    points = posing.ground(level.xyz, level.names, 60)
    assert not isinstance(points, posing.Motion) and points.record["held"] is None
    still = posing.ground(motion, level_only=True)
    bones = [np.linalg.norm(m["lfemur"] - m["ltibia"], axis=1) for m in (walk, still, level)]
    assert np.allclose(bones[0], bones[1], atol=1e-3) and np.allclose(bones[0], bones[2], atol=1e-3)


def test_frames_of_a_motion_have_their_own_bvh(motion, tmp_path):
    for frames, rate in ((slice(10, 50), 60), (slice(0, None, 3), 20), (motion.time > 1, 60)):
        part = posing.retarget(motion, RIG)[frames]
        posing.write(tmp_path / "part.bvh", part)
        back = posing.read(tmp_path / "part.bvh")
        assert np.allclose(back.xyz, part.xyz, atol=1e-4) and back.fps == part.fps == rate


def test_labels_are_put_right(gait, tmp_path):
    swapped = dataclasses.replace(gait, xyz=gait.xyz.copy())
    one, other = (gait.names.index(name) for name in ("LANK", "RANK"))
    swapped.xyz[50:90, [one, other]] = gait.xyz[50:90, [other, one]]
    right = posing.label(swapped)
    (change,) = right.record["labels"]["changes"]
    assert change["frames"] == [50, 90] and np.array_equal(right.xyz, gait.xyz)
    inches = posing.label(swapped.xyz / 2.54, gait.names, 60, units="in")
    assert np.allclose(inches.xyz, gait.xyz, rtol=0, atol=1e-9)
    posing.write(tmp_path / "swapped.c3d", swapped)
    files = posing.label(tmp_path / "swapped.c3d", output=tmp_path / "right.c3d")
    assert np.array_equal(files.xyz, posing.read(tmp_path / "right.c3d").xyz)
    assert (tmp_path / "right.c3d.json").is_file()
    assert posing.label(tmp_path / "swapped.c3d", fps=50).fps == 60  # as the file says
    with pytest.raises(ValueError, match="write"):
        posing.label(swapped, output=tmp_path / "x.csv")


def test_a_take_is_cleaned_as_its_file(gaps, tmp_path):
    posing.write(tmp_path / "gaps.npz", gaps)
    posing.run("clean", tmp_path / "gaps.npz", "-o", tmp_path / "clean.npz")
    take, file = posing.clean(gaps), posing.clean(tmp_path / "gaps.npz")
    for same in (take, file):
        assert np.array_equal(same.xyz, posing.read(tmp_path / "clean.npz").xyz)
        assert same.record["filled"] == 20 and same.fps == 60
    assert np.isnan(posing.clean(gaps, max_gap=0.1)["LANK"]).any()
    assert len(posing.clean(AMC, fps=120)) == 316


def test_a_folder_is_cleaned(gaps, tmp_path):
    raw = tmp_path / "raw"
    raw.mkdir()
    posing.write(raw / "gaps.c3d", gaps)
    (raw / "bad.c3d").write_bytes(b"\x02P" + bytes(600))
    done = posing.clean(raw, output=tmp_path / "clean")
    outcomes = {Path(file["file"]).name: file["outcome"] for file in done["files"]}
    assert outcomes == {"gaps.c3d": "cleaned", "bad.c3d": "failed"}
    assert np.isfinite(posing.read(tmp_path / "clean/gaps.c3d").xyz).all()
    for several in (raw, [raw / "gaps.c3d", raw / "bad.c3d"]):
        for function in (posing.clean, posing.label):
            with pytest.raises(ValueError, match="expected one take"):
                function(several)
    with pytest.raises(posing.Error, match="bad.c3d"):
        posing.clean(raw / "bad.c3d", output=tmp_path / "bad.c3d")


def test_a_folder_says_what_named_and_what_was_solved(gait, tmp_path):
    raw = tmp_path / "raw"
    raw.mkdir()
    posing.write(raw / "still.c3d", gait)
    tracks = [f"*{n}" for n in range(len(gait.names))]
    posing.write(raw / "raw.c3d", dataclasses.replace(gait, names=tracks))
    people = [f"{who}:{name}" for who in ("Ann", "Bob") for name in gait.names]
    both = np.concatenate([gait.xyz, gait.xyz + [150, 0, 0]], axis=1)
    both[50:90, [0, 1]] = both[50:90, [1, 0]]
    posing.write(raw / "two.c3d", dataclasses.replace(gait, names=people, xyz=both))
    done = posing.clean(raw, output=tmp_path / "out", solve=True)
    files = {Path(file["file"]).name: file for file in done["files"]}
    assert files["raw.c3d"]["named_by"] == "still.c3d" and files["raw.c3d"]["names_fit"] > 0.9
    assert files["still.c3d"]["named_by"] is None
    two = files["two.c3d"]
    assert [person["person"] for person in two["people"]] == ["Ann", "Bob"]
    assert all(Path(person["file"]).suffix == ".bvh" for person in two["people"])
    assert all(Path(person["file"]).is_file() for person in two["people"])
    assert two["put_right"] == {"swap": 1}
    assert {"frames": [50, 90]}.items() <= two["places"][0].items()
    assert two["places"][0]["seconds"] == pytest.approx([50 / 60, 1.5], abs=1e-4)


def test_a_plot_is_a_page_that_a_notebook_shows(gaps, motion, tmp_path):
    page = posing.plot(motion, title="A <walk>")
    assert page.startswith("<!DOCTYPE html>") and len(repr(page)) < 50
    assert page._repr_html_().startswith("<iframe srcdoc=")
    assert html.unescape(page._repr_html_()).count("A &lt;walk&gt;") >= 1
    picture = posing.plot(motion, output=tmp_path / "walk.svg")
    assert picture._repr_html_() == str(picture) == (tmp_path / "walk.svg").read_text()
    takes = gaps, posing.complete(gaps), GAIT
    both = posing.plot(*takes, names=["a", "b", "c"], bones=["LKNE-LANK"])
    assert both.notes == [] and '"c"' in both
    assert len(posing.plot(GAIT, to="svg")) > 1000
    with pytest.raises(FileNotFoundError):
        posing.plot("/nonexistent.csv")


def test_a_score_is_that_of_the_command(gait, gaps, tmp_path):
    whole = posing.complete(gaps)
    for name, take in (("truth", gait), ("gaps", gaps), ("whole", whole)):
        posing.write(tmp_path / f"{name}.csv", take)
    files = [tmp_path / f"{name}.csv" for name in ("truth", "whole", "gaps")]
    done = posing.run("score", "--json", "--damaged", files[2], *files[:2])
    assert posing.score(gait, whole, damaged=gaps) == json.loads(done.stdout)
    assert posing.score(*files[:2], damaged=files[2]) == json.loads(done.stdout)
    assert posing.score(gait.xyz, gait.xyz, gait.names)["all"]["rms"] == 0


def test_paths_are_as_good_as_takes(gaps, tmp_path):
    posing.write(tmp_path / "gaps.c3d", gaps)
    file, take = tmp_path / "gaps.c3d", posing.read(tmp_path / "gaps.c3d")
    for function in (posing.complete, posing.denoise):
        assert np.array_equal(function(file).xyz, function(take).xyz, equal_nan=True)
    posing.write(tmp_path / "gaps.trc", file)
    assert posing.read(tmp_path / "gaps.trc", up="y").names == take.names


@pytest.mark.parametrize(
    "call",
    [
        lambda: posing.read("gone.c3d"),
        lambda: posing.complete("gone.c3d"),
        lambda: posing.label("gone.c3d"),
        lambda: posing.solve("gone.c3d"),
        lambda: posing.retarget("gone.c3d", RIG),
        lambda: posing.retarget(AMC, "gone.c3d", fps=120),
        lambda: posing.clean("gone.c3d"),
        lambda: posing.clean("gone.c3d", output="out.c3d"),
        lambda: posing.plot("gone.c3d"),
        lambda: posing.score("gone.c3d", GAIT),
        lambda: posing.audit("gone.c3d"),
        lambda: posing.solve(GAIT, static="gone.c3d"),
        lambda: posing.run("complete", "gone.c3d"),
    ],
)
def test_a_missing_file_is_not_found(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileNotFoundError) as raised:
        call()
    error = pickle.loads(pickle.dumps(raised.value))
    assert isinstance(error, posing.Error) and error.filename == "gone.c3d" and error.errno == 2
    assert str(error) == str(raised.value) and "gone.c3d: No such file" in str(error)


def test_errors_speak_python(gait):
    with pytest.raises(ValueError, match="^solve: take: .*cmu41 knows 1 .* give a set") as raised:
        posing.solve(gait[["LANK"]])
    assert isinstance(raised.value, posing.Error) and raised.value.code == 1
    with pytest.raises(ValueError, match="'fps': expected frames per second, above 0"):
        posing.solve(GAIT, fps=-1)
    for line, said in (
        ("give the frame rate with --fps", "give the frame rate with fps"),
        ("(--units mm, --up -z)", '(units="mm", up="-z")'),
        ("--fps 120, --fps=29.97.", "fps=120, fps=29.97."),
        ("use --self: its own; --no-smooth", "use self=True: its own; no_smooth=True"),
        ("--map NAME|FILE.toml; or", "map=NAME|FILE.toml; or"),
        ("'--max-gap <SECONDS>'; --from, --to", "'max_gap'; from_, to"),
        ("is wrong; see posing audit --help", "is wrong"),
        ("a--b.c3d, --help.csv: bad -- here", "a--b.c3d, --help.csv: bad -- here"),
    ):
        assert in_python(line) == said


DOCUMENTED = {name: getattr(posing, name) for name in posing.__all__}
DOCUMENTED = {"posing": posing, "angle": posing.Take.angle, **DOCUMENTED}


@pytest.fixture
def files(gaps, motion, tmp_path, monkeypatch):
    """The files that examples name, in the current folder."""
    monkeypatch.chdir(tmp_path)
    Path("captures").mkdir()
    for file in ("gait.c3d", "raw.c3d"):
        shutil.copy(GAIT, file)
    for file in ("walk.c3d", "static.c3d"):
        shutil.copy(CASE / file, file)
    for file in ("hero.bvh", "rig.bvh"):
        shutil.copy(RIG, file)
    for file in ("gaps.c3d", "captures/gaps.c3d", "walk.csv"):
        posing.write(file, gaps)
    posing.write("walk.bvh", motion)


def test_the_example_of_the_readme_runs(files, capsys):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    known = {}
    exec(readme.split("```python\n")[1].split("```")[0], known)
    assert known["flexion"].shape == (158,) and Path("cleaned/clean.html").is_file()
    assert posing.read("hero.bvh").names == posing.read("rig.bvh").names


class Shown(doctest.OutputChecker):
    """Compares what an example prints where the docs show it."""

    def check_output(self, want, got, flags):
        return not want or super().check_output(want, got, flags)


@pytest.mark.parametrize("name", [n for n in DOCUMENTED if ">>>" in (DOCUMENTED[n].__doc__ or "")])
def test_examples_of_the_docs_run(name, gait, gaps, files):
    if name.endswith("Error"):
        Path("gait.c3d").unlink()
    known = {"posing": posing, "np": np, "gaps": gaps, "truth": gait, "take": gaps}
    known.update(xyz=gait.xyz, names=gait.names, whole=posing.complete(gaps))
    text = inspect.getdoc(DOCUMENTED[name])
    examples = doctest.DocTestParser().get_doctest(text, known, name, None, None)
    said = []
    done = doctest.DocTestRunner(Shown(), verbose=False).run(examples, out=said.append)
    assert done.attempted and not done.failed, "".join(said)


@pytest.mark.skipif(sys.platform != "linux", reason="Linux ends a child with its parent")
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_the_program_ends_with_the_interpreter(end, tmp_path):
    fifo = tmp_path / "never.csv"
    os.mkfifo(fifo)  # which nobody writes
    script = "import posing, sys; posing.run('trim', sys.argv[1])"
    python = subprocess.Popen(
        [sys.executable, "-c", script, fifo],
        stderr=subprocess.DEVNULL,
        # A job in the background ignores interrupts, and so would its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )

    def children():
        found = []
        for process in Path("/proc").glob("[0-9]*"):
            try:
                is_child = str(fifo).encode() in (process / "cmdline").read_bytes()
            except OSError:  # it has ended
                continue
            found += [process.name] * (is_child and int(process.name) != python.pid)
        return found

    def waited(what):
        until = time.monotonic() + 20
        while not what() and time.monotonic() < until:
            time.sleep(0.02)
        return what()

    try:
        assert waited(children)
    finally:
        python.send_signal(end)
        python.wait(20)
    assert waited(lambda: not children())
