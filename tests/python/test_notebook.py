"""The notebook of the examples: its cells run in order, with and without Matplotlib."""

import json
import sys
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).resolve().parents[2] / "testdata/examples/gait-report.ipynb"


@pytest.mark.parametrize("drawn", [True, False])
def test_the_notebook_runs(drawn, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(NOTEBOOK.parent)
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    if drawn:
        pytest.importorskip("matplotlib")
    else:
        monkeypatch.setitem(sys.modules, "matplotlib", None)
        monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    names = {}
    for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), cell["id"], "exec"), names)
    assert [gap[0] for gap in names["gaps"]] == ["ltibia", "rfemur", "lwrist"]
    report = names["report"].read_text(encoding="utf-8")
    assert "| lwrist | 0.33 | 0.74 |" in report and "0.0% are now" in report
    assert names["clean"].stat().st_size == names["capture"].stat().st_size
    assert (names["folder"] / "lwrist.png").exists() == drawn
    print(report)


def test_the_notebook_is_stripped():
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert len(notebook["cells"]) == 10
    assert all(not cell["outputs"] and cell["execution_count"] is None for cell in code)
