"""Ablations of the paper's sections VIII-A and VIII-B: the effect of masses and of the motion on estimates.

Known strings are thrown in the lab, tracked with noise and estimated. The figures are printed to standard
output as JSON and to standard error as text; docs/explanation/claims.md explains them.
"""

import argparse
import json
import sys
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Any

import numpy as np

from strandcast.config.estimate import EstimateSettings
from strandcast.core.strings import STIFF_BEND, StringBatch
from strandcast.dynamics.masses import FREE_END, MassLayout
from strandcast.estimation.estimate import estimate_throws
from strandcast.estimation.evaluation import distances, evaluation_of_points, point_values
from strandcast.estimation.fit import StringFit
from strandcast.estimation.fit_objective import simulate_throw
from strandcast.estimation.measured import prepare
from strandcast.lab.strings import PAPER_STRINGS, PhysicalString
from strandcast_studies.evidence.figure import Figure
from strandcast_studies.evidence.lab_throws import Specimen, light, rethrown, specimen

SEEDS = 3
TARGETS_M = [(0.50, 0.50), (0.75, 0.30), (0.85, 0.45)]
AGREE_SD = 1.96
PROFILED = EstimateSettings(older_trials_weight=1.0, profiles=True)
OURS = PROFILED.model_copy(update={"profiles": False})
HANGING = PROFILED.model_copy(update={"start_shape": "hanging"})

# The true pipes; as stiff but nearly massless; as heavy but limp.
PIPES = {
    f"{name}.{kind}": (thread, stiff)
    for name in ("paper-5", "paper-6")
    for kind, thread, stiff in (
        ("pipe", PAPER_STRINGS[name], True),
        ("light_pipe", light(PAPER_STRINGS[name], 5e-5), True),
        ("limp_beads", PAPER_STRINGS[name], False),
    )
}
SAME_STRING = ("paper-1", "paper-4")

HOW = {
    "paper": OURS.model_copy(update={"search": "paper", "ranges": "paper", "forces": "paper"}),
    "papers_search": OURS.model_copy(update={"search": "paper", "forces": ["rest_curl"]}),
    "papers_ranges": OURS.model_copy(update={"ranges": "paper"}),
    "ours": PROFILED,
}

Row = dict[str, Any]


@dataclass(frozen=True)
class ModelVariant:
    """The properties that the model can fit at the points of a pipe."""

    mass: bool
    stiffness: bool

    def layout(self, layout: MassLayout) -> MassLayout:
        """Return the layout with the pipe's masses, or with negligible ones."""
        shares = layout.shares.copy()
        if not self.mass:
            shares[layout.count - layout.stiff :] *= 1e-9
        return replace(layout, shares=shares)


VARIANTS = {
    "neither": ModelVariant(False, False),
    "mass": ModelVariant(True, False),
    "stiffness": ModelVariant(False, True),
    "both": ModelVariant(True, True),
}


def fitted(
    one: Specimen,
    motions: Iterable[int],
    settings: EstimateSettings,
    seed: int,
    layout: MassLayout | None = None,
) -> StringFit:
    """Estimate the string from some of its throws, equally weighted."""
    throws, random = [one.throws[k] for k in motions], np.random.default_rng(seed)
    layout = replace(layout or one.layout, tip=FREE_END if settings.free_end else 1.0)
    plain_mass = fits_plain_mass(settings)
    return estimate_throws(throws, one.model, layout, settings, random, plain_mass=plain_mass)


def fits_plain_mass(settings: EstimateSettings) -> bool:
    """Return whether the plain points' common mass is fitted: with the paper's ranges, as in the paper."""
    return settings.ranges == "paper"


def error_m(one: Specimen, motion: int, strings: StringBatch, settings: EstimateSettings = OURS) -> float:
    """Return E (w = 0) of one throw with a string (a batch of one) [m]; infinite if the simulation failed."""
    task = prepare(one.throws[motion], one.model.places_m(), settings.start_shape).fitted()
    simulated = simulate_throw(one.model, task, strings)[0][0]
    distance = distances(task.points_m, simulated, settings.evaluation)
    return float(evaluation_of_points(point_values(distance, task.weight)))


def pipe_rows(one: Specimen, seed: int) -> list[Row]:
    """Return the fits of each of two throws with every variant, and their predictions of the other throw."""
    rows = []
    for name, variant in VARIANTS.items():
        settings = OURS.model_copy(update={"forces": ["rest_curl"] + ["stiff_bend"] * variant.stiffness})
        for motion, other in permutations(range(2)):
            fit = fitted(one, [motion], settings, seed, variant.layout(one.layout))
            values = dict(zip(fit.space.names, fit.space.values(fit.chi), strict=True))
            found = fit.best.free_masses[0, one.layout.count - one.layout.stiff :].sum()
            rows.append(
                {
                    "variant": name,
                    "E_mm": 1e3 * error_m(one, motion, fit.best),
                    "held_out_mm": 1e3 * error_m(one, other, fit.best),
                    "mass": float(found) if variant.mass else None,
                    "true_mass": one.true_pipe(),
                    "factor": float(values[STIFF_BEND]) if variant.stiffness else None,
                }
            )
    return rows


def weight_rows(one: Specimen, seed: int) -> list[Row]:
    """Return the masses estimated for equal weights, by our method, the paper's and mixtures of both."""
    motions = list(range(len(one.throws)))
    jobs = [(how, settings, [k]) for how, settings in HOW.items() for k in motions]
    jobs += [("ours_all_throws", PROFILED, motions)]
    rows = []
    for how, settings, used in jobs:
        fit = fitted(one, used, settings, seed)
        found = fit.best.free_masses[0]
        at = slice(10, 10 + len(found))
        low, high = (fit.space.values(end)[at] for end in (fit.uncertainty.low, fit.uncertainty.high))
        covered = (low <= one.true_weights()) & (one.true_weights() <= high)
        # The paper fits the plain points' mass too; only ratios to it are identifiable.
        relative = fit.best.masses[0] / fit.space.layout.plain
        plain = relative.min() if fits_plain_mass(settings) else 1.0
        rows.append(
            {
                "how": how,
                "relative": (found / plain).tolist(),
                "true": one.true_weights().tolist(),
                "covered": covered.tolist() if settings.profiles else None,
                "E_mm": float(np.mean([1e3 * error_m(one, k, fit.best, settings) for k in used])),
            }
        )
    return rows


def motion_rows(
    one: Specimen, seed: int, settings: EstimateSettings = PROFILED, truth: StringBatch | None = None
) -> list[Row]:
    """Return fits of each throw alone and of all together: parameters, uncertainties, E on every throw."""
    motions = list(range(len(one.throws)))

    def errors_mm(strings: StringBatch) -> list[float]:
        return [1e3 * error_m(one, k, strings, settings) for k in motions]

    rows = []
    for used in [*([k] for k in motions), motions]:
        fit = fitted(one, used, settings, seed)
        known, at = fit.uncertainty, slice(10 + one.layout.count)
        rows.append(
            {
                "used": used,
                "names": list(fit.space.names[at]),
                "exponent": fit.chi[at],
                "sd": known.marginal[at],
                "low": known.low[at],
                "high": known.high[at],
                "decades": known.decades[at],
                "E_mm": errors_mm(fit.best),
                "best": fit.best,
                "true": None if truth is None else fit.space.chi_of(truth)[0, at],
                "E_true_mm": None if truth is None else errors_mm(truth),
            }
        )
    return rows


def run_seed(seed: int) -> dict[str, list[Row]]:
    """Return all rows of one seed by figure name."""

    def thrown(thread: PhysicalString, targets: int, **how: Any) -> Specimen:
        return specimen(thread, TARGETS_M[:targets], np.random.default_rng(seed), **how)

    rows = {
        f"pipe.{name}": pipe_rows(thrown(thread, 2, stiff=stiff), seed)
        for name, (thread, stiff) in PIPES.items()
    }
    for name in SAME_STRING:
        one, same = thrown(PAPER_STRINGS[name], 3), thrown(PAPER_STRINGS[name], 3, scatter=0.0)
        rows[f"motion.{name}.lab"] = motion_rows(one, seed)
        rows[f"motion.{name}.lab_same_grasp"] = motion_rows(same, seed)
        truth = rows[f"motion.{name}.lab"][-1]["best"]
        own = rethrown(one, truth, np.random.default_rng(seed))
        rows[f"motion.{name}.own_model"] = motion_rows(own, seed, PROFILED, truth)
        rows[f"motion.{name}.own_model_known_start"] = motion_rows(own, seed, HANGING, truth)
        if name == "paper-4":  # with two equal weights
            rows[f"weights.{name}"] = weight_rows(one, seed)
    return rows


def spread(values: Iterable[float]) -> list[float]:
    """Return median, least and largest of the finite values."""
    known = np.array([value for value in values if np.isfinite(value)])
    return [float(np.median(known)), float(known.min()), float(known.max())]


def pipe_figures(name: str, seeds: list[list[Row]]) -> list[Figure]:
    """Return figures of a string with a pipe: the held-out error by variant of the model."""
    figures = []
    for variant in VARIANTS:
        rows = [row for rows in seeds for row in rows if row["variant"] == variant]
        detail: Row = {"fits": len(rows), "seeds": len(seeds)}
        for key in ("E_mm", "held_out_mm", "mass", "factor"):
            if rows[0][key] is not None:
                detail[key] = spread(row[key] for row in rows)
        detail["true_mass"] = rows[0]["true_mass"]
        note = "median, least and largest over seeds and motions; masses relative to a plain point"
        figures.append(
            Figure(f"{name}.{variant}", detail["held_out_mm"][0], "mm held out", None, note, detail)
        )
    return figures


def weight_figures(name: str, seeds: list[list[Row]]) -> list[Figure]:
    """Return figures of two equal weights: the ratio of their estimated masses."""
    figures = []
    for how in (*HOW, "ours_all_throws"):
        rows = [row for rows in seeds for row in rows if row["how"] == how]
        found = np.array([row["relative"] for row in rows])
        ratio = np.maximum(found[:, 0], found[:, 1]) / np.minimum(found[:, 0], found[:, 1])
        detail: Row = {"fits": len(rows), "seeds": len(seeds), "larger_to_smaller": spread(ratio)}
        detail["E_mm"] = spread(row["E_mm"] for row in rows)
        for k, true in enumerate(rows[0]["true"]):
            detail[f"weight_{k + 1}"] = spread(found[:, k])
            detail[f"weight_{k + 1}_true"] = true
        if rows[0]["covered"] is not None:
            detail["truth_within_profile"] = float(np.mean([row["covered"] for row in rows]))
        figures.append(Figure(f"{name}.{how}", spread(ratio)[0], "larger to smaller", None, "", detail))
    return figures


def motion_figures(name: str, seeds: list[list[Row]]) -> list[Figure]:
    """Return figures of one string from different motions: agreement of parameters, E across motions."""
    singles = [rows[:-1] for rows in seeds]
    pairs = [(a, b) for rows in singles for a, b in permutations(rows, 2)]
    names = seeds[0][0]["names"]
    apart = np.array([np.abs(a["exponent"] - b["exponent"]) for a, b in pairs])
    doubt = np.array([np.hypot(a["sd"], b["sd"]) for a, b in pairs])
    inside = np.array([(a["low"] <= b["exponent"]) & (b["exponent"] <= a["high"]) for a, b in pairs])
    apart_decades = apart * seeds[0][0]["decades"]
    parameters = {
        parameter: {
            "apart_decades": float(np.median(apart_decades[:, k])),
            "sd_decades": float(np.median([a["sd"][k] * a["decades"][k] for a, _ in pairs])),
            "agree_within_sd": float(np.mean(apart[:, k] <= AGREE_SD * doubt[:, k])),
            "within_profile": float(np.mean(inside[:, k])),
        }
        for k, parameter in enumerate(names)
    }
    count = len(singles[0])
    own = [rows[k]["E_mm"][k] for rows in singles for k in range(count)]
    other = [rows[k]["E_mm"][j] for rows in singles for k, j in permutations(range(count), 2)]
    both = [error for rows in seeds for error in rows[-1]["E_mm"]]
    detail: Row = {
        "seeds": len(seeds),
        "motions": count,
        "E_own_mm": spread(own),
        "E_other_mm": spread(other),
        "E_fitted_to_all_mm": spread(both),
        "within_profile": float(np.mean(inside)),
        "parameters": parameters,
    }
    if seeds[0][0]["true"] is not None:
        detail |= _coverage([row for rows in singles for row in rows], names)
        detail["E_true_mm"] = spread(rows[k]["E_true_mm"][k] for rows in singles for k in range(count))
    share = float(np.mean(apart <= AGREE_SD * doubt))
    note = f"pairs of motions whose estimates differ by less than {AGREE_SD} standard errors; ideally 0.95"
    return [Figure(name, share, "share of parameters", None, note, detail)]


def _coverage(rows: list[Row], names: list[str]) -> Row:
    """Return how often the truth is within the standard errors and within the profile intervals."""
    off = np.array([np.abs(row["exponent"] - row["true"]) <= AGREE_SD * row["sd"] for row in rows])
    inside = np.array([(row["low"] <= row["true"]) & (row["true"] <= row["high"]) for row in rows])
    return {
        "truth_within_sd": float(off.mean()),
        "truth_within_profile": float(inside.mean()),
        "truth_within_sd_of": dict(zip(names, off.mean(axis=0).tolist(), strict=True)),
    }


def figures(seeds: list[dict[str, list[Row]]]) -> list[Figure]:
    """Return all figures from the rows of all seeds."""
    makers = {"pipe": pipe_figures, "weights": weight_figures, "motion": motion_figures}
    found = []
    for name in seeds[0]:
        found += makers[name.partition(".")[0]](name, [rows[name] for rows in seeds])
    return found


def in_words(figure: Figure) -> str:
    """Return the figure and its ranges as a line of text."""
    detail = figure.detail or {}
    spreads = [
        f"{key} {value[0]:.3g} ({value[1]:.3g}…{value[2]:.3g})"
        for key, value in detail.items()
        if isinstance(value, list)
    ]
    return f"{figure.name:36} {figure.value:8.3g} {figure.unit}; " + ", ".join(spreads)


def main(arguments: list[str] | None = None) -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(prog="python -m strandcast_studies.evidence.claims", description=__doc__)
    parser.add_argument("--seeds", type=int, default=SEEDS, help="number of repetitions")
    parser.add_argument("--jobs", type=int, default=1, help="seeds at the same time")
    given = parser.parse_args(arguments)
    with ProcessPoolExecutor(given.jobs) as pool:
        found = figures(list(pool.map(run_seed, range(1, given.seeds + 1))))
    print("\n".join(in_words(figure) for figure in found), file=sys.stderr)
    print(json.dumps([figure.record() for figure in found], indent=2, allow_nan=False))


if __name__ == "__main__":
    main()
