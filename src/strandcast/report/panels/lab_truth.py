"""Errors of track, miss and clock against the truth, which only the lab knows."""

from typing import Any

import numpy as np

from strandcast.core.closest_approach import segment_approaches
from strandcast.records.verdict import Verdict
from strandcast.report.drawing import ALONG_STRING, MEASURED, SINCE_START, Drawing, new_figure
from strandcast.report.measures import rms, target_ends_m
from strandcast.report.numbers import millimetres, milliseconds, scaled
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.results import Array, TrueString
from strandcast.report.typeset import quantity

WINDOW = "from the motion’s start to 0.3 s after its end"
COMPARED = ("miss_m", "offset_s", "drift")  # facts beside a measurement


def lab_truth(page: TrialPageData) -> PanelContent:
    """Return the tracker's error by point and in time, the true miss and the true offset.

    Point i of a video is compared with the true string at i/n of its true free length: a grasp that clamped
    less of the string made it longer, and the tip is its end, wherever the settings say that the end is. A
    marker is as far from the end as it was put there.
    """
    results = page.results
    truth: TrueString = results.need("lab_truth")
    track, summary = results.need("track"), results.need("track_summary")
    alignment, verdict = results.need("alignment"), results.need("verdict")
    mine, theirs = np.intersect1d(track.frame, truth.frame, return_indices=True)[1:]
    places_m = np.linspace(0.0, truth.place_m[-1], summary.points + 1)
    if results.supplied():
        places_m = summary.places_m() + truth.place_m[-1] - summary.length_m
    error_m = np.linalg.norm(track.points_m[mine] - at_places(truth, places_m)[theirs], axis=2)
    camera_s = track.camera_time_s[mine]
    start_s = alignment.motion_start_s
    clock_s = alignment.robot_time_s(camera_s) - truth.robot_time_s[theirs]
    moving = results.in_window()[mine]
    figure = new_figure(10.0, 3.4, top=0.9, bottom=0.16)
    bars, curve = figure.subplots(1, 2)
    by_point_mm = [rms(error_m[moving, k]) * 1e3 for k in range(1, len(places_m))]
    bars.bar(places_m[1:] * 1e3, by_point_mm, 0.7e3 * places_m[1], color=MEASURED["color"])
    bars.set(xlabel=ALONG_STRING, ylabel="rms error of the track [mm]")
    bars.set_title(f"by point, {WINDOW}")
    curve.plot(
        (truth.robot_time_s[theirs] - start_s) * 1e3, error_m[:, -1] * 1e3, **(MEASURED | {"linewidth": 0.9})
    )
    curve.set(xlabel=f"true {SINCE_START}", ylabel="error of the tracked tip [mm]", ylim=(0, None))
    curve.set_title("tip")
    true_miss_m = _miss(truth, verdict, results.window_s()) if verdict.wanted is None else None
    finding = (
        f"The track is {millimetres(rms(error_m[moving, 1:]), digits=2)} rms from the truth {WINDOW} "
        f"(tip {millimetres(rms(error_m[moving, -1]), digits=2)}); true miss {millimetres(true_miss_m)}, "
        f"measured {millimetres(verdict.miss_m, verdict.miss_sigma_m)}; the clocks' offset is off by "
        f"{milliseconds(float(np.mean(clock_s)), digits=3)}."
    )
    rows = [
        ["miss", millimetres(verdict.miss_m, verdict.miss_sigma_m), millimetres(true_miss_m)],
        [
            "clock offset",
            milliseconds(alignment.offset_s, alignment.offset_se_s, digits=3),
            milliseconds(truth.facts.get("offset_s"), digits=3),
        ],
        ["clock drift", *(scaled(v, 1e6, 1, "ppm") for v in (alignment.drift, truth.facts.get("drift")))],
        *_length_row(summary.length_m, summary.choices.get("length_m"), truth),
        *([words, "", text] for words, text in _facts(truth.facts)),
    ]
    return PanelContent(
        finding,
        Drawing(figure, f"Errors against the lab's truth. {finding}", (curve,)),
        [Table(["quantity", "measured", "lab truth"], rows)],
        ["lab_truth.parquet"],
    )


def at_places(truth: TrueString, places_m: Array) -> Array:
    """Return the true points (F, len(places), 2) at places along the string, interpolated."""
    right = np.searchsorted(truth.place_m, places_m).clip(1, len(truth.place_m) - 1)
    left = right - 1
    share = (places_m - truth.place_m[left]) / (truth.place_m[right] - truth.place_m[left])
    share = np.clip(share, 0.0, 1.0)[None, :, None]
    return np.asarray((1 - share) * truth.points_m[:, left] + share * truth.points_m[:, right])


def _miss(truth: TrueString, verdict: Verdict, window_s: tuple[float, float]) -> float:
    inside = (truth.robot_time_s >= window_s[0]) & (truth.robot_time_s <= window_s[1])
    found = segment_approaches(truth.points_m[inside, -1], target_ends_m(verdict))
    return min(each.distance_m for each in found)


def _length_row(given_m: float, detected_m: object, truth: TrueString) -> list[list[str]]:
    """Return the free length of the string: given, detected, true."""
    if not isinstance(detected_m, float):
        return []
    found = f"{millimetres(detected_m, digits=2)} (given: {millimetres(given_m, digits=2)})"
    return [["length out of the clamp", found, millimetres(float(truth.place_m[-1]), digits=2)]]


def _facts(facts: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the facts that are single values, and those of the trial's variation, in words."""
    single = {name: value for name, value in facts.items() if isinstance(value, int | float | str)}
    every = {name: value for name, value in single.items() if name not in COMPARED}
    return [quantity(*pair) for pair in sorted((every | facts.get("variation", {})).items())]
