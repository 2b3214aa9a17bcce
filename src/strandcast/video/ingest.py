"""Inspection of a video before tracking: frames, time stamps, gaps, hash, completeness."""

from pathlib import Path
from typing import Any

import numpy as np

from strandcast.core.even_clock import MAX_MISSING, UNEVEN, even_clock, frame_steps, usual_step
from strandcast.errors import StrandcastError
from strandcast.records.manifest import Gap, VideoFacts
from strandcast.video.files import check_video_path, damaged, video_sha256
from strandcast.video.isolated import probe_isolated
from strandcast.video.source import Contents

RATE_TOLERANCE = 0.02  # chosen: relative difference of declared and stamped rate without a note


def inspect_video(
    path: str | Path,
    frame_rate_hz: float | None = None,
    missing_policy: str = "refuse",
) -> VideoFacts:
    """Return the facts of a video; at most its first frame is decoded.

    Parameters
    ----------
    path
        A video file, or a folder of pictures.
    frame_rate_hz
        The true frame rate if declared: slow-motion exports store another one.
    missing_policy
        "refuse" a truncated video, or "use_prefix": the frames before the cut.

    Returns
    -------
    VideoFacts
        ``packets`` and ``time_stamps`` describe displayed frames: packets without a picture, or removed by
        the container's edit list, are counted in ``discarded_packets`` instead. Time stamps that a file
        rounds, as QuickTime does to 1/600 s, are replaced by the even clock that they fit.

    Raises
    ------
    StrandcastError
        As `strandcast.video.reader.open_video` on opening, and SC-V012 fewer than two frames,
        fewer than the header states (truncated) or too many missing, SC-V017 no frame rate, more than one, or
        `frame_rate_hz` contradicts the camera's clock.
    """
    check_video_path(path)
    contents = probe_isolated(path)
    digest, size = video_sha256(path)
    _check_not_empty(contents, path)
    facts = VideoFacts(
        file=Path(path).name,
        sha256=digest,
        size_bytes=size,
        container=contents.container,
        codec=contents.codec,
        pixel_format=contents.pixel_format,
        width_px=contents.width_px,
        height_px=contents.height_px,
        header_frames=contents.promised or None,
        frame_rate_source="experiment" if frame_rate_hz else "time stamps",
        discarded_packets=contents.discarded,
        **_clock(contents, frame_rate_hz, path),
    )
    missing = sum(gap.missing for gap in facts.gaps)
    cut = _cut(contents, missing)
    if cut and not (missing_policy == "use_prefix" and _ends_early(contents)):
        raise _refusal(cut, path)
    _check_missing(missing, facts.packets, path)
    facts.whole = not cut
    facts.notes = contents.notes + _rate_notes(facts) + _uneven_notes(facts) + ([cut] if cut else [])
    return facts


def camera_times(facts: VideoFacts) -> np.ndarray:
    """Return the camera time (s) of each frame, from 0 at the first, shape (packets,)."""
    return np.asarray(facts.time_stamps, dtype=np.float64) * facts.time_base_s


def _check_not_empty(contents: Contents, path: str | Path) -> None:
    held = len(contents.ticks)
    if held < 2 and contents.promised > held + contents.discarded + 1:
        raise _refusal(_cut(contents, 0) or "", path)
    if held < 2:
        why = f" ({contents.breaks_off})" if contents.breaks_off else ""
        what = f"has {held} frames with a time stamp{why}; at least 2 are needed"
        raise damaged("SC-V012", what, path, fix="give the recording of the throw")


def _clock(contents: Contents, frame_rate_hz: float | None, path: str | Path) -> dict[str, Any]:
    """Return those fields of `VideoFacts` that follow from the time stamps and the declared rate."""
    if contents.several_rates and frame_rate_hz is None:
        raise StrandcastError(
            "SC-V017",
            contents.several_rates,
            file=path,
            field="camera.frame_rate_hz",
            cost="speeds would be wrong, by different factors in parts of the film",
            fix="film at one frame rate; if all its frames are of one rate, give camera.frame_rate_hz",
        )
    stamps = np.asarray(contents.ticks, dtype=np.int64)
    stamps -= stamps[0]
    even = even_clock(stamps, contents.time_base_s or 1.0)
    ticks, step, unit = (stamps, usual_step(stamps), 1.0) if even is None else (even.frame, 1.0, even.step)
    base_s = None if contents.time_base_s is None else unit * contents.time_base_s
    stamped_hz = None if base_s is None else 1.0 / (step * base_s)
    rate_hz = frame_rate_hz or stamped_hz
    if rate_hz is None:
        field = "camera.frame_rate_hz"
        fix = f"give {field} in experiment.yaml"
        raise StrandcastError("SC-V017", "pictures have no frame rate", file=path, field=field, fix=fix)
    if contents.camera_clock and stamped_hz is not None:
        _refuse_other_rate(rate_hz, stamped_hz, path)
    true = base_s if frame_rate_hz is None else None
    rounded = None if even is None else even.rounded_to * (contents.time_base_s or 1.0)
    return {
        "packets": len(ticks),
        "frame_rate_hz": rate_hz,
        "time_stamp_rate_hz": stamped_hz,
        "time_base_s": true or 1.0 / (rate_hz * step),
        "time_stamps": ticks.tolist(),
        "rounded_to_s": rounded,
        "gaps": _gaps(ticks, step, rate_hz),
        "duplicates": int((np.diff(ticks) == 0).sum()),
    }


def _refuse_other_rate(given_hz: float, camera_hz: float, path: str | Path) -> None:
    """Refuse a declared frame rate that the camera's own clock contradicts (SC-V017)."""
    if abs(given_hz / camera_hz - 1.0) > RATE_TOLERANCE:
        raise StrandcastError(
            "SC-V017",
            f"the camera's own clock gives {camera_hz:.6g} frames/s, camera.frame_rate_hz {given_hz:.6g}",
            file=path,
            field="camera.frame_rate_hz",
            cost=f"speeds would be wrong by a factor of {given_hz / camera_hz:.3g}",
            fix="remove camera.frame_rate_hz: this file needs none",
        )


def _cut(contents: Contents, missing: int) -> str | None:
    """Return how frames are lost other than in gaps between time stamps; None if none are."""
    held = len(contents.ticks) + contents.discarded
    # A container that states a duration only may be one frame off.
    short = contents.promised - held - missing > (0 if contents.exact else 1)
    if contents.promised and short:
        return f"has {held} frames of the {contents.promised} that its header states: it is cut or damaged"
    if contents.breaks_off:
        return f"breaks off after {held} frames ({contents.breaks_off})"
    return None


def _ends_early(contents: Contents) -> bool:
    """Return whether the frames before a cut are known to be complete.

    An AVI has no time stamps: unless its data end within a frame, any frames may be missing.
    """
    return contents.breaks_off is not None or contents.container != "avi"


def _refusal(cut: str, path: str | Path) -> StrandcastError:
    cost = "frames after the damage are missing, or have wrong times"
    return damaged("SC-V012", cut, path, field="camera.missing_policy", cost=cost)


def _check_missing(missing: int, held: int, path: str | Path) -> None:
    if missing > MAX_MISSING * (held + missing):
        what = f"{missing} of {held + missing} frames are missing (gaps in time)"
        fix = "record again: a shorter exposure, a faster disk or a constant frame rate"
        raise damaged("SC-V012", what, path, cost="fast parts of the throw are missing", fix=fix)


def _rate_notes(facts: VideoFacts) -> list[str]:
    rate_hz, stamped_hz = facts.frame_rate_hz, facts.time_stamp_rate_hz
    if stamped_hz is None or abs(rate_hz / stamped_hz - 1.0) < RATE_TOLERANCE:
        return []
    kind = "a slow-motion export" if rate_hz > stamped_hz else "a time-lapse export"
    return [
        f"its time stamps give {stamped_hz:.6g} frames/s, the experiment {rate_hz:.6g}, which is used: it is "
        f"{kind}, {rate_hz / stamped_hz:.3g} times as fast as it plays"
    ]


def _gaps(ticks: np.ndarray, step: float, rate_hz: float) -> list[Gap]:
    spans = np.diff(ticks) / step
    return [
        Gap(index=int(index), duration_s=float(spans[index] / rate_hz), missing=int(frames) - 1)
        for index, frames in enumerate(frame_steps(ticks, step))
        if frames > 1
    ]


def _uneven_notes(facts: VideoFacts) -> list[str]:
    ticks = np.asarray(facts.time_stamps)
    step, steps = usual_step(ticks), np.diff(ticks)
    single = steps[frame_steps(ticks, step) <= 1]
    if facts.time_stamp_rate_hz is None or not len(single) or np.ptp(single) <= 2 * UNEVEN * step:
        return []
    low_ms, high_ms = (1e3 * facts.time_base_s * float(steps) for steps in (single.min(), single.max()))
    return [
        f"its frames follow each other at {low_ms:.4g} to {high_ms:.4g} ms: its time stamps are no even "
        "clock's, and are used as they are"
    ]
