"""mtpipe in Python: its names, results that show themselves, its steps one by one as in `run`."""

import json
import re
import sys
import types
from pathlib import Path

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest
import tifffile

import mtpipe
from mtpipe.ground.estimate import Estimate
from mtpipe.ground.progress import by_name, of_step
from tests.stack_images import draw

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
SAMPLE = ROOT / "sample_data" / "clean_short_tether"
FRAMES = 640
# A result's line fits on a line or two of a notebook.
MOST_LETTERS = 300


def test_only_the_public_names_are_listed():
    assert sorted(dir(mtpipe)) == sorted([*mtpipe.__all__, "__version__"])
    for name in dir(mtpipe):
        assert getattr(mtpipe, name) is not None


@pytest.mark.parametrize(
    ("value", "stderr", "interval", "unit", "status", "shown"),
    [
        (8.3123, 0.1234, (8.19, 8.44), "pN", "ok", "8.31 ± 0.12 pN"),
        (8.3123, 0.0477, (8.265, 8.36), "pN", "ok", "8.312 ± 0.048 pN"),
        (2712.4, 27.3, (2685, 2740), "nm", "ok", "2712 ± 27 nm"),
        (2.312e-5, 7.61e-7, (2.236e-5, 2.388e-5), "Hz", "ok", "(2.312 ± 0.076) × 10⁻⁵ Hz"),
        (1.0, 0.3, (0.9, 1.5), "pN", "ok", "1.00 +0.50 −0.10 pN"),
        (-0.52, 0.1, (-0.62, -0.42), "nm", "ok", "−0.52 ± 0.10 nm"),
        (8.31, 0.12, (8.19, 8.43), "pN", "unlike_model", "8.31 ± 0.12 pN (unlike model)"),
        (np.nan, np.nan, (0.1, 5.0), "pN", "not_identified", "0.1 to 5 pN (not identified)"),
        (np.nan, np.nan, (900.0, np.inf), "pN", "not_identified", "> 900 pN (not identified)"),
        (np.nan, np.nan, (np.nan, np.nan), "pN", "not_converged", "— pN (not converged)"),
    ],
)  # fmt: skip
def test_an_estimate_reads_as_a_person_writes_it(value, stderr, interval, unit, status, shown):
    assert repr(Estimate(value, stderr, interval, unit, "test", status)) == shown


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The files that README's example reads, cut from sample data, and a film."""
    folder = tmp_path_factory.mktemp("readme")
    table = pd.read_csv(SAMPLE / "recording.csv.gz", comment="#")
    rests = table.groupby("magnet_mm").filter(lambda rows: len(rows) > FRAMES)
    short = rests.groupby("magnet_mm", sort=False).head(FRAMES).copy()
    last = list(short["magnet_mm"].unique())[-3:]
    short = short[short["magnet_mm"].isin(last)]
    short["time_s"] = np.arange(len(short)) / 120.0
    short.to_csv(folder / "recording.csv", index=False)
    setup = (SAMPLE / "setup.toml").read_text(encoding="utf-8")
    setup = setup.replace("[camera]", "[camera]\npixel_size_nm = 100.0")
    (folder / "setup.toml").write_text(setup, encoding="utf-8")
    shift = np.random.default_rng(1).normal(size=70)
    film = draw((64, 120), [(32 + shift, 32.0, 320.0), (88.3, 30.6, 200.0)])
    tifffile.imwrite(folder / "film.tif", film, photometric="minisblack", metadata=None)
    return folder


@pytest.fixture(scope="module")
def readme(folder):
    """What the names of README's example stand for after it has run, as it stands."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```python\n(import mtpipe.*?)```", text, re.DOTALL)
    names: dict[str, object] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        exec(compile(example, "README.md", "exec"), names)
    return names


def test_the_steps_of_readme_give_what_run_gives(folder, readme):
    run = mtpipe.run(folder / "recording.csv", folder / "out")
    assert repr(run).startswith("Run of recording.csv: 1 ")
    assert len(run.plot().data) == 1
    assert len(run.table) == 1
    assert re.fullmatch(
        r"Plateau 0: rows 0 to \d+, magnets at [\d.]+ mm", repr(readme["recording"].plateaus[0])
    )
    for part in (*run.calibration.beads, *run.calibration.beads[0].plateaus):
        assert len(repr(part)) < MOST_LETTERS
    assert "statistics" in repr(run.checked.beads["b1"])
    written = json.loads((folder / "out" / "mismatch.json").read_text(encoding="utf-8"))
    assert readme["mismatch"].as_dict() == {k: v for k, v in written.items() if k != "run"}
    looks = pd.read_parquet(folder / "out" / "crosscheck.parquet")
    for check in (readme["check"], readme["mismatch"].crosscheck):
        pd.testing.assert_frame_equal(check.table, looks, check_dtype=False)
    pd.testing.assert_frame_equal(readme["calibration"].table, run.calibration.table)
    forces = pd.read_parquet(folder / "out" / "forces.parquet").drop_duplicates("plateau")
    quoted = readme["mismatch"].table
    assert list(quoted["force_pN"]) == list(forces["force_pN"])
    (bead,) = pd.read_parquet(folder / "out" / "beads.parquet").to_dict("records")
    curve = readme["curves"]["b1"]
    assert curve.recommended is not None
    assert curve.recommended.contour_length_nm.value == bead["contour_length_nm"]
    assert curve.recommended.persistence_length_nm.value == bead["persistence_length_nm"]
    assert len(pd.read_csv(folder / "tracked.csv", comment="#")) == 70


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("recording", r"1 tethered and 1 reference beads, 1920 frames in 16 s, 3 plateaus"),
        ("calibration", r"Calibration of 1 bead: 3 of 3 forces to use"),
        ("check", r"b1 p = 0\.\d+"),
        ("mismatch", r"b1 (consistent|explained|unexplained)"),
        ("fit", r"stiffness \S+ ± \S+ pN/nm"),
        ("posterior", r"effective samples"),
        ("curve", r"contour length \d+ ± \d+ nm"),
        ("setup", r"120 Hz"),
    ],
)
def test_results_show_themselves(readme, name, words):
    result = {"curve": readme["curves"]["b1"], "setup": readme["recording"].setup}.get(
        name, readme.get(name)
    )
    shown = repr(result)
    assert re.search(words, shown), shown
    assert "\n" not in shown
    assert len(shown) < MOST_LETTERS
    page = result._repr_html_()
    assert "<table" in page
    assert isinstance(result.table, pd.DataFrame)
    assert len(result.table)
    if name != "setup":
        figure = result.plot()
        assert isinstance(figure, go.Figure)
        assert any(len(trace.x) for trace in figure.data)


def test_a_figure_of_a_bead_that_is_not_there_says_which_are(readme):
    with pytest.raises(mtpipe.MtpipeError, match=r"no bead b9.*b1"):
        readme["check"].plot(bead="b9")


def test_progress_is_a_bar_in_a_notebook_and_silence_elsewhere(monkeypatch):
    shown = []

    class Handle:
        def update(self, bar):
            shown.append(repr(bar))

    def display(bar, display_id):
        assert display_id
        assert "<progress" in bar._repr_html_()
        shown.append(repr(bar))
        return Handle()

    of_step(None, "calibrating beads")(1, 2)
    by_name(None)("reading", 0, 1)
    assert shown == []
    kernel = types.SimpleNamespace(kernel=object())
    module = types.ModuleType("IPython")
    module.get_ipython = lambda: kernel
    inner = types.ModuleType("IPython.display")
    inner.display = display
    monkeypatch.setitem(sys.modules, "IPython", module)
    monkeypatch.setitem(sys.modules, "IPython.display", inner)
    say = of_step(None, "calibrating beads")
    say(0, 2)
    say(2, 2)
    assert shown == ["calibrating beads: 0 of 2", "calibrating beads: 2 of 2"]
    asked = []
    of_step(lambda done, total: asked.append((done, total)), "calibrating beads")(1, 2)
    assert asked == [(1, 2)]
    assert len(shown) == 2
