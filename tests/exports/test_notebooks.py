"""The notebooks run from top to bottom in their kernel, in a project with one small experiment."""

import shutil
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from strandcast.workflow.project import make_project

pytestmark = pytest.mark.thorough

NOTEBOOKS = Path(__file__).resolve().parents[2] / "docs" / "notebooks"


def run(name: str, project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Run a notebook in a copy of the project; return the text that it shows, and the number of figures."""
    folder = tmp_path / "mylab"
    make_project(folder)
    shutil.copytree(project, folder, dirs_exist_ok=True)
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.setenv("PYTHONPATH", str(NOTEBOOKS.parents[1] / "src"))
    notebook = nbformat.read(NOTEBOOKS / name, as_version=4)
    assert all(cell.outputs == [] for cell in notebook.cells if cell.cell_type == "code"), "strip the outputs"
    for cell in notebook.cells:
        cell.source = cell.source.replace('"demo"', '"small"')
    client = NotebookClient(notebook, timeout=None, resources={"metadata": {"path": str(folder)}})
    client.execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    data = [output.get("data", {}) for output in outputs]
    return {
        "text": "".join(output.get("text", "") for output in outputs)
        + "".join(each.get("text/plain", "") for each in data),
        "figures": str(sum("image/png" in each for each in data)),
    }


def test_a_first_look(project, tmp_path, monkeypatch):
    shown = run("first-look.ipynb", project, tmp_path, monkeypatch)
    assert shown["figures"] == "3"


def test_a_string_is_fitted_to_motion_capture(project, tmp_path, monkeypatch):
    shown = run("motion-capture.ipynb", project, tmp_path, monkeypatch)
    assert shown["figures"] == "2"
    assert "mocap: nothing is wrong" in shown["text"]
    error_mm = float(shown["text"].split("E = ")[1].split(" mm")[0])
    assert 0 < error_mm < 20  # a string of 300 mm
    assert (tmp_path / "mylab/results/mocap/trial-01/estimate.json").is_file()


def test_strings_are_simulated(project, tmp_path, monkeypatch):
    assert run("simulate-a-string.ipynb", project, tmp_path, monkeypatch)["figures"] == "3"


def test_planners_are_compared(project, tmp_path, monkeypatch):
    shown = run("compare-planners.ipynb", project, tmp_path, monkeypatch)
    assert shown["figures"] == "1"
    assert "miss [mm]" in shown["text"]
    results = tmp_path / "mylab" / "results"
    assert len(list(results.glob("planner-*/trial-01/verdict.json"))) == 2
