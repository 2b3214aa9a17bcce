"""The hand by command, by the joints and by the camera: its path, and the alignment of the clocks by it."""

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.alignment import Alignment
from strandcast.records.estimate import ServoFit
from strandcast.report import drawing as draw
from strandcast.report.measures import arc_length_m, at_times, path_distance_m, rms, with_gaps, within_motion
from strandcast.report.numbers import millimetres, milliseconds, scaled
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.results import FILES

STYLES = {
    "commanded": draw.PLANNED,
    "measured": draw.MEASURED,
    "seen": draw.FITTED | draw.marks("o", 4, markerfacecolor="none", alpha=0.5),
}
NAMES = {"commanded": "commanded", "measured": "measured (joint log)", "seen": "camera"}
MOST_MARKS = 120  # of the hand by the camera; more would hide each other
PAIRS = (("measured", "commanded"), ("seen", "measured"))


def hand_path(page: TrialPageData) -> PanelContent:
    """Return the hand's paths with equal axes, and their distances in time and in shape."""
    results = page.results
    paths = within_motion(results)
    start_s = results.need("alignment").motion_start_s
    figure = draw.new_figure(10.0, 4.6, left=0.08, top=0.95, bottom=0.2, wspace=0.2)
    path_axes, apart_axes = figure.subplots(1, 2)
    for name, path in reversed(paths.items()):  # the dashed command is drawn last, on top
        step = max(1, len(path.pose) // MOST_MARKS)
        path_axes.plot(*path.pose[:, :2].T, **STYLES[name], markevery=step, label=NAMES[name])
    rows, findings = [], []
    for name, other in PAIRS:
        if name not in paths or other not in paths:
            continue
        time_s, places_m = paths[name].robot_time_s, paths[name].pose[:, :2]
        apart_m = np.linalg.norm(places_m - at_times(paths[other], time_s), axis=1)
        off_m = path_distance_m(places_m, paths[other].pose[:, :2])
        since_s, gapped_m = with_gaps(time_s - start_s, apart_m)
        label = f"{'camera' if name == 'seen' else name} – {other}"
        style = draw.MEASURED if name == "measured" else draw.FITTED | {"linewidth": 1.0}
        apart_axes.plot(since_s * 1e3, gapped_m * 1e3, **style, label=label)
        rows.append([label, *(millimetres(v) for v in (np.nanmax(apart_m), rms(apart_m), np.nanmax(off_m)))])
        findings.append(f"{label}: at most {millimetres(np.nanmax(apart_m))} at the same instant")
    draw.equal_axes(path_axes)
    apart_axes.set(xlabel=draw.SINCE_START, ylabel="distance [mm]", ylim=(0, None))
    draw.legend_below(figure)
    # Noise would lengthen the path from the camera.
    lengths = [
        f"{name} {arc_length_m(path.pose[:, :2])[-1] * 1e3:.0f} mm"
        for name, path in paths.items()
        if name != "seen"
    ]
    finding = "; ".join(findings).capitalize() + ". Length of the path: " + ", ".join(lengths) + "."
    heads = ["paths", "largest, same instant", "rms, same instant", "largest from the path"]
    tables, sources = [Table(heads, rows)], ["hand.parquet", "alignment.json"]
    estimate = results.get("estimate")
    if estimate is not None and estimate.servo is not None and estimate.servo.lag_s is not None:
        tables.append(servo_table(estimate.servo))
        sources.append("estimate.json")
    return PanelContent(
        finding, draw.Drawing(figure, f"Path of the hand. {finding}", (apart_axes,)), tables, sources
    )


def servo_table(servo: ServoFit) -> Table:
    """Return the servo response of each joint, each number ± one standard deviation."""

    def cell(j: int, name: str, scale: float, digits: int, unit: str, sd: str | None) -> str:
        values, sds = getattr(servo, name), None if sd is None else getattr(servo, sd)
        value, sigma = (None if each is None else each[j] for each in (values, sds))
        return scaled(value, scale, digits, unit, sigma).strip()

    columns = (
        ("lag_s", 1e3, 2, "ms", "lag_sd_s"),
        ("delay_s", 1e3, 1, "ms", "delay_sd_s"),
        ("time_constant_s", 1e3, 1, "ms", "time_constant_sd_s"),
        ("fitted_gain", 1.0, 4, "", "fitted_gain_sd"),
        ("residual_rad", 1e3, 2, "mrad", None),
        ("held_out_rad", 1e3, 2, "mrad", None),
    )
    rows = [[str(j + 1), *(cell(j, *column) for column in columns)] for j in range(len(servo.delay_s))]
    caption = (
        "The servo: lag = delay + time constant, each ± one standard deviation; the gain of a second fit."
    )
    if servo.held_out is not None:
        caption += (
            f" Held out: {servo.held_out}; rms {millimetres(servo.held_out_hand_m, digits=2)} at the hand."
        )
    return Table(
        ["joint", "lag", "delay", "time constant", "gain", "rms left", "rms held out"], rows, caption
    )


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
        [_clock_table(fit)],
        ["alignment.json", "hand.parquet"],
    )


def _speed(time_s: np.ndarray, place_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return speeds over about 10 ms, less noisy than between neighbouring frames."""
    step = max(1, round(0.01 / max(float(np.median(np.diff(time_s))), 1e-6)))
    if len(time_s) <= step:
        return time_s[:0], time_s[:0]
    speed = np.linalg.norm(place_m[step:] - place_m[:-step], axis=1) / (time_s[step:] - time_s[:-step])
    return with_gaps((time_s[step:] + time_s[:-step]) / 2, speed)


def _clock_table(fit: Alignment) -> Table:
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
