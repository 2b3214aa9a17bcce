"""Captures of one string with a weight and without: masses in kilograms, and one fit of both."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from tests.forked import run_module

import strandcast
from strandcast.config.estimate import EstimateSettings
from strandcast.estimation.cable_space import space_of_cable
from strandcast.estimation.throws import TrialParts
from strandcast.estimation.together import Member, _joint
from strandcast.imports.capture_mapping import CaptureMapping
from strandcast.imports.mapping import check_mapping
from strandcast.records.estimate import Estimate, WeightFit
from strandcast.stages import import_track
from strandcast.stages.estimate_record import mass_known
from strandcast.stages.run import run_stage

LENGTH_M, MASS_KG_M, WEIGHT_KG = 0.6, 0.012, 0.02
PLACES_M = (0.2, 0.4, 0.6)
MAPPING = {
    "time": "t",
    "length_unit": "m",
    "up": "z",
    "hand": {"position": ["hand"], "behind": ["behind"]},
    "markers": [{"place_m": place_m, "position": [f"m{m}"]} for m, place_m in enumerate(PLACES_M)],
}
YAML = """\
string: {{length_m: 0.6, points: 12, mass_per_length_kg_m: 0.012, weights: {weights}}}
estimate: {{evaluations: 500}}
"""


def write_capture(file: Path, weights: list[tuple[float, float]], seed: int) -> CaptureMapping:
    """Write a swing of 2 s at 60 Hz with markers off by 0.3 mm; return its mapping."""
    time_s = np.arange(0.0, 2.0, 1.0 / 60.0)
    eased = np.clip((time_s - 0.5) / 0.3, 0.0, 1.0) ** 2
    place = (
        0.12 * eased[:, None] * np.column_stack([np.sin(5.0 * time_s), np.sin(7.0 * time_s), 0.0 * time_s])
    )
    down = np.broadcast_to([0.0, 0.0, -1.0], place.shape)
    path = strandcast.simulate(
        time_s,
        place,
        length_m=LENGTH_M,
        mass_kg_m=MASS_KG_M,
        diameter_m=0.004,
        weights=weights,
        direction=down,
    )
    markers = CubicSpline(np.linspace(0.0, LENGTH_M, 41), path, axis=1)(PLACES_M)
    markers += np.random.default_rng(seed).normal(0.0, 3e-4, markers.shape)
    columns = {"t": time_s}
    for name, values in {"hand": place, "behind": place - 0.03 * down}.items():
        columns |= {f"{name}.{axis}": values[:, k] for k, axis in enumerate("xyz")}
    for m in range(len(PLACES_M)):
        columns |= {f"m{m}.{axis}": markers[:, m, k] for k, axis in enumerate("xyz")}
    np.savetxt(
        file, np.column_stack(list(columns.values())), "%.6f", ",", header=",".join(columns), comments=""
    )
    return check_mapping(MAPPING, CaptureMapping)


@pytest.fixture(scope="module")
def captured(tmp_path_factory: pytest.TempPathFactory, project_root: Path) -> Path:
    """Return a project with captures of the bare string and of the weighted one, fitted."""
    root = tmp_path_factory.mktemp("together")
    (root / "config").symlink_to(project_root / "config")
    for name, places in (("bare", []), ("loaded", [(LENGTH_M, WEIGHT_KG)])):
        data = root / "data" / name
        data.mkdir(parents=True)
        weights = "[" + ", ".join(f"{{place_m: {place}}}" for place, _ in places) + "]"
        (data / "experiment.yaml").write_text(YAML.format(weights=weights))
        mapping = write_capture(root / f"{name}.csv", places, len(places))
        import_track.run(root, name, 1, root / f"{name}.csv", mapping)
        for stage in ("register_track", "score", "estimate", "report"):
            run_stage(stage, root, name, 1)
    return root


def test_a_captured_weight_is_given_in_kilograms_with_an_interval_that_holds_it(captured):
    folder = captured / "results" / "loaded" / "trial-01"
    (weight,) = Estimate.read(folder / "estimate.json").weights
    assert weight.plain_kg == pytest.approx(MASS_KG_M * LENGTH_M / 12)
    low, high = (end if end is None else end * weight.plain_kg for end in weight.interval)
    assert low < WEIGHT_KG < high
    assert weight.words in (folder / "report.html").read_text()


def test_one_fit_of_both_knows_the_weight(captured):
    found = json.loads(run_module(captured, "strandcast", "together", "bare", "loaded", "--json").stdout)
    (weight,) = found["experiments"]["loaded"]["weights"]
    assert found["experiments"]["bare"]["weights"] == []
    assert weight["value"] * weight["plain_kg"] == pytest.approx(WEIGHT_KG, rel=0.1)
    # The string is the same, and clamped again: its curl is each experiment's own.
    assert {"bending_length", "damping_s", "air"} <= set(found["shared"])
    assert "curl_left_rad" in found["experiments"]["bare"]["unknowns"]
    assert "curl_left_rad" not in found["shared"]
    assert all(each["E_m"] < 5e-3 for each in found["experiments"].values())


def test_several_files_are_imported_as_the_next_trials(captured):
    files = ["loaded.csv", "bare.csv"]
    columns = captured / "columns.yaml"
    columns.write_text(json.dumps(MAPPING))
    line = ["strandcast", "import", "track", "loaded", "7", *files, "--columns", str(columns), "--json"]
    done = run_module(captured, *line)
    assert done.returncode == 0, done.stderr
    trials = json.loads(done.stdout)["trials"]
    assert [(each["trial"], each["samples"]) for each in trials] == [(7, 120), (8, 120)]
    for number in (7, 8):
        assert (captured / "data" / "loaded" / f"trial-{number:02d}" / "track.json").is_file()
        shutil.rmtree(captured / "data" / "loaded" / f"trial-{number:02d}")


def test_strings_of_unlike_lengths_share_nothing(captured):
    file = captured / "data" / "bare" / "experiment.yaml"
    text = file.read_text()
    file.write_text(text.replace("length_m: 0.6", "length_m: 0.7", 1))
    try:
        refused = run_module(captured, "strandcast", "together", "loaded", "bare")
    finally:
        file.write_text(text)
    assert refused.returncode
    assert "bare: its string is not that of loaded" in refused.stderr


def test_a_shared_unknown_is_the_same_number_where_ranges_differ():
    model, space = space_of_cable(LENGTH_M, two_ends=False)
    other, nothing = replace(space, bounds=0.5 * space.bounds), TrialParts((), np.zeros(0, int), 1, ())
    members = {"one": Member(nothing, space), "other": Member(nothing, other)}
    joint = _joint(members, model, EstimateSettings())
    chi = np.full((1, len(joint.space.names)), 0.3)
    one, two = (box.values(chi[:, rows])[0] for box, rows in zip(joint.boxes, joint.rows, strict=True))
    shared = joint.rows[0] == joint.rows[1]
    assert shared.any()
    np.testing.assert_array_equal(one[shared], two[shared])
    np.testing.assert_array_equal(0.5 * one[~shared], two[~shared])


@pytest.mark.parametrize(
    ("low", "high", "open_high", "agree", "known"),
    [
        (4.0, 30.0, False, True, True),
        (4.0, 40.0, False, True, False),  # more than a factor of three from its middle
        (4.0, 30.0, True, True, False),
        (4.0, 30.0, False, False, False),
    ],
)
def test_a_mass_is_known_within_a_factor_of_three(low, high, open_high, agree, known):
    space = SimpleNamespace(values=lambda chi: 10.0**chi)
    ends = {"low": np.log10([low]), "high": np.log10([high])}
    found = SimpleNamespace(**ends, open_low=[False], open_high=[open_high])
    assert mass_known(space, found, 0, agree=agree)["known"] is known


@pytest.mark.parametrize(
    ("interval", "known", "plain_kg", "words"),
    [
        (None, None, None, "12 plain points"),
        ([10.0, 15.0], True, None, "12 plain points [10 plain points, 15 plain points]"),
        ([10.0, 15.0], True, 0.01, "0.12 kg [0.1 kg, 0.15 kg]"),
        ([10.0, None], False, 0.01, "not known from these data: 0.1 kg to any mass may be true"),
        ([None, 15.0], False, 0.01, "not known from these data: nothing to 0.15 kg may be true"),
        ([10.0, 15.0], False, 0.01, "not known from these data: 0.1 kg to 0.15 kg may be true"),
    ],
)
def test_a_mass_in_words(interval, known, plain_kg, words):
    fit = WeightFit.model_construct(value=12.0, interval=interval, known=known, plain_kg=plain_kg)
    assert fit.words == words


def test_what_a_recording_does_not_tell_is_named_with_a_motion_that_does():
    record = Estimate.model_construct(
        undetermined={"air": "a faster motion", "taper": "", "damping_s": "a free swing"}
    )
    assert record.undetermined_in_words() == (
        "within a factor of three, these recordings do not determine air, taper, damping_s; "
        "a faster motion should narrow air; a free swing should narrow damping_s"
    )
    assert Estimate.model_construct(undetermined={}).undetermined_in_words() is None
