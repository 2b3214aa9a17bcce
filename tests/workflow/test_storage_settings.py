"""The settings in the folder where stages run with object storage are those of the project."""

from pathlib import Path

from strandcast.workflow.storage import _copy_settings


def test_settings_are_copied_and_removed_as_in_the_project(tmp_path, monkeypatch):
    project, folder = tmp_path / "project", tmp_path / "storage"
    files = ("config/arms/a.toml", "config/arms/b.toml", "data/one/experiment.yaml")
    for name in files:
        (project / name).parent.mkdir(parents=True, exist_ok=True)
        (project / name).write_text(name)
    raw = folder / "data/one/trial-01/video.mp4"
    raw.parent.mkdir(parents=True)
    raw.write_bytes(b"raw")
    monkeypatch.chdir(project)
    _copy_settings(folder)
    assert [(folder / name).read_text() for name in files] == list(files)
    Path(files[0]).unlink()
    Path(files[2]).write_text("changed")
    _copy_settings(folder)
    assert not (folder / files[0]).exists()
    assert (folder / files[2]).read_text() == "changed"
    assert raw.read_bytes() == b"raw"
