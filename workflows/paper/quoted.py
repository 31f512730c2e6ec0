"""What te Velthuis et al. report, as far as it is known here, and nothing else.

te Velthuis, Kerssemakers, Lipfert & Dekker 2010, Biophys. J. 99:1292–1302, "Quantitative
guidelines for force calibration through spectral analysis of magnetic tweezers data". Its text is
the source of the numbers; its figures and its Table S1 are not public here, so no value is read off
a figure.
"""

from __future__ import annotations

from dataclasses import dataclass

NOT_PUBLIC = "not public here"

# "Below 10 % error": largest corner frequency (Hz) and, with 2.7 µm of DNA, largest force (pN).
LIMIT_ERROR = 0.10
UNCORRECTED_LIMIT_HZ = 32.0
UNCORRECTED_LIMIT_PN = 14.0
CORRECTED_LIMIT_HZ = 47.0
CORRECTED_LIMIT_HZ_STDERR = 2.0
CORRECTED_LIMIT_PN = 20.0

# A tether of 3.6 kb exceeds the corrected limit from about this force on; radius not stated.
SHORT_TETHER_NM = 3600 * 0.34
SHORT_TETHER_LIMIT_PN = 3.0

TIME_STEP_S = 5e-6


@dataclass(frozen=True)
class Beside:
    """A number of the paper beside ours."""

    name: str
    unit: str
    quoted: float | None
    ours: float

    @property
    def row(self) -> tuple[str, str, str, str]:
        """Name, the paper's, ours, deviation."""
        if self.quoted is None:
            return self.name, NOT_PUBLIC, f"{self.ours:.3g} {self.unit}", "–"
        deviation = 100 * (self.ours / self.quoted - 1)
        return (
            self.name,
            f"{self.quoted:.3g} {self.unit}",
            f"{self.ours:.3g} {self.unit}",
            f"{deviation:+.0f} %",
        )
