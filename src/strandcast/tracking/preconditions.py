"""Checks before and after decoding: the manifest's hash and frame count, the calibrated size."""

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
    """Open a trial's video as its manifest describes it; SC-V021 if the file changed since it was ingested.

    Of a truncated video, only the frames that the manifest counts are decoded.
    """
    check_same(path, facts)
    return open_video(path, threads, frames=None if facts.whole else facts.packets, keep=keep)


def check_size(facts: VideoFacts, camera: Camera, path: str | Path) -> None:
    """Refuse a video whose frames do not have the calibrated size (SC-T002)."""
    size, wanted = (facts.width_px, facts.height_px), (camera.lens.width_px, camera.lens.height_px)
    if size != wanted:
        raise StrandcastError(
            "SC-T002",
            f"{size[0]} x {size[1]} px, but the calibration is for {wanted[0]} x {wanted[1]}",
            file=path,
            fix="calibrate with pictures of the throw's size",
        )


def check_count(decoded: int, facts: VideoFacts, path: str | Path) -> None:
    """Refuse a video that decoded to more or fewer frames than its manifest counts (SC-T001)."""
    if decoded != facts.packets:
        raise StrandcastError(
            "SC-T001",
            f"{decoded} frames were decoded, the manifest counts {facts.packets}",
            file=path,
            exit_code=INTEGRITY,
            cost="frames after the damage would have wrong times",
            fix="copy the file again from the camera",
        )
