"""Inspection of a video before tracking: frames, time stamps, gaps, hash, completeness."""

from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.manifest import Gap, VideoFacts
from strandcast.video.files import check_video_path, damaged, video_sha256
from strandcast.video.isolated import ProcessLimits, probe_isolated
from strandcast.video.registry import probe
from strandcast.video.source import Contents

GAP_FACTOR = 1.5  # chosen: frame interval relative to the usual one above which frames are missing
MAX_MISSING = 0.2  # chosen: largest share of frames missing in gaps
RATE_TOLERANCE = 0.02  # chosen: relative difference of declared and stamped rate without a note
UNEVEN = 0.01  # chosen, of a frame interval: a tip at 10 m/s moves by 0.2 mm in 1 % of 2 ms
SLOPE_SLACK = 0.25  # of a unit from first to last stamp: rounding changes a fitted clock by 0.08
LEAST_RECURRENCES = 3  # of a rounding's pattern, without which a longer step is a missing frame
ROUNDED_HZ = (600, 1000)  # QuickTime's and Matroska's units, which a copy in a finer one keeps


def inspect_video(
    path: str | Path,
    frame_rate_hz: float | None = None,
    missing_policy: str = "refuse",
    isolated: bool = True,
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
    isolated
        Read the file in a separate process.

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
    contents = probe_isolated(path, ProcessLimits()) if isolated else probe(path)
    digest, size = video_sha256(path)
    _check_not_empty(contents, path)
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
        rounded_to_s=clock.rounded_to_s,
        duplicates=int((np.diff(clock.ticks) == 0).sum()),
        discarded_packets=contents.discarded,
        time_stamp_rate_hz=clock.stamped_hz,
        whole=not cut,
        notes=contents.notes + _rate_notes(clock) + _uneven_notes(clock) + ([cut] if cut else []),
    )


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


@dataclass(frozen=True)
class _Clock:
    """Time stamps from 0 in units of `time_base_s`; the true frame rate and that of the stamps."""

    ticks: np.ndarray
    time_base_s: float
    rate_hz: float
    stamped_hz: float | None  # None: the file has no time stamps
    gaps: list[Gap]
    rounded_to_s: float | None  # what the file's time stamps are multiples of, if the clock is not they


def _clock(contents: Contents, frame_rate_hz: float | None, path: str | Path) -> _Clock:
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
    even = _even_clock(stamps, contents.time_base_s or 1.0)
    ticks, step, unit = (stamps, _usual_step(stamps), 1.0) if even is None else (even.frame, 1.0, even.step)
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
    gaps = _gaps(ticks, step, rate_hz)
    return _Clock(ticks, true or 1.0 / (rate_hz * step), rate_hz, stamped_hz, gaps, rounded)


class _EvenClock(NamedTuple):
    """A clock that ticks once per frame, in units of the time stamps that it was rounded to."""

    frame: np.ndarray  # (n,) number of each frame on it; missing ones are counted
    step: float
    rounded_to: float


def _even_clock(stamps: np.ndarray, base_s: float) -> _EvenClock | None:
    """Return the even clock that rounds to `stamps` [ticks]; None: they are exact, or uneven.

    Formats and phones round time stamps: 240 frames/s in QuickTime's 1/600 s last 2 or 3 units. A file that
    was copied to another format keeps the coarser unit: the greatest that divides all stamps, or one that the
    stamps are multiples of, rounded once more.
    """
    numbered = np.concatenate([[0], np.cumsum(_spans(stamps, _usual_step(stamps)))])
    every = np.arange(len(stamps))
    complete = np.array_equal(numbered, every)
    for (unit, again), frame in product(_units(stamps, base_s), (every, numbered)):
        missing = frame[-1] + 1 - len(frame)
        if missing > MAX_MISSING * (frame[-1] + 1) or (np.diff(frame) == 0).any():
            continue
        fitted = float(np.polyfit(frame, stamps, 1)[0])
        step = _usual(fitted, SLOPE_SLACK * unit / frame[-1], base_s)
        off = 0.5 * min(np.ptp(stamps - each * frame) for each in (fitted, step))
        if off < UNEVEN * step and (complete or frame is numbered):
            return None
        # 500 frames/s in 1/600 s look like 600 with every sixth frame missing: a whole rate is more probable.
        if frame is every and not complete and step == fitted:
            continue
        # Steps of two lengths recur as rounding makes them; a single other one is a frame at another time.
        recurrences = len(stamps) * min(step % unit, -step % unit) / unit
        if off <= 0.55 * unit + again and recurrences >= LEAST_RECURRENCES:
            return _EvenClock(frame, step, unit)
    return None


def _units(stamps: np.ndarray, base_s: float) -> list[tuple[float, float]]:
    """Return the units that stamps may have been rounded to, and half a tick if they were rounded again."""
    divisor = float(np.gcd.reduce(stamps))
    coarse = [unit for rate_hz in ROUNDED_HZ if (unit := 1.0 / (rate_hz * base_s)) > divisor]
    again = [unit for unit in coarse if (stamps == np.rint(np.rint(stamps / unit) * unit)).all()]
    return [(divisor, 0.0), *((unit, 0.5) for unit in again)]


def _usual(step: float, slack: float, base_s: float) -> float:
    """Return the step of a whole rate, or of NTSC's 1000/1001 of one, within `slack`; else `step` [ticks]."""
    rate_hz = 1.0 / (step * base_s)
    steps = [1.0 / (each * base_s) for each in (round(rate_hz), round(1.001 * rate_hz) / 1.001) if each > 0]
    near = min(steps, key=lambda each: abs(each - step), default=step)
    return float(near if abs(near - step) <= slack else step)


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


def _rate_notes(clock: _Clock) -> list[str]:
    if clock.stamped_hz is None or abs(clock.rate_hz / clock.stamped_hz - 1.0) < RATE_TOLERANCE:
        return []
    kind = "a slow-motion export" if clock.rate_hz > clock.stamped_hz else "a time-lapse export"
    return [
        f"its time stamps give {clock.stamped_hz:.6g} frames/s, the experiment {clock.rate_hz:.6g}, which is "
        f"used: it is {kind}, {clock.rate_hz / clock.stamped_hz:.3g} times as fast as it plays"
    ]


def _usual_step(ticks: np.ndarray) -> float:
    """Return the usual spacing of the time stamps [ticks]: the mean of those near the median of pairs.

    Time bases are coarse (500 frames/s at 1/16384 s steps by 32 or 33 ticks): the median is too inexact, and
    of steps by 2 and 3 it would be either.
    """
    steps = np.diff(ticks).astype(np.float64)
    rising = steps[steps > 0]
    pairs = 0.5 * (rising[1:] + rising[:-1]) if len(rising) > 1 else rising
    median = float(np.median(pairs)) if len(pairs) else 1.0
    near = steps[(steps >= 0.5 * median) & (steps <= GAP_FACTOR * median)]
    return float(near.mean()) if len(near) else median


def _spans(ticks: np.ndarray, step: float) -> np.ndarray:
    """Return the frames from each time stamp to the next, in whole numbers; 0 for equal stamps."""
    spans = np.diff(ticks) / step
    return np.where(spans > GAP_FACTOR, spans + 0.5, spans > 0).astype(np.int64)


def _gaps(ticks: np.ndarray, step: float, rate_hz: float) -> list[Gap]:
    spans = np.diff(ticks) / step
    return [
        Gap(index=int(index), duration_s=float(spans[index] / rate_hz), missing=int(frames) - 1)
        for index, frames in enumerate(_spans(ticks, step))
        if frames > 1
    ]


def _uneven_notes(clock: _Clock) -> list[str]:
    step = _usual_step(clock.ticks)
    steps = np.diff(clock.ticks)
    single = steps[_spans(clock.ticks, step) <= 1]
    if clock.stamped_hz is None or not len(single) or np.ptp(single) <= 2 * UNEVEN * step:
        return []
    low_ms, high_ms = (1e3 * clock.time_base_s * float(steps) for steps in (single.min(), single.max()))
    return [
        f"its frames follow each other at {low_ms:.4g} to {high_ms:.4g} ms: its time stamps are no even "
        "clock's, and are used as they are"
    ]
