"""Rows 72 to 76 of the fault list: YAML and TOML that ask for too much, or for other files."""

import os
import time
from itertools import pairwise
from pathlib import Path

import pytest

from strandcast.arm.load import load_arm
from strandcast.config.bounded import MOST_BYTES, MOST_LEVELS, BoundError, load_toml, load_yaml
from strandcast.config.find import find_arm
from strandcast.config.load import load_experiment
from strandcast.errors import StrandcastError, StrandcastErrors
from strandcast.imports.mapping import JointMapping, load_mapping

GOOD = "string: {length_m: 0.3}\ntarget_m: [0.5, 0.5]\n"


def refusal(path: Path, text: str) -> StrandcastError:
    path.write_text(text)
    with pytest.raises(StrandcastError) as caught:
        load_experiment(path)
    return caught.value


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "experiment.yaml"


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("seed: 2001-99-99", "'2001-99-99' is not a valid timestamp"),
        ("title: 2001-01-01T99:99:99", "is not a valid timestamp"),
        ("seed: " + "9" * 6000, "999' is not a valid int"),
        ("seed: 0x" + "f" * 6000, "fff' is not a valid int"),
        ("hit_radius_m: " + "9" * 400, "is not a valid int"),
        ("seed: !!int x", "'x' is not a valid int"),
        ("seed: !!bool x", "'x' is not a valid bool"),
        ("seed: 0b_", "'0b_' is not a valid int"),
        (r'title: "\ud800"', "is not a valid str"),
        ("title: !!python/object:os.system x", "python/object:os.system"),
        ("title: !!set {a, b}", "uses the YAML tag"),
        ("title: !foo x", "uses the YAML tag !foo"),
        ("title: &a x\narm: *a", "alias"),
    ],
)
def test_a_value_that_is_none_is_refused_with_its_line(path: Path, line: str, words: str) -> None:
    error = refusal(path, GOOD + line + "\n")
    assert (error.code, error.file) == ("SC-F002", str(path))
    assert error.line in (3, 4)
    assert words in error.what
    assert len(error.message()) < 400


@pytest.mark.parametrize(
    "text",
    [
        "title: " + "[" * 20_000,
        "title: " + "[" * 20_000 + "]" * 20_000,
        "title: " + "{a: " * 20_000,
        "- " * 20_000,
        "".join(" " * level + "a:\n" for level in range(400)),
    ],
)
def test_many_levels_are_refused_at_once(path: Path, text: str) -> None:
    start_s = time.process_time()
    error = refusal(path, GOOD + text + "\n" if text.startswith("t") else text)
    assert error.code == "SC-F002"
    assert f"has more than {MOST_LEVELS} levels" in error.what
    assert time.process_time() - start_s < 10.0  # 20,000 brackets had no end in 120 s


def test_as_many_levels_as_are_allowed_can_be_read() -> None:
    for text in ("[" * MOST_LEVELS + "]" * MOST_LEVELS, "a: " + "[" * 11 + "]" * 11):
        load_yaml(text)
    with pytest.raises(BoundError, match="levels"):
        load_yaml("[" * (MOST_LEVELS + 1) + "]" * (MOST_LEVELS + 1))
    load_toml("a = " + "[" * (MOST_LEVELS - 1) + "]" * (MOST_LEVELS - 1))
    with pytest.raises(BoundError, match="levels"):
        load_toml("a = " + "[" * MOST_LEVELS + "]" * MOST_LEVELS)


def test_an_alias_bomb_is_refused(path: Path) -> None:
    names = "abcdefghi"
    lines = ["a: &a [x, x, x, x, x, x, x, x, x]"]
    lines += [f"{new}: &{new} [{', '.join([f'*{old}'] * 9)}]" for old, new in pairwise(names)]
    assert "alias" in refusal(path, "\n".join(lines)).what


def test_a_file_of_any_size_is_refused(path: Path) -> None:
    assert "larger than 128 KiB" in refusal(path, "#" * (MOST_BYTES + 1)).what
    assert "too many values" in refusal(path, "title: [" + "1," * 25_000 + "]").what
    with path.open("wb") as file:
        file.truncate(1 << 40)  # a sparse file: no disk, no memory
    with pytest.raises(StrandcastError, match="larger than"):
        load_experiment(path)


def test_a_long_value_is_shortened_in_its_message(path: Path) -> None:
    error = refusal(path, GOOD + "title: " + "x" * 100_000)
    assert isinstance(error, StrandcastErrors)
    assert error.problems[0].field == "title"
    assert len(error.message()) < 400


@pytest.mark.parametrize(
    "line",
    [
        "camera: {plane_photo: ../../secret.png}",
        "camera: {plane_photo: /etc/passwd}",
        'camera: {plane_photo: "a\\0b"}',
        "camera: {lens: '**x'}",
        "camera: {lens: .}",
        "track: {background_picture: a/../../b.png}",
        "arm: ''",
        "arm: " + "x" * 300,
    ],
)
def test_a_path_out_of_the_folder_is_no_setting(path: Path, line: str) -> None:
    assert refusal(path, GOOD + line + "\n").code == "SC-F003"


class TestArmFiles:
    """The arm's file lies in config/arms or below the experiment's folder, its URDF beside it."""

    @pytest.fixture
    def root(self, tmp_path: Path, project_root: Path) -> Path:
        for folder in ("config/arms", "data/mine/arms", "outside"):
            (tmp_path / folder).mkdir(parents=True)
            for name in ("planar3.toml", "planar3.urdf"):
                (tmp_path / folder / name).write_bytes((project_root / "config/arms" / name).read_bytes())
        return tmp_path

    def find(self, root: Path, arm: str) -> Path:
        file = root / "data/mine/experiment.yaml"
        file.write_text(GOOD + f"arm: {arm}\n")
        return find_arm(load_experiment(file), file, root)

    def test_both_folders_are_searched(self, root: Path) -> None:
        assert self.find(root, "planar3") == root / "config/arms/planar3.toml"
        assert load_arm(self.find(root, "arms/planar3.toml")).planar().name == "planar3"

    @pytest.mark.parametrize(
        "arm", ["../../../outside/planar3.toml", "{root}/outside/planar3.toml", "link.toml"]
    )
    def test_no_other_file_is_opened(self, root: Path, arm: str) -> None:
        (root / "data/mine/link.toml").symlink_to(root / "outside/planar3.toml")
        with pytest.raises(StrandcastError, match="SC-F010") as caught:
            self.find(root, arm.replace("../../../", "../../").format(root=root))
        assert caught.value.field == "arm"
        assert str(root / "outside") in caught.value.what

    def test_a_name_leads_nowhere_else(self, root: Path) -> None:
        with pytest.raises(StrandcastError, match="SC-F010"):
            self.find(root, "../../outside/planar3")
        with pytest.raises(StrandcastError, match="SC-F001"):
            self.find(root, '"a\\0b"')

    @pytest.mark.parametrize("urdf", ["../../outside/planar3.urdf", "/etc/passwd", "a\\u0000", "link.urdf"])
    def test_the_urdf_lies_beside_it(self, root: Path, urdf: str) -> None:
        path = root / "config/arms/planar3.toml"
        (path.parent / "link.urdf").symlink_to(root / "outside/planar3.urdf")
        path.write_text(path.read_text().replace('"planar3.urdf"', f'"{urdf}"'))
        with pytest.raises(StrandcastError, match="SC-F010") as caught:
            load_arm(path).planar()
        assert caught.value.field == "urdf"

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("a = " + "[" * 60_000, "levels"),
            ("a." * 60_000 + "a = 1", "dots"),
            ("a = " + "9" * 6000, "4300 digits"),
            ("#" * (MOST_BYTES + 1), "larger than"),
            ("a." * 900 + "a = 1", "levels"),
            ("a = 2001-99-99", "is not TOML"),
        ],
    )
    def test_hostile_toml_is_refused(self, tmp_path: Path, text: str, words: str) -> None:
        for path, read, code in (
            (tmp_path / "arm.toml", load_arm, "SC-F002"),
            (tmp_path / "columns.toml", lambda path: load_mapping(path, JointMapping), "SC-I011"),
        ):
            path.write_text(text)
            with pytest.raises(StrandcastError, match=code) as caught:
                read(path)
            assert words in caught.value.what

    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ('velocity="10"', 'velocity="ten"', "'ten' is not a number"),
            ("<robot", "<a>" * 100 + "<robot", "is not XML"),
            ("</robot>", "<a>" * 100 + "</a>" * 100 + "</robot>", "levels"),
            ("</robot>", "</robot>" + " " * (9 << 20), "larger than 8 MiB"),
            ("<?xml", '<?xml encoding="no-such"', "is not XML"),
        ],
    )
    def test_a_hostile_urdf_is_refused(self, root: Path, old: str, new: str, words: str) -> None:
        path = root / "config/arms/planar3.urdf"
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))
        with pytest.raises(StrandcastError, match="SC-F202") as caught:
            load_arm(path.with_suffix(".toml")).planar()
        assert words in caught.value.what


@pytest.mark.parametrize(
    "text", ["time: 2001-99-99", "time: &a [*a]", "- " * 300, "time: !!python/name:os.system"]
)
def test_a_hostile_mapping_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "columns.yaml"
    path.write_text(text)
    with pytest.raises(StrandcastError, match="SC-I011"):
        load_mapping(path, JointMapping)


def test_a_pipe_is_not_read(tmp_path: Path) -> None:
    for name in ("arm.toml", "columns.yaml"):
        os.mkfifo(tmp_path / name)
    with pytest.raises(StrandcastError, match="SC-F001"):
        load_arm(tmp_path / "arm.toml").planar()
    with pytest.raises(StrandcastError, match="SC-I011"):
        load_mapping(tmp_path / "columns.yaml", JointMapping)
