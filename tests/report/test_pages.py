"""The pages as a reader and a browser get them."""

import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from strandcast.core.trial_names import trial_name
from strandcast.records.estimate import Estimate
from strandcast.records.lab_truth import LAB_TRUTH
from strandcast.records.motion import Motion
from strandcast.records.predicted import read_predicted, write_predicted
from strandcast.records.provenance import current_versions
from strandcast.records.tables import read_table, write_table
from strandcast.records.track import TRACK, TrackSummary
from strandcast.records.verdict import Verdict
from strandcast.report.experiment_page import _thumbnail, experiment_page
from strandcast.report.facts import Facts
from strandcast.report.measures import arc_length_m, strobe_rows, tip_error_m
from strandcast.report.pages import page_script
from strandcast.report.panels.content import PanelContent
from strandcast.report.panels.lab_truth import at_places
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.panels.registry import PANELS
from strandcast.report.panels.strobe_picture import project_px
from strandcast.report.results import TrueString, read_results
from strandcast.report.summary import summarise
from strandcast.report.trial_page import trial_page

EVIL = "<script>alert('x')</script> $\\frac{1}$ & co"
VOID = {"meta", "br", "img", "input", "link", "hr"}
FACTS = Facts(
    title="A weighted string",
    excluded={2: "the string slipped"},
    weight_places_m=[0.3],
    speed_limits_rad_s=[10.0, 10.0, 10.0],
    play_command="strandcast play results/swing/trial-04/motion.json",
    settings={"string": {"length_m": 0.3}, "seed": 1},
)
EVIL_FACTS = Facts(title=EVIL, excluded={3: EVIL}, play_command=EVIL, settings={EVIL: EVIL})


class Tags(HTMLParser):
    """Matches every tag with its end, and collects ids, references and text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.references: list[str] = []
        self.words: list[str] = []
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value or "")
            if name in ("href", "src", "xlink:href", "srcset", "action"):
                self.references.append(value or "")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag, f"</{tag}> closes nothing"

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).replace("\u00a0", " ").split())


def page_of(results: Path, trial: int = 3, **changes: object) -> str:
    given = {
        "trial": trial,
        "experiment": "swing",
        "previous": results / "trial-01",
        "next_motion": results / "trial-04" / "motion.json",
        "facts": FACTS,
    }
    return trial_page(results / trial_name(trial), **(given | changes))


@pytest.fixture(scope="module")
def page(results: Path) -> str:
    return page_of(results)


def copy_of(results: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(results, tmp_path / "swing"))


@pytest.mark.usefixtures("undrawn")
def test_the_header_leads_to_the_neighbours(results: Path) -> None:
    header = page_of(results, neighbours=(2, 4)).partition("</header>")[0]
    links = re.findall(r'<a href="([^"]*)">([^<]*)</a>', header)
    assert links == [
        ("../report.html", "↑ swing"),
        ("../trial-02/report.html", "← trial 2"),
        ("../trial-04/report.html", "trial 4 →"),
        ("#checks", "All checks"),
    ]


def test_the_page_is_complete_small_and_self_contained(page: str) -> None:
    tags = Tags(page)
    assert len(page.encode()) < 3_000_000
    assert "could not be made" not in page
    assert page.count("<script") == page.count(f"<script>{page_script()}</script>") == 1
    assert len(tags.ids) == len(set(tags.ids))
    outside = [r for r in tags.references if not r.startswith(("#", "data:", "../", "track", "strobe"))]
    assert [r for r in outside if not re.fullmatch(r"[a-z_]+\.(json|parquet)", r)] == []
    assert {r[1:] for r in tags.references if r.startswith("#")} <= set(tags.ids) | {"main"}
    assert {part[1:] for part in re.findall(r"url\((#[^)]*)\)", page)} <= set(tags.ids)
    assert "http://" not in page
    assert "https://" not in page
    assert "default-src 'none'" in page


def test_every_figure_has_an_alternative_text(page: str) -> None:
    assert (
        page.count('role="img" aria-label="') == page.count('role="img"') == 26
    )  # with 10 tiles of the film strip


def test_colours_follow_light_and_dark(page: str) -> None:
    drawn = page[page.index("<body>") :]
    assert "currentColor" in drawn
    assert "var(--blue)" in drawn
    assert not re.search(r"#(010203|040506|070809|0072b2|d55e00)", drawn)


def test_the_verdict_comes_first_with_its_numbers(page: str, results: Path) -> None:
    text = Tags(page).text
    verdict = Verdict.read(results / "trial-03" / "verdict.json")
    assert verdict.miss_m is not None
    assert text.index("● HIT") < text.index("Strobe picture of the throw")
    for number in (
        f"{verdict.miss_m * 1e3:.1f} ± 0.9 mm",
        "5.40 mm",
        "2.40 mm",
        "99.4 %",
        "500 / 500",
        "731.40 ± 0.15 ms",
        "0.113 px",
    ):
        assert number in text
    assert "at bound: leave it" in text
    assert "8 frames without the tip" in text
    assert "speed limit active at joint_1" in text


def test_lab_truth_stands_beside_the_measurement(page: str) -> None:
    text = Tags(page).text
    truth = re.search(r"the clocks' offset is off by ([\d.]+) ms", text)
    assert truth is not None
    assert float(truth[1]) == pytest.approx(0.2, abs=1e-3)
    rms_mm = re.search(r"The track is ([\d.]+) mm rms from the truth", text)
    assert rms_mm is not None
    assert float(rms_mm[1]) == pytest.approx(0.7 * np.sqrt(2), rel=0.03)


@pytest.mark.usefixtures("undrawn")
def test_no_truth_no_section(results: Path, tmp_path: Path) -> None:
    folder = copy_of(results, tmp_path)
    (folder / "trial-03" / "lab_truth.parquet").unlink()
    assert "Lab truth" not in page_of(folder)


def test_same_results_same_bytes_wherever_they_lie(page: str, results: Path, tmp_path: Path) -> None:
    assert page_of(copy_of(results, tmp_path)) == page


def made_by(path: Path, versions: dict[str, str]) -> None:
    """Store other versions in a record's head."""
    path.write_text(json.dumps(json.loads(path.read_text()) | {"made_by": versions}))


@pytest.mark.usefixtures("undrawn")
def test_the_page_shows_the_versions_of_the_results(page: str, results: Path, tmp_path: Path) -> None:
    folder = copy_of(results, tmp_path)
    text = Tags(page).text
    assert f"numpy {np.__version__}" in text
    assert "different sets of versions" not in text
    made_by(folder / "trial-03" / "estimate.json", {"strandcast": "0.1.9", "numpy": "1.2.3"})
    made_by(folder / "cameras" / "main.json", {})
    text = Tags(page_of(folder)).text
    assert "▲ The results on this page were made by 3 different sets of versions." in text
    made = "Made with these versions:"
    assert f"{made} trial-03/estimate.json. software version numpy 1.2.3 strandcast 0.1.9" in text
    assert f"{made} cameras/main.json. software version unknown not stored in these files" in text
    text = Tags(experiment_of(folder)).text
    assert "▲ The results on this page were made by 3 different sets of versions." in text


def test_the_summary_lists_the_versions_of_every_file(results: Path, tmp_path: Path) -> None:
    folder = copy_of(results, tmp_path)
    made_by(folder / "trial-03" / "estimate.json", {"numpy": "1.2.3"})
    trials = {3: folder / "trial-03"}
    given = {"string_length_m": 0.3, "target_m": [0.6, 0.7], "hit_radius_m": 0.02}
    usual, other = summarise("swing", trials, **given).made_with
    assert usual.versions == current_versions()
    assert {"cameras/main.json", "trial-03/track.parquet", "trial-03/motion.json"} <= set(usual.files)
    assert (other.versions, other.files) == ({"numpy": "1.2.3"}, ["trial-03/estimate.json"])


@pytest.mark.usefixtures("undrawn")
def test_a_missing_result_is_a_box_with_the_reason(results: Path, tmp_path: Path) -> None:
    folder = copy_of(results, tmp_path)
    damaged = folder / "trial-03" / "hand.parquet"
    content = bytearray(damaged.read_bytes())
    content[len(content) // 3] ^= 0x40
    damaged.write_bytes(bytes(content))
    (folder / "trial-03" / "strobe.webp").unlink()
    (folder / "cameras" / "main.json").write_text('{"schema": "strandcast/camera", "version": 1}')
    page = page_of(folder, next_motion=None)
    text = Tags(page).text
    assert text.count("✕ This figure could not be made.") == 7
    assert "7 of 17 figures could not be made" in text
    assert "is damaged or is not a table" in text
    assert "no next motion was planned" in text
    assert "the file was changed" in text
    assert page.count('<td class="state FAIL">') == 1
    assert "String parameters" in text


def test_an_empty_folder_still_gives_a_page(tmp_path: Path) -> None:
    (tmp_path / "trial-01").mkdir()
    page = trial_page(tmp_path / "trial-01", trial=1, experiment="empty")
    text = Tags(page).text
    assert "UNKNOWN" in text
    assert "16 of 16 figures could not be made" in text


@pytest.mark.usefixtures("undrawn")
def test_a_bug_in_a_panel_does_not_lose_the_page(results: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(page: TrialPageData) -> PanelContent:
        raise ZeroDivisionError("on purpose")

    panels = PANELS.known()
    panels["trial.tip"] = replace(panels["trial.tip"], build=broken)
    monkeypatch.setattr(PANELS, "_entries", panels)
    text = Tags(page_of(results)).text
    assert "ZeroDivisionError: on purpose" in text
    assert "1 of 17 figures could not be made" in text


@pytest.mark.usefixtures("undrawn")
def test_an_undetected_tip_is_reported(results: Path, tmp_path: Path) -> None:
    folder = copy_of(results, tmp_path)
    path = folder / "trial-03" / "verdict.json"
    unseen = {"miss_m": None, "miss_sigma_m": None, "hit": False, "closest_frame": None, "closest_m": None}
    reason = "the tip was not tracked at its closest approach"
    Verdict.read(path).model_copy(update=unseen | {"closest_robot_time_s": None, "reason": reason}).write(
        path
    )
    text = Tags(page_of(folder)).text
    assert "◇ NOT SEEN" in text
    assert reason in text
    assert "could not be made" not in text


def test_strobe_instants_hold_the_closest_approach(results: Path) -> None:
    mine = read_results(results / "trial-03")
    rows = strobe_rows(mine)
    assert mine.need("verdict").closest_frame in mine.need("track").frame[rows]
    window = np.nonzero(mine.in_window())[0]
    steps = np.diff(arc_length_m(mine.need("track").points_m[window, -1])[rows - window[0]])
    even = np.abs(steps / steps.mean() - 1) < 0.05
    assert len(rows) == 11
    assert (~even).sum() == 2  # before and after the closest approach, which is forced in


def test_tip_error_is_the_amplitude_put_in(results: Path) -> None:
    mine = read_results(results / "trial-03")
    time_s, apart_m = tip_error_m(mine, mine.need("simulated")["planned"])
    # 60 mm · |sin| · |(0.7, −0.6)| and 0.7 mm of noise; the alignment moves times, not frames
    expected = 0.06 * np.abs(np.sin(9 * (time_s - 2e-4 - 1.0))) * np.hypot(0.7, 0.6)
    assert np.nanmax(np.abs(apart_m - expected)) < 0.004


def test_projection_is_the_cameras(results: Path) -> None:
    camera = read_results(results / "trial-03").need("camera").model_copy(deep=True)
    camera.lens.distortion = [0.0] * 5
    pixel = project_px(camera, np.array([[0.0, 0.35], [0.238, 0.35]]))
    # depth 2.4 m − 0.02 m; 1100 px · 0.238 m / 2.38 m = 110 px
    assert pixel == pytest.approx(np.array([[640.0, 360.0], [750.0, 360.0]]), abs=1e-6)


def test_truth_between_the_labs_places(results: Path) -> None:
    points = np.array([[[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]]])
    truth = TrueString(np.zeros(1, np.int32), np.zeros(1), np.array([0.0, 0.1, 0.3]), points, {})
    assert at_places(truth, np.array([0.05, 0.2, 0.31]))[0] == pytest.approx(
        np.array([[0.5, 0.0], [1.0, 1.0], [1.0, 2.0]])
    )


def test_lab_truth_is_read_by_frame_not_by_row(results: Path, tmp_path: Path) -> None:
    folder = copy_of(results, tmp_path)
    path = folder / "trial-03" / "lab_truth.parquet"
    rows = read_table(path, LAB_TRUTH)
    order = np.random.default_rng(0).permutation(len(rows["frame"]))
    before = read_results(folder / "trial-03").need("lab_truth")
    write_table(path, LAB_TRUTH, {name: column[order] for name, column in rows.items()})
    after = read_results(folder / "trial-03").need("lab_truth")
    assert np.array_equal(before.points_m, after.points_m)


def experiment_of(results: Path, facts: Facts = FACTS) -> str:
    trials = {k: results / trial_name(k) for k in (1, 2, 3)}
    next_motion = results / "trial-04" / "motion.json"
    summary = summarise(
        "swing",
        trials,
        string_length_m=0.3,
        target_m=[0.606, 0.674],
        hit_radius_m=0.02,
        excluded=facts.excluded,
        next_motion=next_motion,
    )
    return experiment_page(summary, trials, next_motion=next_motion, facts=facts)


@pytest.fixture(scope="module")
def experiments_page(results: Path) -> str:
    return experiment_of(results)


def test_the_experiments_page(experiments_page: str, results: Path) -> None:
    page = experiments_page
    assert experiment_of(results) == page
    tags = Tags(page)
    assert "could not be made" not in page
    assert len(tags.ids) == len(set(tags.ids))
    assert "HIT AT TRIAL 3" in tags.text
    assert "excluded: the string slipped" in tags.text
    assert {f"{trial_name(k)}/report.html" for k in (1, 2, 3)} <= set(tags.references)
    assert sum(r.startswith("data:image/webp") for r in tags.references) == 3
    # arcs of 0.5 m · 2.0 rad and 0.6 m · 2.5 rad
    assert "The hand of trial 1 travelled 1000 mm, that of trial 3 1500 mm (+50 %)" in tags.text
    assert "http" not in page.replace("http-equiv", "")
    assert len(page.encode()) < 3_000_000


@pytest.mark.usefixtures("undrawn")
def test_the_experiments_page_without_any_result(results: Path, tmp_path: Path) -> None:
    folder = copy_of(results, tmp_path)
    for file in (folder / "trial-01").iterdir():
        file.unlink()
    text = Tags(experiment_of(folder, Facts(title=EVIL))).text
    assert "failed: the file is not there" in text
    assert EVIL in text
    assert "UNKNOWN" in text  # the hit at trial 3 need not be the first


@pytest.mark.thorough
def test_ten_times_the_frames_make_no_larger_page(page: str, fast_results: Path) -> None:
    assert len(read_results(fast_results / "trial-03").need("track").frame) > 4900
    fast = page_of(fast_results)
    assert "could not be made" not in fast
    assert len(fast) < 1.5 * len(page)


@pytest.mark.usefixtures("undrawn")
def test_the_page_lists_what_a_fit_was_made_from_by_trial(results: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(results, tmp_path / "swing")) / "trial-02"
    names = [f"{trial_name(trial)}/track.parquet" for trial in (1, 2, 99, 100, 101)]
    estimate = Estimate.read(folder / "estimate.json")
    changed = estimate.model_copy(update={"planned_from": {name: "c" * 64 for name in names}})
    changed.write(folder / "estimate.json")
    assert re.findall(r"estimated from ([^<]*parquet)", page_of(folder.parent, 2)) == names


@pytest.mark.thorough
@pytest.mark.usefixtures("undrawn")
def test_an_experiment_of_no_trial_one_or_many(results: Path, tmp_path: Path) -> None:
    given = {"string_length_m": 0.3, "target_m": [0.6, 0.7], "hit_radius_m": 0.02}
    counts = {
        0: "The tip has not hit the target in 0 trials.",
        1: "The tip has not hit the target in 1 trial.",
        33: "The tip hit the target at trial 3, ",
    }
    for count, words in counts.items():
        trials = {}
        for trial in range(1, count + 1):
            trials[trial] = tmp_path / str(count) / trial_name(trial)
            trials[trial].parent.mkdir(exist_ok=True)
            trials[trial].symlink_to(results / trial_name(min(trial, 3)))
        page = experiment_page(summarise("swing", trials, **given), trials, facts=FACTS)
        assert words in Tags(page).text
        assert len(page.encode()) < 1_000_000
        assert page.count("<figcaption>trial ") == count
    numbers = [1, 2, 99, 100, 101]
    for trial in reversed(numbers):
        trials[trial] = tmp_path / trial_name(trial)
        trials[trial].symlink_to(results / "trial-01")
    trials = {trial: trials[trial] for trial in reversed(numbers)}
    summary = summarise("swing", trials, **given)
    assert [line.trial for line in summary.trials] == numbers
    page = experiment_page(summary, trials, facts=FACTS)
    linked = re.findall(r'href="(trial-\d+)/report.html"', page)
    assert list(dict.fromkeys(linked)) == [trial_name(trial) for trial in numbers]
    excluded = {trial: "the string slipped" for trial in (1, 2, 3)}
    facts = replace(FACTS, excluded=excluded)
    assert "not hit the target in 3 trials, 3 of them excluded" in Tags(experiment_of(results, facts)).text


def test_links_lead_to_files_that_are_there(page: str, experiments_page: str, results: Path) -> None:
    for text, folder in ((page, results / "trial-03"), (experiments_page, results)):
        links = {
            r
            for r in Tags(text).references
            if not r.startswith(("#", "data:")) and not r.partition("#")[0].endswith("report.html")
        }
        assert "summary.json" in links or "estimate.json" in links
        assert [link for link in links - {"summary.json"} if not (folder / link).is_file()] == []


@pytest.mark.usefixtures("undrawn")
def test_problems_do_not_name_where_a_page_lies(results: Path, tmp_path: Path) -> None:
    folder = copy_of(results, tmp_path)
    (folder / "trial-03" / "estimate.json").unlink()
    (folder / "trial-04" / "motion.json").write_text("{")
    assert str(tmp_path) not in page_of(folder)


@pytest.mark.usefixtures("undrawn")
def test_frames_without_any_point_are_gaps(results: Path, tmp_path: Path) -> None:
    folder = copy_of(results, tmp_path) / "trial-03"
    rows = read_table(folder / "track.parquet", TRACK)
    kept = (rows["frame"] < 200) | (rows["frame"] >= 260)
    write_table(folder / "track.parquet", TRACK, {name: column[kept] for name, column in rows.items()})
    track = read_results(folder).need("track")
    assert track.frame.tolist() == list(range(500))
    assert np.isnan(track.points_m[200:260]).all()
    assert np.diff(track.camera_time_s) == pytest.approx(0.002, abs=1e-9)
    assert "200 259 60" in Tags(page_of(folder.parent)).text


@pytest.mark.usefixtures("undrawn")
def test_a_picture_with_unknown_instants_shows_the_paths_of_the_tip(
    page: str, results: Path, tmp_path: Path
) -> None:
    folder = copy_of(results, tmp_path)
    path = folder / "trial-03" / "track.json"
    assert section_of(page, "picture").count('class="model"') == 10
    TrackSummary.read(path).model_copy(update={"choices": {}}).write(path)
    picture = section_of(page_of(folder), "picture")
    assert picture.count('class="model"') == picture.count('class="track"') == 1


def section_of(page: str, name: str) -> str:
    return page.partition(f'id="{name}"')[2].partition("</section>")[0]


def test_text_is_text_within_figures_too(results: Path, tmp_path: Path) -> None:
    folder = copy_of(results, tmp_path)
    made_by(folder / "trial-03" / "verdict.json", {EVIL: EVIL})
    path = folder / "trial-04" / "motion.json"
    motion = Motion.read(path).model_copy(update={"joint_names": [EVIL, "a", "b"]})
    motion.write(path)
    beside = path.with_name("predicted.parquet")
    write_predicted(beside, read_predicted(beside)._replace(motion_sha256=motion.content_sha256()))
    path = folder / "trial-03" / "estimate.json"
    Estimate.read(path).model_copy(update={"search": EVIL}).write(path)
    page = page_of(folder, experiment=EVIL, facts=EVIL_FACTS)
    assert "could not be made" not in page
    assert page.count("<script") == 1  # the viewer's
    text = Tags(page).text
    assert text.count(EVIL) >= 9
    assert "◌ EXCLUDED" in text
    assert f"{EVIL}: velocity" in text
    assert f"search: {EVIL}" in text


@pytest.mark.parametrize(
    "limit", ["strandcast.report.experiment_page.MOST_PIXELS", "PIL.Image.MAX_IMAGE_PIXELS"]
)
def test_a_picture_of_absurdly_many_pixels_has_no_thumbnail(
    results: Path, monkeypatch: pytest.MonkeyPatch, limit: str
) -> None:
    picture = (results / "trial-03" / "strobe.webp").read_bytes()
    assert _thumbnail(picture) is not None
    monkeypatch.setattr(limit, 1000)
    assert _thumbnail(picture) is None
