"""Pages of an experiment without a target: they show the fit and the prediction, and speak of no miss."""

import re
import shutil
from html import unescape
from pathlib import Path

import numpy as np
import pytest

from strandcast.core.trial_names import trial_name
from strandcast.records.estimate import CARRIED, HANGING, SIMULATED, UNDER_PREVIOUS, Estimate, HeldOutError
from strandcast.records.summary import ExperimentSummary
from strandcast.records.tables import read_table, write_table
from strandcast.report.campaign import Campaign, CampaignExperiment
from strandcast.report.campaign_page import campaign_page
from strandcast.report.experiment_page import experiment_page
from strandcast.report.summary import summarise
from strandcast.report.trial_page import trial_page
from strandcast.scoring.score import without_target

from .campaigns import summary_of

FALSE_WORDS = re.compile(r"\b(target|miss|missed|hit|hits|next motion|closest)\b", re.IGNORECASE)
# What a page may say: that there is no target, the name of the setting, and the title of the paper.
ALLOWED = re.compile(r"NO TARGET|without a target|target_m|“Casting Manipulation[^”]*”", re.IGNORECASE)


@pytest.fixture(scope="module")
def captured(results: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return results of two filmed trials that aimed at nothing, the second predicted by the first."""
    root = tmp_path_factory.mktemp("captured") / "swing"
    shutil.copytree(results / "cameras", root / "cameras")
    for trial in (1, 2):
        folder = root / trial_name(trial)
        shutil.copytree(results / trial_name(trial), folder)
        for name in ("motion.json", "predicted.parquet", "lab_truth.parquet"):
            (folder / name).unlink(missing_ok=True)
        without_target("swing", trial, 0.02).write(folder / "verdict.json")
        held_out = [HeldOutError(what=UNDER_PREVIOUS, E_m=0.0123)] if trial == 2 else []
        held_out += [HeldOutError(what=HANGING, E_m=0.0871), HeldOutError(what=CARRIED, E_m=0.0642)]
        columns = dict(read_table(folder / "simulated.parquet", SIMULATED))
        columns["source"] = np.where(columns["source"] == "planned", "predicted", columns["source"])
        write_table(folder / "simulated.parquet", SIMULATED, columns)
        fitted = Estimate.read(folder / "estimate.json")
        fitted.model_copy(update={"held_out": held_out, "E_planned_m": None}).write(folder / "estimate.json")
    return root


@pytest.fixture(scope="module")
def summary(captured: Path) -> ExperimentSummary:
    return summarise("swing", folders_of(captured), string_length_m=0.3, target_m=None, hit_radius_m=0.02)


def folders_of(captured: Path) -> dict[int, Path]:
    return {trial: captured / trial_name(trial) for trial in (1, 2)}


def words_of(page: str) -> str:
    """Return the text of a page, without its scripts."""
    body = re.sub(r"<(script|style)\b.*?</\1>", " ", page[page.index("<body") :], flags=re.DOTALL)
    for label in re.findall(r'aria-label="([^"]*)"', body):
        body += f" {label}"
    hidden = re.sub(r"<(\w+)[^>]* hidden>[^<]*</\1>", " ", body)
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]*>", " ", hidden)))


def false_words(page: str) -> list[str]:
    text = ALLOWED.sub(" ", words_of(page))
    return [text[max(m.start() - 60, 0) : m.end() + 40] for m in FALSE_WORDS.finditer(text)]


def test_a_captures_page_shows_fit_and_prediction_and_no_false_word(captured: Path) -> None:
    page = trial_page(captured / "trial-02", trial=2, experiment="swing", previous=captured / "trial-01")
    text = words_of(page)
    assert "could not be made" not in text
    assert "predicted by the fit before" in text
    assert "could not be made" not in page
    assert "NO TARGET" in text
    assert "UNKNOWN" not in text
    assert "The string fitted to the trials before it predicted it to 12.30 mm" in text.replace("\xa0", " ")
    assert "the better of two guesses without a model is 64.20 mm off" in text.replace("\xa0", " ")
    for section in ("picture", "film", "strobe", "tip", "fit", "errors", "parameters"):
        assert f'id="{section}"' in page
    for section in ("predicted", "budget", "next", "next-throw"):
        assert f'id="{section}"' not in page
    assert false_words(page) == []
    assert '<span data-part="tip" style="display: none">' in page  # the script writes "tip to target" into it


def test_the_experiments_page_compares_predictions_with_guesses(
    captured: Path, summary: ExperimentSummary
) -> None:
    page = experiment_page(summary, folders_of(captured))
    text = words_of(page).replace("\xa0", " ")
    assert (summary.verdict, summary.target_m, summary.hit_trial) == ("no target", None, None)
    assert [line.hit for line in summary.trials] == [None, None]
    assert "could not be made" not in page
    assert "was predicted to 12.30 mm. 1 of 1 predictions are better" in text
    assert "trial 2 12.30 mm 2.40 mm 87.10 mm 64.20 mm" in text
    for section in ("misses", "strings", "evaluations", "next"):
        assert f'id="{section}"' not in page
    assert false_words(page) == []


def test_all_experiments_count_captures_apart(summary: ExperimentSummary) -> None:
    aimed = CampaignExperiment("aimed", summary_of(0))
    both = Campaign([aimed, CampaignExperiment("swing", summary)])
    tally, alone = both.tally(), Campaign([aimed]).tally()
    assert (tally.captured, tally.failed, tally.unread) == (1, 0, 0)
    assert tally.scored == alone.scored + 2
    assert tally.experiments == alone.experiments
    assert both.hit_shares() == Campaign([aimed]).hit_shares()
    assert "captured" not in alone.to_json()
    page = campaign_page(both)
    assert "UNKNOWN" not in words_of(page)
    assert "are unknown" not in words_of(page)
    assert f"of {len(aimed.throws)} throws stand out" in words_of(page)
    assert "; 1 has no target" in words_of(page)
    assert "1 has no target" in words_of(campaign_page(Campaign([CampaignExperiment("swing", summary)])))
