"""The ingest stage: a raw file belongs to one trial."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

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
    job: Any = SimpleNamespace(folder=SimpleNamespace(data=tmp_path))
    mine = {"video": "c", "joint_log": "c"}
    _refuse_files_of_another_trial(job, Path("film.mp4"), mine, [other])
    with pytest.raises(StrandcastError, match=f"SC-V023.*{words}"):
        _refuse_files_of_another_trial(job, Path("film.mp4"), mine | {kind: "b"}, [other])
