"""Lineage: a file of another trial, or of inputs that have changed, is refused with both names."""

import json
import os
import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest

from strandcast.errors import StrandcastError
from strandcast.records.alignment import HAND
from strandcast.records.files import write_text
from strandcast.records.lineage import (
    Place,
    check_picture,
    content_sha256_of,
    made_by_stage,
    note_picture,
    place_of,
)
from strandcast.records.page import check_page, write_page
from strandcast.records.tables import read_table, write_table
from strandcast.records.verdict import Verdict
from strandcast.workflow.verify import verify

VERDICT = Verdict(
    experiment="demo",
    trial=1,
    target_m=[0.5, 0.5],
    hit_radius_m=0.02,
    hit=True,
    miss_m=0.004,
    miss_sigma_m=0.001,
    closest_frame=350,
    closest_robot_time_s=0.7,
    closest_m=[0.504, 0.5],
    reason=None,
)


def hand(rows=5):
    return {"source": ["seen"] * rows} | {
        name: np.arange(rows) / 8 for name in HAND.columns if name != "source"
    }


@pytest.fixture
def demo(tmp_path):
    """Return the results of two trials: a hand and the verdict that was made from it."""
    root = tmp_path / "data" / "project"  # a folder above the project may have the name of one within
    for trial in (1, 2):
        folder = root / f"results/demo/trial-0{trial}"
        with made_by_stage("align", root, []):
            write_table(folder / "hand.parquet", HAND, hand(4 + trial))
        with made_by_stage("score", root, [folder / "hand.parquet"]):
            VERDICT.model_copy(update={"miss_m": 0.004 * trial}).write(folder / "verdict.json")
            write_page(folder / "report.html", f"<p>trial {trial} -- done</p>")
    return root / "results" / "demo"


def refusal(read, *arguments):
    with pytest.raises(StrandcastError) as refused:
        read(*arguments)
    return refused.value


def test_places(tmp_path):
    def place(path):
        found = place_of(tmp_path / path)
        return found and (found.root.relative_to(tmp_path).as_posix(), *found[1:])

    assert place("a/results/demo/trial-02/track.json") == ("a", "demo", 2, False)
    assert place("a/data/demo/trial-02/run.json") == ("a", "demo", 2, True)
    assert place("a/results/demo/cameras/main.json") == ("a", "demo", 0, False)
    assert place("results/x/results/demo/summary.json") == ("results/x", "demo", 0, False)
    assert place("results/x/results/demo/motions/1f/motion.json") is None
    assert place("results/x/data/demo/rehearsal/motion.json") is None
    assert place("a/results/data/trial-02/track.json") == ("a", "data", 2, False)
    assert place("data/motions/motion.json") is None  # just a folder with that name
    assert place("elsewhere/motion.json") is None
    assert str(Place(tmp_path, "demo", 2, False)) == "demo trial 2"


def test_a_file_says_where_it_belongs_and_what_it_was_made_from(demo):
    lineage = Verdict.read(demo / "trial-02" / "verdict.json").lineage
    assert (lineage.experiment, lineage.trial, lineage.stage) == ("demo", 2, "score")
    assert list(lineage.inputs) == ["results/demo/trial-02/hand.parquet"]
    assert check_page(demo / "trial-02" / "report.html") == lineage


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("verdict.json", Verdict.read),
        ("hand.parquet", lambda path: read_table(path, HAND)),
        ("report.html", check_page),
    ],
)
def test_a_file_of_another_trial_is_refused_with_both_names(demo, name, read):
    shutil.copy(demo / "trial-02" / name, demo / "trial-01" / name)
    problem = refusal(read, demo / "trial-01" / name)
    assert (problem.code, problem.exit_code) == ("SC-R006", 4)
    assert problem.what == "is of demo trial 2, but lies in the folder of demo trial 1"


def test_a_result_of_changed_inputs_is_refused_and_one_made_again_fits(demo):
    folder = demo / "trial-01"
    write_table(folder / "hand.parquet", HAND, hand(9))
    problem = refusal(Verdict.read, folder / "verdict.json")
    assert problem.code == "SC-R007"
    assert "results/demo/trial-01/hand.parquet" in problem.what
    write_table(folder / "hand.parquet", HAND, hand(5))  # the same content, another file
    assert Verdict.read(folder / "verdict.json").hit
    (folder / "hand.parquet").unlink()  # a result may be kept without what it was made from
    assert Verdict.read(folder / "verdict.json").hit


def test_a_file_rewritten_in_the_same_size_is_hashed_again(tmp_path):
    path, hashes = tmp_path / "joints.csv", []
    for time_s, text in enumerate(("0.1", "0.2")):
        path.write_text(text)
        os.utime(path, (time_s, time_s))
        hashes.append(content_sha256_of(path))
    assert hashes[0] != hashes[1]


def test_raw_files_may_be_copied_to_another_experiment_but_not_to_another_trial(demo):
    root = demo.parents[1]
    VERDICT.write(root / "data/demo/trial-01/verdict.json")
    for place in ("other/trial-01", "demo/trial-02"):
        (root / "data" / place).mkdir(parents=True)
        shutil.copy(root / "data/demo/trial-01/verdict.json", root / "data" / place)
    assert Verdict.read(root / "data/other/trial-01/verdict.json").hit
    assert refusal(Verdict.read, root / "data/demo/trial-02/verdict.json").code == "SC-R006"


def test_a_users_own_json_among_the_raw_files_is_not_a_damaged_record(demo):
    raw = demo.parents[1] / "data/demo/trial-01"
    for name, content in (("notes", '{"camera": "Pixel 8", "gain": NaN}'), ("list", "[1]")):
        write_text(raw / f"{name}.json", content)
        write_text(raw.with_name("rehearsal") / f"{name}.json", content)
    assert verify(demo.parents[1], "demo", raw=False) == []
    write_text(raw / "run.json", "{}")
    write_text(demo / "trial-01/list.json", "[1]")
    states = [(found.file.name, found.state) for found in verify(demo.parents[1], "demo", raw=False)]
    assert states == [("list.json", "damaged"), ("run.json", "damaged")]


def test_results_that_were_copied_to_another_experiment_are_made_again(demo):
    shutil.copytree(demo, demo.parent / "other")
    problem = refusal(Verdict.read, demo.parent / "other/trial-01/verdict.json")
    assert (problem.code, problem.fix) == ("SC-R007", "make it again: strandcast run other")
    assert problem.what == "was made for demo trial 1, but lies in the folder of other trial 1"
    found = [finding for finding in verify(demo.parents[1], "other", raw=False) if finding.state != "missing"]
    assert {finding.state for finding in found} == {"outdated"}


def test_a_picture_of_another_trial_is_refused(demo):
    pictures = [demo / f"trial-0{trial}" / "strobe.webp" for trial in (1, 2)]
    with made_by_stage("track", demo.parents[1], []):
        for number, path in enumerate(pictures):
            path.write_bytes(bytes([number] * 8))
            note_picture(path)
            VERDICT.write(path.with_name("track.json"))
    lineage = Verdict.read(pictures[0].with_name("track.json")).lineage
    assert list(lineage.pictures) == ["strobe.webp"]
    check_picture(pictures[0], lineage)
    shutil.copy(pictures[1], pictures[0])
    assert refusal(check_picture, pictures[0], lineage).code == "SC-R001"


def test_every_changed_character_of_the_lineage_is_refused(demo):
    path = demo / "trial-01" / "verdict.json"
    text = path.read_text()
    for at in range(text.index('"lineage"') + 1, text.index('"experiment": "demo",\n "trial"')):
        path.write_text(text[:at] + chr(ord(text[at]) ^ 1) + text[at + 1 :])
        assert refusal(Verdict.read, path).code == "SC-R001"


def test_a_renamed_column_and_an_unknown_one_are_refused(demo):
    path = demo / "trial-01" / "hand.parquet"
    table = pq.read_table(path)
    metadata = table.schema.metadata
    names = ["X_m" if name == "x_m" else name for name in table.column_names]
    pq.write_table(table.rename_columns(names).replace_schema_metadata(metadata), path)
    assert "the file was changed" in refusal(read_table, path, HAND).what
    foreign = {key: value for key, value in metadata.items() if key != b"content_sha256"}
    pq.write_table(table.append_column("extra", table["x_m"]).replace_schema_metadata(foreign), path)
    assert refusal(read_table, path, HAND).what.startswith("unknown columns")


def test_a_changed_page_is_refused(demo):
    path = demo / "trial-01" / "report.html"
    path.write_text(path.read_text().replace("done", "gone"))
    assert refusal(check_page, path).code == "SC-R001"
    path.write_text("<p>from before</p>")
    assert refusal(check_page, path).code == "SC-R001"


def test_a_comment_cannot_end_early(demo):
    end = (demo / "trial-01" / "report.html").read_text().split("<!-- strandcast ")[1]
    assert end.count("--") == 1
    assert json.loads(end.removesuffix(" -->\n"))["lineage"]["trial"] == 1
