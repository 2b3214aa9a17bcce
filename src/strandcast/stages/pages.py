"""What both kinds of pages need from the experiment's and the arm's files."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

from strandcast import __version__
from strandcast.arm.load import load_arm
from strandcast.errors import StrandcastError
from strandcast.experiment import Experiment, SegmentObjective, ShapeObjective, SwingObjective
from strandcast.report.facts import Facts
from strandcast.stages.context import Context

SOFTWARE = ("numpy", "numba", "scipy", "opencv-contrib-python-headless", "av", "mujoco", "cma", "snakemake")


def facts_of(context: Context, next_motion: Path | None) -> Facts:
    """Return what the pages tell that no result holds."""
    settings = context.settings
    arm = load_arm(context.arm_file)
    return Facts(
        title=settings.title,
        hit_radius_m=settings.hit_radius_m,
        aims_m=_aims_m(settings),
        excluded={exclusion.trial: exclusion.reason for exclusion in settings.excluded},
        weight_places_m=[weight.place_m for weight in settings.string.weights],
        stiff_sections_m=[(section.from_m, section.to_m) for section in settings.string.stiff_sections],
        speed_limits_rad_s=arm.limits.velocity_rad_s.tolist(),
        play_command=_play_command(context, next_motion),
        settings=settings.model_dump(mode="json"),
        software={"strandcast": __version__} | {name: version(name) for name in SOFTWARE},
    )


def _aims_m(settings: Experiment) -> list[tuple[float, float]] | None:
    told = settings.objective
    if isinstance(told, SegmentObjective):
        return list(told.ends_m)
    if isinstance(told, ShapeObjective):
        return [place.at_m for place in told.places]
    return [] if isinstance(told, SwingObjective) else None


def _play_command(context: Context, next_motion: Path | None) -> str | None:
    if next_motion is None:
        return None
    name, trial = context.name, next_motion.parent.name
    if context.settings.lab is not None:
        return f"strandcast throw {name} {int(trial.removeprefix('trial-'))}"
    arm = context.arm_file.as_posix()
    return f"strandcast play {next_motion.as_posix()} --arm {arm} --out data/{name}/{trial}"


def next_motion_of(context: Context, trial: int) -> Path | None:
    """Return the motion that was planned for the trial after this one, if there is one."""
    path = context.folder.trial(trial + 1).results / "motion.json"
    return path if path.is_file() else None


def no_such_trial(context: Context, trial: int) -> StrandcastError:
    """Return the refusal of a page about a trial that is not there."""
    return StrandcastError(
        "SC-H001",
        f"there is no trial {trial}",
        file=context.folder.results,
        fix=f"make its results first: strandcast run {context.name}",
    )
