"""A number in a panel's sentence is the number that its figure shows."""

import csv
import io
import re
import shutil
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest

from strandcast.core.trial_names import trial_name
from strandcast.errors import StrandcastError
from strandcast.records.alignment import Alignment
from strandcast.records.lab_truth import LAB_TRUTH
from strandcast.records.motion import Motion
from strandcast.records.predicted import UNPREDICTED, read_predicted
from strandcast.records.tables import read_facts, read_table, write_table
from strandcast.records.track import TrackSummary
from strandcast.records.verdict import Verdict
from strandcast.report.checks import run_checks
from strandcast.report.drawing import Drawing
from strandcast.report.measures import fit_window
from strandcast.report.numbers import signed
from strandcast.report.pages import csv_link
from strandcast.report.panels.alignment import alignment
from strandcast.report.panels.budget import budget, miss_steps
from strandcast.report.panels.content import PanelContent
from strandcast.report.panels.evaluation import evaluation
from strandcast.report.panels.fit_error import fit_error
from strandcast.report.panels.lab_truth import lab_truth
from strandcast.report.panels.page_data import ExperimentPageData, TrialPageData
from strandcast.report.panels.predicted import next_throw, predicted_throw, throws_of
from strandcast.report.panels.progress import misses
from strandcast.report.panels.quality import quality
from strandcast.report.panels.rig import rig
from strandcast.report.panels.throws import closest_strings
from strandcast.report.panels.tip_path import tip_path
from strandcast.report.results import read_results
from strandcast.report.summary import summarise
from strandcast.report.text import outcome
from strandcast.report.trial_page import trial_page
from strandcast.report.typeset import quantity, typeset, unit


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


def test_the_tips_path_gives_the_rms_of_its_curves(results: Path) -> None:
    made = tip_path(page_data(results / "trial-03"))
    for curve, name in zip(curves(made, 2), ("as planned", "fitted"), strict=False):
        assert f"{name}: {rms_mm(curve[:, 1]):.1f}\u00a0mm rms" in made.finding


def test_the_predicted_misses_are_those_of_the_curve(results: Path) -> None:
    page = page_data(results / "trial-03")
    made = predicted_throw(page)
    shares, hit_radius, measured = curves(made, 3)
    miss_mm, verdict = shares[:, 0], page.need("verdict")
    low_mm, high_mm = np.quantile(miss_mm, (0.1, 0.9))
    assert (
        f"four of five of 20 predicted throws miss by {low_mm:.1f}\u00a0mm to {high_mm:.1f}" in made.finding
    )
    assert measured[0, 0] == pytest.approx(1e3 * verdict.miss_m)
    assert hit_radius[0, 0] == pytest.approx(1e3 * verdict.hit_radius_m)
    below = 100 * np.mean(miss_mm < measured[0, 0])
    assert f"miss of {measured[0, 0]:.1f}\u00a0mm is larger than {below:.1f}\u00a0% of theirs" in made.finding
    np.testing.assert_allclose(shares[:, 1], 5.0 * np.arange(1, 21))


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
    miss_mm = curves(made, 2)[0][:, 0]
    radius_mm = curves(made, 2)[1][0, 0]
    hits, half = 100 * np.mean(miss_mm <= radius_mm), np.median(miss_mm)
    assert (
        f"{hits:.1f}\u00a0% of them hit, and half of them miss by {half:.1f}\u00a0mm or less" in made.finding
    )


def test_a_prediction_of_another_motion_is_refused(results: Path) -> None:
    page = page_data(results / "trial-03")
    throws, motion = page.need("predicted"), page.need("motion")
    assert throws_of(motion, throws, "predicted.parquet") is throws
    for other in (throws._replace(motion_sha256="0" * 64), UNPREDICTED):
        with pytest.raises(StrandcastError, match="SC-H052"):
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


@pytest.fixture(scope="module")
def page(results: Path) -> str:
    """Return the page of a trial."""
    return trial_page(results / "trial-03", trial=3, experiment="swing")


def test_no_raw_key_or_unit_is_on_a_page(page: str) -> None:
    text = re.sub(r"<[^>]*>", " ", page[page.index("<main") : page.index('id="provenance"')])
    assert not re.search(r"\b(rest_curl|clamp_offset|grasp_m|threshold_grey|k_s|C_c2)\b|s2/m2", text)
    assert "In the paper" not in text
    assert "Table 4" not in text


def test_the_parts_of_the_miss_sum_up_to_it(results: Path) -> None:
    page = page_data(results / "trial-03")
    steps, miss_m = miss_steps(page.results)
    assert sum(step.across_m for step in steps) == pytest.approx(miss_m, abs=1e-12)
    verdict = page.need("verdict")
    assert abs(miss_m) <= np.linalg.norm(np.subtract(verdict.closest_m, verdict.target_m)) + 1e-9
    made = budget(page)
    assert f"the sum is {signed(f'{1e3 * miss_m:+.1f}')}\u00a0mm." in made.finding
    assert isinstance(made.drawing, Drawing)
    widths_mm = [bar.get_width() for bar in made.drawing.figure.axes[0].patches]
    np.testing.assert_allclose(
        widths_mm, [1e3 * each for each in (*(step.across_m for step in steps), miss_m)]
    )
    # The fixture's strings move like the measured one, but for these errors of the tip.
    fitted, measured = page.need("simulated")["fitted"], page.need("verdict")
    row = int(np.argmin(np.abs(fitted.robot_time_s - measured.closest_robot_time_s)))
    apart_m = np.linalg.norm(fitted.points_m[row, -1] - measured.closest_m)
    assert abs(steps[-1].across_m) <= apart_m + 5e-3


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


def test_the_rig_names_what_to_look_at(results: Path, tmp_path: Path) -> None:
    assert rig(page_data(results / "trial-03")).finding.startswith("Nothing about the rig stands out.")
    folder = Path(shutil.copytree(results, tmp_path / "swing")) / "trial-03"
    fit = Alignment.read(folder / "alignment.json")
    fit.model_copy(update={"drift": 4e-4, "base_shift_m": [0.004, 0.0]}).write(folder / "alignment.json")
    summary = TrackSummary.read(folder / "track.json")
    longer = summary.choices | {"length_m": 0.33, "length_sigma_m": 0.001}
    summary.model_copy(update={"marker_fraction": 0.5, "choices": longer}).write(folder / "track.json")
    finding = rig(page_data(folder)).finding
    for part in (
        "clocks: drift",
        "camera or base moved",
        "hand's markers: seen",
        "grasp: length out of the clamp",
    ):
        assert part in finding


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
    assert "Predicted before the throw: 1.0 mm to 3.0 mm" in text
    assert "more than predicted" in text
    near = verdict.model_copy(update={"miss_m": 0.0195})
    near.write(folder / "verdict.json")
    assert "too near to its edge to be certain" in outcome(read_results(folder))
    motion.model_copy(update={"target_m": [0.1, 0.2]}).write(folder / "motion.json")
    text = outcome(read_results(folder)).replace("\u00a0", " ")
    assert text.endswith("it did not aim at the one from which the miss is measured.")
    assert "Predicted" not in text


def test_every_table_is_a_csv_within_the_page(page: str) -> None:
    links = re.findall(r'download="([^"]*)" href="data:text/csv;charset=utf-8,([^"]*)"', page)
    assert len(links) == page.count("<thead>")
    text = dict(links)["checks.csv"]
    lines = list(csv.reader(io.StringIO(unquote(text))))
    assert lines[0] == ["check", "result", "found", "expected"]
    assert [
        "video: frames decoded",
        "PASS",
        "500 decoded, 500 expected",
        "as many as the manifest says",
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
        known = motion.predicted.model_copy(update={"miss_quantiles_m": {"p10": low_m, "p90": high_m}})
        motion.model_copy(update={"predicted": known}).write(path)
    page = ExperimentPageData(summary, {k: read_results(each) for k, each in trials.items()}, folder)
    assert "1 of 2 misses lie in the interval predicted before the throw." in misses(page).finding


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
        np.testing.assert_allclose(drawn[k - 1][-1], closest_m)
