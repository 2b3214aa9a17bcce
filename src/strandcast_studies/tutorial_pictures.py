"""Pictures of docs/tutorial.md, from the demo's results: `python -m strandcast_studies.tutorial_pictures`."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
from PIL import Image

import strandcast
from strandcast.api import ExperimentView

FOLDER = Path("docs", "tutorial")
WIDTH_PX = 900


def throws(demo: ExperimentView, path: Path) -> None:
    """Write the strobe pictures of the first and of the last throw, one above the other."""
    files = [trial.folder.results / "strobe.webp" for trial in demo.trials.values()]
    pictures = [Image.open(each) for each in files if each.is_file()]
    scaled = [
        each.resize((WIDTH_PX, each.height * WIDTH_PX // each.width)) for each in (pictures[0], pictures[-1])
    ]
    both = Image.new("RGB", (WIDTH_PX, sum(each.height for each in scaled)))
    for k, each in enumerate(scaled):
        both.paste(each, (0, k * each.height))
    both.save(path, "webp", quality=60, method=6)


def fit(demo: ExperimentView, path: Path) -> None:
    """Draw the tip's measured path in trial 1, with what was planned and what was fitted to it."""
    trial = demo.trials[1]
    figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    tip = trial.track[trial.track["point"] == trial.track["point"].max()]
    axes.plot(tip["x_m"], tip["y_m"], ".", color="0.6", markersize=7, label="measured")
    for source, style in (("planned", ":"), ("fitted", "--")):
        points = trial.simulated[trial.simulated["source"] == source]
        last = points[points["point"] == points["point"].max()]
        axes.plot(last["x_m"], last["y_m"], style, label=source)
    axes.plot(*(demo.settings.target_m or ()), "o", color="black", label="target")
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="the tip in trial 1")
    axes.legend()
    figure.savefig(path, dpi=110, pil_kwargs={"quality": 60, "method": 6})


def main(root: str = ".") -> None:
    """Write all pictures."""
    demo = strandcast.open(root)["demo"]
    FOLDER.mkdir(parents=True, exist_ok=True)
    throws(demo, FOLDER / "throws.webp")
    fit(demo, FOLDER / "fit.webp")


if __name__ == "__main__":
    main(*sys.argv[1:])
