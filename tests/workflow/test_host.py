"""What a computer must offer is checked before the workflow starts (rows 56 and 64 of the fault list)."""

from pathlib import Path

from strandcast.workflow.host import check_host


def project(root: Path) -> Path:
    for place in ("data/a/trial-01", "results/a", "config"):
        (root / place).mkdir(parents=True)
    (root / "data" / "a" / "trial-01" / "video.mp4").write_bytes(b"film")
    return root


def test_a_sound_computer_is_accepted(tmp_path: Path) -> None:
    check_host(project(tmp_path), ["a", "not-begun"])
    assert not (tmp_path / "results" / "not-begun").exists()
