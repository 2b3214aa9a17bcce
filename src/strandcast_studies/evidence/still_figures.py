"""Draw the centrelines found in still pictures.

`python -m strandcast_studies.evidence.still_figures` draws the lines alone, for the documentation, and the
lines over the original pictures, in `results/real-pictures/`.
"""

import os
import sys
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from strandcast.camera.picture_file import write_picture
from strandcast_studies.evidence import franka_stills, mbest_stills
from strandcast_studies.evidence.run import VARIABLE
from strandcast_studies.stills.centreline import StillString, string_in_mask
from strandcast_studies.stills.mask import read_image

DOCUMENTED = Path("docs/explanation/real-pictures.webp")
RESULTS = Path("results/real-pictures")
COLOURS = "viridis"
COLUMNS = 5
SHADE = 0.55  # brightness of the picture under the line; chosen


def draw_string(axes: Axes, name: str, string: StillString) -> None:
    """Draw one string coloured by arc length, its crossings numbered in the order in which it passes them."""
    line = string.line_px[::3]
    axes.scatter(
        line[:, 0], line[:, 1], s=2.0, c=np.linspace(0.0, 1.0, len(line)), cmap=COLOURS, linewidths=0
    )
    for number, crossing in enumerate(string.crossings, start=1):
        x, y = crossing.place_px
        axes.plot(x, y, "o", ms=7, mfc="none", mec="0.3", mew=0.7)
        axes.annotate(f"{number}", (x, y), (5, 4), textcoords="offset points", fontsize=8)
    axes.plot(*string.line_px[0], "s", ms=3, color="black")
    axes.set_title(f"{name.removeprefix('img')}, {string.length_px:.0f} px", fontsize=7, pad=2)
    axes.set(
        xlim=(0, string.mask.shape[1]), ylim=(string.mask.shape[0], 0), aspect="equal", xticks=[], yticks=[]
    )


def lines_figure(strings: dict[str, StillString]) -> Figure:
    """Return a figure of the lines of all pictures, without the pictures."""
    figure = Figure(figsize=(7.6, 8.8), dpi=100, layout="constrained")
    panels = figure.subplots(-(-len(strings) // COLUMNS), COLUMNS).ravel()
    for axes, (name, string) in zip(panels, strings.items(), strict=False):
        draw_string(axes, name, string)
    for axes in panels[len(strings) :]:
        axes.set_axis_off()
    scale = matplotlib.cm.ScalarMappable(cmap=COLOURS)
    bar = figure.colorbar(scale, ax=panels.tolist(), location="bottom", shrink=0.4, aspect=50, pad=0.01)
    bar.set_label("share of the length, from the end marked by a square", fontsize=7)
    bar.ax.tick_params(labelsize=6)
    figure.suptitle("mBEST S1: the cable's order as found; pictures 672 × 896 px", fontsize=8)
    return figure


def overlay(picture: np.ndarray, line_px: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Return a picture (h, w, 3) BGR with a line coloured by arc length over it; white where interpolated."""
    drawn = (SHADE * picture).astype(np.uint8)
    share = matplotlib.colormaps[COLOURS](np.linspace(0.0, 1.0, len(line_px)))[:, 2::-1]
    places = np.rint(16 * line_px).astype(np.int32)
    for k in range(len(places) - 1):
        colour = (255 * share[k]).tolist() if measured[k] else [255, 255, 255]
        cv2.line(drawn, places[k].tolist(), places[k + 1].tolist(), colour, 2, cv2.LINE_AA, 4)
    return drawn


def save(picture: np.ndarray, path: Path) -> None:
    """Write a BGR picture as WebP."""
    write_picture(path, picture, 80)
    print(path)


def main() -> None:
    """Draw all figures."""
    named = os.environ.get(VARIABLE)
    if not named:
        sys.exit(f"{VARIABLE} is not set")
    stills = Path(named) / "mbest_s1"
    strings = {
        name: string_in_mask(mbest_stills.read_mask(stills, name)) for name in mbest_stills.reference_orders()
    }
    for name, string in strings.items():
        picture = read_image(stills / f"{name}.jpg")
        save(overlay(picture, string.line_px, string.measured), RESULTS / f"{name}.webp")
    for name in franka_stills.PICTURES:
        view = franka_stills.read_view(Path(named) / "franka_cable_stills", name)
        cable = franka_stills.find_cable(view)
        save(overlay(view.picture, cable.line_px, cable.measured), RESULTS / f"{name}.webp")
    lines_figure(strings).savefig(DOCUMENTED, pil_kwargs={"quality": 80})
    print(DOCUMENTED)


if __name__ == "__main__":
    main()
