"""manifest.json: what was recorded for one trial, told without decoding a frame."""

from __future__ import annotations

from typing import ClassVar

from strandcast.records.record import Part, Record


class Gap(Part):
    """Time missing between two neighbours: after `index`, `missing` samples of the usual spacing."""

    index: int
    duration_s: float
    missing: int


class VideoFacts(Part):
    """The video file as its container tells it."""

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
    gaps: list[Gap]
    duplicates: int
    discarded_packets: int = 0  # that the container's edit list takes out
    time_stamp_rate_hz: float | None = None  # as the time stamps tell it, whatever the experiment says
    whole: bool = True  # False: it was cut, and the frames before the cut are taken
    notes: list[str] = []  # what a user should know of the file


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
    """Raw files of one trial: hashes, counts, time stamps, gaps."""

    SCHEMA: ClassVar[str] = "strandcast/manifest"

    experiment: str
    trial: int
    video: VideoFacts
    joint_log: LogFacts | None  # a video without a robot has none
    motion_sha256: str | None
    warnings: list[str]
