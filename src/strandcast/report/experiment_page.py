"""The page of one experiment: did the tip hit, at which trial, and how the throws changed on the way."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from PIL import Image

from strandcast.records.summary import Summary, TrialSummary
from strandcast.report.facts import Facts
from strandcast.report.figures.camera_picture import PICTURE, camera_picture
from strandcast.report.figures.next_motion import next_motion as next_motion_figure
from strandcast.report.figures.progress import evaluations, misses
from strandcast.report.figures.throws import hand_paths, tip_paths
from strandcast.report.numbers import millimetres
from strandcast.report.pages import render
from strandcast.report.reportlet import Table, attempt
from strandcast.report.results import Results, read_results
from strandcast.report.text import CITATION, Chip, verdict_chip

THUMBNAIL_PX = 320


class Row(NamedTuple):
    """One trial on the page."""

    line: TrialSummary
    folder: str
    chip: Chip
    remark: str
    thumbnail: str | None


def experiment_page(
    summary: Summary,
    trials: Mapping[int, Path],
    *,
    next_motion: Path | None = None,
    facts: Facts | None = None,
) -> str:
    """Return the HTML page of one experiment.

    Parameters
    ----------
    summary
        The experiment in numbers, as `report.summary.summarise` makes it.
    trials
        Trial -> its folder of results.
    next_motion
        The motion that would be played next.
    facts
        What no result holds: title, limits, settings.
    """
    facts = facts or Facts()
    results = {trial: read_results(folder) for trial, folder in sorted(trials.items())}
    folder = next(iter(results.values())).folder.parent if results else Path()
    counted = [line.trial for line in summary.trials if line.excluded is None]
    last = results[counted[-1]].get("motion") if counted and counted[-1] in results else None
    reportlets = [
        attempt("misses", "Miss per trial", misses, summary),
        attempt("hands", "Hand paths, first throw and hit", hand_paths, summary, results),
        attempt("tips", "Tip paths", tip_paths, summary, results),
        attempt("evaluations", "E before and after each fit", evaluations, summary),
        attempt("next", "The next motion", next_motion_figure, next_motion, folder, last, facts),
    ]
    if (folder / PICTURE).is_file():
        reportlets.append(attempt("camera", "Calibration of the camera", camera_picture, folder))
    return render(
        "experiment.html.jinja",
        summary=summary,
        title=facts.title,
        chip=_outcome(summary),
        headline=_headline(summary),
        rows=[_row(line, trials, results) for line in summary.trials],
        reportlets=reportlets,
        citation=CITATION,
        provenance=_provenance(results, facts),
    )


def _outcome(summary: Summary) -> Chip:
    if summary.hit_trial is not None:
        return Chip(f"HIT AT TRIAL {summary.hit_trial}", "●", "hit")
    return Chip("NO HIT YET", "▲", "miss")


def _headline(summary: Summary) -> str:
    excluded = sum(line.excluded is not None for line in summary.trials)
    count = len(summary.trials)
    trials = f"{count} trial{'' if count == 1 else 's'}" + (
        f", {excluded} of them excluded" if excluded else ""
    )
    if summary.hit_trial is None:
        return f"The tip has not hit the target in {trials}."
    hit = next(line for line in summary.trials if line.trial == summary.hit_trial)
    return (
        f"The tip hit the target at trial {hit.trial}, {millimetres(hit.miss_m)} from its middle ({trials})."
    )


def _row(line: TrialSummary, trials: Mapping[int, Path], results: Mapping[int, Results]) -> Row:
    mine = results.get(line.trial)
    verdict = mine.get("verdict") if mine is not None else None
    remark = f"excluded: {line.excluded}" if line.excluded is not None else ""
    if not remark and verdict is not None and verdict.reason:
        remark = verdict.reason
    if not remark and mine is not None and verdict is None:
        remark = f"failed: {mine.problems['verdict'].what}"
    folder = trials[line.trial].name if line.trial in trials else f"trial-{line.trial:02d}"
    picture = mine.get("strobe") if mine is not None else None
    return Row(line, folder, verdict_chip(verdict, line.excluded), remark, _thumbnail(picture))


def _thumbnail(picture: bytes | None) -> str | None:
    """Return a picture small enough to stand in a row, as base64, or None if it is none."""
    if picture is None:
        return None
    out = io.BytesIO()
    try:
        image = Image.open(io.BytesIO(picture)).convert("RGB")
    except OSError:
        return None
    image.thumbnail((THUMBNAIL_PX, THUMBNAIL_PX))
    image.save(out, "WEBP", quality=60, method=4)
    return base64.b64encode(out.getvalue()).decode()


def _provenance(results: Mapping[int, Results], facts: Facts) -> list[Table]:
    rows = [
        [f"trial {trial}: {name}", record.content_sha256()]
        for trial, mine in results.items()
        for name, record in (
            (n, mine.get(n)) for n in ("manifest", "motion", "track_summary", "alignment", "estimate")
        )
        if record is not None
    ]
    tables = [Table(["record", "content sha256"], rows)]
    if facts.software:
        tables.append(Table(["software", "version"], [list(pair) for pair in sorted(facts.software.items())]))
    if facts.settings:
        tables.append(Table(["setting", "value"], [list(pair) for pair in facts.flat_settings()]))
    return tables
