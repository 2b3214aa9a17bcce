"""What a computer must offer is checked before the workflow starts (rows 56, 64 and 66 of the fault list)."""

import os
import time
from pathlib import Path

import pytest

from strandcast.errors import ENVIRONMENT, StrandcastError
from strandcast.workflow.host import check_host


def project(root: Path) -> Path:
    for place in ("data/a/trial-01", "results/a", "config"):
        (root / place).mkdir(parents=True)
    (root / "data" / "a" / "trial-01" / "video.mp4").write_bytes(b"film")
    return root


def test_a_sound_computer_is_accepted(tmp_path: Path) -> None:
    check_host(project(tmp_path), ["a", "not-begun"])
    assert not (tmp_path / "results" / "not-begun").exists()


@pytest.mark.parametrize("place", ["data/a/trial-01/video.mp4", "results/a/summary.json", "config/demo.yaml"])
def test_a_file_from_the_future_is_refused(tmp_path: Path, place: str) -> None:
    path = project(tmp_path) / place
    path.touch()
    later = time.time() + 172_800
    os.utime(path, (later, later))
    with pytest.raises(StrandcastError, match="SC-W007.*17(2800|2799) s in the future") as caught:
        check_host(tmp_path, ["a"])
    assert caught.value.file == str(path)
    assert caught.value.exit_code == ENVIRONMENT
    assert path.exists()


def test_a_small_difference_of_clocks_is_accepted(tmp_path: Path) -> None:
    video = project(tmp_path) / "data" / "a" / "trial-01" / "video.mp4"
    os.utime(video, (time.time() + 2, time.time() + 2))
    check_host(tmp_path, ["a"])
