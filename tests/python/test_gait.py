"""Gait: the function against the program's own files."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import posing

CASE = Path(__file__).resolve().parents[2] / "testdata/examples/gait"


def test_a_session_is_that_of_the_command(tmp_path):
    walk, static = CASE / "walk.c3d", CASE / "static.c3d"
    norm = tmp_path / "own.json"
    session = posing.gait(walk, static, output=tmp_path / "out", make_norm=norm, sd=True)
    assert session.notes == [] and session.page.startswith("<!") and norm.exists()
    assert session.record == json.loads((tmp_path / "out/gait.json").read_text())
    with (tmp_path / "out/walk.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    knee = [float(row["LKneeAngles.rx"] or "nan") for row in rows]
    assert np.array_equal(session.trials["walk"]["LKneeAngles.rx"], knee, equal_nan=True)
    cycles = session.cycles["walk", "left", 1], session.cycles["walk", "left", "mean"]
    assert all(one["KneeAngles.rx"].shape == (101,) for one in cycles)
    again = posing.gait([walk], static=static, norm=norm)
    assert again.record["scores"]["gps_deg"]["overall"] < 4
    assert repr(again).startswith("<Gait: walk; ") and "<iframe" in again._repr_html_()


def test_parameters_are_given_by_name(tmp_path):
    bare = tmp_path / "bare.c3d"
    bare.write_bytes((CASE / "walk.c3d").read_bytes().replace(b"PROCESSING", b"XROCESSING"))
    given = {"LegLength": 830, "Bodymass": 30}
    found = posing.gait(bare, parameters=given).record["trials"][0]["parameters"]
    assert found["RLegLength"] == {"value": 830, "unit": "mm", "source": "option", "sd": None}
    assert found["Bodymass"]["source"] == "option" and found["LKneeWidth"]["sd"] > 0
    with pytest.raises(ValueError, match="KneeWidth"):
        posing.gait(bare, parameters={"Leg": 1})
    with pytest.raises(FileNotFoundError):
        posing.gait(tmp_path / "none.c3d")


def test_trials_that_cannot_be_read_stop_no_other(tmp_path):
    bad = tmp_path / "bad.c3d"
    bad.write_bytes(b"no trial")
    session = posing.gait([CASE / "walk.c3d", bad], CASE / "static.c3d")
    assert list(session.trials) == ["walk"] and "bad.c3d" in session.notes[-1]
    assert session.record["failed"][0]["file"].endswith("bad.c3d")
    with pytest.raises(ValueError, match="bad.c3d"):
        posing.gait(bad)


def test_forces_are_those_of_the_command(tmp_path):
    loads = posing.forces(CASE / "walk.c3d")
    table = posing.run("c3d2forces", CASE / "walk.c3d").stdout.decode()
    rows = list(csv.DictReader(table.splitlines()))
    assert list(loads) == list(rows[0]) and len(loads) == 25
    for name, values in loads.items():
        cells = [float(row[name] or "nan") for row in rows]
        assert np.array_equal(values, cells, equal_nan=True)
    assert np.array_equal(np.isnan(loads["FP1.px"]), abs(loads["FP1.fy"]) < 10)
    with pytest.raises(ValueError, match="no force plates"):
        posing.forces(CASE.parent / "biomechanist/gait.c3d")
