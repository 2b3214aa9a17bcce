"""The hand's path: what was commanded, what the arm did, what the camera saw."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strandcast.records.estimate import ServoFit
from strandcast.report.drawing import FITTED, MEASURED, PLANNED, legend_below, new_figure, to_svg
from strandcast.report.measures import arc_length_m, at_times, path_distance_m, rms, with_gaps
from strandcast.report.numbers import millimetres, scaled
from strandcast.report.reportlet import Reportlet, Table
from strandcast.report.results import HandPath, Results

STYLES = {
    "commanded": PLANNED,
    "measured": MEASURED,
    "seen": FITTED
    | {"linestyle": "none", "marker": "o", "markersize": 4, "markerfacecolor": "none", "alpha": 0.5},
}
NAMES = {"commanded": "Commanded", "measured": "Measured (joint log)", "seen": "Seen (camera)"}
PAIRS = (("measured", "commanded"), ("seen", "measured"))


def hand_path(key: str, title: str, results: Results) -> Reportlet:
    """Return the hand's paths with equal axes, and how far they are apart in time and in shape."""
    paths = within_motion(results)
    start_s = results.need("alignment").motion_start_s
    figure = new_figure(10.0, 4.6, left=0.08, top=0.95, bottom=0.2, wspace=0.2)
    path_axes, apart_axes = figure.subplots(1, 2)
    for name, path in reversed(paths.items()):  # what is drawn last lies on top: the dashes of the command
        path_axes.plot(path.pose[:, 0], path.pose[:, 1], **STYLES[name], label=NAMES[name])
    rows, findings = [], []
    for name, other in PAIRS:
        if name not in paths or other not in paths:
            continue
        apart_m = np.linalg.norm(
            paths[name].pose[:, :2] - at_times(paths[other], paths[name].robot_time_s), axis=1
        )
        off_m = path_distance_m(paths[name].pose[:, :2], paths[other].pose[:, :2])
        since_s, gapped_m = with_gaps(paths[name].robot_time_s - start_s, apart_m)
        label = f"{name.capitalize()} – {other}"
        apart_axes.plot(
            since_s * 1e3,
            gapped_m * 1e3,
            **(MEASURED if name == "measured" else FITTED | {"linewidth": 1.0}),
            label=label,
        )
        rows.append([label, *(millimetres(v) for v in (np.nanmax(apart_m), rms(apart_m), np.nanmax(off_m)))])
        findings.append(f"{label}: at most {millimetres(np.nanmax(apart_m))} at the same instant")
    path_axes.set(xlabel="x [m]", ylabel="y [m]")
    path_axes.set_aspect("equal", adjustable="datalim")
    apart_axes.set(xlabel="time from the motion's start [ms]", ylabel="distance [mm]", ylim=(0, None))
    legend_below(figure)
    # Noise would lengthen the path that the camera saw.
    lengths = [
        f"{name} {arc_length_m(path.pose[:, :2])[-1] * 1e3:.0f} mm"
        for name, path in paths.items()
        if name != "seen"
    ]
    finding = "; ".join(findings) + ". Length of the path: " + ", ".join(lengths) + "."
    heads = ["paths", "most, same instant", "rms, same instant", "most off the path"]
    tables, sources = [Table(heads, rows)], ["hand.parquet", "alignment.json"]
    estimate = results.get("estimate")
    if estimate is not None and estimate.servo is not None and estimate.servo.lag_s is not None:
        tables.append(servo_table(estimate.servo))
        sources.append("estimate.json")
    return Reportlet(
        key,
        title,
        finding,
        "The distance at the same instant holds the servo's lag; the distance off the path does not. Good: "
        "seen lies on measured to a few mm. Bad: seen is off everywhere (marker's place, camera) or only "
        "while moving fast (alignment).",
        to_svg(figure, key, f"Path of the hand. {finding}"),
        tables,
        sources,
    )


def servo_table(servo: ServoFit) -> Table:
    """Return the servo's response by joint, each number ± one standard deviation."""

    def cell(name: str, j: int, scale: float, digits: int, unit: str, sd: str | None = None) -> str:
        values, sds = getattr(servo, name), None if sd is None else getattr(servo, sd)
        known = values is not None
        return scaled(
            values[j] if known else None, scale, digits, unit, None if sds is None else sds[j]
        ).strip()

    rows = [
        [
            str(j + 1),
            cell("lag_s", j, 1e3, 2, "ms", "lag_sd_s"),
            cell("delay_s", j, 1e3, 1, "ms", "delay_sd_s"),
            cell("time_constant_s", j, 1e3, 1, "ms", "time_constant_sd_s"),
            cell("fitted_gain", j, 1.0, 4, "", "fitted_gain_sd"),
            cell("residual_rad", j, 1e3, 2, "mrad"),
            cell("held_out_rad", j, 1e3, 2, "mrad"),
        ]
        for j in range(len(servo.delay_s))
    ]
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


def within_motion(results: Results) -> dict[str, HandPath]:
    """Return the hand's paths between the motion's start and 0.1 s after its end."""
    alignment = results.need("alignment")
    paths = {}
    for name, path in results.need("hand").items():
        inside: NDArray[np.bool_] = (path.robot_time_s >= alignment.motion_start_s) & (
            path.robot_time_s <= alignment.motion_end_s + 0.1
        )
        if inside.sum() > 1:
            paths[name] = HandPath(path.robot_time_s[inside], path.pose[inside])
    return paths
