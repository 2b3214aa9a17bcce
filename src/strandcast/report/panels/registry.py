"""The panels of each page: the built-in lists, registered ones, and those of installed packages."""

from dataclasses import replace
from typing import Any, Literal

from strandcast.core.registry import Registry
from strandcast.errors import StrandcastError
from strandcast.report.causes import slip_words
from strandcast.report.panels.budget import budget
from strandcast.report.panels.calibration import calibration, camera_picture
from strandcast.report.panels.content import Panel, PanelContent
from strandcast.report.panels.evaluation import evaluation, fit_error
from strandcast.report.panels.hand_path import alignment, hand_path
from strandcast.report.panels.lab_truth import lab_truth
from strandcast.report.panels.next_motion import next_motion
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.panels.parameters import masses, parameters
from strandcast.report.panels.predicted import next_throw, predicted_throw
from strandcast.report.panels.progress import evaluations, misses, predictions
from strandcast.report.panels.quality import quality
from strandcast.report.panels.rig_offsets import compares_arm, rig_offsets
from strandcast.report.panels.space_views import turnable, two_views
from strandcast.report.panels.strobe import strobe, tip_path
from strandcast.report.panels.strobe_picture import camera_views, strobe_picture
from strandcast.report.panels.throws import closest_strings, hand_paths, tip_paths
from strandcast.report.panels.tracking import slip_panel, tracking
from strandcast.report.panels.viewer import viewer

PageKind = Literal["trial", "experiment"]


def _from_video(page: TrialPageData) -> bool:
    """Return whether the track comes from a video, and was not supplied."""
    return not page.results.supplied()


def _plans(page: TrialPageData) -> bool:
    """Return whether a next motion is to be expected."""
    return page.results.aimed() and (page.next_motion is not None or _from_video(page))


def _was_predicted(page: TrialPageData) -> bool:
    """Return whether the throw's motion was planned here, with a prediction, or could not be read."""
    motion = page.played
    return page.results.aimed() and _from_video(page) and (motion is None or motion.predicted is not None)


def _planned(page: TrialPageData) -> bool:
    """Return whether the throw aimed at a place, with a prediction, and its closest approach was seen."""
    verdict = page.results.get("verdict")
    aimed = verdict is None or (verdict.wanted is None and verdict.closest_m is not None)
    return aimed and _was_predicted(page)


CLOCKS = ("alignment", "hand")
THROW = ("track", "alignment", "verdict")

NEXT_MOTION = Panel(
    "next",
    "The next motion",
    next_motion,
    open=True,
    good="the predicted path passes the target, the predicted misses lie below the hit radius, the curves "
    "stay within the limits.",
    bad="the misses spread over decimetres: the string is too uncertain for this motion.",
)

TRIAL_PANELS = [
    Panel(
        "picture",
        "Strobe picture of the throw",
        strobe_picture,
        leads=True,
        needs=("strobe", "verdict"),
        caption="Large ring: the target. Small rings: measured points. Dashed: the fitted string at the same "
        "instants (if these are unknown, the tip’s path as fitted, and as measured: solid).",
        good="rings and dashes lie on the string of the picture.",
        bad="they lie beside it everywhere (camera or alignment), or at some instants (tracking).",
        shown=_from_video,
    ),
    Panel(
        "film",
        "The throw, frame by frame",
        viewer,
        open=True,
        needs=("clip", "track", "verdict", "camera"),
        caption="Blue rings: the measured points; yellow squares: flagged ones (unsure, hidden, predicted). "
        "Dashed: the fitted string. Large ring: the target.",
        good="the rings sit on the string, and the dashed line follows it.",
        bad="rings beside the string (tracking), all of them shifted by the same amount (camera), the dashed "
        "line ahead or behind (clocks), or of another shape (fit).",
        shown=_from_video,
    ),
    Panel(
        "views",
        "The string from two sides",
        two_views,
        leads=True,
        needs=("track", "alignment"),
        caption="Left: seen along y; right: seen along x. Thin blue: the path of the last marker. Rings: the "
        "measured markers at some instants; dashed: the fitted string; squares: the driven ends. Of a throw, "
        "large ring: the target; diamond: the closest approach.",
        good="the dashed string runs through the rings in both views.",
        bad="it misses them in one view only (an axis, a clamp’s direction), or more towards the tip "
        "(stiffness, air).",
        shown=lambda page: page.results.in_space(),
    ),
    Panel(
        "turn",
        "The string, to be turned",
        turnable,
        needs=("track", "alignment", "simulated"),
        caption="Drag the figure, or use its sliders, to turn it. Blue rings: the measured markers; dashed: "
        "the fitted string; green: the string as predicted from the trials before.",
        shown=lambda page: page.results.in_space(),
    ),
    Panel(
        "cameras",
        "What each camera saw",
        camera_views,
        good="the same throw from every side.",
        bad="another throw (exchanged files), or a string that one camera does not show.",
        shown=lambda page: bool(page.results.joined()),
    ),
    Panel(
        "strobe",
        "The throw at equal steps of the tip’s path",
        strobe,
        leads=True,
        needs=THROW,
        shown=lambda page: not page.results.in_space(),
        good="the dashed string covers the solid one at every instant.",
        bad="they separate towards the tip (stiffness, masses or air), or already at the hand (alignment, "
        "servo or clamp).",
    ),
    Panel(
        "tip",
        "Tip path, measured and simulated",
        tip_path,
        needs=(*THROW, "simulated", "estimate"),
        caption="Squares mark every 50 ms of the measured path. After the closest approach nothing is fitted "
        "if the tip has hit.",
        good="the fitted path covers the measured one up to the closest approach, and the tip stays as near "
        "to the simulated one as the tracker’s σ.",
        bad="that distance grows steadily (parameters), jumps (a lost tip), or swings with the speed "
        "(alignment: 1 ms is 10 mm at 10 m/s).",
        shown=lambda page: not page.results.in_space(),
    ),
    Panel(
        "predicted",
        "The throw as predicted, and as measured",
        predicted_throw,
        needs=(*THROW, "motion", "predicted"),
        caption="Thin lines: throws that the planner simulated before the throw, each with another plausible "
        "string or another disturbance (grasp, sway, joint zeros). Band: four of five of them at each time. "
        "Lower right: the share of throws that are predicted to miss by less, which is wider than the fan "
        "where throws in the lab missed by more than simulated ones; solid: the measured miss, dashed: the "
        "hit radius.",
        good="the measured path runs within the fan up to the closest approach, and the measured miss lies "
        "between 10 and 90 %.",
        bad="it leaves a narrow fan: string, servo or grasp were not as the ensemble supposed; the parts of "
        "the miss say which.",
        shown=_was_predicted,
    ),
    Panel(
        "budget",
        "Where the miss came from",
        budget,
        open=True,
        needs=("verdict", "motion", "alignment", "simulated"),
        caption="Each path is compared at its own closest approach, in the direction of the measured miss: "
        "parts of opposite sign cancel. ±: of the measured tip. How much throws of one motion differ is in "
        "the predicted miss.",
        good="each part is well within the hit radius.",
        bad="one part is larger than the hit radius.",
        shown=_planned,
    ),
    Panel(
        "slip",
        "The string slipped out of the clamp",
        slip_panel,
        shown=lambda page: slip_words(page.results) is not None,
    ),
    Panel(
        "hand",
        "Hand path: commanded, measured, by camera",
        hand_path,
        needs=CLOCKS,
        caption="The distance at the same instant includes the servo’s lag; the distance from the path does "
        "not.",
        good="the camera’s path agrees with the measured one within a few mm.",
        bad="it is off everywhere (marker’s place, camera) or only while moving fast (alignment).",
        shown=_from_video,
    ),
    Panel(
        "fit",
        "Evaluation value E and the search",
        evaluation,
        needs=("estimate",),
        caption="E is the mean distance between measured and simulated points, E_i that of point i (eqs. "
        "4–6). The curve is for all trials in the fit, with w; green dash-dot: this trial alone with the "
        "parameters that planned it, w = 0.",
        good="E_i grows gently towards the tip and stays near the tracker’s σ; the curve is flat at its end.",
        bad="one point stands out (a weight at the wrong place, a lost stretch), or the curve still falls "
        "(too small a budget).",
    ),
    Panel(
        "errors",
        "Fitted string, point by frame",
        fit_error,
        needs=("track", "simulated", "alignment", "estimate"),
        caption="Dashed: the frames of the fit.",
        good="even and dark within them.",
        bad="a bright row (a weight at the wrong place), a bright column (a lost or folded string), brighter "
        "towards the tip and in time (parameters).",
    ),
    Panel(
        "parameters",
        "String parameters",
        parameters,
        needs=("estimate",),
        caption="Only ratios can be determined: scaling all masses and coefficients together changes "
        "nothing.",
        good="narrow ensembles. At a bound a string is as good as rigid, or free of that force.",
        bad="an estimate whose range keeps the string from explaining the throws better (▲). Where the "
        "ensemble is wide, no range helps: a throw that bends the string more would determine it.",
    ),
    Panel(
        "masses",
        "Masses along the string",
        masses,
        needs=("estimate",),
        caption="Point i lies at i·L/n from the hand (point 0); a plain point has mass 1, to which "
        "a weight adds its own. Triangles: the experiment’s known weights; hatched: its stiff "
        "sections, which show as mass.",
        good="the tall bars stand at the triangles.",
        bad="a tall bar elsewhere: an undeclared weight, or points that slipped along the string.",
    ),
    replace(NEXT_MOTION, shown=_plans),
    Panel(
        "next-throw",
        "The next throw, as predicted",
        next_throw,
        caption="Thin lines: simulated throws of the next motion, each with another plausible string or "
        "another disturbance. Right: the share of throws that are predicted to miss by less; dashed: the hit "
        "radius.",
        good="a narrow fan that ends at the target, and a curve that is near 100 % at the hit radius.",
        bad="a fan that opens before the target: throws of this motion will differ; a narrow fan beside the "
        "target: nothing within the limits came nearer.",
        shown=_plans,
    ),
    Panel(
        "tracking",
        "Tracking quality",
        tracking,
        needs=("track", "track_summary"),
        good="even and dark above, pale below.",
        bad="columns of gaps (a fast or folded string), a bright row (a point that is always uncertain), a "
        "coloured band in the lower picture (points slipped along the string).",
    ),
    Panel(
        "clocks",
        "Alignment of the clocks",
        alignment,
        needs=CLOCKS,
        caption="The joint log is drawn at the times of the fitted clock, with the arm’s file as it is; the "
        "table gives the distance that remains with the rig’s errors fitted.",
        good="the speeds agree, and the distance changes slowly (zeros of the joints, lengths of the links) "
        "by a few mm.",
        bad="the distance resembles the speed (offset: 1 ms is 2 mm at 2 m/s) or jumps (markers).",
        shown=_from_video,
    ),
    Panel(
        "camera",
        "Calibration",
        calibration,
        needs=("camera",),
        good="short arrows in all directions, corners all over the picture.",
        bad="arrows that turn together or grow towards the edges (lens), one marker with long arrows (its "
        "place is wrong).",
        shown=_from_video,
    ),
    Panel(
        "truth",
        "Lab truth",
        lab_truth,
        needs=("lab_truth", "track_summary", *THROW),
        caption="No stage used any of this: it is shown beside the measurement, never instead of it. Point 0 "
        "is left out: it is the hand by its markers, and the string may leave the clamp beside it.",
        good="errors of the size of the tracker’s σ.",
        bad="an error that grows towards the tip or with its speed.",
        shown=lambda page: page.results.path("lab_truth").exists(),
    ),
]

EXPERIMENT_PANELS = [
    Panel(
        "misses",
        "Miss per trial",
        misses,
        open=True,
        caption="Bars: ± σ of the tracked tip. Wide bars: the interval predicted before the throw, for four "
        "of five throws. Dotted: the best so far. Full disc: hit; open triangle: miss; grey cross: excluded; "
        "no mark: the tip was not detected at its closest approach.",
        good="the marks lie within the wide bars and go down.",
        bad="a mark far above its wide bar: something changed that no string of the ensemble explains.",
        shown=lambda page: page.aimed,
    ),
    Panel(
        "predictions",
        "Each trial, predicted and fitted",
        predictions,
        caption="Diamond: E of a trial under the string that was fitted to the trials before it, from the "
        "hand’s path and the string’s first shape alone. Disc: E after the trial was added to the fit. "
        "Crosses: E of two guesses without a model, a string that hangs straight below the hand, and one "
        "that keeps its first shape and moves with the hand. Excluded trials are grey.",
        good="the diamonds lie far left of the crosses and near the discs: the fitted string predicts "
        "motion that it was not fitted to.",
        bad="a diamond near a cross: the string predicts no better than a guess. The trials differ (another "
        "string, a slipped clamp), or those before it did not excite what this one needs.",
        shown=lambda page: not page.aimed,
    ),
    Panel(
        "hands",
        "Hand paths",
        hand_paths,
        caption="Squares: where the motion starts. Grey: the trials between.",
        shown=lambda page: not page.in_space,
    ),
    Panel(
        "tips",
        "Tip paths",
        tip_paths,
        caption="From the motion’s start until 0.3 s after its end; in space from two sides.",
        shown=lambda page: page.aimed or not page.in_space,
    ),
    Panel(
        "strings",
        "Strings at the closest approach",
        closest_strings,
        good="from trial to trial the tip ends nearer to the target.",
        shown=lambda page: page.aimed,
    ),
    Panel(
        "evaluations",
        "E before and after each fit",
        evaluations,
        caption="Excluded trials are grey.",
        good="the diamonds move left from trial to trial: the string is better known before each throw.",
        shown=lambda page: page.aimed,
    ),
    replace(NEXT_MOTION, shown=lambda page: page.aimed),
    Panel(
        "arm-file",
        "The arm’s file against the video",
        rig_offsets,
        caption="What the arm’s file states wrongly, in the same way in every trial: the hand that the "
        "camera sees against the hand by the joint log. ± one standard deviation, which holds the zeros’ "
        "scatter from trial to trial, the place of the camera’s plane and what these motions cannot tell "
        "apart. At the hand: the farthest that it moves the hand in these motions (of the string: the "
        "string). –: these motions do not tell.",
        good="no deviation is three standard deviations from zero and worth more than 1 mm.",
        bad="a number marked wrong: correct it in the file, and plan again.",
        shown=compares_arm,
    ),
    Panel("quality", "Checks by trial", quality, caption="✓ passed, ▲ warned, ✕ failed, – not run."),
    Panel(
        "camera",
        "Calibration of the camera",
        camera_picture,
        good="the grid agrees with measured places (markers, a ruler, the arm’s base at 0, 0), the arrows "
        "point in all directions.",
        bad="the grid is tilted or stretched (a marker’s place, the lens), one marker has long arrows.",
        shown=lambda page: page.camera_record.with_suffix(".webp").is_file(),
    ),
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
