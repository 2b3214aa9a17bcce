"""What a decoding pass must agree with: the manifest's count and hash, the calibration's size."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.camera import Camera
from strandcast.records.manifest import VideoFacts
from strandcast.video.checks import check_same
from strandcast.video.reader import VideoFile, open_video


def open_ingested(
    path: str | Path, facts: VideoFacts, threads: int = 1, keep: int = 1
) -> AbstractContextManager[VideoFile]:
    """Open a trial's video for its decoding pass, as its manifest describes it.

    Of a video that was cut, only the frames that the manifest counts are decoded.

    Raises
    ------
    StrandcastError
        As `strandcast.video.reader.open_video`, and SC-V021 the file is not the one that was ingested.
    """
    check_same(path, facts)
    return open_video(path, threads, frames=None if facts.whole else facts.packets, keep=keep)


def check_size(facts: VideoFacts, camera: Camera, path: str | Path) -> None:
    """Refuse a video whose pictures are not of the size that was calibrated."""
    size, wanted = (facts.width_px, facts.height_px), (camera.lens.width_px, camera.lens.height_px)
    if size != wanted:
        raise StrandcastError(
            "SC-T002", f"{size[0]} x {size[1]} px, but the calibration is for {wanted[0]} x {wanted[1]}",
            file=path, fix="calibrate with pictures of the throw's size")  # fmt: skip


def check_count(decoded: int, facts: VideoFacts, path: str | Path) -> None:
    """Refuse a video that gave more or fewer frames than its manifest counted."""
    if decoded != facts.packets:
        raise StrandcastError(
            "SC-T001", f"{decoded} frames were decoded, the manifest counts {facts.packets}", file=path,
            exit_code=INTEGRITY, cost="frames after the damage would be at wrong times",
            fix="copy the file again from the camera")  # fmt: skip
