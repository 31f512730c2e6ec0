"""Every way in which programs write the same numbers as text gives the same recording."""

import string

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest import load
from mtpipe.ingest.cells import is_no_number, is_number
from mtpipe.ingest.encodings import encoding_of
from mtpipe.ingest.names import plain
from mtpipe.ingest.text_layout import count_of
from tests.ingest_recordings import FIVE, N, assert_plain, codes, five_columns, five_setup, write

NO_NUMBERS = [
    "", " ", "NaN", "nan", "NAN", "-nan", "+NaN", "nan(ind)", "-nan(ind)", "NaN(0x7ff)", "NaNQ",
    "sNaN", "1.#IND", "-1.#IND", "-1.#IND00", "-1.#IND00000", "-1.#IO", "1.#QNAN", "1.#QNAN0",
    "1.#R", "1.#QO", "1.#SNAN", "1.#INF", "-1.#INF00", "1.#J", "-1.$", "1.#QNAN0e+000",
    "-1.#IND00e-12", "-1,#IND00", "inf", "-Inf", "Infinity", "-infinity", "∞", "NA", "N/A", "n/a",
    "n.a.", "#N/A", "<NA>", "NaT", "NULL", "null", "None", "nil", "--", "-", "---", "?", "***",
    "nan0x7", "nan1", "NaN nm", "nan+0j", "%NAN", "Inf.", "n.d.", "ND", "No data", "missing",
    "undefined", "#N/A N/A", "\\N", "(null)", ".", "#NUM!", "#DIV/0!", "#VALUE!", "#WERT!", "#REF!",
]  # fmt: skip
NUMBERS = ["0", "-1", "+1.5", ".5", "5.", "1e5", "1E-05", "-1.25D+03", "007", "−3.5"]


def lines_of(columns, mark=",", form="{:.4f}", end=""):
    return [
        mark.join(form.format(v) for v in row) + end for row in zip(*columns.values(), strict=True)
    ]


def source_of(mark):
    return {} if mark in (",", "\t", ";") else {"delimiter": "whitespace"}


@pytest.mark.parametrize("word", NO_NUMBERS)
def test_any_spelling_of_no_number_is_known(word):
    assert is_no_number(word)
    assert is_no_number(f"   {word}\t")
    assert not is_number(word, ".")


@pytest.mark.parametrize(
    "word", [*NUMBERS, "LOST", "bead", "1.2.3", "12 nm", "nano", "0x1F", "#5", "nanny", "nod", "Nm"]
)
def test_what_says_something_is_not_taken_for_no_number(word):
    assert not is_no_number(word)
    assert is_number(word, ".") == (word in NUMBERS)
    assert is_no_number(word, (f" {word} ",))


@pytest.mark.parametrize("mark", [",", "\t", ";", " "])
@pytest.mark.parametrize("width", [0, 14])
def test_lost_words_of_all_kinds_in_one_file(tmp_path, mark, width):
    """Each word in one row of the bead, padded or not; the rest of the recording stays."""
    columns = five_columns()
    words = [w for w in NO_NUMBERS if mark not in w and (w.strip() or mark != " ")]
    rows = [line.split(",") for line in lines_of(columns)]
    for k, word in enumerate([*words, "LOST"]):
        rows[20 + 3 * k][2:] = [word.rjust(width)] * 3
    lost = [20 + 3 * k for k in range(len(words) + 1)]
    path = write(tmp_path / "r.txt", [mark.join(FIVE), *map(mark.join, rows)])
    setup = five_setup(lost={"tokens": ["LOST"]}, **source_of(mark))
    assert_plain(load(path, setup), columns, lost=lost)
    with pytest.raises(RecordingError, match=r"'\s*LOST' is no number") as caught:
        load(path, five_setup(**source_of(mark)))
    assert f"line {lost[-1] + 2}, column X" in str(caught.value.where)
    assert "lost.tokens" in caught.value.mend


@pytest.mark.parametrize("word", NUMBERS[2:])
def test_numbers_in_any_usual_writing(tmp_path, word):
    columns = five_columns()
    rows = [line.split(",") for line in lines_of(columns)]
    rows[30][2] = word
    columns["X"][30] = float(word.replace("D", "e").replace("−", "-"))
    path = write(tmp_path / "r.csv", [",".join(FIVE), *map(",".join, rows)])
    assert_plain(load(path, five_setup()), columns)


@pytest.mark.parametrize("mark", [",", "\t", "  "])
@pytest.mark.parametrize("remark", ["# checked by hand", "#", "  # later", "", "   "])
def test_remarks_and_blank_lines_between_rows(tmp_path, mark, remark):
    columns = five_columns()
    rows = lines_of(columns, mark)
    for at in (N, 250, 249, 1, 0):
        rows.insert(at, remark)
    path = write(tmp_path / "r.csv", [mark.join(FIVE), *rows])
    assert_plain(load(path, five_setup()), columns)
    faulty = rows.copy()
    faulty[300] = faulty[300].replace(".", "x", 1)
    path = write(tmp_path / "r.csv", [mark.join(FIVE), *faulty])
    with pytest.raises(RecordingError, match="is no number") as caught:
        load(path, five_setup())
    assert "line 302, column Time" in str(caught.value.where)


def test_lines_are_counted_with_the_remarks_among_them(tmp_path):
    rows = lines_of(five_columns())
    rows[100:100] = ["# one", "", "# two"]
    rows[200] = rows[150]
    path = write(tmp_path / "r.csv", [",".join(FIVE), *rows])
    with pytest.raises(RecordingError, match="goes backward") as caught:
        load(path, five_setup())
    assert str(caught.value.where).endswith("line 202")


HEADS = {
    "excel": ["sep={mark}", "{names}"],
    "program": ["MT recorder 3.1", "Date: 1.2.2023", "", "{names}"],
    "program with marks": ["Recorder{mark}3.1", "User{mark}A. B.{mark}x", "{names}"],
    "settings": ["rate = 120", "Exposure: 8.3 ms", "2023-05-01 12:00:00", "[DATA]", "{names}"],
    "units": ["{names}", "s{mark}mm{mark}nm{mark}nm{mark}nm"],
    "units in brackets": ["{names}", "(s){mark}(mm){mark}[nm]{mark}[nm]{mark}[nm]"],
    "units of some": ["about", "{names}", "s{mark}mm{mark}nm{mark}{mark}-"],
    "three lines of Origin": ["{names}", "s{mark}mm{mark}nm{mark}nm{mark}nm",
                              "clock{mark}motor{mark}a{mark}b{mark}c"],
    "repeated names below": ["a{mark}b{mark}c{mark}d{mark}e", "{names}"],
    "numbers above": ["120{mark}8.3", "1{mark}2{mark}3{mark}4{mark}5", "{names}"],
    "numpy": ["# {names}"],
    "numpy with more": ["# made by x", "#{names}"],
}  # fmt: skip


@pytest.mark.parametrize("mark", [",", "\t", ";"])
@pytest.mark.parametrize("head", HEADS)
def test_names_are_found_by_content(tmp_path, mark, head):
    columns = five_columns()
    names = mark.join(FIVE)
    first = [line.format(mark=mark, names=names) for line in HEADS[head]]
    path = write(tmp_path / "r.txt", [*first, *lines_of(columns, mark)])
    recording = load(path, five_setup())
    assert_plain(recording, columns)
    assert "guessed_layout" in codes(recording)


@pytest.mark.parametrize("rows", [3, 4, 5, 8])
def test_names_are_found_in_short_files_too(tmp_path, rows):
    columns = {name: values[:rows] for name, values in five_columns().items()}
    for first in (["Recorder 3", ",".join(FIVE)], [",".join(FIVE), "s,mm,nm,nm,nm"]):
        path = write(tmp_path / "r.csv", [*first, *lines_of(columns)])
        assert_plain(load(path, five_setup(minimum_s=0.001)), columns)


@pytest.mark.parametrize("head", [["remark without mark"], ["MT recorder 3.1", "", "by hand"]])
def test_preamble_without_names(tmp_path, head):
    columns = five_columns()
    path = write(tmp_path / "r.txt", [*head, *lines_of(columns, "\t")])
    recording = load(path, five_setup((1, 2, 3, 4, 5)))
    assert_plain(recording, columns)
    stated = load(path, five_setup((1, 2, 3, 4, 5), header=False))
    assert_plain(stated, columns)


@pytest.mark.parametrize("mark", [",", "\t", ";"])
@pytest.mark.parametrize(("of_names", "of_rows"), [(False, True), (True, False), (True, True)])
def test_a_delimiter_at_the_end_of_rows(tmp_path, mark, of_names, of_rows):
    columns = five_columns()
    head = mark.join(FIVE) + mark * of_names
    path = write(tmp_path / "r.txt", [head, *lines_of(columns, mark, end=mark * of_rows)])
    assert_plain(load(path, five_setup()), columns)


@pytest.mark.parametrize("head", [[], ["sep=|"]])
def test_columns_separated_by_upright_strokes(tmp_path, head):
    columns = five_columns()
    path = write(tmp_path / "r.csv", [*head, "|".join(columns), *lines_of(columns, "|")])
    assert_plain(load(path, five_setup()), columns)


def test_names_that_fit_no_row_are_told_with_both_numbers(tmp_path):
    columns = five_columns()
    numbered = [f"{k},{line}" for k, line in enumerate(lines_of(columns))]
    path = write(tmp_path / "r.csv", [",".join(columns), *numbered])  # as R writes row names
    with pytest.raises(RecordingError, match=r"line 1, .* has 5 of them, .* have 6 columns"):
        load(path, five_setup())
    path = write(tmp_path / "r.csv", [",".join(columns), *lines_of(columns, end=",,")])
    assert_plain(load(path, five_setup()), columns)


@pytest.mark.parametrize("inner", [";", "\t", ", ", ";;;;"])
def test_marks_within_quoted_names(tmp_path, inner):
    columns = five_columns()
    names = ("Time", f"Magnet{inner}z", f"X{inner}lateral", "Y", "Z")
    head = ",".join(f'"{name}"' for name in names)
    path = write(tmp_path / "r.csv", [head, *lines_of(columns)])
    assert_plain(load(path, five_setup(names)), columns)


def test_names_separated_otherwise_than_the_rows(tmp_path):
    columns = five_columns()
    names = ("Time (s)", "Magnet (mm)", "X (nm)", "Y (nm)", "Z (nm)")
    for head, mark in (("\t".join(names), "  "), ("   ".join(names), " "), (",".join(names), "\t")):
        path = write(tmp_path / "r.txt", [head, *lines_of(columns, mark)])
        assert_plain(load(path, five_setup(names)), columns)


MICRO = "X (µm)", "X (\N{GREEK SMALL LETTER MU}m)"


@pytest.mark.parametrize(
    ("written", "asked"),
    [
        MICRO, MICRO[::-1],
        ("X\N{NO-BREAK SPACE}(nm)", "X (nm)"),
        ("\N{ZERO WIDTH SPACE}X", "X"), ("X\N{ZERO WIDTH NO-BREAK SPACE}", "X"),
        ("X\N{SOFT HYPHEN}pos", "Xpos"), ("X  pos", "X pos"), ("X\x00", "X"),
        ("Höhe", "Ho\N{COMBINING DIAERESIS}he"), ("Ｘ", "X"), ("x²", "x2"),
    ],
)  # fmt: skip
def test_names_that_look_alike_are_the_same(tmp_path, written, asked):
    columns = five_columns()
    path = write(tmp_path / "r.csv", [f"Time,Magnet,{written},Y,Z", *lines_of(columns)])
    assert_plain(load(path, five_setup(("Time", "Magnet", asked, "Y", "Z"))), columns)


@given(st.text(), st.text())
def test_plain_names_are_plain(one, other):
    assert plain(plain(one)) == plain(one)
    assert not any(c.isspace() and c != " " for c in plain(one + other))


@pytest.mark.parametrize(
    "encoding",
    ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-32-le",
     "utf-32-be", "cp1252", "latin-1",
     "mac_roman", "cp437", "cp850"],
)  # fmt: skip
@pytest.mark.parametrize("mark", [",", "  "])
def test_the_encoding_is_found(tmp_path, encoding, mark):
    columns = five_columns()
    names = ("Time (s)", "Magnet (mm)", "X_µ (nm)", "Y°", "Z")
    path = write(tmp_path / "r.csv", [",".join(names), *lines_of(columns, mark)], encoding)
    recording = load(path, five_setup(names))
    assert_plain(recording, columns)
    told = [n.message for n in recording.notices if "text is" in n.message]
    assert bool(told) == (not encoding.startswith("utf-8"))
    stated = load(path, five_setup(names, encoding=encoding))
    assert_plain(stated, columns)


@pytest.mark.parametrize(
    ("encoding", "name"), [("gb18030", "位移 (μm)"), ("cp932", "変位 (μm)"), ("cp1251", "Ось X")]
)
def test_of_encodings_that_could_be_the_one_that_shows_the_names_asked_for_is_taken(encoding, name):
    head = f"time,{name}\n1,2\n".encode(encoding)
    found, said = encoding_of(head, count_of(["time", name]))
    assert name in head.decode(found)
    assert found in said


def test_decimal_marks_that_change_are_told_with_their_place(tmp_path):
    rows = [line.replace(".", ",") for line in lines_of(five_columns(), ";")]
    rows[150] = rows[150].replace(",", ".")
    path = write(tmp_path / "r.csv", [";".join(FIVE), *rows])
    with pytest.raises(RecordingError, match=r"'1\.5000' is no number") as caught:
        load(path, five_setup(decimal=","))
    assert "line 152, column Time" in str(caught.value.where)
    assert "decimal = ','" in caught.value.mend
    with pytest.raises(RecordingError, match=r"line 2, column Time: '0,0000' is no number") as told:
        load(path, five_setup())
    assert "[source] decimal" in str(told.value)


@pytest.mark.parametrize(
    ("line", "at", "words"),
    [
        ("2.5,3.5", 1, "line 2: has 2 columns where 5 are expected ('2.5,3.5')"),
        ("1.0,3.0,1.0", 40, "line 41: has 3 columns where 5 are expected"),
        ("1.0,3.0,oops,1,1", 40, "line 41, column X: 'oops' is no number"),
    ],
)
def test_a_line_that_is_at_fault_is_told_with_what_is_there_and_the_key_that_helps(
    tmp_path, line, at, words
):
    rows = [",".join(FIVE), *lines_of(five_columns())]
    rows.insert(at, line)
    with pytest.raises(RecordingError) as caught:
        load(write(tmp_path / "r.csv", rows), five_setup())
    assert words in str(caught.value)
    assert "skip_lines" in str(caught.value)


@given(
    preamble=st.lists(st.text(string.ascii_letters + " :=.", max_size=30), max_size=6),
    mark=st.sampled_from([",", ";", "\t"]),
    units=st.booleans(),
    seed=st.integers(0, 5),
)
def test_any_preamble_of_words(preamble, mark, units, seed, tmp_path_factory):
    """Lines of words before the names never become names or rows."""
    columns = {name: values[:60] for name, values in five_columns(seed=seed).items()}
    head = [*preamble, mark.join(FIVE), *([mark.join(["s", "mm", "nm", "nm", "nm"])] * units)]
    path = tmp_path_factory.mktemp("t") / "r.txt"
    write(path, [*head, *lines_of(columns, mark)])
    assert_plain(load(path, five_setup(minimum_s=0.1)), columns)


def test_a_file_of_more_than_one_block_is_read_the_same(tmp_path, monkeypatch):
    """A block with odd words among blocks without: all are read alike."""
    from mtpipe.ingest import lines

    monkeypatch.setattr(lines, "BLOCK_BYTES", 1000)
    columns = five_columns()
    rows = lines_of(columns)
    rows[200] = rows[200].rsplit(",", 3)[0] + ",-1.#IO,lost ,1.#QNAN"
    rows.insert(300, "# remark")
    path = write(tmp_path / "r.csv", [",".join(FIVE), *rows])
    setup = five_setup(lost={"tokens": ["lost"]})
    assert_plain(load(path, setup), columns, lost=[200])


def test_numbers_are_those_of_the_file_to_the_last_digit(tmp_path):
    columns = five_columns()
    columns["X"] = np.random.default_rng(3).normal(0, 1e3, N)
    rows = [",".join(repr(float(v)) for v in row) for row in zip(*columns.values(), strict=True)]
    rows[5] = rows[5].replace(",3.0,", ",+3.0,")  # the whole block is looked at cell by cell
    path = write(tmp_path / "r.csv", [",".join(FIVE), *rows])
    np.testing.assert_array_equal(load(path, five_setup()).positions_nm["b1"][:, 0], columns["X"])
