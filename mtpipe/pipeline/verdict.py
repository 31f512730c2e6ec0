"""Verdicts: what the flags, the friction and the tether of a bead come to, in one word.

Without a cross-check the best word is "unchecked": the diagnosis turns it into "good" where the
recording is what the setup would have given.
"""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from mtpipe.calibration.bead_results import BeadResult
from mtpipe.calibration.calibration import Calibration
from mtpipe.calibration.quality import SIGMAS, differs
from mtpipe.curves.extension_curve import ForceExtension
from mtpipe.fit.tether import TetherFit
from mtpipe.ground.estimate import Estimate
from mtpipe.ground.notice import Notice
from mtpipe.setup.measured import Measured
from mtpipe.setup.setup import Setup

Verdict = Literal["good", "caution", "refused", "unchecked"]

# A few percent of contour length is a usual error of z = 0 and the refractive index; persistence
# length varies with salt and with the calibration of all other lengths.
CONTOUR_DIFFERENCE = 0.05
PERSISTENCE_DIFFERENCE = 0.20
# Tethers of one preparation are alike; one shorter than this share of the others' median is another
# thing: a fragment, or two tethers that hold the bead low.
CONTOUR_RATIO = 0.7
# Two tethers have half the persistence length of one, three a third; salt and the calibration of
# lengths make less of a difference.
SHORT_PERSISTENCE = 0.7
SEVERAL_TETHERS = (2, 3)
FEWEST_OTHERS = 2
FLAGGED_SHARE = 0.25


@dataclass(frozen=True)
class BeadVerdict:
    """Verdict on a bead with its reasons in words.

    "good": cross-checked, and nothing is wrong. "unchecked": nothing is wrong, but it was not
    cross-checked. `mismatch` is the verdict of the diagnosis, "" without a cross-check.
    `force_bound_percent` is by how much what is unexplained may still move a force of the bead, at
    most over plateaus (68 %); nan where nobody looked. `material` : whether that, or what was
    named, moves a force by more than the tolerance of the setup's `[report]`.
    """

    bead: str
    verdict: Verdict
    reasons: tuple[str, ...]
    mismatch: str = ""
    force_bound_percent: float = math.nan
    material: bool = False


def bead_verdicts(
    calibration: Calibration,
    flags: Mapping[str, tuple[Notice, ...]],
    curves: Mapping[str, ForceExtension],
    setup: Setup,
    shared: tuple[str, ...] = (),
    cross_checked: Collection[str] = (),
) -> tuple[BeadVerdict, ...]:
    """Verdicts on all beads of a recording, which are also compared with one another.

    Parameters
    ----------
    shared : what spoils every bead, such as a reference bead that moves.
    cross_checked : beads that were compared with simulations, which judge a spectrum better than
        the fit of a trace does, and say what its difference does to the force.
    """
    tethers = tether_reasons(curves, setup)
    return tuple(
        bead_verdict(
            bead,
            flags[bead.bead],
            setup,
            (*tethers.get(bead.bead, ()), *shared),
            cross_checked=bead.bead in cross_checked,
        )
        for bead in calibration.beads
    )


def bead_verdict(
    bead: BeadResult,
    flags: tuple[Notice, ...],
    setup: Setup,
    known: tuple[str, ...] = (),
    *,
    cross_checked: bool = False,
) -> BeadVerdict:
    """Verdict on a bead from the flags of its traces, its friction and its tether.

    "refused": no plateau gives a stiffness. "caution": the bead's friction or tether contradicts
    the setup, no plateau gives a force to use, or a flag of severity caution or worse stands in
    more than a quarter of its plateaus. Else "unchecked": only the cross-check makes a bead good.

    Parameters
    ----------
    known : what is wrong with its tether, or with the whole recording.
    cross_checked : whether the diagnosis says what a spectrum unlike the model comes to.
    """
    lateral = [one for plateau in bead.plateaus for one in plateau.axes if one.axis != "z"]
    told = {plateau.status(one) for plateau in bead.plateaus for one in plateau.axes
            if one.axis != "z"}  # fmt: skip
    if not lateral:
        alone = "x and y were not recorded, and the force comes from the lateral motion"
        return BeadVerdict(bead.bead, "refused", (alone,))
    sentences = [one.refusal for one in lateral if one.refusal]
    if not told & {"ok", "unlike_model"}:
        fallback = NO_FORCE.get(next(iter(told)), NOT_KNOWN) if len(told) == 1 else NOT_KNOWN
        common = [sentence for sentence, _ in Counter(sentences).most_common(3)]
        return BeadVerdict(bead.bead, "refused", tuple(common) or (fallback,))
    reasons = list(known)
    if bead.friction_contradicts and bead.friction_ratio is not None:
        ratio = bead.friction_ratio
        wall = "with" if setup.model.wall else "without"
        reasons.append(
            f"its friction is {ratio.value:.2f} ± {ratio.stderr:.2f} times that expected from "
            f"radius and viscosity ({wall} the wall's correction)"
        )
    plateaus: dict[str, set[int]] = {}
    for notice in flags:
        judged = cross_checked and notice.code == "poor_fit"
        if notice.severity != "info" and notice.plateau is not None and not judged:
            plateaus.setdefault(notice.code, set()).add(notice.plateau)
    for code, where in sorted(plateaus.items(), key=lambda pair: -len(pair[1])):
        if len(where) > FLAGGED_SHARE * len(bead.plateaus):
            reasons.append(f"{FLAG_WORDS[code]} in {len(where)} of {len(bead.plateaus)} plateaus")
    if "ok" not in told and not cross_checked:
        reasons.append("no plateau gives a force to use")
    return BeadVerdict(bead.bead, "caution" if reasons else "unchecked", tuple(reasons))


def tether_reasons(
    curves: Mapping[str, ForceExtension], setup: Setup
) -> dict[str, tuple[str, ...]]:
    """Where a bead's tether contradicts the setup, or is unlike the other beads'."""
    fits = {
        bead: curve.recommended for bead, curve in curves.items() if curve.recommended is not None
    }
    return {
        bead: (
            *_unlike_the_others(fit, [one for other, one in fits.items() if other != bead]),
            *_unlike_the_setup(fit, [one for other, one in fits.items() if other != bead], setup),
        )
        for bead, fit in fits.items()
    }


def _unlike_the_others(fit: TetherFit, others: Sequence[TetherFit]) -> list[str]:
    """What to say of a tether that is far shorter or longer than the others."""
    if len(others) < FEWEST_OTHERS:
        return []
    median = statistics.median(other.contour_length_nm.value for other in others)
    ratio = fit.contour_length_nm.value / median
    if abs(math.log(ratio)) <= abs(math.log(CONTOUR_RATIO)):
        return []
    hint = ", perhaps held by more than one" if ratio < 1 else ""
    return [f"its tether is {ratio:.2f} times as long as the other beads' (median){hint}"]


def _unlike_the_setup(fit: TetherFit, others: Sequence[TetherFit], setup: Setup) -> list[str]:
    """Where a tether contradicts the one configured."""
    contour = _contradiction(
        "contour", fit.contour_length_nm, setup.tether.contour_length_nm, CONTOUR_DIFFERENCE
    )
    stated = setup.tether.persistence_length_nm
    persistence = _contradiction(
        "persistence", fit.persistence_length_nm, stated, PERSISTENCE_DIFFERENCE
    )
    reasons = [contour] if contour else []
    if persistence:
        reasons.append(persistence + _why_short(fit, others, stated, contour_too=bool(contour)))
    return reasons


def _contradiction(name: str, fitted: Estimate, configured: Measured, size: float) -> str:
    """One length beside that of the setup, where they differ; else empty."""
    value = configured.value
    if value is None or not differs(fitted, value, configured.stderr, size):
        return ""
    return (
        f"its {name} length is {fitted.value:.4g} ± {fitted.stderr:.2g} nm, the setup says "
        f"{value:.4g} nm"
    )


def _why_short(
    fit: TetherFit, others: Sequence[TetherFit], stated: Measured, *, contour_too: bool
) -> str:
    """What may make a chain seem too flexible, if anything shows it; else empty.

    n equal tethers side by side have 1/n of the persistence length and the contour length of one.
    A wrong z moves both lengths, and mostly those of all beads. From one bead alone nobody can say.
    """
    value, one = stated.value, fit.persistence_length_nm
    if value is None or one.value > SHORT_PERSISTENCE * value:
        return ""
    if contour_too:
        return "; as both lengths are off, z (its scale, or where it is 0) is probably wrong"
    if len(others) < FEWEST_OTHERS:
        return "; z (its scale, or where it is 0) or the number of tethers may not be as stated"
    short = [other.persistence_length_nm.value < SHORT_PERSISTENCE * value for other in others]
    if 2 * sum(short) > len(short):
        return "; the other beads differ too: z (its scale, or where it is 0) is probably wrong"
    several = any(
        abs(one.value - value / n) < SIGMAS * math.hypot(one.stderr, stated.stderr / n)
        for n in SEVERAL_TETHERS
    )
    if several and not any(short):
        return "; for the other beads it is longer: this one may be held by more than one tether"
    return ""


NOT_KNOWN = "stiffness is not known in any plateau: not identified, or not converged"
NO_FORCE = {
    "zero_force": "in every plateau the force may be zero within its error",
    "not_one_state": "every plateau mixes several states",
}
FLAG_WORDS = {
    "lost_frames": "many frames lost",
    "mistracked": "mistracked frames",
    "refused": "traces refused as no tethered bead's",
    "above_nyquist": "corner frequency near or above Nyquist",
    "short_trace": "traces short against the relaxation time",
    "not_identified": "stiffness not identified",
    "not_converged": "posterior not converged",
    "zero_force": "force that may be zero",
    "not_one_state": "several states mixed",
    "poor_fit": "spectrum unlike the model",
    "drift": "slow motion left in the trace",
    "effective_radius": "effective radius unlike the setup's",
    "no_extension": "no extension, and so no force,",
    "extension": "extension impossible for the tether",
    "unlike_the_series": "traces that contradict the bead's other traces",
    "fx_fy": "forces from x and y differ",
    "known_force": "force unlike the one that the setup states",
    "reference_stepped": "reference beads step in z",
    "beyond_dna": "force higher than double-stranded DNA can bear",
    "focus_moved": "stage or focus moved far in z",
}
