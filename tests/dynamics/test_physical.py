"""`strandcast.simulate`: strings by what can be measured, against statics, a pendulum and each other."""

import re
from math import pi, sqrt
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import brentq
from typer.testing import CliRunner

import strandcast
from strandcast.cli.app import app
from strandcast.dynamics.physical import MATERIALS
from strandcast.errors import StrandcastError

PAGE = "docs/how-to/simulate-a-string.md"
TIME_S = np.linspace(0.0, 1.0, 101)
STILL, LATE = np.zeros((101, 2)), TIME_S[:, None] > 0.5
ALONG_IT = {"place_m": np.zeros((101, 3)), "rest_curl_rad_m": 1.0, "curl_towards": [0, 0, 1]}
# A stiff string does not stay in the plane of such clamps.
ARCHED = {"length_m": 1.0, "far_place_m": STILL + np.array([0.5, 0.0])}
ARCHED |= {"direction": [0.0, 1.0], "far_direction": [0.0, 1.0], "material": "cable"}
# From rest, so that an acceleration begins gently.
SHAKEN = np.column_stack([0.1 * np.clip(TIME_S / 0.3, 0, 1) ** 2 * np.sin(9.0 * TIME_S), 0.0 * TIME_S])


def test_a_weight_on_a_line_swings_like_a_pendulum():
    time_s = np.linspace(0.0, 6.0, 1201)
    pushed = np.zeros((1201, 2))
    pushed[:, 0] = 0.01 * np.clip(time_s / 0.2, 0.0, 1.0)
    tip = strandcast.simulate(
        time_s, pushed, length_m=0.5, material="fishing line", bending_n_m2=0.0, weights=[(0.5, 0.05)]
    )[:, -1, 0]
    swing = tip[time_s > 0.5] - 0.01
    crossed = np.flatnonzero(np.diff(np.sign(swing)) > 0)
    exact = [k - swing[k] / (swing[k + 1] - swing[k]) for k in crossed]
    assert np.mean(np.diff(exact)) * 0.005 == pytest.approx(2 * pi * sqrt(0.5 / 9.81), rel=2e-3)


def test_a_clamped_rod_bends_by_its_weight():
    length, mass, stiff = 0.3, 0.02, 0.05
    tip = strandcast.simulate(
        TIME_S, STILL, length_m=length, mass_kg_m=mass, bending_n_m2=stiff, direction=[1.0, 0.0]
    )[-1, -1]
    assert -tip[1] == pytest.approx(mass * 9.81 * length**4 / (8 * stiff), rel=0.01)


@pytest.mark.parametrize("axes", [2, 3])
def test_a_chain_between_two_ends_is_a_catenary(axes):
    length, span = 1.0, 0.7
    a = brentq(lambda a: 2 * a * np.sinh(span / (2 * a)) - length, 0.05, 10.0)
    near, far = np.zeros((101, axes)), np.zeros((101, axes))
    far[:, 0] = span
    points = strandcast.simulate(TIME_S, near, length_m=length, material="chain", far_place_m=far)
    assert points.shape == (101, 41, axes)
    assert -points[:, :, -1].min() == pytest.approx(a * (np.cosh(span / (2 * a)) - 1.0), rel=2e-3)
    assert points[:, -1] == pytest.approx(far)


def test_the_same_string_in_the_plane_and_in_space():
    upright = np.column_stack([SHAKEN[:, 0], 0.0 * TIME_S, SHAKEN[:, 1]])
    flat = strandcast.simulate(TIME_S, SHAKEN, length_m=0.4)
    spatial = strandcast.simulate(TIME_S, upright, length_m=0.4)
    assert spatial[..., ::2] == pytest.approx(flat, abs=1e-6)
    curled = {"length_m": 0.4, "rest_curl_rad_m": 2.0, "material": "cable"}
    flat = strandcast.simulate(TIME_S, STILL, **curled, direction=[0.0, -1.0])
    assert flat[0, -1, 0] > 0.02
    for towards in ([1.0, 0.0, 0.0], [0.6, 0.8, 0.0]):  # a curl to the left of what hangs is along x
        spatial = strandcast.simulate(
            TIME_S, 0.0 * upright, **curled, direction=[0.0, 0.0, -1.0], curl_towards=towards
        )
        turned = np.column_stack([flat[0, :, :1] * towards[:2], flat[0, :, 1]])
        assert spatial[0] == pytest.approx(turned, abs=1e-6)


def test_a_curled_string_without_weight_is_an_arc():
    curl, length = 3.0, 0.4
    how = {"length_m": length, "material": "cable", "rest_curl_rad_m": curl, "gravity_m_s2": 1e-6}
    end = np.array([np.sin(curl * length), 1.0 - np.cos(curl * length)]) / curl
    loose = strandcast.simulate(TIME_S, STILL, **how, points=10, direction=[1.0, 0.0])
    assert loose[0, -1] == pytest.approx(end, abs=3e-4)
    back = -np.array([np.cos(curl * length), np.sin(curl * length)])
    held = strandcast.simulate(
        TIME_S, STILL, **how, direction=[1.0, 0.0], far_place_m=STILL + end, far_direction=back
    )
    assert held[0, 20] == pytest.approx(np.array([np.sin(0.6), 1.0 - np.cos(0.6)]) / curl, abs=3e-4)


def test_a_curled_string_between_two_ends_stays_in_its_plane():
    far = SHAKEN + np.array([0.25, 0.0])
    how = {"direction": [0.0, -1.0], "far_direction": [0.0, -1.0], "material": "cable"}
    points = strandcast.simulate(TIME_S, SHAKEN, length_m=0.4, far_place_m=far, rest_curl_rad_m=2.0, **how)
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=2)
    assert lengths == pytest.approx(np.full((101, 40), 0.01), rel=0.02)


def test_many_strings_are_each_what_one_is():
    masses = np.array([0.004, 0.02])
    both = strandcast.simulate(TIME_S, SHAKEN, length_m=0.4, mass_kg_m=masses, weights=[(0.3, masses)])
    paths = np.stack([SHAKEN, 0.5 * SHAKEN])
    moved = strandcast.simulate(TIME_S, paths, length_m=0.4)
    for k in range(2):
        given = {"mass_kg_m": masses[k], "weights": [(0.3, masses[k])]}
        assert both[k] == pytest.approx(strandcast.simulate(TIME_S, SHAKEN, length_m=0.4, **given), abs=1e-9)
        assert moved[k] == pytest.approx(strandcast.simulate(TIME_S, paths[k], length_m=0.4), abs=1e-9)


def test_a_string_that_fails_is_missing_among_others():
    both = strandcast.simulate(TIME_S, STILL, **ARCHED, bending_n_m2=[1e-6, 1.3e-3])
    assert np.isnan(both).all(axis=(1, 2, 3)).tolist() == [False, True]


def test_results_at_other_times():
    every = strandcast.simulate(TIME_S, SHAKEN, length_m=0.4)
    assert strandcast.simulate(TIME_S, SHAKEN, length_m=0.4, out_time_s=TIME_S[[20, 70]]) == pytest.approx(
        every[[20, 70]], abs=1e-9
    )


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"length_m": -1.0}, "length_m: -1.0 cannot be"),
        ({"length_m": [0.4, 0.5]}, "length_m: (.*\n)*.*one number for all"),
        ({"length_m": 60.0}, "length_m: 60 m is too long"),
        ({"gravity_m_s2": 0.0}, "gravity_m_s2: 0.0 cannot be"),
        ({"mass_kg_m": "light"}, "mass_kg_m: 'light' cannot be"),
        ({"weights": (0.4, 0.01)}, "weights: (.*\n)*.*pairs of place and mass"),
        ({"material": "silk"}, "material: 'silk' is not known"),
        ({"points": 2}, "points: 2 cannot be"),
        ({"weights": [(0.7, 0.1)]}, "weights: a weight is beside"),
        ({"mass_kg_m": [0.1, np.nan]}, "mass_kg_m: .* cannot be"),
        ({"mass_kg_m": [0.1, 0.2], "diameter_m": [0.1] * 3}, "arrays for 2 and 3 strings"),
        ({"direction": [1.0, 0.0, 0.0]}, r"direction: its shape is \(3,\)"),
        ({"far_place_m": SHAKEN + np.array([0.6, 0.0])}, "far_place_m: at .* the ends are 0.7 m apart"),
        ({"direction": [0.0, 0.0]}, "direction: it has no length"),
        ({"far_place_m": SHAKEN, "direction": [1.0, 0.0]}, "far_direction: only one end is clamped"),
        ({"out_time_s": [-1.0, 0.5]}, "out_time_s: times decrease, or precede"),
        ({"time_s": TIME_S[::-1]}, "time_s: times do not increase"),
        ({"place_m": STILL[:5]}, "place_m: its shape is"),
        ({"place_m": [[0.0, 0.0], [1.0]]}, "place_m: it is no array of numbers"),
        ({"place_m": np.zeros((101, 3)), "rest_curl_rad_m": 1.0}, "curl_towards: None does not say"),
        (ALONG_IT, r"curl_towards: \[0, 0, 1\] does not say"),
        ({"direction": np.where(LATE, [0.0, 1.0], [0.0, -1.0])}, "direction: it turns by 3.14"),
        ({"far_direction": [1.0, 0.0]}, "far_place_m: it is not given"),
        (ARCHED, "leaves the plane"),
        ({"place_m": np.where(LATE, [1.0, 0.0], 0.0)}, "place_m: it moves at 100 m/s after 0.5 s"),
    ],
)
def test_what_cannot_be_is_named(changed, message):
    with pytest.raises(StrandcastError, match=message):
        strandcast.simulate(**{"time_s": TIME_S, "place_m": STILL, "length_m": 0.4} | changed)


def test_the_page_runs_as_printed(project_root: Path):
    [code] = re.findall(r"```python\n(.*?)```", (project_root / PAGE).read_text(), re.DOTALL)
    names: dict[str, np.ndarray] = {}
    exec(code, names)
    assert names["points_m"].shape == (241, 41, 2)


@pytest.mark.parametrize("name", MATERIALS)
def test_the_page_has_the_materials_numbers(name, project_root: Path):
    material, page = MATERIALS[name], (project_root / PAGE).read_text()
    [cells] = re.findall(rf"^\| `{name}`.*?\| (.*) \| (.*) \| (.*) \|$", page, re.MULTILINE)
    stiff = float(re.sub(r" · 10⁻(\S)", lambda found: "e-" + str("⁰¹²³⁴⁵⁶⁷⁸⁹".index(found[1])), cells[2]))
    assert float(cells[0]) == pytest.approx(1e3 * material.diameter_m)
    area = pi * material.diameter_m**2 / 4
    assert float(cells[1]) == pytest.approx(1e3 * material.density_kg_m3 * area, rel=0.03)
    assert stiff == pytest.approx(material.bending_pa * area * material.diameter_m**2 / 16, rel=0.03)


def test_a_path_in_a_file_gives_a_table(tmp_path: Path):
    path, out = tmp_path / "path.csv", tmp_path / "out.csv"
    pd.DataFrame({"time_s": TIME_S, "x_m": SHAKEN[:, 0], "y_m": 0.0}).to_csv(path, index=False)
    line = ["simulate", str(path), "--length", "0.4", "--weight", "0.4:0.01", "--out", str(out), "--json"]
    run = CliRunner().invoke(app, line)
    assert run.exit_code == 0, run.output
    table = pd.read_csv(out)
    expected = strandcast.simulate(TIME_S, SHAKEN, length_m=0.4, weights=[(0.4, 0.01)])
    assert table[["x_m", "y_m"]].to_numpy() == pytest.approx(expected.reshape(-1, 2), abs=1e-5)
    assert table["time_s"].nunique() == 101
    two = CliRunner().invoke(app, [*line, "--rate", "0.1"])
    assert (two.exit_code, len(pd.read_csv(out))) == (0, 41)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s,x_m,y_m\n0,0,0\n0.1,,0\n", "SC-I025.*path.csv:3"),
        ("time_s,x_m,y_m\n0,0,0\n,0,0\n", "SC-I025.*path.csv:3"),
        ("time_s,x_m,y_m,far_y_m\n0,0,0,0\n0.1,0,0,0\n", "SC-I004.*far_x_m"),
        ("time_s,x_m,y_m,far_z_m\n0,0,0,0\n0.1,0,0,0\n", "SC-I004.*z_m"),
        ("time_s,x_m,y_m,far_x,far_y\n0,0,0,0,0\n0.1,0,0,0,0\n", "not far_x"),
    ],
)
def test_a_path_that_cannot_be_read_is_refused(tmp_path: Path, text: str, message: str):
    path = tmp_path / "path.csv"
    path.write_text(text)
    line = ["simulate", str(path), "--length", "0.4", "--out", str(tmp_path / "out.csv")]
    run = CliRunner().invoke(app, line)
    assert re.search(message, f"{run.exception} {run.output}"), f"{run.exception} {run.output}"
    assert not (tmp_path / "out.csv").exists()


def test_the_path_is_not_overwritten(tmp_path: Path):
    path = tmp_path / "path.csv"
    path.write_text("time_s,x_m,y_m\n0,0,0\n0.1,0,0\n")
    assert CliRunner().invoke(app, ["simulate", str(path), "--length", "0.4", "--out", str(path)]).exit_code
    assert path.read_text().startswith("time_s,x_m,y_m")
