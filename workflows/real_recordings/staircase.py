"""Plateaus of recordings of one instrument that one tether and one bead should describe.

Both long rests of the motor on the focus of the staircase, and three of its steps. Whether each is
one state, and when the beads change, is asked of the whole recording before plateaus are chosen: a
log that is half a second early puts a tenth of another force into a step of 5 s.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from pathlib import Path

from mtpipe.drift import subtract_drift
from mtpipe.ingest import load
from mtpipe.recording.recording import Recording, States
from mtpipe.states import with_states

SETUPS = Path(__file__).resolve().parents[2] / "tests" / "data" / "real_setups"
# A row in the middle of each plateau.
ROWS = {
    "cmaddry-run1": (119_500, 128_300, 140_300, 152_300, 182_600),
    "cmaddry-run2": (181_000, 192_700, 204_700, 216_800, 264_800),
    "cmaddry-march": (55_400, 61_850, 85_850, 105_900, 280_800),
}
NOT_LISTED = ("drift", "reference_noise")


def series_of(name: str, recordings: Path) -> Recording:
    """The series of a recording, its drift subtracted, with a setup that is told nothing."""
    whole = subtract_drift(load(recordings / name, SETUPS / f"{name}.toml"))
    return untold(chosen(with_states(whole), ROWS[name]))


def untold(recording: Recording) -> Recording:
    """The recording with a setup that does not expect the stage's motion."""
    model = recording.setup.model
    effects = tuple(effect for effect in model.effects if effect not in NOT_LISTED)
    model = model.model_copy(update={"effects": effects})
    setup = recording.setup.model_copy(update={"model": model})
    return dataclasses.replace(recording, setup=setup)


def chosen(recording: Recording, rows: Collection[int]) -> Recording:
    """A recording whose states are known, with the plateaus alone in which these rows are,
    numbered from 0.
    """
    states = recording.states
    assert states is not None
    kept = [p for p in recording.plateaus if any(p.start <= row < p.stop for row in rows)]
    number = {plateau.number: i for i, plateau in enumerate(kept)}

    def of_kept(reasons: dict[tuple[str, int], str]) -> dict[tuple[str, int], str]:
        return {(bead, number[n]): why for (bead, n), why in reasons.items() if n in number}

    return dataclasses.replace(
        recording,
        plateaus=tuple(dataclasses.replace(p, number=number[p.number]) for p in kept),
        states=States(
            of_kept(dict(states.refused)),
            of_kept(dict(states.doubtful)),
            frozenset(number[n] for n in states.unbelieved if n in number),
        ),
    )


def alone(recording: Recording, bead: str) -> Recording:
    """The recording with the references and one tethered bead."""
    names = (bead, *recording.setup.beads.reference)
    kept = {name: xyz for name, xyz in recording.positions_nm.items() if name in names}
    return dataclasses.replace(recording, positions_nm=kept)
