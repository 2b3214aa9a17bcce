"""A frame reader from a package outside strandcast is found by the file's suffix and reads its format."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from strandcast.errors import StrandcastError
from strandcast.records.folders import TrialFolder
from strandcast.video.ingest import camera_times, inspect_video
from strandcast.video.reader import open_video
from strandcast.video.registry import FRAME_READERS, reader_of

PAGE = "docs/extending/frame-reader.md"


@pytest.fixture
def site(project_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Install the page's reader as a package of its own, for this process and those that it starts."""
    site = tmp_path / "site"
    info = site / "toy_reader-1.0.dist-info"
    info.mkdir(parents=True)
    (site / "toy_reader.py").write_text(
        (project_root / PAGE).read_text().split("```python\n")[1].split("```")[0]
    )
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: toy-reader\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[strandcast.frame_readers]\nnpy = toy_reader\nmp4 = toy_reader\n")
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(site), os.environ.get("PYTHONPATH")])))
    monkeypatch.delitem(sys.modules, "toy_reader", raising=False)
    monkeypatch.setattr(FRAME_READERS, "_entries", {})
    return site


@pytest.fixture
def film(site: Path, tmp_path: Path) -> tuple[Path, np.ndarray]:
    frames = np.random.default_rng(1).integers(0, 256, (12, 32, 48), dtype=np.uint8)
    np.save(tmp_path / "video.npy", frames)
    return tmp_path / "video.npy", frames


def test_the_example_of_the_page_reads_its_format(film):
    path, frames = film
    assert TrialFolder(path.parent, path.parent / "results", 1).video() == path
    facts = inspect_video(path)
    assert (facts.container, facts.packets, facts.width_px, facts.height_px) == ("npy", 12, 48, 32)
    assert camera_times(facts) == pytest.approx(np.arange(12) / 500)
    with open_video(path) as video:
        read = [(index, time_s, grey.copy()) for index, time_s, grey in video]
    assert [index for index, _, _ in read] == list(range(12))
    assert [time_s for _, time_s, _ in read] == pytest.approx(np.arange(12) / 500)
    assert np.array_equal([grey for _, _, grey in read], frames)


def test_built_in_formats_are_not_replaced(site, tmp_path):
    (tmp_path / "video.mp4").write_bytes(b"x")
    assert reader_of(tmp_path / "video.mp4").__name__ == "strandcast.video.container"


def test_a_reader_that_cannot_be_imported_is_named(film, site):
    (site / "toy_reader.py").write_text("import no_such_package\n")
    with pytest.raises(StrandcastError, match="SC-W013") as caught:
        reader_of(film[0])
    assert "no_such_package" in caught.value.what
