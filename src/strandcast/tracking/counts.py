"""What a decoding pass must agree with: the manifest's count, the calibration's size."""

from __future__ import annotations

from pathlib import Path

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.camera import Camera
from strandcast.records.manifest import VideoFacts


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
