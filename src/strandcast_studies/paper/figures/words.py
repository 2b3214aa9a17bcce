"""Open or contradictory points of the paper, and how each method interprets them here."""

from strandcast.estimation.evaluation import W
from strandcast.estimation.optimisers.paper import BETA, CHI_0
from strandcast.report.numbers import UNKNOWN
from strandcast.report.panels.content import PanelContent, Table
from strandcast_studies.paper.figures.counts import NAMES
from strandcast_studies.paper.report.facts import PaperFacts
from strandcast_studies.paper.report.summary import METHODS

# Place; what the paper says; our interpretation. {name} stands for the setting: paper's method / default.
READINGS = (
    ("Eq. 4", "pairs x_r with y_s", "misprint: x_r − x_s and y_r − y_s"),
    (
        "Eqs. 5, 6",
        "no index over frames; h images, n points; weight w not given",
        "d averaged over frames, then E_i over points; the hand, point 0, is not among them; w = "
        f"{W}; every reported E has w = 0",
    ),
    (
        "Section VI",
        "images are “centred on the grasping point”",
        "“paper”: E relative to the hand; ours: in the world",
    ),
    (
        "Section VI",
        "h, “the total number of images taken”",
        "frames up to this time after the closest approach [s]: {estimate.horizon_s}; – is the whole motion",
    ),
    (
        "Section VI",
        "“actual motion of the robot arm”, yet “the profile of each joint obtained from the simulation”",
        "measured joints in the estimate; “paper” plans with commanded ones, ours with the servo",
    ),
    ("Section VI", "which manipulations are used in the estimate", "trials: {estimate.trials}"),
    ("Section VI", "the string’s shape at the start is not mentioned", "{estimate.start_shape}"),
    (
        "Section VI",
        "“a specified number of iterations”, not given",
        "simulated strings: {estimate.evaluations}",
    ),
    (
        "Eq. 3",
        "χ_best is “from the previous manipulation”: fixed while searching, or the running best?",
        "search: {estimate.search}; centre: the running best, as the fixed one is much worse",
    ),
    (
        "Eq. 3",
        "χ₀, β, what m counts",
        f"χ₀ = {CHI_0}, β = {BETA}, m counts strings; M the trials so far; the "
        "first centre is χ = 0, the minima that planned the throw",
    ),
    (
        "Sections IV-B, VII-A",
        "first motion planned with “a random string”, and with the ranges’ minima",
        "{start_string}",
    ),
    (
        "Table 2",
        "“per kg”",
        "accelerations are forces over relative masses: coefficients are per kg of one plain point",
    ),
    (
        "Table 2",
        "k_ph in Nms/rad/kg, C_c1 and C_c2 in Nm/s/kg",
        "k_ph in Nm/rad/kg, C_c1 in 1/s, C_c2 in 1/m: what a spring and a drag have",
    ),
    (
        "Table 2",
        "no range of masses",
        "ranges: {estimate.ranges}; “paper” has masses of 1 to 20, the range of Table 4",
    ),
    (
        "Table 4",
        "“others” are 1.0, 4.3 or 11",
        "only ratios are identifiable; the paper’s search fits the plain points’ mass, and we divide by it",
    ),
    (
        "Fig. 1",
        "k_h, c_h in compression, k_sh, c_sh in tension; the figure is not available to us",
        "a bend that grows takes h, one that straightens sh",
    ),
    (
        "Section VI",
        "“Euler’s method”, step not given",
        "leapfrog with implicit dampers, {estimate.dt_s} s; explicit Euler needs steps of microseconds in a "
        "corner of Table 2",
    ),
    (
        "Section IV",
        "number of mass points not given",
        "one every 30 mm, as Table 4’s m10 at the tip of 300 mm suggests",
    ),
    (
        "Eq. 1",
        "V_0, the last V, α and N not given",
        "V_0 = 0, α up to ± 60 rad/s², 6 free heights; “paper” leaves the end free and "
        "appends a stop ramp, in which hits count",
    ),
    (
        "Section V-B",
        "“± 0.5 rad/s of their previous position”: of the last motion, or of the last try?",
        "method: {method}; “paper” changes the last thrown motion",
    ),
    (
        "Section V",
        "what if no simulated motion hits?",
        "random motions: {plan.evaluations}; then the nearest is thrown and flagged",
    ),
    ("Section V-C", "hit tolerance, size of the target", "hit radius {hit_radius_m} m for the tip’s path"),
    ("Fig. 6", "five targets in the text, four in Fig. 5; one place is printed", "targets 2 to 5 are ours"),
    ("Fig. 5, text", "pipes on strings 5 and 6, or on 6 and 7", "5 and 6, as in Fig. 5 and Table 4"),
    (
        "Table 4, text",
        "all attached masses are 10 g of clay; Table 4 has none on string 6",
        "none on string 6; the pipe’s indices in text and table differ by one: the hand is 0 here",
    ),
    (
        "Table 3, Figs. 9, 10",
        "string 5: 3 repetitions, and 2; string 7: 2, and 1",
        "Table 3 counts throws, the captions retries; we count throws from 1",
    ),
    ("Everywhere", "arm, its limits, camera, light, density and stiffness of the strings", "ours: the lab’s"),
)

PLAIN = {"True": "yes", "False": "no"}


def readings(facts: PaperFacts) -> PanelContent:
    """Return the table of open points of the paper and the choices of both methods."""
    rows = [[where, says, _filled(reading, facts)] for where, says, reading in READINGS]
    tables = [Table(["place", "what the paper says", "interpretation here"], rows)]
    different = _different(facts)
    if different:
        caption = "All settings that differ between the methods; – means none."
        tables.append(Table(["setting", *(NAMES[method] for method in METHODS)], different, caption))
    return PanelContent(
        f"{len(rows)} points where the paper is open, misprinted or contradicts itself.",
        tables=tables,
    )


def _filled(reading: str, facts: PaperFacts) -> str:
    """Return an interpretation with the settings' values filled in."""
    text = reading
    for name in sorted(
        {name for settings in facts.settings.values() for name in settings}, key=len, reverse=True
    ):
        values = [facts.settings[method].get(name, UNKNOWN) for method in METHODS if method in facts.settings]
        values = [PLAIN.get(value, value) for value in values]
        text = text.replace(f"{{{name}}}", " / ".join(dict.fromkeys(values)))
    return text


def _different(facts: PaperFacts) -> list[list[str]]:
    if not all(method in facts.settings for method in METHODS):
        return []
    paper, default = (facts.settings[method] for method in METHODS)
    names = [*default, *(name for name in paper if name not in default)]
    pairs = [[name, paper.get(name, UNKNOWN), default.get(name, UNKNOWN)] for name in names]
    return [pair for pair in pairs if pair[1] != pair[2] and pair[0] not in ("title", "seed")]
