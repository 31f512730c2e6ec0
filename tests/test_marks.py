"""What a reader leaves out by hand is left out everywhere, said, and can be taken back."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import mtpipe
from mtpipe.cli.entry import app
from mtpipe.curves.curve_tables import curves_of_tables
from mtpipe.curves.extension_curve import fit_curves
from mtpipe.ground.errors import MtpipeError
from mtpipe.pipeline.summary import rows_of
from mtpipe.report import write_report
from mtpipe.report.export import Exports, exported, write_tables
from mtpipe.report.folder import read_run_folder
from mtpipe.report.marked import read_marked_run
from mtpipe.report.marks import MARKS, Mark, mark_of, read_marks, write_marks
from tests.report_folder import write_run_folder
from tests.report_page import Page
from tests.simulated import recording
from tests.test_pipeline import write

pytestmark = pytest.mark.slow

BEAD, OTHER = "more1", "more2"


def mark(folder, *arguments):
    return CliRunner().invoke(app, ["mark", str(folder), *map(str, arguments)])


@pytest.fixture
def made_up(tmp_path):
    folder = write_run_folder(tmp_path / "run", good=3)
    write_report(folder)
    return folder


def test_marks_are_written_as_they_are_read(tmp_path):
    marks = (
        Mark("b1", 'it "jumped" ü'),
        Mark("../<b>", "two\ttethers", plateau=0),
        Mark("b1", "focus", from_s=3.0, to_s=4.25),
    )
    write_marks(tmp_path, marks)
    assert read_marks(tmp_path) == marks
    assert read_marks(tmp_path / "nowhere") == ()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("schema = 1\n[[mark]]\nbead = 'b1'", "mark.0.reason"),
        ("schema = 2", "schema"),
        ("[[mark", "cannot be read"),
        ("schema = 1\n[[mark]]\nbead = 'b'\nreason = 'r'\nfrom_s = 4.0", "from_s and to_s"),
        ("schema = 1\n[[mark]]\nbead = 'b'\nreason = 'r'\nfrom_s = 4.0\nto_s = 3.0", "not before"),
        ("schema = 1\n[[mark]]\nbead = 'b'\nreason = 'r'\nplateua = 4", "plateua"),
        ("schema = 1\n[[mark]]\nbead = 'b'\nreason = ''", "mark.0.reason"),
    ],
)
def test_a_file_that_is_wrong_is_told_in_a_sentence(tmp_path, text, said):
    (tmp_path / MARKS).write_text(text)
    with pytest.raises(MtpipeError, match=said) as raised:
        read_marks(tmp_path)
    assert str(tmp_path / MARKS) in str(raised.value)


def test_a_plateau_is_left_out_of_curve_tables_and_report(made_up):
    before = read_marked_run(made_up)
    done = mark(made_up, BEAD, "--plateau", 2, "--reason", "a neighbour came by")
    assert done.exit_code == 0, done.output
    run = read_marked_run(made_up)
    points = read_run_folder(made_up).curve_points
    kept = points[~((points.bead == BEAD) & (points.plateau == 2))]
    expected = fit_curves(curves_of_tables(kept, run.curve_stage, run.assay))
    recommended = expected[BEAD].recommended
    row = run.beads.set_index("bead").loc[BEAD]
    assert row.plateaus_used == 3
    if recommended is not None:
        assert row.contour_length_nm == recommended.contour_length_nm.value
    assert len(expected[BEAD].points) == 3
    other = before.beads.set_index("bead").loc[OTHER], run.beads.set_index("bead").loc[OTHER]
    assert other[0].force_max_pN == other[1].force_max_pN
    forces = pd.read_csv(made_up / "forces.csv")
    marked = forces[forces.excluded.notna()]
    assert set(marked.bead) == {BEAD}
    assert set(marked.plateau) == {2}
    assert set(marked.force_status) == {"excluded"}
    assert set(marked.excluded) == {"a neighbour came by"}
    exported = pd.read_csv(write_tables(made_up) / "forces.csv")
    assert (exported.force_status == "excluded").sum() == 3
    computed = pd.read_parquet(made_up / "forces.parquet")
    assert not (computed.force_status == "excluded").any()
    index = Page(made_up / "report" / "index.html")
    assert f"{BEAD}, plateau 2: a neighbour came by" in index.text
    page = Page(made_up / "report" / f"bead-{BEAD}.html")
    assert "left out by hand: a neighbour came by" in page.text
    assert "3 of 4" in page.text


def test_a_bead_is_left_out_and_taken_back(made_up):
    original = (made_up / "beads.csv").read_text(encoding="utf-8")
    done = mark(made_up, BEAD, "--reason", "two tethers")
    assert done.exit_code == 0, done.output
    beads = pd.read_csv(made_up / "beads.csv").set_index("bead")
    assert beads.loc[BEAD, "verdict"] == "refused"
    assert beads.loc[BEAD, "reasons"].startswith("left out by hand: two tethers")
    assert beads.loc[BEAD, "plateaus_used"] == 0
    assert np.isnan(beads.loc[BEAD, "contour_length_nm"])
    assert beads.loc[OTHER, "verdict"] == "good"
    page = Page(made_up / "report" / f"bead-{BEAD}.html")
    assert "Left out by hand: two tethers." in page.text
    back = mark(made_up, BEAD, "--remove")
    assert back.exit_code == 0, back.output
    assert (made_up / "beads.csv").read_text(encoding="utf-8") == original
    again = mark(made_up, BEAD, "--remove")
    assert again.exit_code == 2


def test_a_mark_replaces_one_of_the_same_place(made_up):
    mark(made_up, BEAD, "--plateau", 1, "--reason", "first")
    mark(made_up, BEAD, "--plateau", 1, "--reason", "second")
    mark(made_up, BEAD, "--plateau", 2, "--reason", "third")
    assert [one.reason for one in read_marks(made_up)] == ["second", "third"]


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("b9", "--reason", "x"), 1, "no bead 'b9'"),
        ((BEAD, "--plateau", "9", "--reason", "x"), 1, "plateaus 0 to 3"),
        ((BEAD, "--from", "1e6", "--to", "2e6", "--reason", "x"), 1, "no plateau"),
        ((BEAD, "--from", "9", "--to", "2", "--reason", "x"), 1, "not before"),
        ((BEAD, "--plateau", "1", "--from", "2", "--to", "9", "--reason", "x"), 1, "not both"),
        ((BEAD, "--from", "9", "--reason", "x"), 2, "both --from and --to"),
        ((BEAD,), 2, "a reason is needed"),
    ],
)
def test_a_mark_that_cannot_be_is_told_and_not_written(made_up, arguments, code, said):
    done = mark(made_up, *arguments)
    assert (done.exit_code if code == 2 else 1) == code
    assert said in (done.output if code == 2 else str(done.exception))
    assert not (made_up / MARKS).exists()


def test_a_mark_of_what_is_not_there_is_said_in_the_report(made_up):
    write_marks(made_up, [Mark("gone", "was here once"), Mark(BEAD, "real", plateau=0)])
    run = read_marked_run(made_up)
    assert [n.message for n in run.notices if n.code == "mark_of_nothing"]
    assert run.beads.set_index("bead").loc[BEAD].plateaus_used == 3


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A real run of three plateaus of 17 s, without a cross-check."""
    folder = tmp_path_factory.mktemp("marked")
    write(folder, recording((0.5, 2.0, 6.0, 9.0), 1024, seed=2))
    mtpipe.run(folder / "recording.csv", folder / "out", cross_check=False)
    return folder


def test_the_points_of_a_run_give_its_curves_again(folder):
    run = read_run_folder(folder / "out")
    again = fit_curves(curves_of_tables(run.curve_points, run.curve_stage, run.assay))
    for bead in run.force_extension.bead.unique():
        written = run.force_extension[(run.force_extension.bead == bead)].set_index("model")
        for fit in again[bead].fits:
            row = written.loc[fit.model]
            assert fit.chi2 == pytest.approx(row.chi2, rel=1e-9)
            assert fit.contour_length_nm.value == pytest.approx(
                row.contour_length_nm, rel=1e-9, nan_ok=True
            )
    csv = pd.read_csv(folder / "out" / "forces.csv")
    assert csv.excluded.isna().all()


def test_a_stretch_is_lost_frames_in_the_next_run(folder):
    out = folder / "out"
    raw = pd.read_parquet(out / "forces.parquet")
    x = raw[(raw.bead == "b1") & (raw.axis == "x")].set_index("plateau")
    begin, end = x.start_s[1] + 2.0, x.start_s[1] + 5.0
    done = mark(out, "b1", "--from", begin, "--to", end, "--reason", "focus was lost")
    assert done.exit_code == 0, done.output
    assert "mtpipe run again" in done.output
    assert "without all of the plateaus it lies in" in done.output
    waiting = pd.read_csv(out / "forces.csv")
    assert set(waiting[waiting.force_status == "excluded"].plateau) == {1}
    mtpipe.run(folder / "recording.csv", out, cross_check=False)
    assert read_marks(out) == (mark_of(bead="b1", from_s=begin, to_s=end, reason="focus was lost"),)
    after = pd.read_csv(out / "forces.csv")
    assert not (after.force_status == "excluded").any()
    lost = after[(after.bead == "b1") & (after.axis == "x")].set_index("plateau").lost_frames
    assert lost[1] == pytest.approx(3.0 * 120, abs=2)
    assert lost[0] == lost[2] == 0
    content = json.loads((out / "run.json").read_text(encoding="utf-8"))
    assert [one["reason"] for one in content["marks"]] == ["focus was lost"]
    page = Page(Path(out / "report" / "index.html"))
    assert "focus was lost" in page.text


def test_a_batch_shows_marks_in_its_summary(made_up):
    mark(made_up, BEAD, "--reason", "two tethers")
    mark(made_up, OTHER, "--plateau", 1, "--reason", "a neighbour came by")
    run = json.loads((made_up / "run.json").read_text()) | {"complete": True}
    rows = {row.bead: row for row in rows_of("day/r1", made_up, run, "")}
    assert rows[BEAD].verdict == "refused"
    assert "left out by hand: two tethers" in rows[BEAD].reasons
    assert "plateau 1 (a neighbour came by)" in rows[OTHER].reasons
    others = [row for bead, row in rows.items() if bead not in (BEAD, OTHER)]
    assert others
    assert not any("by hand" in row.reasons for row in others)
    # a file of marks that cannot be read stops no batch, and is told
    (made_up / MARKS).write_text("[[mark")
    rows = {row.bead: row for row in rows_of("day/r1", made_up, run, "")}
    assert "its marks are not in this row" in rows[BEAD].reasons


def test_what_was_exported_is_written_again(made_up):
    """Files beside the report show what its pages show, after a mark as well."""
    write_tables(made_up)
    table = made_up / "report" / "tables" / "forces.csv"
    assert "a neighbour came by" not in table.read_text()
    done = mark(made_up, BEAD, "--plateau", 2, "--reason", "a neighbour came by")
    assert done.exit_code == 0, done.output
    assert "a neighbour came by" in table.read_text()
    assert exported(made_up) == Exports(tables=True)
