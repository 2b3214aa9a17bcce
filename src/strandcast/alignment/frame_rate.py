"""The camera's true frame rate, from the pace at which the hand covers its path."""

from dataclasses import replace

import numpy as np

from strandcast.alignment.coarse_search import AlignmentData, candidate_offsets
from strandcast.rig.model import Detections, marker_path_m

RATE_STEPS = np.linspace(0.88, 1.12, 25)  # chosen
USUAL_HZ = (
    *(24, 25, 30, 48, 50, 60, 100, 120, 125, 150, 200, 240, 250, 300, 400, 480, 500, 600, 700, 750),
    *(800, 960, 1000, 1200, 1500, 2000, 2500, 3000, 4000, 5000, 10000),
)


def coarse_rate(data: AlignmentData) -> float | None:
    """Return robot time over camera time by the instants at which the hand has covered shares of its path."""
    detections, rows = data.detections, data.rows
    marker = int(np.bincount(detections.marker).argmax())
    mine = detections.where(detections.marker == marker)
    log_s = _path_times(rows.time_s, marker_path_m(data.rig, rows.q_rad, marker))
    video_s = _path_times(mine.time_s, mine.pose.position_m)
    if log_s is None or video_s is None:
        return None
    guess = float((log_s[-1] - log_s[0]) / (video_s[-1] - video_s[0]))
    best: tuple[float, float] = (np.inf, 1.0)
    for ratio in guess * RATE_STEPS:
        middle_s = float(np.mean(log_s - ratio * video_s))
        scaled = replace(data, detections=detections.scaled(ratio))
        _, coarse_m = candidate_offsets(scaled, (middle_s - 0.1, middle_s + 0.1))
        best = min(best, (float(coarse_m[0]), float(ratio)))
    return best[1]


def rate_words(detections: Detections, ratio: float) -> tuple[str, str]:
    """Return the mistake in a frame rate and its fix, in words, for robot time over camera time."""
    nominal_hz = 1.0 / float(np.median(np.diff(np.unique(detections.time_s))))
    true_hz = nominal_hz / ratio
    kind = "a slow-motion export: " if ratio < 0.7 else ""
    return (
        f"with the camera's clock taken {ratio:.4g} times as fast ({kind}the video's times say "
        f"{nominal_hz:.4g} frames/s, the hand's motion {true_hz:.4g})",
        f"set the true rate, camera.frame_rate_hz: {_round_rate(true_hz, nominal_hz):g}; where other films "
        "of this camera have another, use the original of this one",
    )


def _round_rate(rate_hz: float, nominal_hz: float) -> float:
    """Return the usual rate near a fitted one, or the fitted one in five digits: not what is set already."""
    usual = np.array(USUAL_HZ, float)
    near = float(usual[np.argmin(np.abs(np.log(usual / rate_hz)))])
    is_new = abs(near - nominal_hz) > 0.5 * abs(rate_hz - nominal_hz)
    return near if is_new and abs(near / rate_hz - 1.0) < 0.005 else float(f"{rate_hz:.5g}")


def _path_times(time_s: np.ndarray, position_m: np.ndarray) -> np.ndarray | None:
    """Return when a tenth, two tenths … of a path are covered; rest and noise add no length."""
    edges = np.linspace(time_s[0], time_s[-1], 120)
    which = np.clip(np.searchsorted(edges, time_s, side="right") - 1, 0, 118)
    full = np.unique(which)
    middle = np.stack([[np.median(position_m[which == k, axis]) for k in full] for axis in (0, 1)], axis=1)
    times = np.array([time_s[which == k].mean() for k in full])
    step = np.linalg.norm(np.diff(middle, axis=0), axis=1)
    step[step < 0.02 * step.max()] = 0.0
    length = np.concatenate([[0.0], np.cumsum(step)])
    if length[-1] <= 0.0:
        return None
    return np.asarray(np.interp(np.arange(1, 10) / 10.0, length / length[-1], times))
