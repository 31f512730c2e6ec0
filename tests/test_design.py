"""The design of experiments: known bounds, monotony, changes that reach, and what users see."""

import csv
import importlib.util
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from mtpipe.cli.commands import app
from mtpipe.design.arctangent import expected_arctangent
from mtpipe.design.changes import KINDS, Variant, change, reaches
from mtpipe.design.figure import design_figure, write_figure
from mtpipe.design.guide import Design, measurable_forces
from mtpipe.design.likelihood import trace_model
from mtpipe.design.limits import all_ranges, force_range
from mtpipe.design.methods import METHODS
from mtpipe.design.motion import AxisMotion, axis_motion
from mtpipe.design.plan import Knowledge, Plan, plan_of
from mtpipe.design.show import design_frame
from mtpipe.experiment.state import expected_spectrum
from mtpipe.fit.estimates import inverse_information
from mtpipe.ground.errors import MtpipeError, SetupError
from mtpipe.methods.integrated_spectrum import Correction, fit_spectrum
from mtpipe.physics.camera import Camera, power_spectrum
from mtpipe.physics.modes import SINGLE_MODE
from mtpipe.setup.setup import Setup, parse_setup
from mtpipe.setup.usual_errors import exact

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
SETUP = """schema = 1
[camera]
frame_rate_hz = 120
exposure_s = {exposure}
[beads]
radius_nm = {radius}
radius_nm_stderr = {radius_stderr}
reference = ["ref1"]
[tether]
contour_length_nm = {contour}
persistence_length_nm = 50
[buffer]
temperature_K = 293.15
viscosity_mPa_s = 1.0
[field]
direction = "x"
[model]
effects = [{effects}]
"""


def setup_text(effects: str = "", **values: object) -> str:
    given = {"exposure": 1 / 120, "radius": 1400, "radius_stderr": 0, "contour": 2700} | values
    return SETUP.format(effects=effects, **given)


def setup_of(effects: str = "", **values: object) -> Setup:
    import tomllib

    return parse_setup(exact(tomllib.loads(setup_text(effects, **values))))


def plan_a(frames: int = 16_384, **values: object) -> Plan:
    """Configuration A of PHYSICS: no wall, no rotation, no noise."""
    return plan_of(setup_of(**values), frames)[0]


NOISY = '"tracking_noise"'
FULL = '"wall_drag", "rotation_coupling", "tracking_noise"'


# σ(ln k) √N with friction free and known, and of ln γ: PHYSICS section 6, exposure a whole frame.
BOUNDS = {
    0.05: (3.57, 3.57, 1.53),
    0.2: (1.81, 1.79, 1.95),
    0.4: (1.42, 1.29, 2.69),
    0.6: (1.53, 1.08, 3.63),
    0.8: (1.91, 0.97, 4.80),
    1.0: (2.50, 0.91, 6.19),
    2.0: (7.16, 0.79, 15.9),
    5.0: (25.5, 0.73, 53.0),
}


@pytest.mark.parametrize("ratio", BOUNDS)
def test_bounds_of_stiffness_and_friction(ratio: float) -> None:
    plan = plan_a()
    tau = plan.experiment.camera.frame_s / (math.pi * ratio)
    motion = AxisMotion(1e-4, 1e-4 * tau, SINGLE_MODE, 4e4)
    model, theta = trace_model(plan, motion, 0, friction_known=False)
    information = model.information(theta)
    covariance = inverse_information(information)
    found = (
        math.sqrt(plan.frames * covariance[0, 0]),
        math.sqrt(plan.frames / information[0, 0]),
        math.sqrt(plan.frames * covariance[1, 1]),
    )
    # the table has three figures
    assert found == pytest.approx(BOUNDS[ratio], rel=6e-3)


def test_slow_motion_costs_the_root_of_its_relaxation_times() -> None:
    """σ(ln k) = √(1/(π fc T)) where everything is resolved, with prewhitening as without."""
    plan = plan_a()
    for force in (0.3, 0.8):
        corner_hz = plan.nyquist_ratio(force) * 60
        error = METHODS["friction known"].error(plan, force, "along")
        assert error.statistics == pytest.approx(
            math.sqrt(1 / (math.pi * corner_hz * plan.duration_s)), rel=0.02
        )


@pytest.mark.parametrize("axis", [0, 1])
def test_model_of_the_fit_expects_the_spectrum_of_the_experiment(axis: int) -> None:
    """Two ways to the same number: description → model of the fit, description → spectrum."""
    plan, _ = plan_of(setup_of(FULL), 16_384)
    motion = axis_motion(plan, 10.0, axis)
    model, theta = trace_model(plan, motion, axis, friction_known=True)
    frequency = model.spectrum.frequency_hz
    expected = expected_spectrum(frequency, plan.state(10.0), plan.experiment, axis)
    # the first bins of a finite trace are wide against their frequency
    high = frequency > 1.0
    assert model.expected(theta[None])[0][high] == pytest.approx(expected[high], rel=5e-3)


def test_forces_of_the_paper() -> None:
    """Corner frequencies that te Velthuis et al. 2010 quote for this bead and tether."""
    plan = plan_a()
    assert plan.nyquist_ratio(14.0) * 60 == pytest.approx(32.5, rel=0.005)
    assert plan.nyquist_ratio(20.0) * 60 == pytest.approx(46.1, rel=0.005)


def test_uncorrected_arctangent_passes_ten_percent_near_a_quarter_of_nyquist() -> None:
    plan = plan_a()
    found = force_range(plan, METHODS["arctangent-uncorrected"], "along", 0.1)
    assert found.upper is not None
    assert found.upper.force_pN == pytest.approx(6.7, abs=0.3)
    assert "blur and aliases" in found.upper.reason
    corrected = force_range(plan, METHODS["arctangent"], "along", 0.1)
    assert corrected.upper is not None
    assert corrected.upper.force_pN > 20


@pytest.mark.parametrize("ratio", [0.05, 0.3, 1.0, 2.0, 2.4])
@pytest.mark.parametrize("aliases", [(-1, 1), ()])
def test_arctangent_at_once_and_in_rounds(ratio: float, aliases: tuple[int, ...]) -> None:
    """The root is where the scheme's rounds end; where they run away there is none."""
    camera = Camera(1 / 120, 1 / 120)
    correction = Correction(bool(aliases), aliases)
    frequency = np.arange(1, 257) / 256 * 60
    power = power_spectrum(frequency, 1000.0, 1 / (2 * math.pi * 60 * ratio), camera)
    start = (math.log(1000), math.log(60 * ratio))
    rounds = fit_spectrum(frequency, power, 1 / 120, 1 / 120, correction)
    at_once = expected_arctangent(frequency, power, start, 1 / 120, 1 / 120, correction)
    assert rounds is not None
    assert rounds.converged == (at_once is not None)
    if at_once is None:
        assert ratio == 2.4
        return
    assert at_once.ln_variance == pytest.approx(rounds.fit[0], abs=2e-5)
    if aliases:  # where the model holds, the scatter is that which the method states
        scatter = math.sqrt(float(at_once.response**2 @ power**2))
        assert scatter == pytest.approx(math.sqrt(rounds.covariance[0, 0]), rel=0.01)


@pytest.mark.parametrize("method", ["friction known", "friction free", "equipartition", "series"])
def test_more_of_the_same_is_better(method: str) -> None:
    """Longer, or with better knowledge or less noise: no error grows."""
    plan, _ = plan_of(setup_of(FULL, radius=500, contour=1200, radius_stderr=10), 8192)
    axis = METHODS[method].axes[0]

    def total(one: Plan, force: float) -> float:
        return METHODS[method].error(one, force, axis).total

    known = replace(plan, knowledge=Knowledge(0, 0, 0, 0, 1.1))
    tracker = replace(plan.experiment.tracker, noise_nm=(0.5, 0.5, 3.0))
    quiet = replace(plan, experiment=replace(plan.experiment, tracker=tracker))
    unsure = replace(plan, knowledge=replace(plan.knowledge, exposure=0.02, temperature=0.01))
    for force in (0.1, 1.0, 5.0, 20.0):
        now = total(plan, force)
        assert total(change(plan, "duration", 4).plan, force) < now
        assert total(known, force) <= now
        assert total(quiet, force) < now
        assert total(unsure, force) > now


def test_parts_add_up_and_a_series_beats_its_traces() -> None:
    plan, _ = plan_of(setup_of(FULL, radius=500, contour=1200), 8192)
    for force in (0.5, 5.0, 15.0):
        series = METHODS["series"].error(plan, force, "both")
        for axis in ("along", "across"):
            known = METHODS["friction known"].error(plan, force, axis)
            assert known.total**2 == pytest.approx(known.shift**2 + known.scatter**2)
            assert series.scatter < known.scatter
            assert known.scatter < METHODS["friction free"].error(plan, force, axis).scatter


def test_a_range_ends_where_the_error_is_passed() -> None:
    plan, _ = plan_of(setup_of(FULL, radius=500, contour=1200), 8192)
    for name in ("friction known", "friction free", "arctangent"):
        found = force_range(plan, METHODS[name], "along", 0.1)
        assert found.lower is not None
        assert found.upper is not None
        error_at = METHODS[name].error(plan, found.upper.force_pN, "along").total
        assert error_at == pytest.approx(0.1, rel=0.02)
        assert METHODS[name].error(plan, 1.15 * found.upper.force_pN, "along").total > 0.1
        narrower = force_range(plan, METHODS[name], "along", 0.03)
        assert narrower.upper is not None
        assert narrower.upper.force_pN < found.upper.force_pN
    assert force_range(plan, METHODS["series"], "both", 0.001).upper is None


def test_what_reaches_a_force_really_reaches_it() -> None:
    plan, _ = plan_of(setup_of(FULL, radius=500, contour=1200), 16_384)
    assert METHODS["friction free"].error(plan, 20.0, "along").total > 0.1
    by_method = {reach.method: reach for reach in reaches(plan, 20.0, 0.1)}
    assert by_method["friction known"].within
    assert not by_method["friction known"].changes
    free = by_method["friction free"]
    assert not free.within
    order = list(KINDS)
    assert [order.index(one.kind) for one in free.changes] == sorted(
        order.index(one.kind) for one in free.changes
    )
    assert free.changes
    for one in free.changes:
        again = force_range(one.plan, METHODS["friction free"], "along", 0.1)
        assert again.lower is not None
        assert again.upper is not None
        assert again.lower.force_pN < 20 <= again.upper.force_pN * 1.01
        less = one.factor / 2**0.5 if one.factor > 1 else one.factor * 2**0.5
        if not math.isclose(less, 1):
            smaller = change(plan, one.kind, less).plan
            assert METHODS["friction free"].error(smaller, 20.0, "along").total > 0.1


def test_nothing_reaches_beyond_overstretching() -> None:
    plan = plan_a(4096)
    assert all(not reach.within and not reach.changes for reach in reaches(plan, 70.0, 0.1))


def test_changes_do_what_they_say() -> None:
    plan = plan_a(exposure=0.004)
    faster = change(plan, "frame rate", 4).plan
    assert faster.duration_s == pytest.approx(plan.duration_s)
    assert faster.experiment.camera.exposure_s == pytest.approx(1 / 480)
    assert change(plan, "frame rate", 2).plan.experiment.camera.exposure_s == 0.004
    assert change(plan, "exposure", 0.25).plan.experiment.camera.exposure_s == 0.001
    assert change(plan, "duration", 2).plan.frames == 2 * plan.frames
    words = change(plan, "viscosity", 2).words
    assert words == "viscosity 2 mPa s (×2)"


def test_command_prints_table_csv_and_figure(tmp_path: Path) -> None:
    path, table, page = tmp_path / "setup.toml", tmp_path / "a.csv", tmp_path / "a.html"
    path.write_text(setup_text(FULL, radius=500, contour=1200))
    result = CliRunner().invoke(
        app,
        ["design", str(path), "--frames=4096", "--reach=20", f"--csv={table}", f"--figure={page}"],
    )
    assert result.exit_code == 0, result.output
    for words in ("tracking noise", "x, along the field", "Cheapest: ", "arctangent, n = ±1"):
        assert words in result.output
    with table.open() as file:
        rows = list(csv.DictReader(file))
    steps = sum(len(kind.steps) for kind in KINDS.values())
    now = sum(len(method.axes) for method in METHODS.values())
    assert len(rows) == now + steps * len(METHODS)
    assert all(float(row["lower_pN"]) < float(row["upper_pN"]) for row in rows if row["lower_pN"])
    assert "Plotly" in page.read_text(encoding="utf-8")


def test_figure_is_one_that_plotly_draws(tmp_path: Path) -> None:
    import plotly.graph_objects as go

    plan, notices = plan_of(setup_of(FULL), 1024)
    ranges = all_ranges(plan, 0.1)
    changed = change(plan, "viscosity", 2)
    ranges_then = tuple(
        force_range(changed.plan, method, method.axes[0], 0.1) for method in METHODS.values()
    )
    variants = (Variant(changed, ranges_then),)
    design = Design(plan, 0.1, ranges, variants, 20.0, (), notices)
    figure = design_figure(design)
    go.Figure(figure)  # refuses what plotly does not know
    assert len(design_frame(design)) == len(ranges) + len(METHODS)
    with pytest.raises(MtpipeError, match=r"\.html or \.png"):
        write_figure(design, tmp_path / "a.pdf")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("radius_nm = 1400", 'radius_nm = "unknown"', r"\[beads\] radius_nm is \"unknown\""),
        ("contour_length_nm = 2700", 'contour_length_nm = "unknown"', "contour_length_nm is"),
    ],
)
def test_unknown_values_are_named(old: str, new: str, words: str) -> None:
    import tomllib

    text = setup_text().replace("radius_nm_stderr = 0\n", "").replace(old, new)
    with pytest.raises(SetupError, match=words):
        measurable_forces(parse_setup(tomllib.loads(text)))


def test_impossible_arguments_are_refused(tmp_path: Path) -> None:
    setup = setup_of()
    for bad in (
        {"error": 0.0},
        {"error": math.nan},
        {"reach_pN": -1.0},
        {"frames": 5},
        {"duration_s": -1.0},
    ):
        with pytest.raises(SetupError):
            measurable_forces(setup, **bad)  # type: ignore[arg-type]
    path = tmp_path / "setup.toml"
    path.write_text(setup_text())
    both = ["design", str(path), "--duration", "10", "--frames", "1000"]
    assert CliRunner().invoke(app, both).exit_code == 2


def test_predictions_are_what_simulated_recordings_give() -> None:
    """A small `workflows/design/confirm.py`: 16 repeats, 2048 frames, two forces.

    For Gaussian errors the mean square over the prediction is χ²₁₆/16; bounds at 1e-4 each for
    eight comparisons: one false failure in 600 seeds. The seed is fixed.
    """
    path = ROOT / "workflows" / "design" / "confirm.py"
    spec = importlib.util.spec_from_file_location("confirm_design", path)
    assert spec is not None
    assert spec.loader is not None
    confirm = importlib.util.module_from_spec(spec)
    sys.modules["confirm_design"] = confirm
    spec.loader.exec_module(confirm)
    plan, _ = plan_of(setup_of(NOISY), 2048)
    methods = ("friction known", "equipartition")
    results = confirm.confirm(plan, (1.0, 10.0), 16, 3, methods)
    assert len(results) == 8
    for one in results:
        assert len(one.errors) == 16
        # χ²₁₆/16 is between 0.16 and 2.9 with a probability of 1 − 2e-4
        assert 0.16 < float(np.mean(one.errors**2)) / one.rms**2 < 2.9
