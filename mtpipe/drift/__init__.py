"""Drift: slow motion of the stage, common to all beads, taken off the tethered ones.

`subtract_drift` is the whole step, steered by the setup's `[drift]` table; `reference_noise_nm`
gives the tracking noise of the reference beads on its own. Parts, in the order they are used:
`grid` (series on the camera's grid), `faults` (mistracked frames, jumps), `noise` (white noise, own
motion), `references` (which to trust), `combine` (several made one), `stage_moves` (sudden ones,
which a low-pass would smear), `lowpass` (its low-pass and the choice of the cutoff), `fast_z`
(beads whose z shows fast motion on a scale of its own), `highpass` (the alternative without a
reference).
"""

from mtpipe.drift.subtract import reference_noise_nm, subtract_drift

__all__ = ["reference_noise_nm", "subtract_drift"]
