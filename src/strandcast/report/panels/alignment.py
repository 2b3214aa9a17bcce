"""The alignment of the clocks: the hand by the camera and by the joint log."""

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.alignment import Alignment
from strandcast.report import drawing as draw
from strandcast.report.measures import at_times, rms, with_gaps, within_motion
from strandcast.report.numbers import millimetres, milliseconds, scaled
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.results import FILES


def alignment(page: TrialPageData) -> PanelContent:
    """Return the hand's speed from both sources, and the distance of its places."""
    results = page.results
    fit = results.need("alignment")
    paths = within_motion(results)
    if "seen" not in paths or "measured" not in paths:
        raise StrandcastError(
            "SC-H031",
            f"the hand was not both detected and logged (alignment: {fit.source})",
            file=FILES["hand"],
            fix="the offset can be checked only where the camera sees the hand's marker",
        )
    seen, measured = paths["seen"], paths["measured"]
    figure = draw.new_figure(10.0, 4.6, left=0.07, top=0.97, bottom=0.19, hspace=0.15)
    speed_axes, apart_axes = figure.subplots(2, 1, sharex=True)
    for path, style, name in ((measured, draw.MEASURED, "joint log"), (seen, draw.FITTED, "camera")):
        time_s, speed = _speed(path.robot_time_s, path.pose[:, :2])
        speed_axes.plot((time_s - fit.motion_start_s) * 1e3, speed, **style, label=f"hand by {name}")
    apart_mm = (seen.pose[:, :2] - at_times(measured, seen.robot_time_s)) * 1e3
    rms_mm = rms(np.linalg.norm(apart_mm, axis=1))
    since_s, apart_mm = with_gaps(seen.robot_time_s - fit.motion_start_s, apart_mm)
    drawn = (
        (np.linalg.norm(apart_mm, axis=1), draw.MEASURED, "distance"),
        (apart_mm[:, 0], draw.FITTED | {"linewidth": 0.9}, "camera – joint log, x"),
        (apart_mm[:, 1], draw.PLANNED | {"linewidth": 0.9}, "camera – joint log, y"),
    )
    for values, style, name in drawn:
        apart_axes.plot(since_s * 1e3, values, **style, label=name)
    apart_axes.axhline(rms_mm, **draw.dashes(draw.TRUE, linewidth=1.4), label="rms distance")
    speed_axes.set_ylabel("speed [m/s]")
    apart_axes.set(xlabel=draw.SINCE_START, ylabel="residual [mm]")
    speed_axes.legend(loc="upper right")
    draw.legend_below(figure, apart_axes)
    finding = (
        f"Within the motion the hand by the camera is {millimetres(rms_mm / 1e3, digits=2)} rms from the "
        f"aligned joint log; clock offset {milliseconds(fit.offset_s, fit.offset_se_s)}."
    )
    return PanelContent(
        finding,
        draw.Drawing(figure, f"Alignment of the clocks. {finding}", (speed_axes, apart_axes)),
        [_table(fit)],
        ["alignment.json", "hand.parquet"],
    )


def _speed(time_s: np.ndarray, place_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return speeds over about 10 ms, less noisy than between neighbouring frames."""
    step = max(1, round(0.01 / max(float(np.median(np.diff(time_s))), 1e-6)))
    if len(time_s) <= step:
        return time_s[:0], time_s[:0]
    speed = np.linalg.norm(place_m[step:] - place_m[:-step], axis=1) / (time_s[step:] - time_s[:-step])
    return with_gaps((time_s[step:] + time_s[:-step]) / 2, speed)


def _table(fit: Alignment) -> Table:
    offset = milliseconds(fit.offset_s, fit.offset_se_s)
    rows = [
        ["offset (robot = camera · (1 + drift) + offset)", offset],
        ["drift", scaled(fit.drift, 1e6, 1, "ppm", fit.drift_se)],
        ["prior of the drift (standard deviation)", scaled(fit.drift_prior, 1e6, 0, "ppm")],
        [
            f"distance of the hand with all of this fitted, rms over {fit.frames} frames",
            millimetres(fit.residual_rms_m, digits=2),
        ],
        ["source", fit.source],
        *_rig_rows(fit),
    ]
    if fit.marker_shift_m is not None:
        shift = ", ".join(map(millimetres, fit.marker_shift_m))
        rows.append(["marker against the arm's file, x and y", shift])
    if fit.marker_turn_rad is not None:
        turn = scaled(fit.marker_turn_rad, 180 / np.pi, 2, "°")
        rows.append(["marker against the arm's file, turn", turn])
    for event in fit.sync_events:
        name = f"sync event ({event.kind}{'' if event.used else ', not used'})"
        when = f"{name} at camera time {event.camera_time_s:.4f} s: motion – event"
        rows.append([when, milliseconds(event.difference_s, event.motion_se_s)])
    return Table(["clock", "value"], rows)


def _rig_rows(fit: Alignment) -> list[list[str]]:
    """Return the rig's fitted errors against the arm's file and the calibration."""
    errors = (
        ("zeros of the joints", fit.joint_zero_rad, 180 / np.pi, "°"),
        ("lengths of the links", fit.link_length_m, 1e3, "mm"),
        ("place of the base, x and y", fit.base_shift_m, 1e3, "mm"),
    )
    return [
        [f"{name}: off by", ", ".join(scaled(value, scale, 2, shown) for value in values)]
        for name, values, scale, shown in errors
        if values
    ]
