"""The page of one trial, from results only."""

from __future__ import annotations

from pathlib import Path

from strandcast.records.files import write_text
from strandcast.report.trial_page import trial_page
from strandcast.stages.context import context_of
from strandcast.stages.pages import facts_of, next_motion_of, no_such_trial


def run(root: Path, name: str, trial: int) -> None:
    """Write results/<experiment>/trial-NN/report.html."""
    context = context_of(root, name)
    trial_folder = context.folder.trial(trial)
    folder = trial_folder.results
    known = folder.is_dir() or trial_folder.data.is_dir()
    if not known and context.settings.excluded_reason(trial) is None:
        raise no_such_trial(context, trial)
    earlier = context.counted_before(trial)
    next_motion = next_motion_of(context, trial)
    page = trial_page(
        folder,
        trial=trial,
        experiment=name,
        previous=context.folder.trial(earlier[-1]).results if earlier else None,
        next_motion=next_motion,
        facts=facts_of(context, next_motion),
    )
    write_text(folder / "report.html", page)
