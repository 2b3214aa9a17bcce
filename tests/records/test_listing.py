"""Which files exist: on disk, or in the listing of a project's object storage."""

from pathlib import Path

import pytest

from strandcast.records import listing
from strandcast.records.folders import ExperimentFolder

LISTED = {
    "data/rope/trial-01/video.mp4": 1000,
    "data/rope/trial-02/video/0001.png": 10,
    "data/rope/trial-02/video/0002.png": 20,
    "data/rope/trial-03/run.json": 5,
    "data/rope/calibration/lens-01.png": 7,
    "data/rope/calibration/plane.png": 7,
}


@pytest.fixture
def project(tmp_path, monkeypatch) -> Path:
    """Change to an empty folder whose project is listed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(listing.LISTING, "")  # is restored
    listing.write_listing(tmp_path / "listing.json", LISTED)
    return Path()


def test_trials_and_their_videos_are_known_without_a_file_on_disk(project):
    folder = ExperimentFolder(project, "rope")
    assert folder.recorded_trials() == [1, 2]
    assert folder.thrown_trials() == [1, 2, 3]
    assert folder.trial(1).video_files() == [Path("data/rope/trial-01/video.mp4")]
    assert [path.name for path in folder.trial(2).video_files()] == ["0001.png", "0002.png"]
    assert sum(map(listing.size_bytes_of, folder.trial(2).video_files())) == 30


def test_patterns_match_listed_files_of_their_depth_only(project):
    folder = Path("data/rope")
    assert listing.files_matching(folder, "calibration/lens-*.png") == [folder / "calibration/lens-01.png"]
    assert listing.files_matching(folder, "*.png") == []


def test_files_on_disk_count_too(project):
    taken = Path("data/rope/trial-01/motion.json")
    assert not listing.file_exists(taken)
    taken.parent.mkdir(parents=True)
    taken.write_text("{}")
    assert listing.file_exists(taken)
    names = [path.name for path in ExperimentFolder(project, "rope").trial(1).raw_files()]
    assert names == ["motion.json", "video.mp4"]


def test_without_a_listing_only_the_disk_counts(project, monkeypatch):
    monkeypatch.delenv(listing.LISTING)
    assert ExperimentFolder(project, "rope").recorded_trials() == []
    assert listing.size_bytes_of(Path("data/rope/trial-01/video.mp4")) == 0
