"""A number in a panel's sentence is the number that its figure shows."""

import csv
import io
import itertools
import re
import shutil
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest

from strandcast.core.trial_names import trial_name
from strandcast.errors import StrandcastError
from strandcast.records.alignment import Alignment
from strandcast.records.estimate import Estimate
from strandcast.records.lab_truth import LAB_TRUTH
from strandcast.records.motion import Motion
from strandcast.records.predicted import UNPREDICTED, read_predicted
from strandcast.records.record import RigFault
from strandcast.records.tables import read_facts, read_table, write_table
from strandcast.records.track import OCCLUDED, TrackSummary
from strandcast.records.verdict import Verdict
from strandcast.report.checks import run_checks
from strandcast.report.drawing import Drawing
from strandcast.report.expected import expected_miss, probable
from strandcast.report.first_screen import first_figures
from strandcast.report.measures import fit_window
from strandcast.report.numbers import millimetres, milliseconds
from strandcast.report.pages import csv_link
from strandcast.report.panels.budget import budget, miss_parts
from strandcast.report.panels.content import PanelContent
from strandcast.report.panels.evaluation import evaluation, fit_error
from strandcast.report.panels.hand_path import alignment
from strandcast.report.panels.lab_truth import lab_truth
from strandcast.report.panels.next_motion import next_motion
from strandcast.report.panels.page_data import ExperimentPageData, TrialPageData
from strandcast.report.panels.predicted import next_throw, predicted_throw, throws_of
from strandcast.report.panels.progress import misses
from strandcast.report.panels.quality import quality
from strandcast.report.panels.strobe import strobe, tip_path
from strandcast.report.panels.strobe_picture import strobe_picture
from strandcast.report.panels.throws import closest_strings
from strandcast.report.panels.viewer import film_of
from strandcast.report.results import read_results
from strandcast.report.summary import summarise
from strandcast.report.text import outcome
from strandcast.report.typeset import quantity, typeset, unit

from .conftest import OFFSET_S, START_S


def page_data(folder: Path) -> TrialPageData:
    return TrialPageData(read_results(folder))


def curves(made: PanelContent, axes: int) -> list[np.ndarray]:
    assert isinstance(made.drawing, Drawing)
    return [
        np.column_stack([line.get_xdata(), line.get_ydata()]) for line in made.drawing.figure.axes[axes].lines
    ]


def rms_mm(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))


def test_lab_truth_gives_the_rms_of_its_curve(results: Path) -> None:
    page = page_data(results / "trial-03")
    made = lab_truth(page)
    tip = curves(made, 1)[0]
    start_s, end_s = page.results.window_s()
    inside = (tip[:, 0] >= 0) & (tip[:, 0] <= 1e3 * (end_s - start_s))
    assert f"(tip {rms_mm(tip[inside, 1]):.2f}\u00a0mm)" in made.finding


def test_the_labs_offset_is_the_true_one(results: Path) -> None:
    row = next(
        row for row in lab_truth(page_data(results / "trial-03")).tables[0].rows if row[0] == "clock offset"
    )
    assert row[2] == milliseconds(OFFSET_S, digits=3)


def test_the_panels_measure_a_miss_from_what_was_aimed_at(results: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(results, tmp_path / "swing")) / "trial-03"
    verdict = Verdict.read(folder / "verdict.json")
    for panel, hit in itertools.product((strobe, strobe_picture), (False, True)):
        aimed = verdict.model_copy(update={"wanted": "at least 5 m/s", "hit": hit})
        aimed.write(folder / "verdict.json")
        finding = panel(page_data(folder)).finding
        words = "reached to within" if hit else "missed by"
        assert f"he aim was {words} {millimetres(verdict.miss_m)}" in finding
        assert "from the target" not in finding
    assert verdict.closest_m is not None
    x, y = verdict.closest_m
    bar_m = [[x - 1.0, y], [x + 1.0, y]]  # where the tip passes it at 0, far from its middle
    verdict.model_copy(update={"bar_m": bar_m, "target_m": bar_m[0]}).write(folder / "verdict.json")
    page = page_data(folder)
    for text in (strobe(page).finding, strobe_picture(page).finding, outcome(page.results)):
        assert "the bar from (" in text
    assert np.nanmin(film_of(page.results, page.need("clip")).to_target_m) < 0.01


def test_a_true_string_of_another_length_is_compared_at_equal_shares(results: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(results, tmp_path / "swing")) / "trial-03"
    rows, facts = (read(folder / "lab_truth.parquet", LAB_TRUTH) for read in (read_table, read_facts))
    before = lab_truth(page_data(folder)).finding
    write_table(folder / "lab_truth.parquet", LAB_TRUTH, rows | {"place_m": rows["place_m"] * 1.02}, facts)
    assert lab_truth(page_data(folder)).finding == before


def test_the_alignment_gives_the_rms_of_its_curves(results: Path) -> None:
    made = alignment(page_data(results / "trial-03"))
    distance, x, y, line = (curve[:, 1] for curve in curves(made, 1))
    assert f"{rms_mm(distance):.2f}\u00a0mm rms from the aligned joint log" in made.finding
    np.testing.assert_allclose(distance, np.hypot(x, y))
    np.testing.assert_allclose(line, rms_mm(distance))
    rows = dict(made.tables[0].rows)
    assert rows["distance of the hand with all of this fitted, rms over 500 frames"] == "0.80\u00a0mm"


def test_the_tips_path_counts_the_frames_of_the_fit_alone(results: Path, tmp_path: Path) -> None:
    """What comes after them, as after a contact, is drawn and not counted."""
    folder = Path(shutil.copytree(results, tmp_path / "swing")) / "trial-03"
    estimate = Estimate.read(folder / "estimate.json")
    first_ms, last_ms = 50.0, 400.0
    window_s = [START_S + 1e-3 * each for each in (first_ms, last_ms)]
    estimate.model_copy(update={"window_s": window_s, "frames_used": 175}).write(folder / "estimate.json")
    page = page_data(folder)
    track = page.need("track")
    track.flags[100:110, -1] = OCCLUDED
    for throw in page.need("simulated").values():
        throw.points_m[throw.robot_time_s > window_s[1]] += 0.1
        throw.points_m[100:110, -1] += 0.1
    made = tip_path(page)
    assert made.finding.startswith("Over the 175 frames from 50 to 400 ms after the motion’s start: ")
    for curve, name in zip(curves(made, 2), ("as planned", "fitted"), strict=False):
        counted = (curve[:, 0] >= first_ms) & (curve[:, 0] <= last_ms)
        counted[100:110] = False
        counted_mm = curve[counted, 1]
        assert np.nanmax(counted_mm) < np.nanmax(curve[:, 1])
        assert f"{name}: {np.nanmean(counted_mm):.1f}\u00a0mm from the measured tip" in made.finding
        assert f"at most {np.nanmax(counted_mm):.1f}\u00a0mm" in made.finding
    film = film_of(page.results, page.need("clip"))
    worst = film.worst()
    assert worst is not None
    assert first_ms <= 1e3 * film.since_start_s[worst] <= last_ms


def test_a_throw_has_one_predicted_miss_and_it_is_that_of_the_figures(results: Path) -> None:
    upcoming = results / "trial-04" / "motion.json"
    page = TrialPageData(read_results(results / "trial-03"), next_motion=upcoming)
    summary = summarise(
        "swing", {3: page.folder}, string_length_m=0.3, target_m=[0.6, 0.7], hit_radius_m=0.02
    )
    experiment = ExperimentPageData(summary, {3: page.results}, results, upcoming)
    for motion, panels in (
        (page.need("motion"), {predicted_throw: 3}),
        (Motion.read(upcoming), {next_throw: 2, next_motion: None}),
    ):
        expected = expected_miss(motion)
        assert expected is not None
        assert motion.predicted is not None
        words = f"{expected.middle()} ({expected.interval()}), {expected.likely()}"
        for panel, axes in panels.items():
            made = panel(page)
            assert f"Predicted miss of trial {motion.trial}: {words}." in made.finding
            if axes is not None:
                misses_mm, shares = curves(made, axes)[0].T
                drawn = {f"p{share:.0f}": 1e-3 * miss for share, miss in zip(shares, misses_mm, strict=True)}
                assert drawn == pytest.approx(motion.predicted.miss_quantiles_m)
    headlines = first_figures(page.results, Motion.read(upcoming))
    for motion, (_, value, note) in zip((page.played, Motion.read(upcoming)), headlines[1:], strict=True):
        expected = expected_miss(motion)
        assert expected is not None
        assert (value, note) == (expected.middle(), f"{expected.interval()}; {expected.likely()}")
    assert next_motion(experiment).finding == next_motion(page).finding
    (line,) = summary.trials
    assert (line.predicted_p10_m, line.predicted_p90_m) == (0.002, 0.031)
    made = misses(experiment)
    assert isinstance(made.drawing, Drawing)
    bars = [each.get_ydata() for each in made.drawing.figure.axes[0].lines if each.get_linewidth() > 10]
    np.testing.assert_allclose(bars, [[2.0, 31.0]])


@pytest.mark.parametrize(
    ("probability", "words"), [(0.9984, "over 99 %"), (0.87, "87 %"), (0.036, "4 %"), (0.001, "under 1 %")]
)
def test_no_hit_is_certain(probability: float, words: str) -> None:
    assert probable(probability).replace("\u00a0", " ") == words


def test_the_view_of_the_target_holds_every_place_that_lies_in_it(results: Path) -> None:
    page = page_data(results / "trial-03")
    made, throws = predicted_throw(page), page.need("predicted")
    assert isinstance(made.drawing, Drawing)
    overview, view = made.drawing.figure.axes[:2]
    (left, right), (low, high) = view.get_xlim(), view.get_ylim()
    target_m = page.need("verdict").target_m
    assert [(left + right) / 2, (low + high) / 2] == pytest.approx(target_m)
    assert right - left == pytest.approx(high - low)
    within = 0
    for whole, part in zip(curves(made, 0), curves(made, 1)[: len(throws.throw) + 1], strict=False):
        x, y = whole.T
        inside = (x > left) & (x < right) & (y > low) & (y < high)
        np.testing.assert_array_equal(part[inside], whole[inside])
        within += inside.sum()
    assert within > len(throws.throw)
    assert overview.get_xlim()[1] - overview.get_xlim()[0] > right - left


def test_the_share_within_the_band_is_that_of_its_figure(results: Path) -> None:
    page = page_data(results / "trial-03")
    made = predicted_throw(page)
    assert isinstance(made.drawing, Drawing)
    measured = curves(made, 2)[0]
    (band,) = made.drawing.figure.axes[2].collections
    edge = band.get_paths()[0].vertices
    since_ms = np.unique(edge[:, 0])
    low_mm, high_mm = ([f(edge[edge[:, 0] == t, 1]) for t in since_ms] for f in (np.min, np.max))
    verdict, alignment = page.need("verdict"), page.need("alignment")
    until_ms = 1e3 * (verdict.closest_robot_time_s - alignment.motion_start_s)
    counted = measured[(measured[:, 0] <= until_ms) & np.isfinite(measured[:, 1])]
    low, high = (np.interp(counted[:, 0], since_ms, each) for each in (low_mm, high_mm))
    inside = 100 * np.mean((counted[:, 1] >= low) & (counted[:, 1] <= high))
    assert 0 < inside < 100
    assert f"within the band in {inside:.1f}\u00a0% of frames" in made.finding


def test_the_fan_of_the_next_throw_is_that_of_its_file(results: Path) -> None:
    path = results / "trial-04" / "motion.json"
    made = next_throw(TrialPageData(read_results(results / "trial-03"), next_motion=path))
    throws = read_predicted(path.with_name("predicted.parquet"))
    drawn = curves(made, 0)[: len(throws.throw)]
    for path_m, tip_m in zip(drawn, throws.tip_m, strict=True):
        np.testing.assert_array_equal(path_m, tip_m[: len(path_m)])


def test_a_prediction_of_another_motion_is_refused(results: Path) -> None:
    page = page_data(results / "trial-03")
    throws, motion = page.need("predicted"), page.need("motion")
    assert throws_of(motion, throws, "predicted.parquet") is throws
    for other in (throws._replace(motion_sha256="0" * 64), UNPREDICTED):
        with pytest.raises(StrandcastError, match="SC-X020"):
            throws_of(motion, other, "predicted.parquet")


def test_the_curve_of_the_miss_ends_in_the_verdicts(results: Path) -> None:
    page = page_data(results / "trial-03")
    verdict = page.need("verdict")
    drawn = curves(tip_path(page), 1)
    assert [1e3 * verdict.miss_m] in [curve[:, 1].tolist() for curve in drawn]
    # Between two frames the tip may be nearer, by less than its way in half of their interval.
    assert 0 <= np.nanmin(drawn[0][:, 1]) - 1e3 * verdict.miss_m < 10


def test_E_is_the_mean_of_its_bars_and_names_its_frames(results: Path) -> None:
    page = page_data(results / "trial-03")
    made = evaluation(page)
    assert isinstance(made.drawing, Drawing)
    heights_mm = [bar.get_height() for bar in made.drawing.figure.axes[0].patches]
    assert made.finding.startswith(f"E {np.mean(heights_mm):.2f}\u00a0mm after the fit, over 290 frames")
    assert fit_window(page.results) == "290 frames from 0 to 580 ms after the motion’s start"


def test_the_misses_are_those_of_the_marks(results: Path) -> None:
    trials = {k: results / trial_name(k) for k in (1, 2, 3)}
    summary = summarise("swing", trials, string_length_m=0.3, target_m=[0.6, 0.6], hit_radius_m=0.02)
    far = [summary.trials[0].model_copy(update={"miss_m": 1.0}), *summary.trials[1:]]
    made = misses(ExperimentPageData(summary.model_copy(update={"trials": far}), {}))
    assert isinstance(made.drawing, Drawing)
    axes = made.drawing.figure.axes[0]
    line = next(each for each in axes.lines if len(each.get_xdata()) == 3)
    shown = " → ".join(f"{y:.1f}" for y in line.get_ydata())
    assert made.finding.startswith(f"Miss by trial: {shown} mm")
    assert axes.get_yscale() == "log"  # 1 m would squash 6 mm


@pytest.mark.parametrize(("room_m", "state"), [(0.001, "WARN"), (0.03, "PASS")])
def test_a_millimetre_to_the_workspaces_edge_is_a_warning(
    results: Path, tmp_path: Path, room_m: float, state: str
) -> None:
    motion = Motion.read(results / "trial-04" / "motion.json")
    assert motion.predicted is not None
    assert motion.provenance is not None
    near = motion.model_copy(
        update={
            "predicted": motion.predicted.model_copy(update={"workspace_room_m": room_m}),
            "provenance": motion.provenance.model_copy(update={"flags": []}),
        }
    )
    near.write(tmp_path / "motion.json")
    check = run_checks(read_results(results / "trial-03"), tmp_path / "motion.json")[-1]
    assert check.state == state


def test_names_and_units_are_typeset() -> None:
    assert typeset("k_sh at <b>, rest_curl_rad_m") == "k<sub>sh</sub> at &lt;b&gt;, rest curl"
    assert unit("N s2/m2/kg") == "N·s²/(m²·kg)"
    assert unit("N s/m/kg") == "N·s/(m·kg)"
    assert quantity("grasp_length_m", 0.0034989) == ("grasp length", "3.499\u00a0mm")
    assert quantity("sway_rad", [0.01, -0.02]) == ("sway", "0.573, −1.146°")
    assert quantity("bead_at_tip", True) == ("bead at tip", "yes")


def test_no_raw_key_or_unit_is_on_a_page(drawn: str) -> None:
    text = re.sub(r"<[^>]*>", " ", drawn[drawn.index("<main") : drawn.index('id="provenance"')])
    assert not re.search(r"\b(rest_curl|clamp_offset|grasp_m|threshold_grey|k_s|C_c2)\b|s2/m2", text)
    assert "In the paper" not in text
    assert "Table 4" not in text


def test_the_parts_of_the_miss_sum_up_to_it(results: Path) -> None:
    page = page_data(results / "trial-03")
    parts, miss_m = miss_parts(page.results)
    verdict = page.need("verdict")
    assert miss_m == pytest.approx(verdict.miss_m, abs=1e-9)
    assert sum(part.part_m for part in parts) == pytest.approx(miss_m, abs=1e-12)
    since_s = verdict.closest_robot_time_s - page.need("alignment").motion_start_s
    assert sum(part.later_s for part in parts) == pytest.approx(since_s)
    made = budget(page)
    assert f"the miss of {millimetres(miss_m, verdict.miss_sigma_m)}: " in made.finding
    assert isinstance(made.drawing, Drawing)
    widths_mm = [bar.get_width() for bar in made.drawing.figure.axes[0].patches]
    np.testing.assert_allclose(widths_mm, [1e3 * each for each in (*(part.part_m for part in parts), miss_m)])
    sigma = f"±\u00a0{1e3 * verdict.miss_sigma_m:.1f}"
    assert [sigma in row[1] for row in made.tables[0].rows] == [False, False, False, True]


@pytest.mark.parametrize("late_s", [0.0, 0.06])
def test_a_throw_that_is_late_was_not_planned_to_miss(results: Path, late_s: float) -> None:
    """Paths that pass the target at other times are compared where each passes it."""
    page = page_data(results / "trial-03")
    motion, verdict = page.need("motion"), page.need("verdict")
    time_s, tip_m = np.array(motion.predicted.time_s), np.array(motion.predicted.tip_m)
    # The predicted tip passes the target itself, earlier than the measured one.
    tip_m = tip_m + np.subtract(verdict.target_m, verdict.closest_m)
    early = motion.predicted.model_copy(
        update={"time_s": (time_s - late_s).tolist(), "tip_m": tip_m.tolist()}
    )
    page.results.pieces["motion"] = motion.model_copy(update={"predicted": early})
    plan, arm, *_ = miss_parts(page.results)[0]
    assert np.linalg.norm(plan.passage.off_m) < 2e-3
    assert abs(plan.part_m) < 2e-3
    assert arm.later_s == pytest.approx(late_s, abs=4e-3)


@pytest.mark.parametrize(
    ("hit", "moved", "said"),
    [
        (True, "fitted", "string, +50.0\u00a0mm. The throw hit: nothing needs to change."),
        (False, "fitted", "string, +50.0\u00a0mm. Next: throw again"),
        (False, "", "unexplained, +50.0\u00a0±\u00a00.9\u00a0mm."),  # nothing was seen to help
    ],
)
def test_a_miss_is_followed_by_advice_where_it_helps(results: Path, hit: bool, moved: str, said: str) -> None:
    page = page_data(results / "trial-03")
    verdict, throws = page.need("verdict"), page.need("simulated")
    away_m = 0.05 * np.subtract(verdict.closest_m, verdict.target_m) / verdict.miss_m
    if moved:
        throws[moved] = throws[moved]._replace(points_m=throws[moved].points_m + away_m)
    there = {"closest_m": (verdict.closest_m + away_m).tolist(), "hit": hit}
    page.results.pieces["verdict"] = verdict.model_copy(update=there)
    finding = budget(page).finding
    part = max(miss_parts(page.results)[0], key=lambda each: abs(each.part_m))
    assert part.part_m == pytest.approx(0.05, abs=2e-3)
    said = said.replace("+50.0", f"+{1e3 * part.part_m:.1f}")
    assert said in finding
    assert finding.endswith("mm.") == ("±" in said)


def test_the_worst_error_is_that_of_the_image(results: Path) -> None:
    made = fit_error(page_data(results / "trial-03"))
    assert isinstance(made.drawing, Drawing)
    axes = made.drawing.figure.axes[0]
    shown_mm = np.asarray(axes.images[0].get_array())
    left, right = sorted({line.get_xdata()[0] for line in axes.lines})
    low, high = axes.images[0].get_extent()[:2]
    since_ms = np.linspace(low, high, shown_mm.shape[1])
    inside = shown_mm[:, (since_ms >= left) & (since_ms <= right)]
    assert f"at most {np.nanmax(inside):.1f}\u00a0mm" in made.finding


def test_the_checks_name_what_of_the_rig_to_look_at(results: Path, tmp_path: Path) -> None:
    def named(folder: Path) -> set[str]:
        before = read_results(results / "trial-02")
        checks = run_checks(read_results(folder), None, before)
        return {check.name for check in checks if check.state == "WARN"}

    usual = named(results / "trial-03")
    folder = Path(shutil.copytree(results, tmp_path / "swing")) / "trial-03"
    fit = Alignment.read(folder / "alignment.json")
    fit.model_copy(update={"drift": 4e-4, "base_shift_m": [0.004, 0.0]}).write(folder / "alignment.json")
    summary = TrackSummary.read(folder / "track.json")
    longer = summary.choices | {"length_m": 0.33, "length_sigma_m": 0.001}
    longer_by = RigFault(what="the string is longer", cost="mm", fix="measure it", field="string.length_m")
    changes = {"marker_fraction": 0.5, "choices": longer, "faults": [longer_by]}
    summary.model_copy(update=changes).write(folder / "track.json")
    assert named(folder) - usual == {
        "alignment: drift",
        "alignment: camera or base moved",
        "hand's markers: seen",
        "track: length of the string",
    }


def test_the_outcome_gives_the_miss_and_the_prediction(results: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(results, tmp_path / "swing")) / "trial-03"
    verdict, motion = Verdict.read(folder / "verdict.json"), Motion.read(folder / "motion.json")
    assert motion.predicted is not None
    quantiles = motion.predicted.model_copy(
        update={"miss_quantiles_m": {"p10": 0.001, "p50": 0.002, "p90": 0.003}}
    )
    motion.model_copy(update={"predicted": quantiles}).write(folder / "motion.json")
    text = outcome(read_results(folder)).replace("\u00a0", " ")
    assert f"The tip passed {1e3 * verdict.miss_m:.1f} ± 0.9 mm from the target" in text
    assert "; more than predicted." in text
    near = verdict.model_copy(update={"miss_m": 0.0195})
    near.write(folder / "verdict.json")
    assert "too near to its edge to be certain" in outcome(read_results(folder))
    motion.model_copy(update={"target_m": [0.1, 0.2]}).write(folder / "motion.json")
    text = outcome(read_results(folder)).replace("\u00a0", " ")
    assert text.endswith(" The motion was planned for another target, at (100, 200) mm.")
    assert "predicted" not in text


def test_every_table_is_a_csv_within_the_page(drawn: str) -> None:
    links = re.findall(r'download="([^"]*)" href="data:text/csv;charset=utf-8,([^"]*)"', drawn)
    assert len(links) == drawn.count("<thead>")
    text = dict(links)["checks.csv"]
    lines = list(csv.reader(io.StringIO(unquote(text))))
    assert lines[0] == ["check", "result", "found", "expected", "bears on", "otherwise"]
    assert [
        "video: frames decoded",
        "PASS",
        "500 decoded, 500 expected",
        "as many as the manifest says",
        "the miss",
        "",
    ] in lines
    assert unquote(str(csv_link([["=1+1"]], ["a"], "x"))).count("'=1+1") == 1


def test_misses_are_held_against_what_was_predicted_before(results: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(results, tmp_path / "swing"))
    trials = {k: folder / trial_name(k) for k in (1, 2, 3)}
    summary = summarise("swing", trials, string_length_m=0.3, target_m=[0.6, 0.6], hit_radius_m=0.02)
    for trial, low_m, high_m in ((1, 0.0, 9.0), (3, 8.0, 9.0)):
        path = trials[trial] / "motion.json"
        motion = Motion.read(path)
        assert motion.predicted is not None
        quantiles = {"p10": low_m, "p50": low_m, "p90": high_m}
        known = motion.predicted.model_copy(update={"miss_quantiles_m": quantiles})
        motion.model_copy(update={"predicted": known}).write(path)
    page = ExperimentPageData(summary, {k: read_results(each) for k, each in trials.items()}, folder)
    assert "1 of 3 misses lie in the interval predicted before the throw." in misses(page).finding


def test_the_matrix_of_checks_leads_to_the_trial_that_failed(results: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(results, tmp_path / "swing"))
    trials = {k: folder / trial_name(k) for k in (1, 2, 3)}
    summary = summarise("swing", trials, string_length_m=0.3, target_m=[0.6, 0.6], hit_radius_m=0.02)
    path = trials[2] / "track.json"
    TrackSummary.read(path).model_copy(update={"tracked_fraction": 0.5}).write(path)
    page = ExperimentPageData(summary, {k: read_results(each) for k, each in trials.items()}, folder)
    rows = {row[0]: row[1:] for row in quality(page).tables[0].rows}
    passed, warned, again = rows["track: points detected"]
    assert ">✓</a>" in passed
    assert ">✓</a>" in again
    assert 'href="trial-02/report.html#checks" aria-label="trial 2: warn">▲</a>' in warned
    assert "video: frames decoded" not in rows


def test_the_strings_of_all_trials_are_overlaid(results: Path) -> None:
    trials = {k: results / trial_name(k) for k in (1, 2, 3)}
    summary = summarise("swing", trials, string_length_m=0.3, target_m=[0.6, 0.6], hit_radius_m=0.02)
    made = closest_strings(ExperimentPageData(summary, {k: read_results(each) for k, each in trials.items()}))
    drawn = curves(made, 0)
    for k, each in trials.items():
        closest_m = Verdict.read(each / "verdict.json").closest_m
        np.testing.assert_allclose(drawn[k - 1][-1], closest_m, atol=0.01)  # half a frame's way
