"""What a video tells before it is tracked: frames, time stamps, gaps, hash, and whether it is whole."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.manifest import Gap, VideoFacts
from strandcast.video.child import Limits, probe_in_child
from strandcast.video.files import check_video_path, video_sha256
from strandcast.video.formats import probe
from strandcast.video.source import Contents

GAP_FACTOR = 1.5  # neighbours further apart than this many usual intervals have lost frames between them
MOST_MISSING = 0.2  # of all frames may be missing in gaps
RATE_TOLERANCE = 0.02  # by which the experiment's rate and the time stamps' may differ unsaid


def inspect_video(
    path: str | Path,
    frame_rate_hz: float | None = None,
    missing_policy: str = "refuse",
    isolated: bool = True,
) -> VideoFacts:
    """Read the facts of a video; no more than its first frame is decoded.

    Parameters
    ----------
    path
        A video file, or a folder of pictures.
    frame_rate_hz
        The true frame rate, if the experiment gives it: cameras that export slow motion write another.
    missing_policy
        "refuse" a video that was cut, or "use_prefix": the frames before the cut.
    isolated
        Read the file in a process of its own.

    Returns
    -------
    VideoFacts
        ``packets`` and ``time_stamps`` hold what a decoder shows: packets that the container's edit list
        takes out are counted in ``discarded_packets`` instead.

    Raises
    ------
    StrandcastError
        As `strandcast.video.reader.open_video` when it opens, and SC-V011 fewer than two frames, SC-V012
        fewer than the header promises (it was cut), SC-V017 no frame rate, SC-V018 too many missing.
    """
    check_video_path(path)
    contents = probe_in_child(path, Limits()) if isolated else probe(path)
    digest, size = video_sha256(path)
    _check_some(contents, path)
    clock = _clock(contents, frame_rate_hz, path)
    missing = sum(gap.missing for gap in clock.gaps)
    cut = _cut(contents, missing)
    if cut and not (missing_policy == "use_prefix" and _ends_early(contents)):
        raise _refusal(cut, path)
    _check_missing(missing, len(clock.ticks), path)
    return VideoFacts(
        file=Path(path).name,
        sha256=digest,
        size_bytes=size,
        container=contents.container,
        codec=contents.codec,
        pixel_format=contents.pixel_format,
        width_px=contents.width_px,
        height_px=contents.height_px,
        header_frames=contents.promised or None,
        packets=len(clock.ticks),
        frame_rate_hz=clock.rate_hz,
        frame_rate_source="experiment" if frame_rate_hz else "time stamps",
        time_base_s=clock.time_base_s,
        time_stamps=clock.ticks.tolist(),
        gaps=clock.gaps,
        duplicates=int((np.diff(clock.ticks) == 0).sum()),
        discarded_packets=contents.discarded,
        time_stamp_rate_hz=clock.stamped_hz,
        whole=not cut,
        notes=contents.notes + _rate_notes(clock) + ([cut] if cut else []),
    )


def camera_times(facts: VideoFacts) -> np.ndarray:
    """Return the camera time (s) of each frame, from 0 at the first, shape (packets,)."""
    return np.asarray(facts.time_stamps, dtype=np.float64) * facts.time_base_s


def _check_some(contents: Contents, path: str | Path) -> None:
    held = len(contents.ticks)
    if held < 2 and contents.promised > held + contents.discarded + 1:
        raise _refusal(_cut(contents, 0) or "", path)
    if held < 2:
        why = f" ({contents.breaks_off})" if contents.breaks_off else ""
        raise StrandcastError(
            "SC-V011", f"holds {held} frames with a time stamp{why}; at least 2 are needed", file=path,
            exit_code=INTEGRITY, fix="give the recording of the throw")  # fmt: skip


@dataclass(frozen=True)
class _Clock:
    """Time stamps from 0, in `time_base_s` of true time; the true rate and the one that they tell."""

    ticks: np.ndarray
    time_base_s: float
    rate_hz: float
    stamped_hz: float | None  # None: the file has no time stamps
    gaps: list[Gap]


def _clock(contents: Contents, frame_rate_hz: float | None, path: str | Path) -> _Clock:
    ticks = np.asarray(contents.ticks, dtype=np.int64)
    ticks -= ticks[0]
    step = _usual_step(ticks)
    stamped_hz = None if contents.time_base_s is None else 1.0 / (step * contents.time_base_s)
    rate_hz = frame_rate_hz or stamped_hz
    if rate_hz is None:
        raise StrandcastError(
            "SC-V017", "pictures state no frame rate", file=path, field="camera.frame_rate_hz",
            fix="give camera.frame_rate_hz in experiment.yaml")  # fmt: skip
    true = contents.time_base_s if frame_rate_hz is None else None
    return _Clock(ticks, true or 1.0 / (rate_hz * step), rate_hz, stamped_hz, _gaps(ticks, step, rate_hz))


def _cut(contents: Contents, missing: int) -> str | None:
    """Return in what way frames are lost other than in gaps between time stamps; None if none are."""
    held = len(contents.ticks) + contents.discarded
    # A container that states a duration only may be one frame off.
    short = contents.promised - held - missing > (0 if contents.exact else 1)
    if contents.promised and short:
        return (
            f"holds {held} frames of the {contents.promised} that its header promises: it was cut or damaged"
        )
    if contents.breaks_off:
        return f"breaks off after {held} frames ({contents.breaks_off})"
    return None


def _ends_early(contents: Contents) -> bool:
    """Return whether the frames before a cut are known to be all there.

    An AVI only counts its frames as it finds them: unless its data end within one, the hole may be anywhere.
    """
    return contents.breaks_off is not None or contents.container != "avi"


def _refusal(cut: str, path: str | Path) -> StrandcastError:
    return StrandcastError(
        "SC-V012", cut, file=path, field="camera.missing_policy", exit_code=INTEGRITY,
        cost="frames after the damage are not seen, or at wrong times",
        fix="copy the file again from the camera; if its end is all that is lost, "
        "camera.missing_policy: use_prefix in experiment.yaml takes the frames before")  # fmt: skip


def _check_missing(missing: int, held: int, path: str | Path) -> None:
    if missing > MOST_MISSING * (held + missing):
        raise StrandcastError(
            "SC-V018", f"{missing} of {held + missing} frames are missing (gaps in time)", file=path,
            exit_code=INTEGRITY, cost="the string is not seen in fast parts of the throw",
            fix="record again: a shorter exposure, a faster disk or a constant frame rate")  # fmt: skip


def _rate_notes(clock: _Clock) -> list[str]:
    if clock.stamped_hz is None or abs(clock.rate_hz / clock.stamped_hz - 1.0) < RATE_TOLERANCE:
        return []
    kind = "a slow-motion export" if clock.rate_hz > clock.stamped_hz else "a time-lapse export"
    return [
        f"its time stamps tell {clock.stamped_hz:.6g} frames/s, the experiment {clock.rate_hz:.6g}, which is "
        f"taken: it is {kind}, {clock.rate_hz / clock.stamped_hz:.3g} times as fast as it plays"
    ]


def _usual_step(ticks: np.ndarray) -> float:
    """Return the usual spacing of the time stamps, in ticks: the mean of those near the median.

    Time bases are coarse (500 frames/s at 1/16384 s steps by 32 or 33 ticks), so the median alone is not it.
    """
    steps = np.diff(ticks).astype(np.float64)
    median = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    near = steps[(steps > 0.5 * median) & (steps < GAP_FACTOR * median)]
    return float(near.mean()) if len(near) else median


def _gaps(ticks: np.ndarray, step: float, rate_hz: float) -> list[Gap]:
    spans = np.diff(ticks) / step
    return [
        Gap(index=int(index), duration_s=float(spans[index] / rate_hz), missing=int(spans[index] + 0.5) - 1)
        for index in np.flatnonzero(spans > GAP_FACTOR)
    ]
