"""Settings under their old names: accepted for one version, with the line and the new name in a warning."""

from pathlib import Path

import pytest
from ruamel.yaml import YAML

from strandcast.config.estimate import EstimateSettings
from strandcast.config.fix import fix_names
from strandcast.config.load import load_experiment
from strandcast.config.renamed import MERGED, RENAMED, with_new_names
from strandcast.errors import StrandcastError
from strandcast_studies.settings_page import fields

HEAD = "string: {length_m: 0.3}\ntarget_m: [0.5, 0.5]\n"
EXAMPLE = Path(__file__).parents[2] / "config/experiments/demo.yaml"


def loaded(text: str):
    return YAML(typ="rt").load(text)


def test_old_names_and_values_are_translated_in_place():
    data = loaded("arm: x\ntrack:\n  polarity: dark\n  hand: pivot\n")
    (change,) = with_new_names(data, Path("e.yaml"))
    assert dict(data["track"]) == {"polarity": "dark", "tracker": "pendulum"}
    assert data["track"].lc.data["tracker"][0] == 3
    assert (change.line, change.what[:40]) == (3, "track.hand is now called track.tracker; ")


def test_what_was_dropped_is_left_out_with_its_line(tmp_path, caplog):
    text = EXAMPLE.read_text(encoding="utf-8")
    file = tmp_path / "demo.yaml"
    file.write_text(
        text + "\nestimate:\n  integrator: euler\n  search: cma\n  find_weights: 1\n", encoding="utf-8"
    )
    settings = load_experiment(file)
    assert settings.estimate.search == "thorough"
    expected = load_experiment(EXAMPLE)
    assert settings.model_copy(update={"estimate": expected.estimate}) == expected
    line = len(text.splitlines()) + 3
    assert f"demo.yaml:{line}: estimate.integrator was dropped" in caplog.text
    assert f"demo.yaml:{line + 2}: estimate.find_weights was dropped" in caplog.text
    assert f"demo.yaml:{line + 1}: estimate.search: cma was dropped; thorough is used" in caplog.text


def test_new_names_pass_in_silence():
    data = loaded("plan: {evaluations: 400}\n")
    assert with_new_names(data, Path("e.yaml")) == []
    assert dict(data["plan"]) == {"evaluations": 400}


@pytest.mark.parametrize("cameras", ["camera: {lens_file: a.yaml}", "cameras: {left: {lens_file: a.yaml}}"])
def test_a_setting_of_every_camera_is_translated(cameras):
    data = loaded(cameras + "\n")
    (line,) = with_new_names(data, Path("e.yaml"))
    assert line.what.startswith("cameras.*.lens_file is now called cameras.*.lens;")
    assert "'lens': 'a.yaml'" in str(data)


def test_settings_that_became_one_are_read_and_refused_twice(tmp_path, caplog):
    file = tmp_path / "e.yaml"
    file.write_text(
        HEAD + "align:\n  drift_prior: 1.0e-4\n  led: {x_m: 0.1, y_m: 0.2, latency_sd_s: 1.0e-3}\n"
    )
    align = load_experiment(file).align
    assert align.drift == (0.0, 1e-4)
    assert (align.led.place_m, align.led.latency_s) == ((0.1, 0.2), (0.0, 1e-3))
    assert (
        f"e.yaml:{len(HEAD.splitlines()) + 2}: align.drift_prior is now align.drift: [0.0, 0.0001]"
        in caplog.text
    )
    file.write_text(HEAD + "align: {drift: [0.0, 1.0e-4], known_drift: 1.0e-5}\n")
    with pytest.raises(StrandcastError, match=r"SC-F003.*align\.known_drift"):
        load_experiment(file)


def test_both_names_are_refused():
    data = loaded("track:\n  hand: pivot\n  tracker: chain\n")
    with pytest.raises(StrandcastError) as caught:
        with_new_names(data, Path("e.yaml"))
    assert (caught.value.code, caught.value.line) == ("SC-F003", 2)


def test_renamed_settings_exist_under_the_new_name_only():
    known = {path for path, _ in fields()}
    given_up = {change.old.replace(".*", "") for change in RENAMED if change.new != change.old}
    of_one = [(each, name) for each in MERGED for name in each.old if name != each.new]
    given_up |= {f"{each.section.replace('.*', '')}.{name}" for each, name in of_one}
    assert not given_up & known
    assert {change.new.replace(".*", "") for change in RENAMED if change.new} <= known


def test_the_papers_search_is_its_method(tmp_path, caplog):
    file = tmp_path / "old.yaml"
    fit = "estimate: {search: paper, reading: sign, evaluations: 900}\n"
    old = "plan: {planner: paper, use_servo: true}\n" + fit
    file.write_text(HEAD + old)
    settings = load_experiment(file)
    line = len(HEAD.splitlines())
    assert f"old.yaml:{line + 2}: estimate.search: paper is now method: paper" in caplog.text
    assert (settings.method, settings.plan.duration_s) == ("paper", (0.2, 1.2))
    given = settings.estimate
    assert (given.search, given.ranges, given.evaluation, given.evaluations) == (
        "paper",
        "paper",
        "hand",
        900,
    )


def test_readings_of_the_papers_method_are_fixed(tmp_path, caplog):
    file = tmp_path / "e.yaml"
    file.write_text(HEAD + "estimate: {free_end: false, paper: {beta: 0.9}}\nplan: {use_servo: true}\n")
    settings = load_experiment(file)
    assert settings.estimate == EstimateSettings()
    for name in ("estimate.free_end was", "estimate.paper was", "plan.use_servo was"):
        assert name in caplog.text
    assert len(caplog.records) == 3
    file.write_text(HEAD + "method: paper\n")
    assert not load_experiment(file).estimate.free_end


@pytest.mark.parametrize("newline", ["\n", "\r", "\r\r\n"])
def test_fix_counts_lines_as_yaml_does(tmp_path, newline):
    file = tmp_path / "e.yaml"
    head = f'title: "one\u2028two"\n{HEAD}'.replace("\n", newline)
    file.write_bytes(f"{head}plan: {{use_servo: true}}{newline}".encode())
    assert fix_names(file) == 1
    assert file.read_bytes().decode().startswith(head)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (
            "estimate:\n  # how it is fitted\n  find_weights: 0  # none\n  # so many\n  evaluations: 900\n",
            "estimate:\n  # how it is fitted\n  # so many\n  evaluations: 900\n",
        ),
        ("estimate:\n  integrator: euler\nseed: 3\n", "estimate:\n  {}\nseed: 3\n"),
        (
            "plan: {use_servo: true, finer: false, carry_residual: true}\n",
            "plan: {}\n",
        ),
        (
            "method: paper\nplan: {evaluations: 9, screening: 500}\n",
            "method: paper\nplan: {evaluations: 500}\n",
        ),
        ("plan: {screening: 900, duration_s: [0.4, 1]}\n", "plan: {duration_s: [0.4, 1]}\n"),
        (
            "objective:\n  kind: point\n  tolerance_rad: 0.2\n  direction_rad: 1\n",
            "objective:\n  kind: point\n  direction_rad: [1, 0.2]\n",
        ),
        ("objective: {kind: point, tolerance_rad: 0.2}\n", "objective: {kind: point}\n"),
        ("plan: {ensemble: 4}\nestimate: {ensemble: 4}\n", "plan: {}\nestimate: {}\n"),
        ("plan: {planner: ensemble, evaluations: 900}\n", "plan: {evaluations: 900}\n"),
        (
            "plan: {mesh_refinement:  true,  evaluations: 400}  # few\n",
            "plan: {evaluations: 400}  # few\n",
        ),
        ("plan:\n  scatter:\n    sway_rad: 0.1\n  evaluations: 400\n", "plan:\n  evaluations: 400\n"),
        ("estimate: {paper: {beta: 0.9}, free_end: false}\n", "estimate: {}\n"),
        ("camera: {scale: arc, exposure_s: 0.001}\n", "camera: {exposure_s: 0.001}\n"),
        (
            "camera: {board: {legacy: true}, plane: {board: {first_id: 9, x_m: 0, y_m: 0}}}\n",
            "camera: {board: {}, plane: {board: {x_m: 0, y_m: 0}}}\n",
        ),
        (
            "camera:\n  string_offset_sd_m: 0.002  # by eye\n  lens_video: calibration/board.mp4\n",
            "camera:\n  string_offset_m: [0.0, 0.002]  # by eye\n  lens: calibration/board.mp4\n",
        ),
        (
            "align:\n  led: {x_m: 0.1, radius_m: 0.02, y_m: 0.2}\n",
            "align:\n  led: {place_m: [0.1, 0.2], radius_m: 0.02}\n",
        ),
        (
            "estimate: {search: paper, reading: sign}\nplan:\n  planner: paper\n",
            "estimate: {}\nplan:\n  {}\n",
        ),
        (
            "estimate: {evaluations: 900, drag_along: false, friction_stick: true}\n",
            "estimate: {evaluations: 900, forces: [rest_curl, friction_stick]}\n",
        ),
        (
            "estimate:\n  rest_curl: true  # as ever\n  drag_along: auto\nseed: 3\n",
            "estimate:\n  {}\nseed: 3\n",
        ),
        (
            "estimate:\n  rest_curl: false  # a chain\n  dt_s: 0.002\n",
            "estimate:\n  forces: [drag_along]  # a chain\n  dt_s: 0.002\n",
        ),
        (
            "estimate:\n  clamp_offset: true\n  dt_s: 0.001\n  clamp_offset_sd_rad: null\n",
            "estimate:\n  clamp_offset_sd_rad: any\n  dt_s: 0.001\n",
        ),
        ("estimate: {clamp_offset: true}\n", "estimate: {clamp_offset_sd_rad: 0.05}\n"),
        ("estimate: {clamp_offset: false}\n", "estimate: {clamp_offset_sd_rad: 0}\n"),
        (
            "lab: {noise: 2, scatter: {sway_rad: 0.02, servo_gain: 0, drawn: true}}\n",
            "lab: {noise: {grasp_length_m: 0.004, grasp_lateral_m: 0.002, grasp_angle_rad: "
            "0.10471975511965978, sway_rad: 0.04, sway_rad_s: 0.1, joint_zero_rad: 0.002, servo_gain: 0.0, "
            "joint_log_rad: 0.001}, draws: unknown_rig}\n",
        ),
        (
            "lab:\n  string: paper-2\n  scatter:\n    sway_rad: 0.02  # seen\n  servo: pd\n",
            "lab:\n  string: paper-2\n  noise:\n    sway_rad: 0.02  # seen\n  servo: pd\n",
        ),
        (
            "lab:\n  scatter:\n    sway_rad: 0.02\n    draws: heavy_tails\n  servo: pd\n",
            "lab:\n  noise: {sway_rad: 0.02}\n  draws: heavy_tails\n  servo: pd\n",
        ),
        (
            "lab:\n  scatter:  # seen\n    draws: heavy_tails\n\n    sway_rad: 0.02\n",
            "lab:\n  noise: {sway_rad: 0.02}\n  draws: heavy_tails  # seen\n",
        ),
        ("lab:\n  scatter:\n  servo: pd\n", "lab:\n  servo: pd\n"),
        ("lab: {noise: 0.5, scatter: {draws: normal}}\n", "lab: {noise: 0.5, draws: normal}\n"),
        ("lab:\n  scatter: {}\nseed: 3\n", "lab:\n  {}\nseed: 3\n"),
        ("estimate: {search: 'cma'}\r\n", "estimate: {search: thorough}\r\n"),
    ],
)
def test_fix_writes_former_settings_as_they_are_now_and_nothing_else(tmp_path, caplog, old, new):
    file = tmp_path / "e.yaml"
    file.write_text("# A throw.\n" + HEAD + old, newline="")
    assert fix_names(file) > 0
    method = "method: paper\n" if "planner: paper" in old else ""
    assert file.read_bytes().decode() == "# A throw.\n" + method + HEAD + new
    caplog.clear()
    load_experiment(file)
    assert not caplog.text
    assert fix_names(file) == 0


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("estimate: {forces: auto, marker_shift: true}\n", r"estimate\.marker_shift"),
        (
            "lab: {draws: normal, scatter: {draws: heavy_tails}}\n",
            r"lab\.scatter is the old name",
        ),
        ("lab: {noise: {sway_rad: 0.1}, scatter: {sway_rad_s: 1}}\n", r"lab\.scatter cannot be multiplied"),
        ("target_m: 5\nestimate: {clamp_offset: true}\n", "target_m"),
        ("# no target_m\nestimate: {clamp_offset: true}\n", "does not say how far"),
        ("estimate: {clamp_offset: no}\n", "clamp_offset: no "),
        ("lab: {noise: 11, scatter: {sway_rad: 0.1}}\n", r"lab\.scatter cannot be multiplied"),
        ("lab: {scatter: {draws: normal, drawn: true}}\n", r"lab\.scatter is the old name"),
        ("method: paper\nplan: {planner: ensemble}\n", r"plan\.planner: ensemble goes by method"),
        ("method: null\nplan: {planner: paper}\n", r"plan\.planner: paper goes by method"),
        (
            "objective: {kind: point, direction_rad: [1, 0.1], tolerance_rad: 0.2}\n",
            "direction_rad",
        ),
        ("lab: {noise: {sway: 0.1}}\n", "'sway' is no size of the lab's noise; these are: grasp_length_m, "),
    ],
)
def test_what_has_no_one_meaning_is_refused(tmp_path, text, named):
    file = tmp_path / "e.yaml"
    file.write_text((HEAD if "target_m" not in text else "string: {length_m: 0.3}\n") + text)
    with pytest.raises(StrandcastError, match=f"SC-F003.*{named}"):
        load_experiment(file)


def test_a_force_of_a_capture_is_added_to_what_was_fitted(tmp_path):
    file = tmp_path / "e.yaml"
    file.write_text("string: {length_m: 0.3}\nestimate: {friction_stick: true, marker_shift: false}\n")
    assert load_experiment(file).estimate.forces == ["rest_curl", "friction_stick", "taper"]


@pytest.mark.parametrize(
    ("old", "forces"),
    [
        ("method: paper\nestimate: {drag_along: false}\n", "paper"),
        ("method: paper\nestimate: {rest_curl: true}\n", ["rest_curl"]),
        ("estimate: {drag_along: true}\n", ["rest_curl", "drag_along"]),
        ("estimate: {friction_stick: false}\n", "auto"),
    ],
)
def test_former_forces_stay_what_they_were(tmp_path, old, forces):
    file = tmp_path / "e.yaml"
    file.write_text(HEAD + old)
    assert load_experiment(file).estimate.forces == forces
