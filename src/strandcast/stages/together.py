"""Fit one string to the trials of several experiments."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from strandcast.errors import StrandcastError
from strandcast.estimation.together import OWN, JointFit, Member, fit_together
from strandcast.records.estimate import WeightFit
from strandcast.seeds import rng
from strandcast.stages.context import Context, context_of
from strandcast.stages.declarations import STAGES
from strandcast.stages.estimate import CAPTURE_SEARCHES, Fitted, what_is_fitted
from strandcast.stages.estimate_record import mass_known, plain_mass_kg
from strandcast.stages.job import Files, Job


def together(root: Path, experiments: Sequence[str]) -> dict[str, Any]:
    """Return the string that experiments share, fitted to all their trials, and what each has of its own.

    Raises
    ------
    StrandcastError
        SC-E009 one was not run, or their strings are not alike; any that their files raise.
    """
    contexts = [context_of(root, name) for name in experiments]
    fitted = [_fitted(context) for context in contexts]
    (parts, model, space, settings, _), *others = fitted
    for context, (rolls, other, box, _, _) in zip(contexts[1:], others, strict=True):
        if (other.length_m, other.points, box.in_plane) != (model.length_m, model.points, space.in_plane):
            raise _refused(
                context, f"its string is not that of {experiments[0]}", "give strings of one length"
            )
        if not parts.keys() & rolls.keys():
            what = f"its ends, or those of {experiments[0]}, have an orientation and the others none"
            raise _refused(context, what, "name the ends alike: all with an orientation, or all with behind")
    found: list[JointFit] = []
    for roll in [roll for roll in parts if all(roll in each[0] for each in others)]:
        members = [Member(each[0][roll], each[2]) for each in fitted]
        random = rng("+".join(experiments), contexts[0].settings.seed, 0, "estimate")
        named = dict(zip(experiments, members, strict=True))
        found.append(fit_together(named, model, settings, random, CAPTURE_SEARCHES))
    return _content(min(found, key=lambda fit: fit.log.best()[1]), contexts)


def _content(fit: JointFit, contexts: Sequence[Context]) -> dict[str, Any]:
    """Return a joint fit as numbers and words: the shared unknowns, and those of each experiment."""
    space, known = fit.objective.space, fit.uncertainty
    best, low, high = (space.values(chi) for chi in (fit.log.best()[0], known.low, known.high))
    shared: dict[str, Any] = {}
    experiments: dict[str, Any] = {
        context.name: {"E_m": fit.error_m(k), "unknowns": {}, "weights": []}
        for k, context in enumerate(contexts)
    }
    for row, joint_name in enumerate(space.names):
        name, _, owner = joint_name.partition(OWN)
        is_open = [bool(known.open_low[row]), bool(known.open_high[row])]
        found = {"value": float(best[row]), "low": float(low[row]), "high": float(high[row]), "open": is_open}
        if not name.startswith("weight_"):
            (experiments[owner]["unknowns"] if owner else shared)[name] = found
            continue
        k = [context.name for context in contexts].index(owner)
        weight: dict[str, Any] = mass_known(space, known, row, agree=not fit.warnings)
        weight["place_m"] = float(
            fit.objective.boxes[k].layout.places_m[int(name.removeprefix("weight_")) - 1]
        )
        weight |= {"value": found["value"], "plain_kg": plain_mass_kg(contexts[k], fit.objective.model)}
        weight["words"] = WeightFit.model_construct(**weight).words
        experiments[owner]["weights"].append(weight)
    return {"shared": shared, "experiments": experiments, "warnings": fit.warnings}


def _fitted(context: Context) -> Fitted:
    run = [n for n in context.folder.reported_trials() if context.counted([n])]
    if not run:
        raise _refused(context, "no trial was fitted", f"run it first: strandcast run {context.name}")
    return what_is_fitted(Files(STAGES["estimate"], Job(context, run[-1])))[1]


def _refused(context: Context, what: str, fix: str) -> StrandcastError:
    return StrandcastError("SC-E009", f"{context.name}: {what}", file=context.file, fix=fix)
