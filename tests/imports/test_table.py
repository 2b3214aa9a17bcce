import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from strandcast.errors import StrandcastError
from strandcast.imports.table import read_numbers


def table_of(tmp_path, text: str | bytes):
    path = tmp_path / "log.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_numbers(path)


def read_all(tmp_path, text: str | bytes):
    table = table_of(tmp_path, text)
    table.columns(table.names)
    return table


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_columns_by_name_whatever_the_separator(tmp_path, separator):
    table = table_of(
        tmp_path, separator.join(["t", " q[0]"]) + "\r\n" + separator.join(["1.5", "-2e-3"]) + "\r\n"
    )
    assert table.names == ["t", "q[0]"]
    np.testing.assert_array_equal(table.column("q[0]"), [-2e-3])


def test_columns_by_number_without_a_header(tmp_path):
    table = table_of(tmp_path, "1,2,3\n4,5,6\n")
    np.testing.assert_array_equal(table.columns(["1", "3"]), [[1, 3], [4, 6]])
    assert not table.has_header


def test_comments_blank_lines_bom_and_closing_separators_are_taken(tmp_path):
    table = table_of(tmp_path, "\ufeff# rig 2\nsep=,\nt,a,\n\n0,1,\n1,,\n")
    assert table.names == ["t", "a"]
    np.testing.assert_array_equal(table.column("a"), [1, np.nan])
    assert table.lines.tolist() == [5, 6]


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        pytest.param("t,q\n0,1\n0.1,2,3\n", 3, "3 cells, the header has 2", id="row31-extra-value"),
        ("t,q\n0,1\n0.1\n", 3, "1 cells, the header has 2"),
        pytest.param("t;q\n0,1;1,5\n0.2;1\n", 2, "decimal comma, and other", id="row30-decimal-comma"),
        ("t,q\n20.11.2026 12:00:01.5,0\n", 2, "neither a number nor a time as in ISO 8601"),
        ("t,q\n0,1\n0.1,abc\n", 3, "'abc' is not a number"),
        pytest.param("t,q\n0,1\n0.1,inf\n", 3, "not a finite number", id="row36-infinite"),
        pytest.param("t,q\n0,1\n0.1\0\0\0,2\n", 3, "NUL bytes from byte 11 on", id="row32-NUL"),
        (b"t,q\n0,\xff\xfe\n", 2, "'ÿþ' is not a number"),
        ('t,q\n0,1\n0.1,"2\n0.2,3\n', 3, "quotation marks do not enclose cells"),
        ('t,q\n0,"1"2\n', 2, "quotation marks do not enclose cells"),
        ('t,q\n0,"' + "1" * 140_000 + '"\n', 2, r"field limit .131072.*140004 characters"),
        ("t,q\n0," + "1" * 140_000 + "\n", 2, r"1… .140000 characters.' is not a finite number"),
        ("t," + "q" * 500 + "\n0,1\n", 1, "column's name of 500 characters"),
        ("t,q\n0,1_0\n", 2, "'1_0' is not a number"),
        ("t,q\n0,١\n", 2, "'١' is not a number"),
        ("t,q\n0,1\x0c0.1,2\n", 2, "3 cells, the header has 2"),
        pytest.param("t,q\n", None, "no rows", id="row28-header-only"),
        pytest.param("", None, "empty", id="row28-empty"),
    ],
)
def test_what_does_not_fit_is_one_message_with_the_line(tmp_path, text, line, words):
    with pytest.raises(StrandcastError, match=words) as refusal:
        read_all(tmp_path, text)
    assert refusal.value.line == line
    assert refusal.value.file.endswith("log.csv")
    assert refusal.value.fix


@pytest.mark.parametrize("separator", [";", "\t"])
def test_commas_are_decimal_where_they_do_not_separate_and_no_number_has_a_point(tmp_path, separator):
    text = "\n".join(separator.join(row) for row in (["t", "q"], ["0,1", "-1,5"], ["0,2", "1e-3"]))
    assert read_all(tmp_path, text).values.tolist() == [[0.1, -1.5], [0.2, 0.001]]
    assert read_all(tmp_path, "0,1;1,5;2,5\n0,2;1,5;2,5\n").values[1].tolist() == [0.2, 1.5, 2.5]


@pytest.mark.parametrize("form", ["{} {}", '"{}","{}"'])
def test_decimal_commas_between_blanks_and_in_quotation_marks_are_read(tmp_path, form):
    text = "".join(form.format(*row) + "\n" for row in (["t", "q"], ["0,1", "-1,5"], ["0,25", "1,25"]))
    assert table_of(tmp_path, text).values.tolist() == [[0.1, -1.5], [0.25, 1.25]]


def test_thousands_in_quotation_marks_are_no_decimals(tmp_path):
    with pytest.raises(StrandcastError, match="'1,000' has a decimal comma"):
        read_all(tmp_path, 't,q\n"0","1,000"\n"1","2,000"\n')


def test_columns_may_be_numbered_where_a_comment_names_them(tmp_path):
    table = table_of(tmp_path, "# t q1\n0.0 0.5\n0.1 0.7\n")
    assert table.column("2").tolist() == table.column("q1").tolist() == [0.5, 0.7]


@pytest.mark.parametrize("head", ["%time,frame_id,q", "# made by a recorder, 2\n# t, frame_id, q"])
def test_names_in_the_comment_above_the_rows_are_the_header(tmp_path, head):
    table = table_of(tmp_path, f"{head}\n17,world,0.5\n18,world,0.7\n")
    assert table.names[1:] == ["frame_id", "q"]
    assert table.column("q").tolist() == [0.5, 0.7]
    assert table_of(tmp_path, "# a, b\nt,q\n17,0.5\n").names == ["t", "q"]


@pytest.mark.parametrize(
    ("times", "seconds"),
    [(("59:59.998", "00:00.004"), 0.006), (("9:59:59.5", "10:00:00.5"), 1.0)],
)
def test_minutes_and_seconds_and_short_hours_are_times(tmp_path, times, seconds):
    table = table_of(tmp_path, "t,q\n" + "".join(f"{each},0\n" for each in times))
    assert np.diff(table.times("t", 1.0)).tolist() == pytest.approx([seconds])


def test_a_last_number_that_was_cut_is_left_out(tmp_path):
    rows = "t,q\n" + "".join(f"{k},0.{k:06d}\n" for k in range(12))
    table = table_of(tmp_path, rows + "12,0.28")
    assert len(table.values) == 12
    assert "line 14, the last, was cut ('0.28' has fewer decimals" in table.notes[0]
    for cut in ("142", "-142.", "0."):
        assert len(table_of(tmp_path, rows + f"12,{cut}").values) == 12
    for whole in (*(rows + f"12,{last}" for last in ("0.28\n", "0.280000", "", "0", "1e-07", "nan")),):
        assert len(table_of(tmp_path, whole).values) == 13


def test_times_of_the_day_go_on_after_midnight(tmp_path):
    table = table_of(tmp_path, "t,q\n23:59:59.5,0\nnan,0\n00:00:00.25,0\n")
    assert table.times("t", 1.0).tolist()[::2] == [86399.5, 86400.25]


def test_only_a_last_line_without_an_end_may_be_cut(tmp_path):
    table = table_of(tmp_path, "t,a\n0,1\n1,2\n2")
    assert table.values.tolist() == [[0.0, 1.0], [1.0, 2.0]]
    assert table.notes == ["line 4, the last, was cut (1 of 2 cells) and is left out"]
    assert table_of(tmp_path, "t,a\n0,1\n1,2").notes == []
    with pytest.raises(StrandcastError, match="1 cells, the header has 2"):
        table_of(tmp_path, "t,a\n0,1\n2\n")  # with its line end, it was written so
    with pytest.raises(StrandcastError, match="3 cells"):
        table_of(tmp_path, "t,a\n0,1\n1,2\n2,3,4")


def test_cells_in_quotation_marks_are_read(tmp_path):
    table = table_of(tmp_path, '"t","q, measured"\n"0",1\n0.1,"2"\n')
    assert table.names == ["t", "q, measured"]
    np.testing.assert_array_equal(table.values, [[0, 1], [0.1, 2]])


def test_a_missing_file_and_a_missing_column_are_named(tmp_path):
    with pytest.raises(StrandcastError, match="the file is missing"):
        read_numbers(tmp_path / "none.csv")
    with pytest.raises(StrandcastError, match="no column 'x'; the columns are t, q"):
        table_of(tmp_path, "t,q\n0,1\n").column("x")


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.one_of(st.binary(max_size=200), st.text("0123456789.,;-eE\n\t \"'#tq", max_size=200)))
def test_any_file_gives_a_table_or_one_clear_error(tmp_path, text):
    try:
        table = read_all(tmp_path, text)
    except StrandcastError as refusal:
        assert refusal.code.startswith("SC-I")
    else:
        assert table.values.shape == (len(table.lines), len(table.names))
        assert not np.isinf(table.values).any()


def test_a_name_that_two_columns_have_is_refused_where_they_differ_and_it_is_used(tmp_path):
    table = table_of(tmp_path, "t,q,q\n0,1,2\n")
    with pytest.raises(StrandcastError, match=r"SC-I004.*names this column twice(?s:.*)q@2, q@3"):
        table.column("q")
    assert table.columns(["t", "q@3"]).tolist() == [[0, 2]]
    assert table_of(tmp_path, "t,q,q\n0,1,1\n").column("q").tolist() == [1]


@pytest.mark.parametrize("form", ["{}.{}", "{}_{}", "{} {}"])
def test_a_point_has_its_columns_whatever_parts_name_and_axis(tmp_path, form):
    names = [form.format(point, axis) for point in ("tip", "hand") for axis in "xyz"]
    table = table_of(tmp_path, ",".join(["t", *names]) + "\n0,1,2,3,4,5,6\n")
    assert table.points() == ["tip", "hand"]
    assert table.listed() == "tip, hand, t"
    assert table.columns(["hand.x", "tip.z"]).tolist() == [[4, 3]]


def test_names_in_a_message_are_whole_the_likely_ones_first(tmp_path):
    names = [f"Subject:Segment{k:03d}:virtual" for k in range(100)] + ["tip"]
    table = table_of(tmp_path, ",".join(names) + "\n" + ",".join(["0"] * len(names)) + "\n")
    assert table.listed() == ", ".join(names)
    with pytest.raises(StrandcastError, match="the columns are tip, Subject:.*virtual and 8[0-9] more"):
        table.column("tipp")


def test_a_file_of_any_size_is_refused_before_it_is_read(tmp_path):
    with (tmp_path / "a.csv").open("wb") as file:
        file.truncate(1 << 40)  # a sparse file: no disk, and no memory
    with pytest.raises(StrandcastError, match="SC-I001.*larger than 256 MiB"):
        read_numbers(tmp_path / "a.csv")
