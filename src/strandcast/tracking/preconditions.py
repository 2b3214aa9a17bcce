"""Checks before and after decoding: the manifest's hash and frame count, the calibrated size."""

from contextlib import AbstractContextManager
from pathlib import Path

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.camera import Camera
from strandcast.records.manifest import VideoFacts
from strandcast.video.checks import check_same
from strandcast.video.reader import VideoFile, open_video
from strandcast.video.source import SQUARE_TOLERANCE, VideoInfo


def open_ingested(path: str | Path, facts: VideoFacts, threads: int = 1) -> AbstractContextManager[VideoFile]:
    """Open a trial's video as its manifest describes it; SC-V005 if the file changed since it was ingested.

    Of a truncated video, only the frames that the manifest counts are decoded.
    """
    check_same(path, facts)
    return open_video(path, threads, None if facts.whole else facts.packets)


def check_size(facts: VideoFacts, camera: Camera, path: str | Path) -> None:
    """Refuse a video whose frames do not have the calibrated size (SC-C012)."""
    size, wanted = (facts.width_px, facts.height_px), (camera.lens.width_px, camera.lens.height_px)
    if size != wanted:
        raise StrandcastError(
            "SC-C012",
            f"{size[0]} x {size[1]} px, but the calibration is for {wanted[0]} x {wanted[1]}",
            file=path,
        )


def check_pixel_aspect(info: VideoInfo, camera: Camera | None, path: str | Path) -> None:
    """Refuse a video whose pixels are not those of its calibration (SC-C012); None: a scale without a lens.

    A pixel `a` times as wide as high makes fy = a · fx. Of a lens with other pixels than a video that states
    square ones, or none, `calibrate` warns: many cameras that skip lines state nothing.
    """
    aspect = info.pixel_aspect
    calibrated = 1.0 if camera is None else camera.lens.matrix[1][1] / camera.lens.matrix[0][0]
    wrong = abs(aspect / calibrated - 1.0)
    if abs(aspect - 1.0) < SQUARE_TOLERANCE or wrong < SQUARE_TOLERANCE:
        return
    basis = "there is no lens with such" if camera is None else f"the lens has fy / fx = {calibrated:.4g}"
    raise StrandcastError(
        "SC-C012",
        f"its pixels are {aspect:.4g} times as wide as high (sample aspect ratio); {basis}",
        file=path,
        cost=f"widths would be wrong by {wrong:.0%} relative to heights",
        fix="convert it to square pixels (ffmpeg -i IN -vf scale=iw*sar:ih,setsar=1 OUT), and calibrate with "
        "pictures of that size",
    )


def check_count(decoded: int, facts: VideoFacts, path: str | Path) -> None:
    """Refuse a video that decoded to more or fewer frames than its manifest counts (SC-V005)."""
    if decoded != facts.packets:
        raise StrandcastError(
            "SC-V005",
            f"{decoded} frames were decoded, the manifest counts {facts.packets}",
            file=path,
            exit_code=INTEGRITY,
            cost="frames after the damage would have wrong times",
        )
