"""What recordings leave open: whether it is named, and whether the advised motion then determines it.

    python -m strandcast_studies.evidence.left_open --seeds 500-509

prints a line per capture, drawn as in `captured_weights` and fitted to one recording: the unknowns that
it can and cannot determine, which are named, and their intervals with the advised motion as a second one.
"""

import argparse
import json
from typing import Any

import numpy as np

from strandcast.core.strings import PARAMETERS, REST_CURL, StringBatch, side
from strandcast.dynamics.batch import HandPath
from strandcast.dynamics.parameters import DRAG_KG_M3, Array
from strandcast.estimation.descent import GaussNewtonModel, descend, descent_batch
from strandcast.estimation.excitation import margins, other_motions
from strandcast.estimation.fit import StringFit
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective
from strandcast_studies.benchmarks.loop.run import numbers
from strandcast_studies.evidence.captured_weights import POINTS, Capture, Problem, Recording, drawn, fitted

# Rises of the cost, by which a string explains the recording as well, and surely does not.
AS_WELL, WORSE = 0.02, 0.2
TRUE_ROUNDS, HELD_ROUNDS = 12, 8  # of descents
REST_S = 0.6  # before an advised motion
STIFF = 1e8  # k_s of a string that hardly stretches [N/m/kg]


def true_string(capture: Capture, problem: Problem) -> StringBatch:
    """Return the drawn string as the fit's model has it (a batch of one)."""
    known, layout, spacing_m = capture.known, problem.space.layout, capture.true["length_m"] / POINTS
    bending = known["bending_n_m2"] / (known["mass_kg_m"] * spacing_m**2)
    damping = bending * known["damping_s"]
    values = {
        "k_s": STIFF,
        "c_s": 1.0,
        **dict.fromkeys(("k_h", "k_sh"), bending),
        **dict.fromkeys(("c_h", "c_sh"), damping),
        "C_c1": 1e-6,
        "C_c2": DRAG_KG_M3 * known["diameter_m"] / known["mass_kg_m"],
        "k_ph": 2.0 * bending,
        "c_ph": 2.0 * damping,
    }
    free = np.array([[mass_kg / capture.plain_kg for _, mass_kg in known["weights"]]])
    curl = REST_CURL if problem.space.in_plane else side(REST_CURL, "left")
    return StringBatch(
        np.array([[values[name] for name in PARAMETERS]]),
        layout.plain + free @ layout.shares,
        {curl: np.array([known["rest_curl_rad_m"]])},
        free_masses=free,
    )


def can_determine(objective: FitObjective, chi: Array) -> dict[str, bool | None]:
    """Return which unknowns a recording determines, given exponents (d,) near the best; None: hardly.

    It does not, if another string, with one unknown off by a factor of three, explains it as well.
    """
    log, slopes, space = EvaluationLog(objective.cost), GaussNewtonModel(objective), objective.space
    d = len(chi)
    effort = 32 * 2 * d
    now = descend(log, slopes, descent_batch(chi[None], log(chi[None])), effort * TRUE_ROUNDS, TRUE_ROUNDS)
    best, value = log.best()
    moved = np.concatenate([best + sign * np.diag(margins(space)) for sign in (-1.0, 1.0)])
    held = np.tile(np.eye(d, dtype=bool), (2, 1))
    inside = ((moved >= 0.0) & (moved <= 1.0)).all(axis=1)
    now = descent_batch(moved[inside], log(moved[inside]), held[inside])
    now = descend(log, slopes, now, effort * HELD_ROUNDS, HELD_ROUNDS)
    rise = np.full(2 * d, np.inf)
    rise[inside] = now.value / min(value, log.best()[1]) - 1.0
    least = rise.reshape(2, d).min(axis=0)
    answers = [False if each < AS_WELL else True if each > WORSE else None for each in least]
    return dict(zip(space.names, answers, strict=True))


def advised(capture: Capture, recording: Recording, name: str, random: np.random.Generator) -> Recording:
    """Return a recording of an advised motion, after a rest."""
    time_s, hand_m, *_ = recording
    step_s = float(time_s[1] - time_s[0])
    paths = dict(other_motions(HandPath(time_s, hand_m), hand_m.shape[1], capture.true["length_m"]))
    at_s = np.arange(0.0, REST_S + paths[name].time_s[-1], step_s)
    moved_m = np.column_stack([np.interp(at_s - REST_S, paths[name].time_s, x) for x in paths[name].pose.T])
    return capture.recorded(at_s, moved_m, random)


def measured(seed: int, axes: int, *, bare: bool) -> dict[str, Any]:
    """Return what is named of one capture, and what an advised motion makes of it."""
    capture, (recording, *_) = drawn(seed, axes, bare=bare)
    problem = capture.problem([recording])
    fit = fitted(problem, seed)
    parts, settings = problem.parts[fit.roll], problem.settings
    shares = parts.shares(settings.older_trials_weight)
    objective = FitObjective(
        problem.model,
        fit.space,
        parts.throws,
        shares,
        settings.evaluation,
        axes == 3,
    )
    true = fit.space.chi_of(true_string(capture, problem))[0]
    start = min((true, fit.chi), key=lambda chi: objective.cost(chi[None])[0])
    answers = can_determine(objective, start)
    row: dict[str, Any] = {"seed": seed, "axes": axes, "motion": capture.true["motions"][0]}
    row |= {"markers": len(capture.places), "E_mm": 1e3 * fit.E_m}
    for what, answer in (("open", False), ("determined", True), ("between", None)):
        row[what] = {name: name in fit.undetermined for name, each in answers.items() if each is answer}
    motions = [motion for motion in fit.undetermined.values() if motion]
    if motions:
        motion = max(motions, key=motions.count)
        own = [recording, advised(capture, recording, motion, np.random.default_rng([seed, axes]))]
        with_it = fitted(capture.problem(own), seed)
        row |= {"advised": motion, "E_with_it_mm": 1e3 * with_it.E_m, "promised": {}}
        for name in (name for name, each in fit.undetermined.items() if each == motion):
            row["promised"][name] = _narrowed(name, fit, with_it)
    return row


def _narrowed(name: str, alone: StringFit, both: StringFit) -> list[Any]:
    """Return the widths of an unknown's interval, of its range, and whether it is named with both motions."""
    if name not in both.space.names:
        return []
    widths = []
    for fit in (alone, both):
        k, known = fit.space.names.index(name), fit.uncertainty
        low, high = (
            (0.0 if known.open_low[k] else known.low[k]),
            (1.0 if known.open_high[k] else known.high[k]),
        )
        widths.append(round(float(high - low), 3))
    return [*widths, name in both.undetermined]


def main(arguments: list[str] | None = None) -> None:
    """Print what was named of each drawn capture, in the plane and in space."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=numbers, required=True, help="e.g. 500-509")
    parser.add_argument("--bare", action="store_true", help="strings without a weight, a third of the time")
    given = parser.parse_args(arguments)
    for seed in given.seeds:
        for axes in (2, 3):
            print(json.dumps(measured(seed, axes, bare=given.bare)), flush=True)


if __name__ == "__main__":
    main()
