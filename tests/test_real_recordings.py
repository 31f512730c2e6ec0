"""mtpipe's answers on pieces of real recordings: docs/real-recordings.md says more of each.

None of these recordings has a known truth: the tests hold what can be defended, each with the
reason for its limits. All are skipped where ../shared is not beside the checkout.
"""

import dataclasses
import importlib
from pathlib import Path

import numpy as np
import pytest

from mtpipe.calibration.calibration import calibrate
from mtpipe.calibration.quality import trace_flags
from mtpipe.drift import subtract_drift
from mtpipe.ingest import load
from mtpipe.ingest.surface import put_surface_at_zero
from mtpipe.pipeline.verdict import bead_verdict
from mtpipe.recording.recording import Plateau
from mtpipe.setup.conditions import conditions_of
from mtpipe.setup.measured import Measured
from mtpipe.setup.setup import read_setup

ROOT = Path(__file__).parents[1]
RECORDINGS = ROOT.parent / "shared" / "recordings"
SETUPS = ROOT / "tests" / "data" / "real_setups"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not RECORDINGS.is_dir(), reason="../shared/recordings is not beside this checkout"
    ),
]


def read(where, name, beads=None):
    raw = load(RECORDINGS / where, SETUPS / f"{name}.toml")
    if beads is not None:
        kept = {bead: raw.positions_nm[bead] for bead in beads}
        raw = dataclasses.replace(raw, positions_nm=kept)
    return put_surface_at_zero(subtract_drift(raw))


@pytest.fixture(scope="module")
def cmaddry():
    """The complete recording, with the exposure that its good tethers agree on, a whole frame."""
    recording = read("cmaddry-run2", "cmaddry-run2")
    camera = recording.setup.camera.model_copy(update={"exposure_s": Measured(value=1 / 400)})
    setup = recording.setup.model_copy(update={"camera": camera})
    return dataclasses.replace(recording, setup=setup)


def on_rows(recording, beads, start, stop, magnet_mm=21.7):
    """Calibration of some beads in one stretch of rows, whatever the rotation motor did."""
    kept = {bead: recording.positions_nm[bead] for bead in beads}
    plateau = Plateau(0, start, stop, magnet_mm)
    part = dataclasses.replace(recording, positions_nm=kept, plateaus=(plateau,))
    return calibrate(part)


def lateral(bead):
    (plateau,) = bead.plateaus
    return [one for one in plateau.axes if one.axis != "z"]


# Forces that the owners printed for rows 138000 to 140000 (spectrum of x), and the extension that
# turns their equipartition force of y back into the variance of y. Theirs is ours less 40 nm for
# b1 and b2, and less 378 nm for b4: where z = 0 lies is all that has to differ.
OWNERS_HIGH = {"b1": (3.203, 1384.0), "b2": (2.718, 1613.0), "b4": (3.528, 1372.0)}


def test_cmaddry_strong_force_is_the_owners_but_for_the_zero_of_z(cmaddry):
    result = on_rows(cmaddry, OWNERS_HIGH, 138_000, 140_000)
    for bead in result.beads:
        printed, owners_nm = OWNERS_HIGH[bead.bead]
        x, y = lateral(bead)
        extension = bead.plateaus[0].extension_nm
        # a 5 s trace gives the stiffness to 5 %; the exposures assumed differ by as much
        assert x.force.value * owners_nm / extension == pytest.approx(printed, rel=0.10)
        # three beads of one kind under one magnet
        assert 2.4 < x.force.value < 4.8
        assert 0.6 < x.force.value / y.force.value < 1.3


def test_cmaddry_friction_of_good_tethers(cmaddry):
    """Between Stokes with the wall and half as much again, as a bead of 1050 nm would have it."""
    result = on_rows(cmaddry, OWNERS_HIGH, 172_300, 191_400)
    for bead in result.beads:
        assert 1.0 < bead.friction_ratio.value < 1.5


def test_cmaddry_forces_that_differ_are_not_shared(cmaddry):
    """b2 in 48 s: y shows 1.4 times the force of x and 1.3 times its friction."""
    (bead,) = on_rows(cmaddry, ("b2",), 172_300, 191_400).beads
    x, y = lateral(bead)
    assert not x.shares_force
    assert not y.shares_force
    assert y.force_alone.value > 1.2 * x.force_alone.value
    assert x.force.value == pytest.approx(x.force_alone.value, rel=0.05)
    assert y.force.value == pytest.approx(y.force_alone.value, rel=0.05)


def test_cmaddry_weak_force(cmaddry):
    result = on_rows(cmaddry, ("b1", "b2", "b4"), 145_000, 168_000, 11.7)
    forces = [one.force.value for bead in result.beads for one in lateral(bead)]
    assert all(0.03 < force < 0.065 for force in forces)


def test_cmaddry_the_short_bead_is_unlike_its_neighbours(cmaddry):
    """b3 at the weak force: the magnets pull all beads alike, yet it seems pulled twice as hard."""
    result = on_rows(cmaddry, ("b1", "b2", "b3", "b4"), 145_000, 168_000, 11.7)
    force = {bead.bead: lateral(bead)[1].force.value for bead in result.beads}
    assert force["b3"] > 2 * max(force[bead] for bead in ("b1", "b2", "b4"))


def test_cmaddry_circling_beads_are_refused(cmaddry):
    """While the magnets turn, and nobody told mtpipe that they do."""
    result = on_rows(cmaddry, ("b1", "b2", "b3", "b4"), 271_000, 283_000)
    for bead in result.beads:
        assert all(one.force is None and "circles at 3" in one.refusal for one in lateral(bead))


def test_cmaddry_circling_in_the_middle_of_a_dwell_is_cut_out(cmaddry):
    """The owners' range of rotation begins and ends with magnets at rest, which give forces."""
    result = on_rows(cmaddry, ("b1", "b2", "b4"), 265_000, 290_000)
    for bead in result.beads:
        before, turning, after = bead.plateaus
        assert all(one.force is None and "circles at 3" in one.refusal for one in turning.axes)
        # by the rotation column the motor turns in rows 270 474 to 283 774
        assert before.trace.plateau.stop <= 270_500
        assert after.trace.plateau.start >= 283_700
        for rest in (before, after):
            assert all(2.4 < one.force.value < 4.8 for one in rest.axes if one.axis != "z")


@pytest.fixture(scope="module")
def crosscheck_map():
    """The module of the workflow that prints the maps of docs/real-recordings.md."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "workflows" / "real_recordings"))
        yield importlib.import_module("crosscheck_map")


@pytest.mark.parametrize("bead", ["b1", "b2"])
def test_cmaddry_map_shows_the_vibration_untold(cmaddry, crosscheck_map, bead):
    """30 s in the first dwell: z vibrates at 29.77 and 35.77 Hz, and no longer once subtracted.

    The setup names neither vibration nor drift. b2 shows 1.3 times the references' vibration, b1
    very nearly as much as they; the repeated frames of the first minute (docs/real-recordings.md)
    are left out.
    """
    whole = load(RECORDINGS / "cmaddry-run2", SETUPS / "cmaddry-run2.toml")
    kept = {name: whole.positions_nm[name] for name in ("ref1", "ref2", bead)}
    first = dataclasses.replace(whole.plateaus[0], start=28_440, stop=40_440)
    raw = crosscheck_map.cut_out(dataclasses.replace(whole, positions_nm=kept), [first])
    part = {name: cmaddry.positions_nm[name] for name in kept}
    without = crosscheck_map.cut_out(dataclasses.replace(cmaddry, positions_nm=part), [first])
    told = crosscheck_map.untold(without).setup.model.effects
    assert not {"vibration", "drift", "reference_noise"} & set(told)

    before = crosscheck_map.map_of(crosscheck_map.raw_stretch(raw, without))
    after = crosscheck_map.map_of(without)
    assert before["bead_p_value"].iloc[0] < 1e-6
    assert least_p_of_line(before, "z", 35.77) < 1e-6
    for line_hz in (29.77, 35.77):
        assert least_p_of_line(after, "z", line_hz) > 1e-3


def least_p_of_line(table, axis, frequency_hz):
    """Smallest p-value of the lines that stand out at this frequency; 1 where none is there."""
    line = table[table["statistic"].isin(["line", "second_line"]) & (table["axis"] == axis)]
    here = (line["band_low_hz"] < frequency_hz) & (line["band_high_hz"] > frequency_hz)
    return line.loc[here, "p_value"].min() if here.any() else 1.0


def test_cmaddry_map_shows_the_height_of_b3(cmaddry, crosscheck_map):
    """Two rests at one motor position: b3's mean heights are further from one chain than b1's."""
    rests = [p for p in cmaddry.plateaus if p.number in (4, 36)]
    rests[0] = dataclasses.replace(rests[0], stop=rests[0].start + 8_000)
    kept = {bead: cmaddry.positions_nm[bead] for bead in ("ref1", "ref2", "b1", "b3")}
    part = dataclasses.replace(cmaddry, positions_nm=kept)
    table = crosscheck_map.map_of(crosscheck_map.cut_out(part, rests))
    heights = table[(table["statistic"] == "extension") & table["plateau"].notna()]
    largest = heights["value"].abs().groupby(heights["bead"]).max()
    assert largest["b3"] > 3 * largest["b1"]


def test_softmatterlab_stiffness():
    """A whole frame of blur lowers the variance to 0.89; tracking noise can only raise it."""
    recording = read("softmatterlab-water", "softmatterlab-water")
    (bead,) = calibrate(recording).beads
    (x,) = [one for one in bead.plateaus[0].axes if one.axis == "x"]
    conditions, _ = conditions_of(recording.setup)
    variance = float(np.var(recording.positions_nm["b1"][:, 0]))
    unblurred = conditions.thermal_energy_pN_nm / variance
    assert 0.85 * unblurred < x.estimates.stiffness.value < 1.05 * unblurred
    assert x.estimates.stiffness.value == pytest.approx(1.12e-3, rel=0.06)
    assert x.estimates.stiffness.stderr < 0.03 * x.estimates.stiffness.value
    assert x.force is None


@pytest.mark.parametrize("name", ["bead1_cal", "bead2_cal", "bead1_trj", "bead2_trj"])
def test_vbtpm_stiffness_with_caution_or_refusal(name):
    """No force holds these tethers: what is left is kT over the variance, and slow drift."""
    recording = read(f"vbtpm/{name}.mat", "vbtpm")
    result = calibrate(recording)
    (bead,) = result.beads
    conditions, _ = conditions_of(recording.setup)
    for axis, one in enumerate(lateral(bead)):
        assert one.force is None
        if not one.refusal:
            variance = float(np.var(recording.positions_nm["b1"][:, axis]))
            expected = conditions.thermal_energy_pN_nm / variance
            assert one.estimates.stiffness.value == pytest.approx(expected, rel=0.35)
    flags = trace_flags(result, bead, bead.plateaus[0], recording.setup)
    assert bead_verdict(bead, flags, recording.setup).verdict != "good"


def test_picotwist_heights_alone_give_no_force():
    setup = read_setup(SETUPS / "picotwist.toml")
    kept = (7, 10, 71)  # two references and a hairpin
    others = tuple(f"bead{n:03d}" for n in range(74) if n not in kept)
    source = setup.source.model_copy(update={"leave_out": others})
    raw = load(RECORDINGS / "picotwist", setup.model_copy(update={"source": source}))
    result = calibrate(put_surface_at_zero(subtract_drift(raw)))
    assert [bead.bead for bead in result.beads] == ["bead010"]
    for bead in result.beads:
        verdict = bead_verdict(bead, (), setup)
        assert verdict.verdict == "refused"
        assert "x and y were not recorded" in verdict.reasons[0]


def test_picotwist_plot_file_gives_no_force():
    recording = read("picotwist/grfile.gr", "picotwist-gr")
    (bead,) = calibrate(recording).beads
    verdict = bead_verdict(bead, (), recording.setup)
    assert verdict.verdict == "refused"
    assert "x and y were not recorded" in verdict.reasons[0]


def test_vannoort_focus_scan_gives_no_force():
    """Where z = 0 is nobody knows: no extension, no force."""
    recording = read("vannoort-stacks/data_024.tdms", "vannoort-tdms", ["bead0", "bead3", "bead10"])
    for bead in calibrate(recording).beads:
        assert all(one.force is None for one in lateral(bead))
