"""A tethered bead drawn from equilibrium: where the step-by-step simulator starts.

In terms of the chain's end-to-end vector the energy is a sum, A(r) - F z of the chain's end and a
part of the angles alone. So vector and angles are drawn each on their own, exactly but for a grid
of the distance and of the tilt, and those that have the bead in the surface are drawn again. Where
the magnets hold the bead sideways, that adds an energy of both, never below 0: a draw is then kept
with the Boltzmann weight of it (rejection).
"""

from __future__ import annotations

import numpy as np
from scipy.special import i0e

from mtpipe.ground.types import FloatArray
from mtpipe.simulation.bead import BrownianBead
from mtpipe.simulation.chain_table import ChainTable
from mtpipe.simulation.dynamics import attachment

_DRAWS, _ROUNDS = 1024, 40


def draw_state(
    bead: BrownianBead, table: ChainTable, force_pN: float, random: np.random.Generator
) -> FloatArray:
    """A state of equilibrium: centre's x and y, lowest point's z, cos φ, sin φ, cos ψ, sin ψ.

    Raises
    ------
    ValueError : there is none, or too rarely: the attachment is too far from the lowest point for
        the tether to let the bead stand on the surface, or the magnets hold the bead sideways some
        ten thousand times as stiffly as the tether does.
    """
    kT, lever = bead.thermal_energy_pN_nm, bead.radius_nm
    pull = force_pN * lever / kT
    sine, cosine = np.sin(bead.attachment_angle_rad), np.cos(bead.attachment_angle_rad)
    sideways = force_pN * bead.sideways_per_nm / (2 * kT)
    stands = False
    for _ in range(_ROUNDS):
        phi, psi = np.zeros(_DRAWS), np.zeros(_DRAWS)
        if bead.alignment_pN_nm is not None:
            psi = _draw_tilt(bead, pull, _DRAWS, random)
        if bead.turns:
            swing = pull * cosine * np.cos(psi)
            phi = random.vonmises(np.where(swing < 0, np.pi, 0.0), np.abs(swing))
        ends = _draw_vector(table, force_pN, kT, _DRAWS, random)
        turned = np.stack([np.cos(phi), np.sin(phi), np.cos(psi), np.sin(psi)], axis=1)
        # a Boltzmann weight is the chance that an exponential number exceeds the energy over kT
        most = random.exponential(size=_DRAWS) if sideways else np.zeros(_DRAWS)
        for end, angles, allowed in zip(ends, turned, most, strict=True):
            centre = end - lever * np.array(attachment(sine, cosine, *angles))
            if not centre[2] > lever:
                continue
            stands = True
            if sideways * ((centre[0] + lever * sine) ** 2 + centre[1] ** 2) <= allowed:
                return np.array([centre[0], centre[1], centre[2] - lever, *angles])
    if stands:
        raise ValueError(
            f"magnets that hold the bead sideways by {bead.sideways_per_nm:g} of their force per "
            "nm leave nothing of the tether's swing to start from"
        )
    raise ValueError(
        f"a tether of {bead.chain.contour_length_nm:g} nm attached "
        f"{bead.attachment_angle_rad:.2g} rad off the lowest point of a bead of radius "
        f"{lever:g} nm does not let the bead out of the surface"
    )


def _draw_tilt(
    bead: BrownianBead, pull: float, count: int, random: np.random.Generator
) -> FloatArray:
    """The angle ψ in equilibrium: the field's hold against the chain's pull on the attachment."""
    hold = float(np.ravel(bead.holding_pN_nm)[0]) / bead.thermal_energy_pN_nm
    side = pull * np.sin(bead.attachment_angle_rad)
    down = pull * np.cos(bead.attachment_angle_rad)
    peak = np.arctan2(-side, hold + down)
    psi = peak + np.linspace(-np.pi, np.pi, 200001)
    # averaged over φ where that turns: a Bessel function, scaled by its exponential
    below = down * np.cos(psi)
    log_weight = hold * np.cos(psi) - side * np.sin(psi)
    log_weight += np.log(i0e(below)) + np.abs(below) if bead.turns else below
    cumulated = np.cumsum(np.exp(log_weight - log_weight.max()))
    return np.asarray(np.interp(random.uniform(size=count) * cumulated[-1], cumulated, psi))


def _draw_vector(
    table: ChainTable, force_pN: float, kT: float, count: int, random: np.random.Generator
) -> FloatArray:
    """End-to-end vectors of the chain under a force along z, without any surface: (count, 3)."""
    r = table.distance_nm
    pull = force_pN * r / kT
    # the angles integrate to sinh(pull)/pull, here e^pull (1 - e^(-2 pull))/(2 pull)
    angles = np.ones_like(pull)
    np.divide(-np.expm1(-2 * pull), 2 * pull, out=angles, where=pull > 1e-12)
    log_weight = pull - table.energy_pN_nm / kT
    weight = r**2 * angles * np.exp(log_weight - log_weight.max())
    below = np.cumsum(weight)
    distance = np.interp(random.uniform(size=count) * below[-1], below, r)

    pull = np.maximum(force_pN * distance / kT, 1e-12)
    share = random.uniform(size=count)
    cosine = 1 + np.log1p(-(1 - share) * -np.expm1(-2 * pull)) / pull
    cosine = np.clip(cosine, -1.0, 1.0)
    azimuth = random.uniform(0, 2 * np.pi, size=count)
    across = distance * np.sqrt(1 - cosine**2)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), distance * cosine], axis=1)
