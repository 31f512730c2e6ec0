"""The workflow on the 2010 paper: its limits, its readings of the recipe, its page."""

import importlib
import re
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.slow

CHECKOUT = Path(__file__).parents[1]
WORKFLOW = CHECKOUT / "workflows" / "paper"
PAGE = CHECKOUT / "docs" / "paper.md"
PARTS = ("figures-2-3", "figure-4", "figure-5", "figure-6", "figure-8", "differences")
NYQUIST_HZ = 60.0


@pytest.fixture(scope="module")
def paper():
    """name → module of the workflow."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(WORKFLOW))
        yield importlib.import_module


def test_force_and_corner_frequency_belong_together_as_in_the_paper(paper):
    setting, quoted = paper("setting").Setting(), paper("quoted")
    for hertz, force in (
        (quoted.UNCORRECTED_LIMIT_HZ, quoted.UNCORRECTED_LIMIT_PN),
        (quoted.CORRECTED_LIMIT_HZ, quoted.CORRECTED_LIMIT_PN),
    ):
        assert setting.force_at_corner(hertz) == pytest.approx(force, rel=0.03)
    assert setting.at(14.0).corner_hz[0] == pytest.approx(32.5, abs=0.1)


def test_limits_on_expected_spectra(paper):
    recovery = paper("recovery")
    limits = {method: recovery.bias_limit(method) * NYQUIST_HZ for method in recovery.METHODS}
    assert limits["arctangent-uncorrected"] == pytest.approx(16.0, abs=0.2)
    assert limits["arctangent-blur-only"] == pytest.approx(33.5, abs=0.3)
    assert limits["arctangent"] > 2 * NYQUIST_HZ
    assert limits[recovery.EXACT] == np.inf
    at_quoted = recovery.expected("arctangent", 47 / NYQUIST_HZ).bias
    assert at_quoted[0] == pytest.approx(-0.0065, abs=0.001)


@pytest.mark.parametrize("method", ["arctangent-uncorrected", "arctangent-blur-only", "arctangent"])
def test_recipe_read_as_written_is_the_method_of_mtpipe(paper, method):
    recovery, readings = paper("recovery"), paper("readings")
    for ratio in (0.1, 0.5, 0.8):
        read = readings.error(readings.Reading(), recovery.CORRECTIONS[method], ratio)
        assert read == pytest.approx(recovery.expected(method, ratio).bias[0], abs=2e-3)


def test_half_of_the_aliases_gives_the_quoted_limit_and_all_of_them_do_not(paper):
    recovery, readings = paper("recovery"), paper("readings")
    full = recovery.CORRECTIONS["arctangent"]
    half = readings.Reading(alias_share=0.5, number="inverse")
    found, _ = recovery.limit(lambda ratio: readings.error(half, full, ratio))
    assert found * NYQUIST_HZ == pytest.approx(47, abs=2)
    assert abs(readings.error(readings.Reading(), full, 47 / NYQUIST_HZ)) < 0.01


@pytest.mark.parametrize("method", ["arctangent", "exact fit"])
def test_scatter_to_first_order_is_that_of_simulated_traces(paper, method):
    recovery, setting = paper("recovery"), paper("setting")
    frames, many = 2048, 60
    bead = setting.Setting().at(14.0)
    traces = setting.exact_traces(bead, frames, many, np.random.default_rng(5))
    errors = np.array([recovery.recover(method, x, bead)[0] for x in traces])
    ratio = float(bead.corner_hz[0]) / NYQUIST_HZ
    first_order = recovery.expected(method, ratio).scatter[0] / np.sqrt(frames)
    assert errors.std() == pytest.approx(first_order, rel=4 / np.sqrt(2 * many))
    assert abs(errors.mean()) < 4 * first_order / np.sqrt(many)


def test_stepwise_traces_lose_the_variance_the_camera_takes(paper):
    setting = paper("setting")
    bead, frames = setting.Setting().at(10.0), 3000
    traces = setting.stepwise_traces(bead, frames, np.random.default_rng(3))
    share = np.mean(traces**2, axis=0) / bead.frame_variance() - 1
    assert np.all(np.abs(share) < 4 * bead.variance_stderr(frames))
    # the negative control: the variance before the camera is far from what is recorded
    without_camera = np.mean(traces**2, axis=0) / bead.variance - 1
    assert np.all(without_camera < -4 * bead.variance_stderr(frames))


def test_a_limit_is_the_first_crossing_or_the_last_fit(paper):
    limit = paper("recovery").limit
    assert limit(lambda ratio: ratio / 10)[0] == pytest.approx(1.0, abs=1e-3)
    end, why = limit(lambda ratio: 0.0 if ratio < 1 else np.nan)
    assert why == "no fit beyond"
    assert end == pytest.approx(1.0, rel=2e-3)
    assert limit(lambda ratio: 0.0)[0] == np.inf


def test_the_page_is_printed_and_complete(paper, tmp_path):
    text = PAGE.read_text(encoding="utf-8")
    for name in PARTS:
        block = re.search(rf"<!-- paper: {name} -->\n(.*?)<!-- end -->", text, re.DOTALL)
        assert block is not None
        assert "Printed 20" in block[1]
        assert (PAGE.parent / "images" / f"paper-{name}.png").stat().st_size < 100_000
    results = tmp_path / "results"
    results.mkdir()
    (results / "one.md").write_text("a table\n", encoding="utf-8")
    (results / "paper-one.png").write_bytes(b"")
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- paper: one -->\nold\n<!-- end -->\nafter\n", encoding="utf-8")
    paper("page").print_page(page, results, ["one"], "the command")
    printed = page.read_text(encoding="utf-8")
    assert "a table" in printed
    assert "`the command`" in printed
    assert "old" not in printed
    assert printed.startswith("before")
    assert printed.endswith("after\n")
    page.write_text("no place", encoding="utf-8")
    with pytest.raises(ValueError, match="one place"):
        paper("page").print_page(page, results, ["one"], "the command")


@pytest.mark.parametrize("part", ["figures_2_3", "figure_4"])
def test_a_part_gives_its_text_and_tables_and_the_same_again(paper, part):
    pytest.importorskip("matplotlib", reason="the workflow's own requirement")
    first, again = (paper(part).part(4, 200) for _ in range(2))
    assert first.text == again.text
    assert "not public here" in first.text
    assert all(len(table) for table in first.tables.values())
