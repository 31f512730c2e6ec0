"""Numbers of docs/physics.md that follow from formulas alone: chains, aliases, the whole potential.

    python workflows/physics/closed_forms.py --write docs/physics.md

Each is calculated in a second way: alias sums term by term, averages over a potential by quadrature
over distance and direction.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.integrate import cumulative_simpson

from mtpipe.ground.types import FloatArray
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.camera import Camera, power_spectrum
from mtpipe.physics.tether import Chain, extension_nm, force_pN, stiffness_pN_per_nm

sys.path.append(str(Path(__file__).parents[1] / "common"))
from pages import into_page, table

COMMAND = "python workflows/physics/closed_forms.py --write docs/physics.md"
KELVIN, PERSISTENCE_NM, MODULUS_PN, RATE_HZ = 293.15, 50.0, 1000.0, 120.0
CONTOURS_NM = (2700.0, 1200.0)
KT = float(thermal_energy_pN_nm(KELVIN))


def chain_of(contour_nm: float) -> Chain:
    """DNA by Bouchiat's formula."""
    return Chain(contour_nm, PERSISTENCE_NM, KELVIN)


def interpolation(forces_pN: tuple[float, ...] = (0.1, 0.5, 1, 5, 10)) -> str:
    """What Marko and Siggia's interpolation misses, for any contour length."""
    exact = chain_of(CONTOURS_NM[0])
    near = replace(exact, formula="marko-siggia")
    lines = []
    for force in forces_pN:
        length, of_near = float(extension_nm(exact, force)), float(extension_nm(near, force))
        inferred = float(force_pN(near, length))
        stiffer = float(stiffness_pN_per_nm(exact, length) / stiffness_pN_per_nm(near, of_near))
        changes = (of_near / length, inferred / force, stiffer)
        lines.append([f"{force:g}", *(percent(one - 1) for one in changes)])
    head = ["force / pN", "extension", "force that it infers from an extension"]
    return table(" | ".join([*head, "$k_z$ of Bouchiat over it"]), lines)


def stretching(forces_pN: tuple[float, ...] = (0.1, 2, 5, 10, 20)) -> str:
    """What a modulus does to extension and stiffness."""
    stiff = chain_of(CONTOURS_NM[0])
    soft = replace(stiff, formula="extensible", stretch_modulus_pN=MODULUS_PN)
    lines = []
    for force in forces_pN:
        long, short = float(extension_nm(soft, force)), float(extension_nm(stiff, force))
        left = float(stiffness_pN_per_nm(soft, long) / stiffness_pN_per_nm(stiff, short))
        odijk = stiff.contour_length_nm * (
            1 - 0.5 * np.sqrt(KT / (force * PERSISTENCE_NM)) + force / MODULUS_PN
        )
        apart = f"{odijk - long:+.1f}".replace("-", "−")
        lines.append([f"{force:g}", percent(long / short - 1), f"{left:.2f}", apart])
    head = (
        "force / pN | longer by | share of $k_z$ that is left | Odijk's formula less this one / nm"
    )
    return table(head, lines)


def aliases(corners_hz: tuple[float, ...] = (60.0, 150.0)) -> str:
    """The largest error of a spectrum of which only some aliases are kept."""
    lines = []
    for corner in corners_hz:
        for words, kept in (("$n = -1, 0, 1$", (-1, 0, 1)), ("$n = -1, 0$", (-1, 0))):
            errors = [truncated(corner, share / RATE_HZ, kept) for share in (1.0, 0.5, 0.1, 0.0)]
            lines.append([f"{corner:g}", words, *map(percent, errors)])
    return table("$f_c$ / Hz | aliases that are kept | $W = D$ | $D/2$ | $D/10$ | 0", lines)


def truncated(corner_hz: float, exposure_s: float, kept: tuple[int, ...]) -> float:
    """The largest relative error between 0 and the Nyquist frequency, with its sign."""
    camera = Camera(1 / RATE_HZ, exposure_s)
    f, tau = np.linspace(0, RATE_HZ / 2, 2001), 1 / (2 * np.pi * corner_hz)
    beyond = f + RATE_HZ * np.array(kept)[:, None]
    each = 4 * tau / (1 + (2 * np.pi * beyond * tau) ** 2) * np.sinc(beyond * exposure_s) ** 2
    error = each.sum(axis=0) / power_spectrum(f, 1.0, tau, camera) - 1
    return float(error[np.argmax(np.abs(error))])


def averages(forces_pN: tuple[float, ...] = (0.02, 0.05, 0.1, 0.5, 1)) -> str:
    """Averages of the tether's end over the potential in the half space above the surface."""
    lines = []
    for contour in CONTOURS_NM:
        found = [averaged(chain_of(contour), force) for force in forces_pN]
        for name, column in (("kurtosis of $x$", 0), ("skewness of $z$", 1)):
            values = [f"{one[column]:+.3f}".replace("-", "−") for one in found]
            lines.append([f"{name}, $L_0 = {contour:g}$ nm", *values])
        for name, column in (
            (r"$k_BT\langle z\rangle/\langle x^2\rangle$ over $F$", 2),
            (r"$\operatorname{Var} z$ over $k_BT/k_z$", 3),
        ):
            lines.append([f"{name}, $L_0 = {contour:g}$ nm", *(percent(o[column]) for o in found)])
    return table(" | ".join(["", *(f"{force:g} pN" for force in forces_pN)]), lines)


def averaged(chain: Chain, force: float) -> tuple[float, float, float, float]:
    """Kurtosis of x, skewness of z, and by which share two linear relations are off."""
    r = np.linspace(1e-6, 0.9995, 6001) * chain.contour_length_nm
    work = cumulative_simpson(np.asarray(force_pN(chain, r)), x=r, initial=0.0)
    cosine, weights = np.polynomial.legendre.leggauss(400)
    cosine, weights = 0.5 * (cosine + 1), 0.5 * weights  # above the surface
    exponent = (force * r[:, None] * cosine - work[:, None]) / KT
    weight = r[:, None] ** 2 * weights * np.exp(exponent - exponent.max())
    weight /= weight.sum()

    def mean(values: FloatArray) -> float:
        return float(np.sum(weight * values))

    across = r[:, None] ** 2 * (1 - cosine**2)
    x2, x4 = mean(across) / 2, 3 / 8 * mean(across**2)
    z = r[:, None] * cosine
    height = mean(z)
    variance, third = mean((z - height) ** 2), mean((z - height) ** 3)
    slope = float(stiffness_pN_per_nm(chain, extension_nm(chain, force)))
    return (
        x4 / x2**2 - 3,
        third / variance**1.5,
        KT * height / x2 / force - 1,
        variance * slope / KT - 1,
    )


def percent(share: float) -> str:
    """A share in percent, with as many digits as it needs."""
    digits = max(0, min(2, 1 - int(np.floor(np.log10(max(abs(100 * share), 1e-2))))))
    shown = f"{100 * share:+.{digits}f} %".replace("-", "−")
    return "0 %" if float(f"{100 * share:.{digits}f}") == 0 else shown


def blocks() -> dict[str, str]:
    """The tables by their names in the page."""
    made = {
        "interpolation": interpolation(),
        "stretching": stretching(),
        "aliases": aliases(),
        "averages": averages(),
    }
    return {name: f"Printed with `{COMMAND}`:\n\n{block}" for name, block in made.items()}


def main() -> None:
    """Print the tables, or write them into their page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", type=Path, help="page to put the tables into")
    page = parser.parse_args().write
    print("\n\n".join(blocks().values()))
    if page is not None:
        page.write_text(into_page(page.read_text(encoding="utf-8"), blocks()), encoding="utf-8")


if __name__ == "__main__":
    main()
