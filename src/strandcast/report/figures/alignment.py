"""The camera's clock against the robot's: the hand as it was seen, and as the joints say."""

from __future__ import annotations

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.report.drawing import FITTED, MEASURED, PLANNED, legend_below, new_figure, to_svg
from strandcast.report.figures.hand_path import within_motion
from strandcast.report.measures import at_times, with_gaps
from strandcast.report.numbers import millimetres, milliseconds, scaled
from strandcast.report.reportlet import Reportlet, Table
from strandcast.report.results import FILES, Results


def alignment(key: str, title: str, results: Results) -> Reportlet:
    """Return the hand's speed from both sources over each other, and the residual of its place."""
    fit = results.need("alignment")
    paths = within_motion(results)
    if "seen" not in paths or "measured" not in paths:
        raise StrandcastError(
            "SC-H041",
            f"the hand was not both seen and logged (alignment: {fit.source})",
            file=FILES["hand"],
            fix="the offset can be checked only where the camera sees the hand's marker",
        )
    seen, measured = paths["seen"], paths["measured"]
    figure = new_figure(10.0, 4.6, left=0.07, top=0.97, bottom=0.19, hspace=0.15)
    speed_axes, apart_axes = figure.subplots(2, 1, sharex=True)
    for path, style, name in ((measured, MEASURED, "joint log"), (seen, FITTED, "camera")):
        time_s, speed = _speed(path.robot_time_s, path.pose[:, :2])
        speed_axes.plot((time_s - fit.motion_start_s) * 1e3, speed, **style, label=f"hand by {name}")
    apart_mm = (seen.pose[:, :2] - at_times(measured, seen.robot_time_s)) * 1e3
    styles = (FITTED | {"linewidth": 1.0}, PLANNED | {"linewidth": 1.0})
    since_s, apart_mm = with_gaps(seen.robot_time_s - fit.motion_start_s, apart_mm)
    for k, axis in enumerate("xy"):
        apart_axes.plot(
            since_s * 1e3,
            apart_mm[:, k],
            **styles[k],
            label=f"seen – joint log, {axis}",
        )
    speed_axes.set_ylabel("speed [m/s]")
    apart_axes.set(xlabel="time from the motion's start [ms]", ylabel="residual [mm]")
    speed_axes.legend(loc="upper right")
    legend_below(figure, apart_axes)
    finding = (
        f"Offset {milliseconds(fit.offset_s, fit.offset_se_s)}; residual of the hand "
        f"{millimetres(fit.residual_rms_m, digits=2)} rms over {fit.frames} frames."
    )
    return Reportlet(
        key,
        title,
        finding,
        "Good: the speeds lie over each other and the residual has no shape. Bad: the residual looks like "
        "the speed (offset: 1 ms is 2 mm at 2 m/s) or like the place (marker's place, camera).",
        to_svg(figure, key, f"Alignment of the clocks. {finding}"),
        [_table(fit)],
        ["alignment.json", "hand.parquet"],
    )


def _speed(time_s: np.ndarray, place_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return speeds over about 10 ms, which the marker's noise does not drown."""
    step = max(1, round(0.01 / max(float(np.median(np.diff(time_s))), 1e-6)))
    if len(time_s) <= step:
        return time_s[:0], time_s[:0]
    speed = np.linalg.norm(place_m[step:] - place_m[:-step], axis=1) / (time_s[step:] - time_s[:-step])
    return with_gaps((time_s[step:] + time_s[:-step]) / 2, speed)


def _table(fit: object) -> Table:
    facts = fit.model_dump()  # type: ignore[attr-defined]
    shift, turn = facts["marker_shift_m"], facts["marker_turn_rad"]
    rows = [
        [
            "offset (robot = camera · (1 + drift) + offset)",
            milliseconds(facts["offset_s"], facts["offset_se_s"]),
        ],
        ["drift", scaled(facts["drift"], 1e6, 1, "ppm", facts["drift_se"])],
        ["prior of the drift (standard deviation)", scaled(facts["drift_prior"], 1e6, 0, "ppm")],
        ["residual of the hand, rms", millimetres(facts["residual_rms_m"], digits=2)],
        ["where from", facts["source"]],
    ]
    if shift is not None:
        rows.append(
            ["marker against the arm's file, x and y", ", ".join(millimetres(value) for value in shift)]
        )
    if turn is not None:
        rows.append(["marker against the arm's file, turn", scaled(turn, 180 / np.pi, 2, "°")])
    rows += [
        [
            f"sync event ({event['kind']}{'' if event['used'] else ', not used'}) at camera time "
            f"{event['camera_time_s']:.4f} s: motion – event",
            milliseconds(event["difference_s"], event["motion_se_s"]),
        ]
        for event in facts["sync_events"]
    ]
    return Table(["clock", "value"], rows)
