"""The panels of each page: the built-in lists, registered ones, and those of installed packages."""

from typing import Any, Literal

from strandcast.core.registry import Registry
from strandcast.errors import StrandcastError
from strandcast.report.panels.alignment import alignment
from strandcast.report.panels.budget import budget
from strandcast.report.panels.calibration import calibration
from strandcast.report.panels.camera_picture import camera_picture
from strandcast.report.panels.content import Panel, PanelContent
from strandcast.report.panels.evaluation import evaluation
from strandcast.report.panels.fit_error import fit_error
from strandcast.report.panels.hand_path import hand_path
from strandcast.report.panels.lab_truth import lab_truth
from strandcast.report.panels.next_motion import next_motion
from strandcast.report.panels.page_data import ExperimentPageData, TrialPageData
from strandcast.report.panels.parameters import masses, parameters
from strandcast.report.panels.progress import evaluations, misses
from strandcast.report.panels.quality import quality
from strandcast.report.panels.rig import rig
from strandcast.report.panels.strobe import strobe
from strandcast.report.panels.strobe_picture import strobe_picture
from strandcast.report.panels.throws import closest_strings, hand_paths, tip_paths
from strandcast.report.panels.tip_path import tip_path
from strandcast.report.panels.tracking import tracking
from strandcast.report.panels.viewer import viewer

PageKind = Literal["trial", "experiment"]


def _from_video(page: TrialPageData) -> bool:
    """Return whether the track comes from a video, and was not supplied."""
    return not page.results.supplied()


def _plans(page: TrialPageData) -> bool:
    """Return whether a next motion is to be expected."""
    return page.next_motion is not None or _from_video(page)


def _planned(page: TrialPageData) -> bool:
    """Return whether the throw aimed at a place, with a prediction, and its closest approach was seen."""
    motion, verdict = page.played, page.results.get("verdict")
    aimed = verdict is None or (verdict.wanted is None and verdict.closest_m is not None)
    return aimed and _from_video(page) and (motion is None or motion.predicted is not None)


def _in_the_lab(page: TrialPageData) -> bool:
    """Return whether the trial was thrown in the lab."""
    return page.results.path("lab_truth").exists()


def _has_picture(page: ExperimentPageData) -> bool:
    """Return whether the calibration drew its picture."""
    return page.camera_record.with_suffix(".webp").is_file()


CLOCKS = ("alignment", "hand")
THROW = ("track", "alignment", "verdict")

TRIAL_PANELS = [
    Panel("picture", "Strobe picture of the throw", strobe_picture, ("strobe", "verdict"), _from_video),
    Panel("film", "The throw, frame by frame", viewer, ("clip", "track", "verdict", "camera"), _from_video),
    Panel("strobe", "The throw at equal steps of the tip’s path", strobe, THROW),
    Panel(
        "tip", "Tip path, measured and simulated", tip_path, ("track", "verdict", "alignment", "simulated")
    ),
    Panel(
        "budget",
        "Where the miss came from",
        budget,
        ("verdict", "motion", "alignment", "simulated"),
        _planned,
    ),
    Panel("rig", "Health of the rig", rig, shown=_from_video),
    Panel("hand", "Hand path: commanded, measured, by camera", hand_path, CLOCKS, _from_video),
    Panel("fit", "Evaluation value E and the search", evaluation, ("estimate",)),
    Panel(
        "errors", "Fitted string, point by frame", fit_error, ("track", "simulated", "alignment", "estimate")
    ),
    Panel("parameters", "String parameters", parameters, ("estimate",)),
    Panel("masses", "Masses along the string", masses, ("estimate",)),
    Panel("next", "The next motion", next_motion, shown=_plans),
    Panel("tracking", "Tracking quality", tracking, ("track", "track_summary")),
    Panel("clocks", "Alignment of the clocks", alignment, CLOCKS, _from_video),
    Panel("camera", "Calibration", calibration, ("camera",), _from_video),
    Panel("truth", "Lab truth", lab_truth, ("lab_truth", *THROW), _in_the_lab),
]

EXPERIMENT_PANELS = [
    Panel("misses", "Miss per trial", misses),
    Panel("hands", "Hand paths, first throw and hit", hand_paths),
    Panel("tips", "Tip paths", tip_paths),
    Panel("strings", "Strings at the closest approach", closest_strings),
    Panel("evaluations", "E before and after each fit", evaluations),
    Panel("next", "The next motion", next_motion),
    Panel("quality", "Checks by trial", quality),
    Panel("camera", "Calibration of the camera", camera_picture, shown=_has_picture),
]

# By "page.name", in the order of the pages.
PANELS: Registry[Panel] = Registry(
    "report panel",
    "strandcast.panels",
    entries={f"trial.{panel.name}": panel for panel in TRIAL_PANELS}
    | {f"experiment.{panel.name}": panel for panel in EXPERIMENT_PANELS},
)


def panels_of(kind: PageKind) -> list[Panel]:
    """Return the panels of a page: the built-in and registered ones in order, then those of packages."""
    return [_panel(name) for name in PANELS if name.startswith(f"{kind}.")]


def _panel(name: str) -> Panel:
    """Return a panel; one that cannot be imported shows its error on the page."""
    try:
        return PANELS.get(name)
    except StrandcastError as error:
        problem = error

        def build(page: Any) -> PanelContent:
            raise problem

        return Panel(name.partition(".")[2], f"Panel {name}", build)
