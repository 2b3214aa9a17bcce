"""The arm's file against all trials: what it states wrongly, in the same way in each."""

from strandcast.core.trial_names import trial_name
from strandcast.records.estimate import Estimate, RigOffsets
from strandcast.report.numbers import millimetres, scaled
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import ExperimentPageData

HEADS = ["number", "by the trials alone", "wrong with", "if wrong, at the hand", ""]
UNDECIDED = 0.5  # probability of a right file below which the trials do not decide
STATES = {"right": "", "wrong": "▲ wrong", "possible": "▲ this or another"}


def offset_rows(offsets: RigOffsets) -> list[list[str]]:
    """Return the rows of the table: each number's deviation from the file, and what it is worth."""
    rows = []
    for one in offsets.numbers:
        value = scaled(one.value, 1e3, 1, "mrad" if one.unit == "rad" else "mm", one.sd)
        wrong = scaled(one.wrong_probability, 100.0, 0, "%")
        rows.append([one.name, value, wrong, millimetres(one.hand_m), STATES[one.state]])
    return rows


def offsets_finding(offsets: RigOffsets) -> str:
    """Return what is wrong in the arm's file, or that nothing is that these trials show."""
    if offsets.warnings:
        return " ".join(f"{words[0].upper()}{words[1:]}." for words in offsets.warnings)
    trials, together = f"trials {', '.join(map(str, offsets.trials))}", millimetres(offsets.together_m)
    if offsets.right_probability < UNDECIDED:
        likely = max(offsets.numbers, key=lambda one: one.wrong_probability or 0.0)
        probability = scaled(1.0 - offsets.right_probability, 100.0, 0, "%")
        return (
            f"A number of the arm’s file may be wrong (with {probability}); most likely {likely.says}, which "
            f"{trials} do not decide: throw again, with another motion."
        )
    return f"Nothing that {trials} show contradicts the arm’s file: {together} at the hand at most."


def compares_arm(page: ExperimentPageData) -> bool:
    """Return whether two trials or more were compared with the arm's file."""
    return _newest(page) is not None


def _newest(page: ExperimentPageData) -> Estimate | None:
    """Return the newest estimate with such a comparison, of a trial that counts."""
    found = [page.trials[line.trial].get("estimate") for line in reversed(page.summary.counted())]
    return next((each for each in found if each is not None and each.rig_offsets is not None), None)


def rig_offsets(page: ExperimentPageData) -> PanelContent:
    """Return what all trials show of the arm's file, as the newest estimate has it."""
    newest = _newest(page)
    assert newest is not None
    assert newest.rig_offsets is not None
    table = Table(HEADS, offset_rows(newest.rig_offsets))
    sources = [f"{trial_name(newest.trial)}/estimate.json"]
    return PanelContent(offsets_finding(newest.rig_offsets), None, [table], sources)
