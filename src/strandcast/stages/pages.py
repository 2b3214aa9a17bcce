"""Facts for the pages of trials and of experiments, from the experiment's and the arm's files."""

from collections.abc import Mapping
from pathlib import Path

from strandcast.arm.load import load_arm
from strandcast.core.trial_names import trial_number
from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.report.facts import Facts
from strandcast.stages.context import Context
from strandcast.stages.producers import play_command


def facts_of(context: Context, next_motion: Path | None) -> Facts:
    """Return the facts that the pages show besides results."""
    settings = context.settings
    arm = load_arm(context.arm_file)
    return Facts(
        title=settings.title,
        hit_radius_m=settings.hit_radius_m,
        aims_m=settings.objective.marks_m,
        excluded=settings.excluded_reasons,
        weight_places_m=[weight.place_m for weight in settings.string.weights],
        stiff_sections_m=[(section.from_m, section.to_m) for section in settings.string.stiff_sections],
        speed_limits_rad_s=arm.limits.velocity_rad_s.tolist(),
        play_command=None
        if next_motion is None
        else play_command(context, trial_number(next_motion.parent.name)),
        settings=settings.model_dump(mode="json"),
    )


def refuse_unread(context: Context, page: Path, unread: Mapping[str, str]) -> None:
    """Raise SC-H023 if a page that was just written shows results that could not be read."""
    files = [f"{file}: {why}" for file, why in unread.items()]
    if files:
        what = f"the page says what could not be read ({'; '.join(files)})"
        fix = f"restore these files, or delete them and make them again: strandcast run {context.name}"
        raise StrandcastError("SC-H023", what, file=page, fix=fix, exit_code=INTEGRITY)


def no_such_trial(context: Context, trial: int) -> StrandcastError:
    """Return the error for a trial that does not exist."""
    what = f"there is no trial {trial}"
    fix = f"make its results first: strandcast run {context.name}"
    return StrandcastError("SC-W030", what, file=context.folder.results, fix=fix)
