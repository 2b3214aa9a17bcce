"""A campaign of a thousand trials: what its page says, counts and leaves open."""

import csv
import io
import re
from html import unescape
from pathlib import Path
from urllib.parse import unquote

import pytest

from strandcast.core.trial_names import trial_name
from strandcast.records.summary import TrialSummary
from strandcast.report.campaign import Campaign, CampaignExperiment, WaitingTrial
from strandcast.report.campaign_page import campaign_page, headline
from strandcast.report.pages import page_script
from strandcast.workflow.campaign import campaign_of, write_campaign

from .campaigns import campaign_in_memory, name_of, summary_of, write_summaries
from .test_pages import Tags

MOST_BYTES = 2_000_000


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("campaign")
    write_summaries(root)
    return root


@pytest.fixture(scope="module")
def page(project: Path) -> str:
    return write_campaign(project)[1].read_text()


def rows_of(page: str) -> list[list[str]]:
    """Return the texts of the rows of the table of trials."""
    body = page[page.index('<table class="sortable">') :].partition("<tbody>")[2].partition("</tbody>")[0]
    cells = (re.findall(r"<td[^>]*>(.*?)</td>", row) for row in body.split("</tr>") if "<td" in row)
    return [[unescape(re.sub(r"<[^>]*>", "", cell)) for cell in row] for row in cells]


@pytest.mark.thorough
def test_a_thousand_trials_are_one_small_page_without_network(page: str, project: Path) -> None:
    tags = Tags(page)
    assert len(page.encode()) < MOST_BYTES
    assert "could not be made" not in page
    assert page.count("<script") == page.count(f"<script>{page_script('table.js.jinja')}</script>") == 1
    assert "default-src 'none'" in page
    assert "http" not in page.replace("http-equiv", "")
    assert len(tags.ids) == len(set(tags.ids))
    assert {r[1:] for r in tags.references if r.startswith("#")} <= set(tags.ids)
    links = {r for r in tags.references if not r.startswith(("#", "data:"))}
    trials = {f"{name_of(k)}/{trial_name(n)}/report.html" for k in range(50) for n in range(1, 21)}
    assert links == trials | {f"{name_of(k)}/report.html" for k in range(50)}
    assert campaign_page(campaign_of(project)) == page[: page.index("\n<!-- strandcast")]


def test_every_trial_is_a_row_and_the_unknown_come_first(page: str) -> None:
    rows = rows_of(page)
    assert len(rows) == 1000
    assert [row[:4] for row in rows[:2]] == [
        ["string-06", "1", "1", "✕ UNKNOWN"],
        ["string-07", "2", "2", "◇ NOT SEEN"],
    ]
    excluded = next(row for row in rows if row[:2] == ["string-08", "5"])
    assert excluded[2:4] == ["–", "◌ EXCLUDED"]
    assert excluded[-1] == "excluded: the string <slipped>"
    after = next(row for row in rows if row[:2] == ["string-08", "6"])
    assert after[2] == "5"  # an excluded trial is no throw


def test_the_csv_has_the_same_trials_in_the_units_of_the_files(page: str) -> None:
    link = re.search(r'download="campaign.csv" href="data:text/csv;charset=utf-8,([^"]*)"', page)
    assert link is not None
    table = list(csv.DictReader(io.StringIO(unquote(link[1]))))
    assert len(table) == 1000
    line: TrialSummary = summary_of(9).trials[3]
    row = next(each for each in table if (each["experiment"], each["trial"]) == (name_of(9), "4"))
    assert float(row["miss_m"]) == line.miss_m
    assert float(row["clock_drift"]) == line.clock_drift
    assert next(each for each in table if each["experiment"] == name_of(6))["miss_m"] == ""


def test_what_stands_out_is_named_with_the_reason(page: str, project: Path) -> None:
    found = campaign_of(project).outliers()
    assert [(each.experiment, each.trial) for each in found] == [
        ("string-03", 4),
        ("string-04", 2),
        ("string-05", 3),
    ]
    text = Tags(page).text
    assert "3 of 999 throws stand out." in text
    assert "string-03, trial 4 miss of 900.0 mm" in text
    assert "clock drift: 500.00 ppm; at most 100 ppm is good" in text
    assert "2 of 999 throws have a quantity of the rig beyond its limit." in text


@pytest.mark.parametrize("drift", [5e-4, -5e-4])
def test_a_clock_that_drifts_either_way_stands_out(drift: float) -> None:
    summary = summary_of(40, 3)
    summary.trials[1].clock_drift = drift
    [found] = Campaign([CampaignExperiment("a", summary)]).outliers()
    assert (found.trial, found.severity) == (2, pytest.approx(5.0))


def test_the_tally_counts_what_is_done_failed_and_left() -> None:
    tally = campaign_in_memory().tally()
    assert (tally.done, tally.excluded, tally.failed, tally.left) == (241, 1, 2, 1)
    assert tally.experiments == {"hit": 11, "no hit": 0, "unknown": 3}
    assert headline(tally) == "11 of 14 experiments have hit; 3 are unknown."
    assert str(tally).startswith("241 trials done, 2 failed, 1 left; hits: ")
    assert str(tally).endswith("; excluded: 1; without a readable summary: 1")


def test_throws_too_near_to_the_hit_radius_are_counted_and_named() -> None:
    lines = summary_of(40, 3).trials
    misses_m = (0.0195, 0.0205, 0.0225)  # σ 0.9 mm, radius 20 mm: two of them within 2 σ
    lines = [
        line.model_copy(update={"miss_m": miss_m, "hit": miss_m < 0.02})
        for line, miss_m in zip(lines, misses_m, strict=True)
    ]
    campaign = Campaign([CampaignExperiment("a", summary_of(40, 3).model_copy(update={"trials": lines}))])
    assert campaign.tally().uncertain == 2
    assert "; 2 throws too near to the hit radius to be certain" in str(campaign.tally())
    text = campaign_page(campaign)
    assert "2 throws within two standard deviations of the tracked tip from the hit radius count" in text
    excluded = [line.model_copy(update={"excluded": "slipped"}) for line in lines]
    summary = summary_of(40, 3).model_copy(update={"trials": excluded})
    assert Campaign([CampaignExperiment("a", summary)]).tally().uncertain == 0


def test_the_methods_say_what_was_counted(page: str) -> None:
    text = " ".join(page.split())
    assert (
        "999 throws of 50 experiments were counted; 1 trial was excluded, with a reason; "
        "the outcome of 1 throw is unknown. The miss is" in text
    )
    assert "a miss of at most 20.0 mm is a hit" in text
    share = Campaign([CampaignExperiment(name_of(n), summary_of(n)) for n in range(50)]).hit_shares()[-1]
    assert f"By throw {share.throw}, {share.hits} of {share.known} experiments had hit" in text
    assert "Software: strandcast 0.2.0." in text


def test_the_methods_count_the_experiments_that_were_thrown() -> None:
    campaign = Campaign(
        [CampaignExperiment("a", summary_of(40, 3)), CampaignExperiment("b", None, "damaged")]
    )
    assert "3 throws of 1 experiment were counted. The miss is" in campaign_page(campaign)


def test_an_unprocessed_throw_leaves_open_whether_the_tip_hit() -> None:
    missed = summary_of(20, 3)
    assert CampaignExperiment("a", missed).verdict == "no hit"
    waiting = CampaignExperiment("a", missed, waiting=[WaitingTrial(4)])
    assert waiting.verdict == "unknown"
    assert [waiting.has_hit_by(throw) for throw in (3, 4)] == [False, None]
    without_2 = missed.model_copy(update={"trials": [missed.trials[0], missed.trials[2]]})
    between = CampaignExperiment("a", without_2, waiting=[WaitingTrial(2)])
    assert [between.has_hit_by(throw) for throw in (1, 2)] == [False, None]


def test_shares_leave_out_what_is_unknown_and_keep_what_stopped() -> None:
    hits = {"a": [False, True], "b": [False], "c": [None, False, True], "d": [False, None]}
    experiments = []
    for name, outcomes in hits.items():
        lines = summary_of(30, len(outcomes)).trials
        lines = [line.model_copy(update={"hit": hit}) for line, hit in zip(lines, outcomes, strict=True)]
        experiments.append(CampaignExperiment(name, summary_of(30, 1).model_copy(update={"trials": lines})))
    not_thrown = CampaignExperiment("e", summary_of(30, 1).model_copy(update={"trials": []}))
    shares = Campaign([*experiments, not_thrown]).hit_shares()
    assert sum(Campaign([*experiments, not_thrown]).tally().experiments.values()) == 4
    assert [(s.hits, s.known, s.unknown) for s in shares] == [(0, 3, 1), (1, 2, 2), (1, 2, 2)]


def test_the_best_miss_never_grows() -> None:
    best = campaign_in_memory().best_so_far()
    assert [len(misses) for misses in best.values()] == [12] + 19 * [13]  # string-06 is unknown in throw 1
    for position in range(13):
        course = [misses[position] for throw, misses in best.items() if throw > 1]
        assert course == sorted(course, reverse=True)


def test_text_of_records_is_text(page: str) -> None:
    assert "the string &lt;slipped&gt;" in page
    hostile = Campaign([CampaignExperiment("<script>alert(1)</script>", None, "<img src=x>")])
    assert campaign_page(hostile).count("<script") == 1
    assert "<img" not in campaign_page(hostile)


def test_a_project_without_experiments_has_a_page() -> None:
    assert "NO EXPERIMENT" in campaign_page(Campaign())


def test_what_cannot_be_read_is_unknown_and_comes_first(tmp_path: Path) -> None:
    write_summaries(tmp_path, 4)
    damaged = tmp_path / "results" / name_of(1) / "summary.json"
    damaged.write_text(damaged.read_text().replace('"hit_trial"', '"hit_trail"', 1))
    for trial in (21, 22):
        folder = tmp_path / "data" / name_of(2) / trial_name(trial)
        folder.mkdir()
        (folder / "video.mp4").write_bytes(b"cut off")
    logs = tmp_path / "results" / name_of(2) / "trial-22" / "logs"
    logs.mkdir(parents=True)
    (logs / "ingest.log").write_text("SC-V005 ERROR  video.mp4: is cut off\n        Fix: copy it again\n")
    tally, path = write_campaign(tmp_path)
    assert (tally.failed, tally.left, tally.unread) == (1, 1, 1)
    assert path == tmp_path / "results" / "report.html"
    text = Tags(path.read_text()).text
    first = text[text.index("Failed and unknown", text.index("Provenance")) :]
    assert first.index("string-01 ✕ UNKNOWN summary.json:") < first.index("string-02, trial 21 ◌ WAITING")
    assert "string-02, trial 22 ✕ FAILED ingest: SC-V005 video.mp4: is cut off" in first
