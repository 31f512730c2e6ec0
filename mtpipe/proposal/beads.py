"""What the beads' motion adds to a draft: references, the field's axis, plateaus, z = 0."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from mtpipe.ground.types import FloatArray
from mtpipe.proposal.asking import Asking
from mtpipe.proposal.draft import USUAL, Draft
from mtpipe.proposal.motion import field_axis, fixed_beads, motion_of
from mtpipe.proposal.name_words import is_reference
from mtpipe.proposal.questions import ASKED
from mtpipe.proposal.rest import SHORTEST_S, rest_of
from mtpipe.proposal.surface import surface_of
from mtpipe.recording.plateaus import find_plateaus
from mtpipe.recording.recording import Plateau, Recording
from mtpipe.setup.measured import UNKNOWN
from mtpipe.setup.tables import Plateaus


def put_references(
    draft: Draft, asking: Asking, positions_nm: Mapping[str, FloatArray], rate_hz: float
) -> None:
    """Put the beads that are fixed to the surface, by their names or their motion."""
    motion = motion_of(positions_nm, rate_hz)
    named = [bead for bead in positions_nm if is_reference(bead)]
    still = list(fixed_beads(motion))
    found = named or still
    others = [bead for bead in motion.beads if bead not in found]
    moving = [bead for bead in found if bead in motion.beads]
    how = ""
    if moving and others:
        they = "they move" if len(moving) > 1 else "it moves"
        how = f"{they} by {motion.of(moving)} within a second, the others by {motion.of(others)}"
    if named:
        stuck = [bead for bead in still if bead not in named]
        also = f"; {', '.join(stuck)} move as little" if stuck else ""
        why = f"by name; {how}{also}" if how else "by name"
    elif still:
        why = f"a guess: {how}"
    else:
        why = "a guess: no bead moves much less than the others"
    if len(found) == len(positions_nm):
        found, why = [], "all beads seem to be fixed: say which are"
    alone = len(positions_nm) == 1
    question = ASKED["beads.reference"]
    asking.about(
        "beads.reference", question, found, "there is one bead" if alone else why, certain=alone
    )


def put_field(
    draft: Draft, asking: Asking, positions_nm: Mapping[str, FloatArray], rate_hz: float
) -> None:
    """Put the axis of the field: along it beads move less."""
    axis = field_axis(positions_nm, rate_hz)
    if axis is None:
        guess, why = "x", f"the motion does not show it; {USUAL}"
    else:
        guess = axis[0]
        why = f"a guess: beads move less along it (variance smaller by a factor of {axis[1]:.2g})"
    asking.about("field.direction", ASKED["field.direction"], guess, why)


def put_rest(draft: Draft, recording: Recording, *, log: bool) -> Sequence[Plateau]:
    """Put what counts as a plateau; the stretches of resting magnets, short ones too."""
    lasts_s = float(recording.time_s[-1] - recording.time_s[0])
    if recording.magnet_mm is None:
        if lasts_s < Plateaus().minimum_s:
            shorter = float(f"{lasts_s / 2:.1g}")
            draft.put("plateaus.minimum_s", shorter, f"it lasts {lasts_s:.3g} s", guess=True)
        return ()
    rest = rest_of(recording.time_s, recording.magnet_mm, log=log)
    for key, value in rest.choices.items():
        draft.put(f"plateaus.{key}", value, rest.why[key], guess=True)
    chosen = {**(draft.get("plateaus") or {}), "minimum_s": SHORTEST_S}
    return find_plateaus(recording.time_s, recording.magnet_mm, Plateaus.model_validate(chosen))


def put_surface(draft: Draft, recording: Recording, stretches: Sequence[Plateau]) -> None:
    """Put where z = 0 is."""
    if draft.states_some("source.z_zero") or draft.states_some("source.z_zero_of"):
        return
    beads = recording.setup.beads.model_copy(
        update={"reference": tuple(draft.get("beads.reference") or ())}
    )
    setup = recording.setup.model_copy(update={"beads": beads})
    stated = draft.get("tether.contour_length_nm")
    contour_nm = float(stated) if isinstance(stated, (int, float)) else None
    surface = surface_of(replace(recording, setup=setup), stretches, contour_nm)
    if surface.touch is not None:
        rows = [surface.touch[0] + 1, surface.touch[1]]
        draft.put("source.z_zero.touch_rows", rows, f"a guess: {surface.why}", guess=True)
        draft.put("source.z_zero.no_plateau", True)
    else:
        why = f"a guess: {surface.why}"
        if "value_nm" in surface.z_zero and "source.scale.z" in draft.guessed:
            why += ". It was multiplied by scale.z: change both by the same factor"
        draft.put("source.z_zero", surface.z_zero, why, guess=True)


def put_without_reading(draft: Draft) -> None:
    """Put what a setup must have, where the beads could not be looked at."""
    for key, value in (
        ("camera.frame_rate_hz", UNKNOWN),
        ("beads.reference", []),
        ("field.direction", "x"),
    ):
        if draft.get(key) is None:
            draft.put(key, value, f"the beads could not be looked at; {USUAL}")
    if draft.get("source.beads") is not None and draft.get("source.z_zero") is None:
        draft.put("source.z_zero", {"unknown": True}, "the beads could not be looked at")
