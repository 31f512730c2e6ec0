"""What is known of a bead's tracking noise before its spectra are fitted.

Reference beads show the noise there is, photons, camera, tracker and stage together, but theirs:
they are in another focus than tethered beads. A recording that mtpipe tracked itself knows from
the images how much of it light and camera make for every bead (`Recording.tracked`). Both are
used: the reference beads' noise, in proportion to what the images say of this bead and of them.
"""

from __future__ import annotations

import math
import statistics

from mtpipe.recording.recording import Recording

Axes = tuple[float | None, float | None, float | None]


def expected_noise_nm(recording: Recording, bead: str, reference_nm: Axes) -> Axes:
    """Tracking noise to expect of a bead along x, y, z, in nm; None where nothing is known.

    Parameters
    ----------
    recording : after drift subtraction.
    reference_nm : noise that the reference beads in use show; None where there are none.
    """
    if recording.tracked is None:
        return reference_nm
    precision = recording.tracked.precision_nm
    own = precision.get(bead, (math.nan,) * 3)
    used = [] if recording.drift is None else [r for r in recording.drift.references if r.used]

    def along(axis: int) -> float | None:
        shown = reference_nm[axis]
        if not own[axis] > 0:
            return shown
        ratios = [
            r.noise_nm[axis] / precision[r.bead][axis]
            for r in used
            if r.bead in precision and r.noise_nm[axis] > 0 and precision[r.bead][axis] > 0
        ]
        if not ratios:
            return own[axis] if shown is None else shown
        return own[axis] * statistics.median(ratios)

    return along(0), along(1), along(2)
