"""manifest.json: the recorded files of one trial, described without decoding a frame."""

from typing import ClassVar

from strandcast.records.record import Part, Record


class Gap(Part):
    """Time missing between two neighbours: after `index`, `missing` samples of the usual spacing."""

    index: int
    duration_s: float
    missing: int


class VideoFacts(Part):
    """The video file as its container describes it."""

    file: str
    sha256: str
    size_bytes: int
    container: str
    codec: str
    pixel_format: str
    width_px: int
    height_px: int
    header_frames: int | None
    packets: int
    frame_rate_hz: float
    frame_rate_source: str  # "time stamps", "header" or "experiment"
    time_base_s: float
    time_stamps: list[int]  # per packet in order of display, in time bases from the first
    rounded_to_s: float | None = None  # the file's time stamps; those above are the even clock that they fit
    gaps: list[Gap]
    duplicates: int
    discarded_packets: int = 0  # without a picture, or removed by the container's edit list
    time_stamp_rate_hz: float | None = None  # from the time stamps, whatever the experiment's file says
    whole: bool = True  # False: it was cut off, and the frames before the cut are used
    notes: list[str] = []  # remarks for the user


class LogFacts(Part):
    """The joint log as read."""

    file: str
    sha256: str
    rows: int
    start_s: float
    end_s: float
    rate_hz: float
    gaps: list[Gap]
    duplicates: int


class Manifest(Record):
    """The raw files of one trial: hashes, counts, time stamps, gaps."""

    SCHEMA: ClassVar[str] = "strandcast/manifest"

    experiment: str
    trial: int
    video: VideoFacts
    joint_log: LogFacts | None  # a video without a robot has none
    motion_sha256: str | None
    target_m: list[float] | None = None  # at which the motion that was played aimed
    warnings: list[str]
