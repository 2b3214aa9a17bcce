"""The ingest stage: a raw file belongs to one trial."""

import json
from pathlib import Path

import pytest

from strandcast.errors import StrandcastError
from strandcast.stages.ingest import _refuse_files_of_another_trial


@pytest.mark.parametrize(
    ("kind", "words"),
    [("video", r"film\.mp4.*the video of trial-01"), ("joint_log", "joints.csv.*the joint log")],
)
def test_a_file_that_another_trial_has_is_refused(tmp_path: Path, kind: str, words: str) -> None:
    other = tmp_path / "trial-01" / "manifest.json"
    other.parent.mkdir()
    other.write_text(json.dumps({"video": {"sha256": "a"}, "joint_log": None} | {kind: {"sha256": "b"}}))
    own = {"video": (Path("film.mp4"), "c"), "joint_log": (Path("joints.csv"), "c")}
    _refuse_files_of_another_trial(own, [other])
    own[kind] = own[kind][0], "b"
    with pytest.raises(StrandcastError, match=f"SC-V023.*{words}"):
        _refuse_files_of_another_trial(own, [other])
