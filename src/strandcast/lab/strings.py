"""The strings of the lab: strings 1–7 of the paper by name, or given by values."""

from __future__ import annotations

from dataclasses import dataclass, replace

from strandcast.config.experiment import Experiment
from strandcast.errors import StrandcastError

CLAY_KG = 0.010
PIPE_KG = 0.0015
# Bending damping over stiffness: the relaxation time of a link joint (chosen).
DAMPING_TIME_S = 0.01


@dataclass(frozen=True)
class PhysicalString:
    """A physical string: uniform, inextensible, with weights and pipes.

    Attributes
    ----------
    length_m
        Free length beyond the clamp [m].
    linear_density_kg_m, bending_stiffness_n_m2, curl_rad_m, diameter_m
        Properties of the bare string; curl is its curvature without load.
    weights
        (position [m], mass [kg]) each.
    pipes
        (from [m], to [m], mass [kg]) each; a pipe does not bend.
    """

    length_m: float
    linear_density_kg_m: float
    bending_stiffness_n_m2: float
    curl_rad_m: float
    diameter_m: float
    weights: tuple[tuple[float, float], ...] = ()
    pipes: tuple[tuple[float, float, float], ...] = ()

    def clamped(self, length_m: float) -> PhysicalString:
        """Return the string with `length_m` of it in the clamp; places count from where it comes out."""
        free_m = self.length_m - length_m
        return replace(
            self,
            length_m=free_m,
            weights=tuple((min(place, free_m), mass) for place, mass in self.weights),
            pipes=tuple((start, min(end, free_m), mass) for start, end, mass in self.pipes),
        )

    def shifted(self, more_m: float) -> PhysicalString:
        """Return the string with `more_m` more free length below the clamp."""
        return replace(
            self,
            length_m=self.length_m + more_m,
            weights=tuple((place + more_m, mass) for place, mass in self.weights),
            pipes=tuple((start + more_m, end + more_m, mass) for start, end, mass in self.pipes),
        )


# Lengths, weights and pipes are from the paper. Density, stiffness, curl, and the positions of weights and
# pipes are chosen (Table 4's indices cannot be matched to millimetres with certainty).
PAPER_STRINGS = {
    "paper-1": PhysicalString(0.30, 0.003, 0.6e-6, 2.5, 0.0024, ((0.300, CLAY_KG),)),
    "paper-2": PhysicalString(0.30, 0.005, 1.5e-6, 2.0, 0.0030, ((0.110, CLAY_KG),)),
    "paper-3": PhysicalString(0.30, 0.009, 4.0e-6, 2.5, 0.0040, ((0.150, CLAY_KG),)),
    "paper-4": PhysicalString(0.51, 0.004, 1.0e-6, 3.0, 0.0027, ((0.400, CLAY_KG), (0.510, CLAY_KG))),
    "paper-5": PhysicalString(
        0.51, 0.005, 1.5e-6, 2.5, 0.0030, ((0.170, CLAY_KG),), ((0.370, 0.440, PIPE_KG),)
    ),
    "paper-6": PhysicalString(0.51, 0.007, 2.6e-6, 2.0, 0.0036, (), ((0.400, 0.500, 0.0025),)),
    "paper-7": PhysicalString(0.61, 0.006, 2.0e-6, 2.5, 0.0033, ((0.290, CLAY_KG),)),
}
TOLERANCE_M = 1e-6
# The lab's arm always holds a string: 50 mm of thread, 0.05 g, stand for an empty clamp.
EMPTY_CLAMP = PhysicalString(0.05, 1e-3, 1e-6, 0.0, 1e-3)


def physical_string(experiment: Experiment) -> PhysicalString:
    """Return the string of a lab experiment, with what the clamp covers.

    Raises
    ------
    StrandcastError
        SC-L003 not a lab experiment, the string's length differs from the experiment's, or it has pipes in
        space.
    """
    if experiment.lab is None:
        raise StrandcastError(
            "SC-L003",
            "the experiment has no virtual rig",
            field="lab",
            fix="add a `lab:` section, or throw on the real arm",
        )
    chosen, known = experiment.lab.string, experiment.string
    if isinstance(chosen, str):
        string = PAPER_STRINGS[chosen]
    else:
        weights = tuple((w.place_m, CLAY_KG if w.mass_kg is None else w.mass_kg) for w in known.weights)
        pipes = tuple((s.from_m, s.to_m, PIPE_KG) for s in known.stiff_sections)
        string = PhysicalString(known.length_m, **chosen.model_dump(), weights=weights, pipes=pipes)
    if abs(string.length_m - known.length_m) > TOLERANCE_M:
        raise StrandcastError(
            "SC-L003",
            f"{chosen} is {string.length_m} m long, the experiment says {known.length_m} m",
            field="string.length_m",
            fix=f"give length_m: {string.length_m}, or another lab.string",
        )
    if string.pipes and experiment.aims_in_space:
        raise StrandcastError(
            "SC-L003",
            "the string has stiff sections, and the lab's strings in space have none",
            field="lab.string",
            fix="leave string.stiff_sections out, and name a string without pipes (not paper-5, paper-6)",
        )
    return string
