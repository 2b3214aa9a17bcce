"""A trial's video is found whatever the camera calls its kind."""

import pytest

from strandcast.errors import StrandcastError
from strandcast.records.folders import ExperimentFolder, TrialFolder, trial_folders
from strandcast.records.lineage import place_of


@pytest.fixture
def trial(tmp_path) -> TrialFolder:
    return TrialFolder(tmp_path, tmp_path / "results", 1)


@pytest.mark.parametrize(
    ("names", "video", "files"),
    [
        (["video.mp4", "joints.csv"], "video.mp4", ["video.mp4"]),
        (["video.AVI"], "video.AVI", ["video.AVI"]),
        (["video.mp4", "video.mp4.sha256"], "video.mp4", ["video.mp4"]),
        (["video.cine"], "video.cine", ["video.cine"]),
        (["video.cihx", "video.mraw"], "video.cihx", ["video.cihx", "video.mraw"]),
        (["video.cih", "video.cihx", "video.mraw"], "video.cihx", ["video.cih", "video.cihx", "video.mraw"]),
        (["video.mraw"], "video.mraw", ["video.mraw"]),
        (["video/f1.png", "video/f2.png", "video/notes.txt"], "video", ["f1.png", "f2.png"]),
    ],
)
def test_the_video_and_its_files(trial, names, video, files):
    for name in names:
        (trial.data / name).parent.mkdir(exist_ok=True)
        (trial.data / name).write_bytes(b"x")
    assert trial.video().name == video
    assert [path.name for path in trial.video_files()] == files


@pytest.mark.parametrize("names", [[], ["video.mp4", "video.avi"], ["video.mp4", "video.mraw"], ["film.mp4"]])
def test_none_or_two_are_refused_by_name(trial, names):
    for name in names:
        (trial.data / name).write_bytes(b"x")
    with pytest.raises(StrandcastError) as caught:
        trial.video()
    assert caught.value.code == "SC-V020"
    assert all(name in caught.value.what for name in names)


@pytest.mark.parametrize(
    "name",
    ["video.mp4", "Video.MP4", "VIDEO.Avi", "video.mraw", "video.cihx", "video.cine", "video.tif", "video"],
)
def test_a_trial_with_any_kind_of_video_is_recorded(tmp_path, name):
    trial = ExperimentFolder(tmp_path, "e").trial(1)
    assert not trial.videos()
    trial.data.mkdir(parents=True)
    (trial.data / "video.txt").touch()
    assert not trial.videos()
    (trial.data / name).touch() if "." in name else (trial.data / name).mkdir()
    assert [path.name for path in trial.videos()] == [name]


def test_a_trial_with_any_raw_file_was_thrown(tmp_path):
    folder = ExperimentFolder(tmp_path, "e")
    for name in ("trial-01/.DS_Store", "trial-02/cam.avi", "trial-04/joints.csv", "trials/x.txt"):
        (folder.data / name).parent.mkdir(parents=True)
        (folder.data / name).touch()
    (folder.data / "trial-03").mkdir()
    assert folder.thrown_trials() == [2, 4]


def test_trials_with_a_video_or_a_supplied_track_are_recorded(tmp_path):
    experiment = ExperimentFolder(tmp_path, "e")
    for number, name in ((1, "video.mp4"), (2, "joints.csv"), (3, "track.parquet")):
        experiment.trial(number).data.mkdir(parents=True)
        (experiment.trial(number).data / name).touch()
    assert experiment.recorded_trials() == [1, 3]


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("trial-00", 2),
        ("trial-1", 2),
        ("trial-001", 2),
        ("trial-007", 7),
        ("trial-0100", 100),
        ("trial-1000000", 2),
        ("trial_01", 2),
        ("trial01", 2),
        ("Trial-01", 2),
        ("Trial-03", 3),
        ("TRIAL 2", 2),
        ("trial‐01", 2),
    ],
)
def test_a_folder_that_would_be_overlooked_is_refused(tmp_path, name, number):
    folder = ExperimentFolder(tmp_path, "x")
    for each in ("trial-01", "calibration", "trial-03-failed", "trials", name):
        (folder.data / each).mkdir(parents=True)
        (folder.data / each / "video.mp4").write_bytes(b"x")
    with pytest.raises(StrandcastError, match="SC-R032") as caught:
        folder.recorded_trials()
    assert caught.value.file == str(folder.data / name)
    assert str(caught.value).endswith(str(folder.trial(number).data))
    assert "trial-99, then trial-100 to trial-999999" in str(caught.value)
    (folder.data / name).rename(folder.trial(number).data)
    assert folder.recorded_trials() == [1, number]


def test_trials_are_in_the_order_of_their_numbers(tmp_path):
    folder = ExperimentFolder(tmp_path, "e")
    numbers = [1, 2, 99, 100, 101]
    for number in reversed(numbers):
        for place in (folder.trial(number).data, folder.trial(number).results):
            place.mkdir(parents=True)
        (folder.trial(number).data / "video.mp4").touch()
        (folder.trial(number).results / "report.html").touch()
    assert folder.recorded_trials() == folder.thrown_trials() == folder.reported_trials() == numbers
    assert list(trial_folders(folder.data)) == numbers
    assert place_of(folder.trial(100).data / "joints.csv").trial == 100
