"""A simulation contains the effects that the setup lists and sizes, and tells of the others."""

import math

import numpy as np
import pytest

from mtpipe.crosschecking.prepared_bead import described, prepare
from mtpipe.crosschecking.setup_effects import with_listed
from mtpipe.drift import subtract_drift
from mtpipe.effects.catalogue import OWN
from mtpipe.experiment.description import Line
from mtpipe.experiment.from_setup import experiment_of
from mtpipe.ground.errors import SetupError
from mtpipe.joint_fit.fit import fit_configured
from mtpipe.setup.setup import parse_setup
from mtpipe.setup.tables import DESCRIBED
from mtpipe.simulation.images import render_stack
from mtpipe.simulation.setup_experiment import stated_experiment
from mtpipe.simulation.simulate import simulate
from tests.simulated import setup_content

pytestmark = pytest.mark.slow

FORCES_PN = [1.0, 3.0, 9.0]
# A table's answer to height is a curve: it is fitted to a recording, and no size can be stated.
SIZED = [one for one in OWN if one.name not in {*DESCRIBED, "z_response"}]
KNOWN = ["wall_drag", "rotation_coupling"]
# Memory shows to a fast camera only.
FAST_HZ = 10_000.0


def setup(**model):
    """A setup that lists these effects, with these sizes."""
    tables = {name: sizes for name, sizes in model.items() if sizes}
    beads = {"radius_nm": 500.0, "reference": ["ref1"]}
    model = {"effects": [*KNOWN, *model], **tables}
    rate_hz = FAST_HZ if "hydrodynamic_memory" in model["effects"] else 120.0
    camera = {"frame_rate_hz": rate_hz, "exposure_s": 1 / rate_hz}
    return parse_setup(setup_content(model=model, beads=beads, camera=camera))


def stated(**model):
    return stated_experiment(setup(**model), FORCES_PN, 2000)


def left_out(notices):
    return [n.message for n in notices if n.code == "effects_not_simulated"]


# Of every effect that has a size: a setup's table, and the sizes as the effect reports them.
SIZES = {
    "off_center_attachment": {"offset_nm": 200.0},
    "exposure": {"exposure_s": 0.004},
    "drift": {f"walk_{a}_nm_per_root_s": v for a, v in zip("xyz", (2.0, 0.0, 3.0), strict=True)},
    "reference_noise": {
        "motion_x_nm": 3.0, "motion_y_nm": 0.0, "motion_z_nm": 1.0, "relaxation_s": 2.0,
    },
    "vibration": {
        "line_hz": 31.0, "amplitude_x_nm": 4.0, "amplitude_y_nm": 0.0, "amplitude_z_nm": 2.0,
    },
    "viscosity": {"viscosity_mPa_s": 1.2},
    "bead_radius": {"radius_nm": 520.0},
    "lateral_scale": {"factor": 1.05},
    "axial_scale": {"factor": 0.9},
    "dropped_frames": {"share": 0.1},
    "field_rotation": {"angle_deg": 20.0},
    "force_drift": {"relative_change": -0.1},
    "hopping": {"step_nm": 25.0, "half_force_pN": 3.0, "rate_hz": 2.0},
    "contour_length": {"contour_length_nm": 1250.0},
}  # fmt: skip


def sizes_of(effect):
    """The table of an effect; where none is written above, sizes that its hypothesis begins at."""
    if effect.name in SIZES:
        return SIZES[effect.name]
    base, _ = experiment_of(setup(**{effect.name: {}}), FORCES_PN, 2000)
    first, *_ = effect.hypotheses(base, None)
    begun = first.experiment
    for parameter in first.parameters:
        begun = parameter.change(begun, parameter.start)
    return {name: value for name, value, _ in effect.strengths(begun)}


@pytest.mark.parametrize("effect", SIZED, ids=lambda effect: effect.name)
def test_every_effect_of_the_catalogue_is_simulated_at_its_stated_size(effect):
    sizes = sizes_of(effect)
    experiment, notices = stated(**{effect.name: sizes})
    assert not left_out(notices)
    reported = {name: value for name, value, _ in effect.strengths(experiment)}
    assert reported == pytest.approx(sizes, rel=1e-6, abs=1e-5)
    assert experiment != stated(**{effect.name: {}})[0]


@pytest.mark.parametrize("effect", SIZED, ids=lambda effect: effect.name)
def test_an_effect_with_a_size_missing_is_left_out_and_the_size_is_named(effect):
    sizes = sizes_of(effect)
    for missing in sizes:
        rest = {name: value for name, value in sizes.items() if name != missing}
        experiment, notices = stated(**{effect.name: rest})
        (said,) = left_out(notices)
        assert f"{effect.name}, of which [model.{effect.name}] does not state {missing}." in said
        assert experiment == stated(**{effect.name: {}})[0]


def test_what_no_simulation_has_is_told():
    listed = setup(anharmonic_tether={}, pixel_locking={})
    experiment, notices = stated_experiment(listed, FORCES_PN, 2000)
    assert experiment.anharmonic
    assert left_out(notices) == [
        "The simulation does not contain pixel_locking, which no simulation has."
    ]


def test_an_unknown_curve_is_not_simulated():
    (said,) = left_out(stated(z_response={})[1])
    assert "z_response, which does not apply to this setup" in said


def test_a_whole_tether_needs_a_bead_that_turns():
    def told(effects):
        content = setup_content(model={"effects": [*effects, "anharmonic_tether"]})
        return left_out(simulate(parse_setup(content), [1.0], 100).notices)

    assert not told(["rotation_coupling"])
    (said,) = told(["wall_drag"])
    assert "only simulated for a bead that turns" in said


def test_an_effect_that_does_not_apply_is_told():
    content = setup_content(model={"effects": [*KNOWN, "reference_noise"]})
    content["beads"].pop("reference", None)
    _, notices = stated_experiment(parse_setup(content), FORCES_PN, 2000)
    assert "reference_noise, which does not apply to this setup" in left_out(notices)[0]


def test_a_size_that_is_none_is_refused():
    with pytest.raises(SetupError, match="hight_nm is no size"):
        stated(hopping={"hight_nm": 3.0})


def test_a_recording_shows_what_its_setup_states():
    """A line of 31 Hz and 6 nm in x, and z that is short by a tenth."""
    plain = setup()
    listed = setup(
        vibration={"line_hz": 31.0, "amplitude_x_nm": 6.0, "amplitude_y_nm": 0.0,
                   "amplitude_z_nm": 0.0},
        axial_scale={"factor": 0.9},
    )  # fmt: skip
    one, other = (simulate(s, [8.0], 20_000, 4) for s in (plain, listed))
    one_nm, other_nm = (r.positions_nm["b1"] - r.positions_nm["ref1"] for r in (one, other))
    assert other_nm[:, 2].mean() / one_nm[:, 2].mean() == pytest.approx(0.9, abs=0.005)
    x = other_nm[:, 0]
    turn = np.exp(2j * np.pi * 31.0 * other.time_s)
    assert 2 * abs(np.mean((x - x.mean()) * turn)) == pytest.approx(6.0, rel=0.1)


def test_the_fit_takes_the_same_sizes_that_the_simulation_had():
    listed = setup(
        vibration={"line_hz": 31.0, "amplitude_x_nm": 4.0, "amplitude_y_nm": 1.0,
                   "amplitude_z_nm": 2.0},
        force_drift={"relative_change": -0.1},
    )  # fmt: skip
    recording = subtract_drift(simulate(listed, FORCES_PN, 4096, 7))
    case = with_listed(prepare(recording, "b1"), listed)
    experiment = described(case)
    assert experiment.stage.lines == (Line(31.0, pytest.approx((4.0, 1.0, 2.0))),)
    courses = experiment.magnets.courses
    assert [(c.kind, c.relative_change) for c in courses] == [("ramp", pytest.approx(-0.1))] * 3
    silent = fit_configured(prepare(recording, "b1").fit.model)
    assert case.fit.log_likelihood > silent.log_likelihood + 20


def test_a_film_lacks_the_frames_that_are_dropped(tmp_path):
    sizes = {"dropped_frames": {"share": 0.2}}
    content = setup_content(
        model={"effects": [*KNOWN, "dropped_frames"], **sizes},
        camera={"frame_rate_hz": 100.0, "exposure_s": 0.01, "pixel_size_nm": 110.0},
    )
    truth = render_stack(tmp_path / "film.tif", parse_setup(content), [2.0], 150, 3)
    frames = len(truth.time_s)
    assert abs(frames - 120) < 5 * math.sqrt(150 * 0.16)
    assert frames < 150
    assert np.allclose(np.diff(truth.time_s), 0.01)
