"""How much throws differ on the rig: expected, measured in each trial, learnt."""

from collections.abc import Sequence

from strandcast.core.trial_names import trial_name
from strandcast.records.motion import Motion, RigScatter
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import ExperimentPageData

# Quantity -> words, and the unit in which it is shown with its factor.
WORDS = {
    "grasp_angle_rad": ("turn in the clamp", 1e3, "mrad"),
    "grasp_length_m": ("length out of the clamp", 1e3, "mm"),
    "sway_rad": ("turn about the hand at the start", 1e3, "mrad"),
    "sway_rad_s": ("its rate", 1e3, "mrad/s"),
    "joint_zero_rad": ("zeros of the joints", 1e3, "mrad"),
    "servo_gain": ("travel of a joint", 1e3, "per mille"),
    "servo_lag_s": ("lag of a joint", 1e3, "ms"),
}


def scatter_rows(scatter: Sequence[RigScatter], trials: Sequence[int]) -> tuple[list[str], list[list[str]]]:
    """Return heads and rows of the table: standard deviations, and what each trial showed."""
    heads = [
        "quantity",
        "unit",
        "expected",
        *(f"trial {trial}" for trial in trials),
        "learnt",
        "90 %",
        "from",
    ]
    rows = []
    for one in scatter:
        words, factor, unit = WORDS[one.quantity]
        count = len(one.measured)
        rows.append(
            [
                words,
                unit,
                f"{_short(factor * one.prior_median)} ×÷ {one.prior_factor:g}",
                *(_measured(one.measured.get(trial), factor) for trial in trials),
                _short(factor * one.median) if count else "as expected",
                f"{_short(factor * one.low)} to {_short(factor * one.high)}",
                f"{count} trial{'s' * (count != 1)}",
            ]
        )
    return heads, rows


def _short(number: float) -> str:
    """Return a number with two digits, without an exponent."""
    return f"{number:.0f}" if number >= 10.0 else f"{number:.2g}"


def _measured(values: list[float | None] | None, factor: float) -> str:
    return ", ".join("–" if value is None else f"{factor * value:z.1f}" for value in values or []) or "–"


def learns_scatter(page: ExperimentPageData) -> bool:
    """Return whether a motion was planned with what trials show of the rig's scatter."""
    return any(_scatter_of(results.get("motion")) for results in page.trials.values())


def _scatter_of(motion: Motion | None) -> list[RigScatter]:
    return [] if motion is None or motion.provenance is None else motion.provenance.scatter


def rig_scatter(page: ExperimentPageData) -> PanelContent:
    """Return what the trials showed of the rig's scatter, as the newest motion was planned with it."""
    motions = [results.get("motion") for _, results in sorted(page.trials.items())]
    planned = None if page.next_motion is None else Motion.read(page.next_motion)
    newest = next(motion for motion in [planned, *reversed(motions)] if _scatter_of(motion))
    assert newest is not None
    scatter = _scatter_of(newest)
    heads, rows = scatter_rows(scatter, sorted({trial for one in scatter for trial in one.measured}))
    warnings = [warning for one in scatter for warning in one.warnings]
    finding = (
        " ".join(f"{warning}." for warning in warnings) or "No quantity drifts or is far from the prior."
    )
    return PanelContent(finding, None, [Table(heads, rows)], [f"{trial_name(newest.trial)}/motion.json"])
