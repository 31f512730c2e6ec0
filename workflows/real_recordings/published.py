"""What the owners of cmaddry-run2 printed of it, and which rows they took.

Forces in pN of `tweezepy`'s Allan variance, its spectrum, and equipartition, from the repository's
notebooks by way of ../shared/recordings/README.md. Rows count from 0, the end is not included.
"""

from __future__ import annotations

from dataclasses import dataclass

THERMAL_ENERGY_PN_NM = 4.1
STAIRCASE = (175_000, 250_000)
ROTATION = (273_000, 280_000)


@dataclass(frozen=True)
class Range:
    """Rows of constant force and the forces printed for them: Allan, spectrum, equipartition."""

    name: str
    start: int
    stop: int
    magnet_mm: float
    forces_pN: dict[str, tuple[float, float, float]]


RANGES = (
    Range(
        "high",
        138_000,
        140_000,
        21.7,
        {"b1": (3.133, 3.203, 3.129), "b2": (2.718, 2.718, 3.211), "b4": (3.581, 3.528, 2.521)},
    ),
    Range(
        "low",
        145_000,
        168_000,
        11.7,
        {
            "b1": (0.0359, 0.0358, 0.0360),
            "b2": (0.0374, 0.0376, 0.0359),
            "b4": (0.0733, -0.0668, 0.0682),
        },
    ),
)
