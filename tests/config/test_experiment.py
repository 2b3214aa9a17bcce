"""experiment.yaml: all errors are reported at once, each with line, field and suggestion."""

import textwrap

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strandcast.config.camera import LENS
from strandcast.config.experiment import Experiment
from strandcast.config.find import find_arm, find_experiment
from strandcast.config.load import load_experiment
from strandcast.config.schema import json_schema
from strandcast.errors import StrandcastError, StrandcastErrors

GOOD = """\
string:
  length_m: 0.3
target_m: [0.5, 0.5]
"""


def load(tmp_path, text: str) -> Experiment:
    path = tmp_path / "experiment.yaml"
    path.write_text(textwrap.dedent(text))
    return load_experiment(path)


def problems(tmp_path, text: str) -> list[StrandcastError]:
    with pytest.raises(StrandcastErrors) as caught:
        load(tmp_path, text)
    return caught.value.problems


def test_a_minimal_experiment_has_defaults(tmp_path):
    experiment = load(tmp_path, GOOD)
    assert experiment.string.n == 10
    assert experiment.hit_radius_m == 0.02
    assert experiment.lab is None
    assert load(tmp_path, GOOD.replace("0.3", "0.51")).string.n == 17
    assert load(tmp_path, GOOD.replace("0.3", "0.61")).string.n == 20


def test_only_what_aims_needs_a_target(tmp_path):
    captured = load(tmp_path, GOOD.replace("target_m: [0.5, 0.5]\n", ""))
    assert captured.target_m is None
    assert captured.aim is None
    for aims, who in (("lab: {}\n", "the lab"), ("objective: {kind: swing, height_m: 1}\n", "the objective")):
        (missing,) = problems(tmp_path, GOOD.replace("target_m: [0.5, 0.5]\n", aims))
        assert (missing.field, missing.what) == ("target_m", f"{who} needs a target")
        assert "[x, y, z]" in str(missing.fix)


def test_camera_is_short_for_the_camera_main(tmp_path):
    one = load(tmp_path, GOOD + "camera: {exposure_s: 0.001}\n")
    assert one == load(tmp_path, GOOD + "cameras: {main: {exposure_s: 0.001}}\n")
    assert (one.camera_name, one.camera.exposure_s) == ("main", 0.001)
    assert load(tmp_path, GOOD).camera_name == "main"
    assert load(tmp_path, GOOD + "cameras: {side: {exposure_s: 0.001}}\n").camera_name == "side"
    with pytest.raises(StrandcastError, match="SC-F003"):
        load(tmp_path, GOOD + "camera: {}\ncameras: {side: {}}\n")


@pytest.mark.parametrize("form", ["camera: {exposure: 1}\n", "cameras: {main: {exposure: 1}}\n"])
def test_a_wrong_camera_setting_is_reported_as_it_is_written(tmp_path, form):
    (wrong,) = problems(tmp_path, GOOD + form)
    assert wrong.field == ("cameras.main" if "cameras" in form else "camera") + ".exposure"
    assert (wrong.line, wrong.fix) == (4, "did you mean 'exposure_s'?")


BARE = GOOD.replace("target_m: [0.5, 0.5]\n", "")
TWO = BARE + "cameras:\n  side: {board: {squares_x: 9}, string_offset_m: 0.02, exposure_s: 0.001}\n"


def test_of_several_cameras_each_has_its_photos_and_all_see_the_same(tmp_path):
    side, top = load(tmp_path, TWO + "  top: {string_offset_m: 0.01}\n").cameras.values()
    assert (side.lens, side.plane_photo) == ("calibration/side/lens-*.png", "calibration/side/plane.png")
    assert (top.lens, top.plane_photo) == ("calibration/top/lens-*.png", "calibration/top/plane.png")
    assert (top.board, top.string_offset_m, top.exposure_s) == (side.board, 0.01, None)
    assert load(tmp_path, TWO).camera.lens == LENS
    assert [*load(tmp_path, TWO + "  1: {}\n").cameras] == ["side", "1"]
    assert "plane_photo" not in side.model_fields_set
    named = load(tmp_path, TWO + "  top: {plane_photo: top.png}\n").cameras["top"]
    assert (named.plane_photo, named.model_fields_set >= {"plane_photo", "board"}) == ("top.png", True)


def test_what_is_wrong_in_the_first_camera_is_reported_once(tmp_path):
    wrong = TWO.replace("squares_x: 9", "squares: 9") + "  top: {}\n  left: {board: {squares: 9}}\n"
    assert [each.field for each in problems(tmp_path, wrong)] == [
        "cameras.side.board.squares",
        "cameras.left.board.squares",
    ]


@pytest.mark.parametrize(
    ("more", "field"),
    [
        ("  top: {}\ntarget_m: [0.5, 0.5]\n", "target_m"),
        ("  top: {}\ntarget_m: [0.5, 0.5]\nlab: {}\n", "cameras"),
        ("  top: {}\ntrack: {background_picture: empty.png}\n", "track.background_picture"),
        ("  logs: {}\n", "cameras.logs"),
        ("  video: {}\n", "cameras.video"),
        ("  trial-01: {}\n", "cameras.trial-01"),
        ("  top: {exposure: 1}\n", "cameras.top.exposure"),
    ],
)
def test_what_several_cameras_cannot_have_is_refused(tmp_path, more, field):
    assert [wrong.field for wrong in problems(tmp_path, TWO + more)] == [field]


def test_the_objective_is_a_point_a_segment_a_shape_or_a_swing(tmp_path):
    assert load(tmp_path, GOOD).objective.kind == "point"
    bare = GOOD.replace("target_m: [0.5, 0.5]\n", "")
    bar = load(tmp_path, bare + "objective: {kind: segment, ends_m: [[0.8, 0.2], [0.9, 0.4]]}\n")
    assert bar.target_m == pytest.approx((0.85, 0.3))
    places = "[{along_m: 0.1, at_m: [0.7, 0]}, {along_m: 0.3, at_m: [0.9, 0.1]}]"
    shape = f"objective: {{kind: shape, places: {places}}}\n"
    assert load(tmp_path, bare + shape).target_m == (0.9, 0.1)
    assert load(tmp_path, GOOD + shape).target_m == (0.5, 0.5)
    swing = load(tmp_path, GOOD + "objective: {kind: swing, height_m: 0.7}\n")
    assert swing.objective.height_m == 0.7
    (none,) = problems(tmp_path, bare + "objective: {kind: swing, height_m: 0.7}\n")
    assert none.field == "target_m"
    (both,) = problems(tmp_path, GOOD + "objective: {kind: swing, height_m: 0.7, speed_m_s: 9}\n")
    assert both.what == "give height_m or speed_m_s"
    (wrong,) = problems(tmp_path, GOOD + "objective: {kind: segmnt}\n")
    assert "'segment'" in wrong.fix


def test_all_problems_are_reported_at_once_with_their_lines(tmp_path):
    found = problems(
        tmp_path,
        """\
        string:
          length_m: 300
          lenght_m: 0.3
          weights:
            - place_m: 0.3
              mass: 0.01
        target_m: [500, 0.5]
        hit_radius_m: "0.02"
        max_trials: no
        start_string: ensembel
        estimate:
          serach: cma
          dt_s: 1
        lab: {strng: paper-1}
        """,
    )
    fixes = {(p.line, p.field): p.fix for p in found}
    assert fixes[2, "string.length_m"] == "lengths are in metres: 300 mm would be 0.3"
    assert fixes[3, "string.lenght_m"] == "did you mean 'length_m'?"
    assert fixes[6, "string.weights.0.mass"] == "did you mean 'mass_kg'?"
    assert fixes[7, "target_m.0"] == "lengths are in metres: 500 mm would be 0.5"
    assert fixes[8, "hit_radius_m"] == "write a number, without quotes"
    assert (9, "max_trials") in fixes
    assert fixes[10, "start_string"] == "did you mean 'ensemble'?"
    assert fixes[12, "estimate.serach"] == "did you mean 'search'?"
    assert fixes[13, "estimate.dt_s"] == "times are in seconds: 1 ms would be 0.001"
    assert fixes[14, "lab.strng"] == "did you mean 'string'?"
    assert len(found) == 10


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "contains no settings"),
        ("- 1\n- 2\n", "contains no settings"),
        ("string: {length_m: 0.3\n", "experiment.yaml"),
        ("string: {length_m: 0.3}\nstring: {length_m: 0.4}\n", "duplicate"),
        ("string:\n\tlength_m: 0.3\n", "experiment.yaml:2"),
        ("target_m: [0.5, 0.5]\n", "string: field required"),
        (GOOD.replace("0.3", ".nan"), "string.length_m"),
        (GOOD.replace("0.3", "yes"), "string.length_m"),
        (GOOD.replace("[0.5, 0.5]", "[0.5]"), "target_m"),
        (GOOD + "excluded: [{trial: 2}]\n", "excluded.0.reason: field required"),
        (GOOD + "plan: {duration_s: [0.9, 0.2]}\n", "plan.duration_s"),
        (GOOD + "start_string: {k_z: 3}\n", "k_z"),
        ("string: {length_m: 0.3, weights: [{place_m: 0.4}]}\ntarget_m: [0.5, 0.5]\n", "beyond the string"),
        (
            GOOD + "objective: {kind: shape, places: [{along_m: 0.5, at_m: [0.7, 0.3]}]}\n",
            "the shape's place at 0.5 m lies beyond the string's 0.3 m",
        ),
        (
            GOOD + "objective: {kind: segment, ends_m: [[0, 0], [1, 1]], least_speed_m_s: 3}\n",
            "objective.least_speed_m_s: there is no such setting\n        Fix: one of: kind, ends_m",
        ),
    ],
)
def test_bad_files_give_one_clear_message(tmp_path, text, words):
    with pytest.raises(StrandcastError) as caught:
        load(tmp_path, text)
    assert words in str(caught.value)
    assert "experiment.yaml" in str(caught.value)


def test_yaml_1_2_numbers_and_words(tmp_path):
    experiment = load(tmp_path, GOOD + "estimate: {dt_s: 1e-3}\nseed: 010\ntitle: no\n")
    assert experiment.estimate.dt_s == 0.001
    assert experiment.seed == 10
    assert experiment.title == "no"


@pytest.mark.parametrize(
    ("more", "line", "field", "fix"),
    [
        ("workspace_m: {x_m: [0, 0.4], y_m: [0, 1]}\n", 3, "target_m", "widen workspace_m"),
        ("title: x\nmin_trials: 4\nmax_trials: 3\n", 5, "min_trials", "max_trials"),
        ("objective: {direction_rad: 1}\n", 4, "objective", "kind is one of point"),
        ("objective: {kind: swng}\n", 4, "objective", "did you mean 'swing'? kind is one of point, segment"),
        (
            "title: x\nobjective: {kind: shape, places: [{along_m: 0.5, at_m: [0.7, 0.3]}]}\n",
            5,
            "objective",
            "up to string.length_m",
        ),
    ],
)
def test_contradicting_settings_give_a_line_and_a_fix(tmp_path, more, line, field, fix):
    (problem,) = problems(tmp_path, GOOD + more)
    assert (problem.line, problem.field) == (line, field)
    assert fix in problem.fix


@given(text=st.text(max_size=80))
@settings(max_examples=60, deadline=None)
def test_no_text_raises_anything_else(tmp_path_factory, text):
    path = tmp_path_factory.mktemp("any") / "experiment.yaml"
    path.write_bytes(text.encode())
    with pytest.raises(StrandcastError):
        load_experiment(path)


def test_the_shipped_schema_is_current(project_root):
    schema = (project_root / "config" / "experiment.schema.json").read_text()
    assert schema == json_schema(), "run: strandcast docs schema > config/experiment.schema.json"


def test_shipped_experiments_and_their_arms_are_valid(project_root):
    files = sorted(project_root.glob("config/ex*/*.yaml"))
    assert {path.parent.name for path in files} == {"examples", "experiments"}
    for path in files:
        assert find_arm(load_experiment(path), path, project_root).is_file()


def test_a_misspelt_experiment_gives_a_suggestion(project_root):
    with pytest.raises(StrandcastError, match="did you mean 'demo'"):
        find_experiment("dmeo", project_root)
