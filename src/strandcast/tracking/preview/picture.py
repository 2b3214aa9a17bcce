"""The preview as a picture: a few frames with all detections, the scene, the profile across the string."""

import textwrap
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon

from strandcast.tracking.preview.findings import CLEAR, contrast_to_noise, findings, problems
from strandcast.tracking.preview.preview import Preview, PreviewFrame, to_pixels

# Okabe–Ito; each mark has a shape of its own too.
STRING, POINT, MARKER = "#56b4e9", "#e69f00", "#009e73"
HAND, TARGET, DETECTED = "#f0e442", "#cc79a7", "#d55e00"
WIDTH_IN, HEIGHT_IN, DPI = 15.0, 9.8, 100
MARGIN_PX = 32.0
BESIDE_PX = 2.5  # from the string's edge to the lines along it
ASPECT = 1.06  # of the frames' panels
COLUMNS = 3
LEAST_REACH = 0.3  # of all greys, between black and white in the picture
CASING = {"boxstyle": "round,pad=0.12", "facecolor": "black", "edgecolor": "none", "alpha": 0.65}
SETTINGS: dict[str, Any] = {
    "font.family": "sans-serif",
    "font.size": 9.5,
    "text.parse_math": False,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
}
GRID: dict[str, Any] = {
    "left": 0.01,
    "right": 0.99,
    "top": 0.94,
    "bottom": 0.01,
    "hspace": 0.11,
    "wspace": 0.04,
    "width_ratios": [1.0, 1.0, 1.0, 0.95],
    "height_ratios": [1.0, 1.0, 0.62],
}


def preview_picture(preview: Preview, title: str) -> np.ndarray:
    """Return the picture (height, width, 3), RGB."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(SETTINGS)
        figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), dpi=DPI)
        canvas = FigureCanvasAgg(figure)
        figure.suptitle(title, x=0.01, y=0.992, ha="left", fontsize=12, fontweight="bold")
        grid = figure.add_gridspec(3, 4, **GRID)
        size = shown_size(preview)
        for place, frame in enumerate(preview.frames):
            axes = figure.add_subplot(grid[place // COLUMNS, place % COLUMNS])
            _draw_frame(axes, preview, frame, shown_window(preview, frame, size))
        _draw_scene(figure.add_subplot(grid[0, 3]), preview)
        _draw_profile(figure.add_subplot(grid[1, 3]), preview)
        _legend(figure.add_subplot(grid[2, 3]))
        _write(figure.add_subplot(grid[2, :3]), preview)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def spots_px(preview: Preview, frame: PreviewFrame) -> np.ndarray:
    """Return the pixels (K, 2) of hand and string in a frame; (0, 2) where neither is found."""
    spots = [] if frame.hand is None else list(frame.hand.corners_px.values())
    if frame.string is not None:
        spots.append(to_pixels(preview, frame.string.points_m))
    every = np.concatenate(spots) if spots else np.zeros((0, 2))
    return every[np.isfinite(every).all(axis=1)]


def shown_size(preview: Preview) -> tuple[float, float]:
    """Return width and height [px] of the part of each frame that is shown: large enough for all of them."""
    height, width = preview.background.shape
    spans = [
        np.ptp(spots, axis=0)
        for spots in (spots_px(preview, frame) for frame in preview.frames)
        if len(spots)
    ]
    if not spans:
        return float(width), float(height)
    across, down = np.max(spans, axis=0) + 2 * MARGIN_PX
    across, down = max(across, ASPECT * down), max(down, across / ASPECT)
    return min(float(across), float(width)), min(float(down), float(height))


def shown_window(
    preview: Preview, frame: PreviewFrame, size: tuple[float, float]
) -> tuple[float, float, float, float]:
    """Return left, right, top, bottom [px] of the part of a frame that is shown, about hand and string."""
    spots = spots_px(preview, frame)
    limits = np.array(preview.background.shape[::-1], float)
    half = 0.5 * np.array(size)
    middle = 0.5 * (spots.min(axis=0) + spots.max(axis=0)) if len(spots) else 0.5 * limits
    middle = np.clip(middle, half, np.maximum(limits - half, half))
    return middle[0] - half[0], middle[0] + half[0], middle[1] - half[1], middle[1] + half[1]


def _show(axes: Any, image: np.ndarray, preview: Preview, window: tuple[float, float, float, float]) -> None:
    # White paper may saturate, so that scene and string are not dark; the string must not.
    levels = [*np.percentile(preview.background, (1, 90)).tolist(), *(s.level for s in preview.strings)]
    low, reach = min(levels), max(max(levels) - min(levels), LEAST_REACH * preview.max_level)
    axes.imshow(
        image, cmap="gray", vmin=low - 0.05 * reach, vmax=low + 1.15 * reach, interpolation="antialiased"
    )
    axes.set(xlim=window[:2], ylim=(window[3], window[2]), xticks=[], yticks=[])


def _draw_frame(
    axes: Any, preview: Preview, frame: PreviewFrame, window: tuple[float, float, float, float]
) -> None:
    _show(axes, frame.image, preview, window)
    title = f"frame {frame.index} · {frame.time_s:.3f} s"
    if frame.hand is None:
        axes.set_title(title + " · no hand")
        return
    for marker, four in frame.hand.corners_px.items():
        axes.add_patch(Polygon(four, closed=True, fill=False, edgecolor=MARKER, lw=1.6))
        _label(axes, four.mean(axis=0), str(marker), MARKER)
    ahead_m = frame.hand.pose.place(np.array([0.04, 0.0]))
    clamp, ahead = to_pixels(preview, np.stack([frame.hand.pose.position_m, ahead_m]))
    axes.annotate("", ahead, clamp, arrowprops={"arrowstyle": "-|>", "color": HAND, "lw": 1.6})
    axes.plot(*clamp, marker="s", ms=4.5, color=HAND, mec="black", mew=0.5)
    if frame.string is None:
        axes.set_title(title + " · no string")
    else:
        _draw_string(axes, preview, frame)
        clear = float((frame.string.quality[1:] >= CLEAR).mean())
        axes.set_title(f"{title} · {frame.string.width_px:.1f} px wide · {100 * clear:.0f} % clear")
    _draw_target(axes, preview)


def _draw_string(axes: Any, preview: Preview, frame: PreviewFrame) -> None:
    assert frame.string is not None
    course = to_pixels(preview, frame.string.nodes_m)
    # Beside the string, so that the string itself stays visible.
    along = np.gradient(course, axis=0)
    normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    clear = (frame.string.quality >= CLEAR)[:, None]
    for side in (-1.0, 1.0):
        beside = course + side * (0.5 * frame.string.width_px + BESIDE_PX) * normal
        axes.plot(*np.where(clear, beside, np.nan).T, color=STRING, lw=1.2)
        axes.plot(*np.where(clear, np.nan, beside).T, color=DETECTED, lw=1.6, ls=(0, (1, 1)))
    points = to_pixels(preview, frame.string.points_m)
    axes.plot(*points[1:].T, ls="none", marker="o", ms=3.6, mfc="none", mec=POINT, mew=1.1)
    _label(axes, points[-1], f"{len(points) - 1}", POINT)
    total = np.linalg.norm(np.diff(frame.string.nodes_m, axis=0), axis=1).sum()
    for place in preview.expected.weights_m:
        node = min(round(place / total * (len(course) - 1)), len(course) - 1)
        axes.plot(*course[node], marker="D", ms=8, mfc="none", mec=POINT, mew=1.2)


def _draw_target(axes: Any, preview: Preview) -> None:
    if not preview.calibrated or preview.expected.target_m is None:
        return
    given = to_pixels(preview, preview.expected.target_m[None])[0]
    axes.plot(*given, marker="+", ms=13, color=TARGET, mew=1.8)
    if preview.target is not None:
        assert preview.camera is not None
        middle = to_pixels(preview, np.array([preview.target.place_m]))[0]
        radius_px = preview.target.radius_m / preview.camera.scale_m_per_px
        axes.add_patch(Circle(middle, radius_px + 2.0, fill=False, edgecolor=DETECTED, lw=1.4, ls="--"))


def _label(axes: Any, place: np.ndarray, text: str, colour: str) -> None:
    axes.annotate(
        text,
        place,
        xytext=(7, 7),
        textcoords="offset points",
        color=colour,
        fontsize=9,
        fontweight="bold",
        bbox=CASING,
    )


def _draw_scene(axes: Any, preview: Preview) -> None:
    height, width = preview.background.shape
    _show(axes, preview.background, preview, (0.0, width, 0.0, height))
    for frame in preview.frames:
        if frame.string is not None:
            course = to_pixels(preview, frame.string.nodes_m)
            axes.plot(*course.T, color=STRING, lw=1.0)
            axes.plot(*course[0], marker="s", ms=3, color=HAND, mec="black", mew=0.4)
    _draw_target(axes, preview)
    axes.set_title(f"background, as learned · {width} x {height} px")
    if preview.camera is None:
        return
    scale_m = preview.camera.scale_m_per_px
    bar_m = 0.1 * max(1, round(0.25 * width * scale_m / 0.1))
    x, y = 0.04 * width, 0.95 * height
    axes.plot([x, x + bar_m / scale_m], [y, y], color="white", lw=3.5, solid_capstyle="butt")
    label = f"{1e3 * bar_m:.0f} mm" + ("" if preview.calibrated else " (estimated)")
    axes.text(x, y - 0.02 * height, label, color="white", fontsize=9, va="bottom", bbox=CASING)


def _draw_profile(axes: Any, preview: Preview) -> None:
    strings = preview.strings
    axes.set_title("profile across the string")
    if not strings:
        axes.text(0.5, 0.5, "no string found", ha="center", va="center", transform=axes.transAxes)
        axes.set(xticks=[], yticks=[])
        return
    box = axes.get_position()
    axes.set_position([box.x0 + 0.035, box.y0 + 0.05, box.width - 0.035, box.height - 0.05])
    offsets = strings[0].offsets_px
    for string in strings:
        axes.plot(offsets, string.profile, color="0.7", lw=0.8)
    usual = np.median([string.profile for string in strings], axis=0)
    axes.axhspan(-preview.noise, preview.noise, color=STRING, alpha=0.45, lw=0)
    axes.plot(offsets, usual, color="black", lw=1.8)
    width = float(np.median([string.width_px for string in strings]))
    half = 0.5 * usual[np.abs(usual).argmax()]
    middle = offsets[np.abs(usual).argmax()]
    axes.plot(
        [middle - width / 2, middle + width / 2], [half, half], color=DETECTED, lw=2.5, marker="|", ms=9
    )
    axes.text(middle + width / 2 + 0.6, half, f"{width:.1f} px", color=DETECTED, va="center")
    axes.set(
        xlabel="across the string [px]",
        ylabel="change from the background [grey levels]",
        xlim=(offsets[0], offsets[-1]),
    )
    note = f"contrast-to-\nnoise {contrast_to_noise(preview):.0f}\n\nblue band:\nnoise ±{preview.noise:.1f}"
    axes.text(0.99, 0.97, note, transform=axes.transAxes, va="top", ha="right")


def _legend(axes: Any) -> None:
    axes.axis("off")
    marks: list[tuple[dict[str, Any], str]] = [
        ({"color": STRING, "lw": 1.5}, "string, as found in this frame alone"),
        ({"color": DETECTED, "lw": 2.2, "ls": (0, (1, 1))}, "part of it that is not visible"),
        ({"color": POINT, "marker": "o", "mfc": "none", "ls": "none"}, "mass point (the last one numbered)"),
        ({"color": POINT, "marker": "D", "mfc": "none", "ls": "none"}, "weight, as declared"),
        ({"color": MARKER, "marker": "s", "mfc": "none", "ls": "none", "ms": 9}, "hand's marker with its id"),
        ({"color": HAND, "marker": "s", "lw": 1.5, "mec": "black"}, "clamp; the string leaves it this way"),
        ({"color": TARGET, "marker": "+", "ms": 11, "mew": 1.8, "ls": "none"}, "target_m"),
        ({"color": DETECTED, "marker": "o", "mfc": "none", "ls": "none", "ms": 10}, "target, as detected"),
    ]
    handles = [Line2D([], [], label=text, **style) for style, text in marks]
    axes.legend(handles=handles, loc="upper left", frameon=False, borderaxespad=0.0, labelspacing=0.35)


def _write(axes: Any, preview: Preview) -> None:
    axes.axis("off")
    wrong = [("!", text) for text in problems(preview)] or [("✓", "nothing is wrong in these frames")]
    lines = [*wrong, *(("·", text) for text in findings(preview))]
    wrapped = ["\n   ".join(textwrap.wrap(f"{sign}  {text}", 128)) for sign, text in lines]
    axes.text(
        0.0, 1.0, "\n".join(wrapped), transform=axes.transAxes, va="top", linespacing=1.35, fontsize=9.5
    )
