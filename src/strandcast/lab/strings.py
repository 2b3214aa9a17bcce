"""Strings 1–7 of the paper by name, and strings of the user's own making."""

from __future__ import annotations

from dataclasses import dataclass

from strandcast.errors import StrandcastError
from strandcast.experiment import Experiment

CLAY_KG = 0.010
PIPE_KG = 0.0015
# Bending is damped in proportion to its stiffness: the time constant of a joint's own relaxation.
DAMPING_TIME_S = 0.01


@dataclass(frozen=True)
class Thread:
    """A string as it is: uniform, inextensible, with weights and pipes on it.

    Attributes
    ----------
    length_m
        Free length beyond the clamp [m].
    linear_density_kg_m, bending_stiffness_n_m2, curl_rad_m, diameter_m
        Of the bare string; curl is the curvature that it takes when nothing pulls at it.
    weights
        (place [m], mass [kg]) each.
    pipes
        (from [m], to [m], mass [kg]) each; a pipe does not bend.
    damping_time_s
        Bending damping over bending stiffness [s].
    """

    length_m: float
    linear_density_kg_m: float
    bending_stiffness_n_m2: float
    curl_rad_m: float
    diameter_m: float
    weights: tuple[tuple[float, float], ...] = ()
    pipes: tuple[tuple[float, float, float], ...] = ()
    damping_time_s: float = DAMPING_TIME_S

    def shifted(self, more_m: float) -> Thread:
        """Return the string with `more_m` more of it hanging out of the clamp."""
        return Thread(
            self.length_m + more_m,
            self.linear_density_kg_m,
            self.bending_stiffness_n_m2,
            self.curl_rad_m,
            self.diameter_m,
            tuple((place + more_m, mass) for place, mass in self.weights),
            tuple((start + more_m, end + more_m, mass) for start, end, mass in self.pipes),
            self.damping_time_s,
        )


# The paper gives lengths and what hangs on the strings; density, stiffness and curl are ours, and so are the
# places of weights and pipes (Table 4's indices cannot be matched to millimetres with certainty).
PAPER_STRINGS = {
    "paper-1": Thread(0.30, 0.003, 0.6e-6, 2.5, 0.0024, ((0.300, CLAY_KG),)),
    "paper-2": Thread(0.30, 0.005, 1.5e-6, 2.0, 0.0030, ((0.110, CLAY_KG),)),
    "paper-3": Thread(0.30, 0.009, 4.0e-6, 2.5, 0.0040, ((0.150, CLAY_KG),)),
    "paper-4": Thread(0.51, 0.004, 1.0e-6, 3.0, 0.0027, ((0.400, CLAY_KG), (0.510, CLAY_KG))),
    "paper-5": Thread(0.51, 0.005, 1.5e-6, 2.5, 0.0030, ((0.170, CLAY_KG),), ((0.370, 0.440, PIPE_KG),)),
    "paper-6": Thread(0.51, 0.007, 2.6e-6, 2.0, 0.0036, (), ((0.400, 0.500, 0.0025),)),
    "paper-7": Thread(0.61, 0.006, 2.0e-6, 2.5, 0.0033, ((0.290, CLAY_KG),)),
}
TOLERANCE_M = 1e-6


def thread_of(experiment: Experiment) -> Thread:
    """Return the string that the lab throws in an experiment.

    Raises
    ------
    StrandcastError
        SC-L001 not a lab experiment, SC-L003 the string has another length than the experiment says.
    """
    if experiment.lab is None:
        raise StrandcastError(
            "SC-L001",
            "the experiment has no virtual rig",
            field="lab",
            fix="add a `lab:` section, or throw on the real arm",
        )
    chosen, known = experiment.lab.string, experiment.string
    if not isinstance(chosen, str):
        weights = tuple((w.place_m, CLAY_KG if w.mass_kg is None else w.mass_kg) for w in known.weights)
        pipes = tuple((s.from_m, s.to_m, PIPE_KG) for s in known.stiff_sections)
        return Thread(known.length_m, **chosen.model_dump(), weights=weights, pipes=pipes)
    thread = PAPER_STRINGS[chosen]
    if abs(thread.length_m - known.length_m) > TOLERANCE_M:
        raise StrandcastError(
            "SC-L003",
            f"{chosen} is {thread.length_m} m long, the experiment says {known.length_m} m",
            field="string.length_m",
            fix=f"give length_m: {thread.length_m}, or another lab.string",
        )
    return thread
