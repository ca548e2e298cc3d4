"""The package against the program: values, formats, errors."""

import dataclasses
import gzip
import io
import os
import pickle
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import posing
from posing._program import flags, in_python

ROOT = Path(__file__).resolve().parents[2]
AMC = ROOT / "testdata/cmu/07/07_01.amc"
TABLES = ROOT / "tests/fuzz/seeds/tables"


def outcome(*arguments, **keywords):
    """Exit code, standard output and the last line of standard error of the program."""
    done = subprocess.run([posing.program(), *map(str, arguments)], capture_output=True, **keywords)
    return done.returncode, done.stdout, (done.stderr.decode().splitlines() or [""])[-1]


def npy(array):
    file = io.BytesIO()
    np.save(file, array.reshape(len(array), -1))
    return file.getvalue()


@pytest.fixture(scope="module")
def walk():
    return posing.read(AMC, fps=120)


@pytest.fixture(scope="module")
def gaps(walk):
    """The walk with three gaps: of 50 frames, of 30, and of one."""
    take = dataclasses.replace(walk, xyz=walk.xyz.copy())
    for name, first, end in (("lwrist", 40, 90), ("rfemur", 150, 180), ("lradius", 60, 61)):
        take.xyz[first:end, take.names.index(name)] = np.nan
    return take


@pytest.fixture(scope="module")
def whole(gaps):
    return posing.complete(gaps)


def test_a_take_has_names_a_rate_and_positions(walk):
    assert walk.xyz.shape == (316, 23, 3) and walk.xyz.dtype == np.float64
    assert walk.names[:2] == ["root", "lhipjoint"] and walk.fps == 120
    assert np.allclose(np.diff(walk.time), 1 / 120) and set(walk.take) == {"07_01"}
    assert repr(walk) == "<Take: 316 frames, 23 points, 120.0 fps, 0.0% missing>"


def test_completed_values_are_those_of_the_command(gaps, whole):
    code, stdout, _ = outcome("complete", "--fps", 120, "--to", "npy", "-", input=npy(gaps.xyz))
    assert code == 0
    assert np.array_equal(np.load(io.BytesIO(stdout)).reshape(gaps.xyz.shape), whole.xyz)


def test_denoised_values_are_those_of_the_command(walk):
    noisy = walk.xyz + np.random.default_rng(1).normal(0, 0.3, walk.xyz.shape)
    clean = posing.denoise(noisy, walk.names, walk.fps, noise=0.3)
    given = ["denoise", "--noise", "0.3", "--fps", 120, "--to", "npy"]
    code, stdout, _ = outcome(*given, input=npy(noisy))
    assert code == 0
    assert np.array_equal(np.load(io.BytesIO(stdout)).reshape(noisy.shape), clean.xyz)
    assert np.abs(clean.xyz - walk.xyz).mean() < np.abs(noisy - walk.xyz).mean()


def test_measured_values_come_back_bit_for_bit(gaps, whole):
    seen = np.isfinite(gaps.xyz)
    assert whole.xyz[seen].tobytes() == gaps.xyz[seen].tobytes()
    assert np.isfinite(whole.xyz).all()


def test_status_and_sd_have_a_value_for_each_point(gaps, whole):
    missing = np.isnan(gaps.xyz).any(axis=2)
    assert whole.status.shape == whole.sd.shape == whole.method.shape == (316, 23)
    assert whole.unlike.shape == (316,)
    assert set(whole.status[missing]) == {"inferred"}
    assert "inferred" not in whole.status[~missing]
    assert (whole.sd[missing] > 0).all() and set(whole.method[missing]) >= {"regression"}
    assert set(whole.method[whole.status == "observed"]) == {""}


def test_a_long_gap_stays_and_is_unknown(gaps):
    part = posing.complete(gaps, max_gap=0.3)
    wrist = part.names.index("lwrist")
    assert np.isnan(part.xyz[40:90, wrist]).all()
    assert set(part.status[40:90, wrist]) == {"unknown"} and np.isnan(part.sd[40:90, wrist]).all()
    assert np.isfinite(part.xyz[150:180]).all()


def test_a_take_is_as_good_as_its_arrays(gaps, whole):
    arrays = posing.complete(gaps.xyz, names=gaps.names, fps=gaps.fps)
    unnamed = posing.complete(gaps.xyz, fps=gaps.fps)
    for other in (arrays, unnamed):
        assert np.array_equal(other.xyz, whole.xyz) and np.array_equal(other.sd, whole.sd)
        assert other.names == whole.names


def test_other_types_are_converted(gaps, tmp_path):
    single = gaps.xyz.astype(np.float32)
    masked = np.ma.masked_invalid(single)
    listed = [[[None if np.isnan(v) else v for v in p] for p in f] for f in single.tolist()]
    for same in (single, masked, listed, np.asfortranarray(single)):
        posing.write(tmp_path / "single.npz", same, gaps.names, 120)
        back = posing.read(tmp_path / "single.npz").xyz
        assert back.tobytes() == single.astype(np.float64).tobytes()
    whole_numbers = posing.complete(np.arange(90).reshape(10, 3, 3), list("abc"), 30, self=True)
    assert whole_numbers.xyz.dtype == np.float64


def test_units_of_an_array_are_those_of_the_result(gaps, whole):
    meters = posing.complete(gaps.xyz / 100, gaps.names, gaps.fps, units="m")
    assert np.allclose(meters.xyz * 100, whole.xyz, atol=1e-6)
    seen = np.isfinite(gaps.xyz)
    assert np.array_equal(meters.xyz[seen], (gaps.xyz / 100)[seen])


def test_points_of_any_names_are_filled_by_themselves(gaps):
    names = [f"M{i}" for i in range(23)]
    whole = posing.complete(gaps.xyz, names, 120, self=True)
    assert whole.names == names and np.isfinite(whole.xyz).all()
    for function in (posing.complete, posing.denoise):
        itself = function(gaps.xyz, names, 120)
        assert np.array_equal(itself.xyz, function(gaps.xyz, names, 120, self=True).xyz, True)
        assert "none of the model's points" in itself.notes[0] and "self=True" in itself.notes[0]
    with pytest.raises(ValueError, match="anatomical"):
        posing.complete(gaps.xyz, names, 120, map="nonsense")


def test_complete_goes_on_with_what_denoise_left_in_mind(gaps, tmp_path):
    table, clean = tmp_path / "gaps.csv", tmp_path / "clean.csv"
    posing.write(table, gaps)
    outcome("denoise", "--status", table, "-o", clean)
    _, stdout, _ = outcome("complete", "--status", "--to", "npz", clean)
    piped = np.load(io.BytesIO(stdout))
    whole = posing.complete(posing.denoise(gaps))
    assert np.array_equal(whole.xyz, piped["xyz"]) and np.array_equal(whole.sd, piped["sd"])


@pytest.mark.parametrize("name", ["gaps.csv", "gaps.npz", "gaps.npy"])
def test_tables_come_back_bit_for_bit(gaps, tmp_path, name):
    posing.write(tmp_path / name, gaps)
    back = posing.read(tmp_path / name, fps=120 if name.endswith("npy") else None)
    assert back.xyz.tobytes() == gaps.xyz.tobytes()
    assert back.names == gaps.names and back.fps == gaps.fps
    if not name.endswith("npy"):
        assert np.array_equal(back.time, gaps.time) and np.array_equal(back.take, gaps.take)


@pytest.mark.parametrize(
    "name, options, tolerance", [("gaps.c3d", {}, 1e-4), ("gaps.trc", {"up": "y"}, 1e-9)]
)
def test_marker_files_come_back(gaps, tmp_path, name, options, tolerance):
    posing.write(tmp_path / name, gaps)
    back = posing.read(tmp_path / name, **options)
    assert np.allclose(back.xyz, gaps.xyz, rtol=0, atol=tolerance, equal_nan=True)
    assert back.names == gaps.names and back.fps == gaps.fps


def test_a_bvh_file_holds_the_motion(walk, tmp_path):
    notes = posing.write(tmp_path / "walk.bvh", walk, skeleton=AMC.with_name("07.asf"))
    assert any("fit: mean" in note for note in notes)
    back = posing.read(tmp_path / "walk.bvh", ends=True)
    same = [back.names.index(name) for name in walk.names]
    assert np.allclose(back.xyz[:, same], walk.xyz, rtol=0, atol=0.01)


def test_a_glb_file_is_written(walk, tmp_path):
    posing.write(tmp_path / "walk.glb", walk)
    assert (tmp_path / "walk.glb").read_bytes()[:4] == b"glTF"


def test_a_c3d_file_keeps_what_is_measured(gaps, whole, tmp_path):
    posing.write(tmp_path / "gaps.c3d", gaps)
    posing.write(tmp_path / "whole.c3d", whole, into=tmp_path / "gaps.c3d")
    before, after = posing.read(tmp_path / "gaps.c3d"), posing.read(tmp_path / "whole.c3d")
    seen = np.isfinite(before.xyz)
    assert np.array_equal(before.xyz[seen], after.xyz[seen]) and np.isfinite(after.xyz).all()


def test_an_amc_file_finds_its_skeleton_beside_it(walk):
    every = posing.read(AMC, fps=120, joints="all")
    assert len(every.names) == 31
    same = [every.names.index(name) for name in walk.names]
    assert np.array_equal(every.xyz[:, same], walk.xyz)
    named = posing.read(AMC, fps=120, asf=AMC.with_name("07.asf"), joints=["root", "head"])
    assert named.names == ["root", "head"]


def test_a_compressed_file_is_read_by_its_content(gaps, tmp_path):
    posing.write(tmp_path / "gaps.c3d", gaps)
    plain = posing.read(tmp_path / "gaps.c3d")
    packed = tmp_path / "no-extension"
    packed.write_bytes(gzip.compress((tmp_path / "gaps.c3d").read_bytes()))
    assert np.array_equal(posing.read(packed).xyz, plain.xyz, equal_nan=True)


def test_a_table_of_another_program_needs_unit_and_axis():
    file = TABLES / "anipose.csv"
    with pytest.raises(posing.PosingError, match='with units="mm"|units'):
        posing.read(file)
    with pytest.raises(posing.PosingError, match="up"):
        posing.read(file, units="mm")
    millimeters, meters = (posing.read(file, units=u, up="z", fps=30) for u in ("mm", "m"))
    assert np.allclose(millimeters.xyz * 1000, meters.xyz, equal_nan=True)


def test_angles_are_columns(tmp_path):
    file = tmp_path / "angles.mot"
    file.write_text("nRows=2\nnColumns=2\nendheader\ntime\tknee\n0.0\t10\n0.01\t11\n")
    take = posing.read(file)
    assert take.xyz.shape == (2, 0, 3) and take.columns["knee"].tolist() == [10, 11]


def test_further_columns_stay_beside_the_points(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("a_x,a_y,a_z,file\n1,2,3,7\n1,2,4,8\n")
    take = posing.read(file, units="cm", up="y", fps=30)
    assert take.columns["file"].tolist() == [7, 8]
    assert posing.complete(take, self=True).columns["file"].tolist() == [7, 8]


def test_a_data_frame_goes_in_and_out(gaps, whole, tmp_path):
    pandas = pytest.importorskip("pandas")
    posing.write(tmp_path / "gaps.csv", gaps)
    frame = posing.read(tmp_path / "gaps.csv", frame=True)
    assert frame.columns.names == ["point", "axis"] and frame.index.name == "time"
    lwrist = gaps.xyz[:, gaps.names.index("lwrist")]
    assert np.array_equal(frame["lwrist"].to_numpy(), lwrist, equal_nan=True)
    assert np.array_equal(frame["lwrist", "y"].to_numpy(), lwrist[:, 1], equal_nan=True)
    assert frame.xs("y", axis=1, level="axis").shape == (316, 23)
    assert np.array_equal(posing.complete(frame).xyz, whole.xyz)
    pandas.testing.assert_frame_equal(gaps.from_frame(frame).to_frame(), frame)
    with pytest.raises(ValueError, match="two levels"):
        posing.complete(pandas.read_csv(tmp_path / "gaps.csv"))


def test_a_frame_of_several_takes_says_which(walk, tmp_path):
    pytest.importorskip("pandas")
    take = np.repeat(["a", "b"], [200, 116])
    time = np.concatenate([walk.time[:200], walk.time[:116]])
    frame = dataclasses.replace(walk, take=take, time=time).to_frame()
    assert frame.index.names == ["take", "time"] and frame.loc["b"].shape == (116, 69)
    posing.write(tmp_path / "two.csv", frame)
    assert posing.read(tmp_path / "two.csv").take.tolist() == take.tolist()


def test_audit_of_an_array_is_that_of_its_file(gaps, tmp_path):
    posing.write(tmp_path / "gaps.csv", gaps)
    (array,), (file,) = posing.audit(gaps), posing.audit(tmp_path / "gaps.csv")
    assert array["takes"][0]["gaps"] == file["takes"][0]["gaps"]
    assert "missing" in [finding["kind"] for finding in array["takes"][0]["findings"]]
    (strict,) = posing.audit(gaps, max_gap=0.1)
    assert len(strict["takes"][0]["findings"]) > len(array["takes"][0]["findings"])


def test_audit_goes_on_after_a_bad_file(gaps, tmp_path):
    posing.write(tmp_path / "gaps.csv", gaps)
    (tmp_path / "bad.c3d").write_bytes(b"\x02P" + bytes(600))
    bad, good = posing.audit([tmp_path / "bad.c3d", tmp_path / "gaps.csv"])
    assert "error" in bad and good["takes"][0]["points"] == 23
    with pytest.raises(posing.PosingError, match="bad.c3d"):
        posing.audit(tmp_path / "bad.c3d")


def test_an_error_is_the_line_of_the_program(gaps, tmp_path):
    posing.write(tmp_path / "gaps.trc", gaps)
    for arguments, call in (
        (("trc2xyz", tmp_path / "gaps.trc"), lambda: posing.read(tmp_path / "gaps.trc")),
        (("trim", "/nonexistent.c3d"), lambda: posing.read("/nonexistent.c3d")),
        (("complete", "--max-gap=x"), lambda: posing.complete(gaps, max_gap="x")),
    ):
        code, _, line = outcome(*arguments, stdin=subprocess.DEVNULL)
        with pytest.raises(posing.PosingError) as raised:
            call()
        assert (str(raised.value), raised.value.code) == (in_python(line), code)
        assert "\n" not in line and "--" not in str(raised.value)


def test_an_error_passes_between_processes():
    error = pickle.loads(pickle.dumps(posing.PosingError("trim: no", 2, ["trim: before"])))
    assert (str(error), error.code, error.notes) == ("trim: no", 2, ["trim: before"])


def test_an_unknown_keyword_is_a_type_error(gaps):
    with pytest.raises(TypeError, match="'max_gap'$"):
        posing.complete(gaps, max_gpa=0.5)


@pytest.mark.parametrize(
    "change, what",
    [
        (lambda x: (x[:, :, :2], None, 120), "shape"),
        (lambda x: (x.reshape(len(x), -1), None, 120), "shape"),
        (lambda x: (x, ["a", "b"], 120), "2 names for 23 points"),
        (lambda x: (x, None, np.nan), "fps"),
        (lambda x: (x, None, np.inf), "fps"),
        (lambda x: (x, None, 0), "fps"),
        (lambda x: (np.where(np.isnan(x), np.inf, x), None, 120), r"xyz\[40, \d+\] is infinite"),
        (lambda x: ([["a"]], None, 120), "a"),
    ],
)
def test_what_does_not_fit_is_a_value_error(gaps, change, what):
    for function in (posing.complete, posing.denoise, posing.audit):
        with pytest.raises(ValueError, match=what):
            function(*change(gaps.xyz))


def test_an_unknown_extension_is_a_value_error(walk, tmp_path):
    with pytest.raises(ValueError, match=r"\.c3d"):
        posing.write(tmp_path / "walk.fbx", walk)
    assert not list(tmp_path.iterdir())


def test_remarks_are_notes(gaps):
    pose = gaps.xyz[:2]
    (note,) = posing.complete(pose, gaps.names).notes
    assert note.startswith("complete: the table has no time")
    assert posing.complete(pose, gaps.names, quiet=True).notes == []


def test_a_large_take_passes_the_pipes(walk, tmp_path):
    large = np.tile(walk.xyz, (50, 1, 1))
    done = threading.Event()
    worker = threading.Thread(
        target=lambda: (posing.write(tmp_path / "large.npz", large, fps=120), done.set()),
        daemon=True,
    )
    worker.start()
    assert done.wait(50), "the pipes are stuck"
    assert np.array_equal(posing.read(tmp_path / "large.npz").xyz, large)
    with pytest.raises(posing.PosingError):  # ends before it has read its input
        posing.run("trim", "--to=zip", input=bytes(10**7))


def test_keywords_are_flags():
    assert flags(max_gap=0.5, self=True, fill=False, model=None, from_=1) == [
        "--max-gap=0.5",
        "--self",
        "--from=1",
    ]
    assert flags(observe=["a", "b"], fps={"c3d": 100}) == ["--observe=a,b", "--fps=c3d=100"]
    assert flags(a=np.float64(0.1), b=np.bool_(True), c=np.array([1, 2])) == [
        "--a=0.1",
        "--b",
        "--c=1,2",
    ]


def test_names_that_look_like_flags_are_files(gaps, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    posing.write("--help.csv", gaps)
    assert posing.read("--help.csv").names == gaps.names
    assert len(posing.audit("--help.csv")) == 1


def test_the_program_is_found(tmp_path, monkeypatch):
    place = Path(posing.program()).resolve()
    for chosen in (place, place.parent):
        monkeypatch.setenv("POSING_BIN", str(chosen))
        assert Path(posing.program()) == place
    monkeypatch.setenv("POSING_BIN", str(tmp_path))
    with pytest.raises(FileNotFoundError, match="POSING_BIN"):
        posing.read(AMC)
    monkeypatch.delenv("POSING_BIN")
    monkeypatch.setenv("PATH", str(place.parent))
    monkeypatch.setattr("sysconfig.get_path", lambda *_: str(tmp_path))
    assert os.path.samefile(posing.program(), place)
    (tmp_path / place.name).write_bytes(b"")
    assert posing.program() == str(tmp_path / place.name)


def test_the_module_runs_the_program():
    assert posing.__version__.count(".") == 2
    for arguments in (["--version"], ["complete", "--nonsense"]):
        module = subprocess.run([sys.executable, "-m", "posing", *arguments], capture_output=True)
        assert (module.returncode, module.stdout) == outcome(*arguments)[:2]
