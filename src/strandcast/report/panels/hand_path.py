"""The hand's path: commanded, measured by the joints, detected by the camera."""

import numpy as np

from strandcast.records.estimate import ServoFit
from strandcast.report import drawing as draw
from strandcast.report.measures import arc_length_m, at_times, path_distance_m, rms, with_gaps, within_motion
from strandcast.report.numbers import millimetres, scaled
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import TrialPageData

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
        finding,
        draw.Drawing(figure, f"Path of the hand. {finding}", (apart_axes,)),
        tables,
        sources,
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
