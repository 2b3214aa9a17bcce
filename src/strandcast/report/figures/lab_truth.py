"""What the lab knows and a real rig does not: how far track, miss and clock are from the truth."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from strandcast.records.summary import Verdict
from strandcast.report.drawing import MEASURED, new_figure, to_svg
from strandcast.report.measures import path_distance_m, rms
from strandcast.report.numbers import millimetres, milliseconds
from strandcast.report.reportlet import Reportlet, Table
from strandcast.report.results import LabTruth, Results

Array = NDArray[np.float64]
BAR_PLACES = 201  # of a bar to strike, from which the true miss is taken


def lab_truth(key: str, title: str, results: Results) -> Reportlet:
    """Return the tracker's error by point and in time, the true miss and the true offset."""
    truth: LabTruth = results.need("lab_truth")
    track, summary = results.need("track"), results.need("track_summary")
    alignment, verdict = results.need("alignment"), results.need("verdict")
    mine, theirs = np.intersect1d(track.frame, truth.frame, return_indices=True)[1:]
    places_m = np.arange(summary.points + 1) * summary.length_m / summary.points
    error_m = np.linalg.norm(track.points_m[mine] - at_places(truth, places_m)[theirs], axis=2)
    camera_s = track.camera_time_s[mine]
    start_s = alignment.motion_start_s
    clock_s = alignment.robot_time_s(camera_s) - truth.robot_time_s[theirs]
    moving = results.in_window()[mine]
    figure = new_figure(10.0, 3.4, top=0.9, bottom=0.16)
    bars, curve = figure.subplots(1, 2)
    by_point_mm = [
        rms(error_m[moving, k]) * 1e3 if _any(error_m[moving, k]) else np.nan for k in range(len(places_m))
    ]
    bars.bar(places_m * 1e3, by_point_mm, 0.7e3 * places_m[1], color=MEASURED["color"])
    bars.set(xlabel="place along the string from the hand [mm]", ylabel="rms error of the track [mm]")
    bars.set_title("by point, during the motion")
    curve.plot(
        (truth.robot_time_s[theirs] - start_s) * 1e3, error_m[:, -1] * 1e3, **(MEASURED | {"linewidth": 0.9})
    )
    curve.set(
        xlabel="true time from the motion's start [ms]",
        ylabel="error of the tracked tip [mm]",
        ylim=(0, None),
    )
    curve.set_title("tip")
    true_miss_m = _miss(truth, verdict, results.window_s()) if verdict.wanted is None else None
    finding = (
        f"The track is {millimetres(rms(error_m[moving]), digits=2)} rms from the truth during the motion "
        f"(tip {millimetres(rms(error_m[moving, -1]), digits=2)}); true miss {millimetres(true_miss_m)}, "
        f"measured {millimetres(verdict.miss_m, verdict.miss_sigma_m)}; the clocks' offset is off by "
        f"{milliseconds(float(np.mean(clock_s)), digits=3)}."
    )
    rows = [
        ["miss", millimetres(verdict.miss_m, verdict.miss_sigma_m), millimetres(true_miss_m)],
        [
            "clock offset",
            milliseconds(alignment.offset_s, alignment.offset_se_s, digits=3),
            milliseconds(alignment.offset_s - float(np.mean(clock_s)), digits=3),
        ],
        *([name, "", _plain(value)] for name, value in _scalars(truth.facts)),
    ]
    return Reportlet(
        key,
        title,
        finding,
        "Nothing of this was used by any stage: it stands beside the measurement, never instead of it.",
        to_svg(figure, key, f"Errors against the lab's truth. {finding}"),
        [Table(["quantity", "measured", "lab truth"], rows)],
        ["lab_truth.parquet"],
    )


def at_places(truth: LabTruth, places_m: Array) -> Array:
    """Return the true points (F, len(places), 2) at places along the string, between the lab's own."""
    right = np.searchsorted(truth.place_m, places_m).clip(1, len(truth.place_m) - 1)
    left = right - 1
    share = (places_m - truth.place_m[left]) / (truth.place_m[right] - truth.place_m[left])
    share = np.clip(share, 0.0, 1.0)[None, :, None]
    return np.asarray((1 - share) * truth.points_m[:, left] + share * truth.points_m[:, right])


def _miss(truth: LabTruth, verdict: Verdict, window_s: tuple[float, float]) -> float:
    inside = (truth.robot_time_s >= window_s[0]) & (truth.robot_time_s <= window_s[1])
    ends = np.array(verdict.bar_m or [verdict.target_m])
    share = np.linspace(0.0, 1.0, BAR_PLACES if verdict.bar_m else 1)[:, None]
    places = (1.0 - share) * ends[0] + share * ends[-1]
    return float(path_distance_m(places, truth.points_m[inside, -1]).min())


def _any(values: Array) -> bool:
    return bool(np.isfinite(values).any())


def _scalars(facts: dict[str, Any]) -> list[tuple[str, Any]]:
    """Return the facts that are single values, those of the trial's variation among them."""
    every = facts | {f"variation: {name}": value for name, value in facts.get("variation", {}).items()}
    return [(name, value) for name, value in sorted(every.items()) if isinstance(value, int | float | str)]


def _plain(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
