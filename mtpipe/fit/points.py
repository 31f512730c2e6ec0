"""What a curve is fitted to: forces and mean extensions with errors, and how they came about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.types import FloatArray

# Which height of a tether belongs to a force (`mtpipe.fit.tether`).
Relation = Literal["potential", "long-chain"]

# Shapes of the stage's motion with less of its variance than this are rounding.
_LEAST_SHARE = 1e-10


@dataclass(frozen=True)
class ExtensionPoints:
    """Forces and mean extensions of one bead, one per plateau; all arrays of the same length.

    `lever_nm` is the length the lateral stiffness was multiplied by to give the force (extension
    along the field, extension + radius across). It matters only where heights may be off together,
    by the zero of z or the stage's motion: the force then moves with them. None: the force was
    measured otherwise. `stage_nm2` is the (points, points) covariance of the extensions by the
    stage's motion, which `extension_stderr_nm` holds and `force_stderr_pN` does not; None for none.
    """

    plateau: NDArray[np.int64]
    force_pN: FloatArray
    force_stderr_pN: FloatArray
    extension_nm: FloatArray
    extension_stderr_nm: FloatArray
    lever_nm: FloatArray | None = None
    stage_nm2: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.force_pN)

    def select(self, keep: NDArray[np.bool_]) -> ExtensionPoints:
        """The points where `keep` is True."""
        return ExtensionPoints(
            self.plateau[keep],
            self.force_pN[keep],
            self.force_stderr_pN[keep],
            self.extension_nm[keep],
            self.extension_stderr_nm[keep],
            None if self.lever_nm is None else self.lever_nm[keep],
            None if self.stage_nm2 is None else self.stage_nm2[keep][:, keep],
        )

    @property
    def own_stderr_nm(self) -> FloatArray:
        """(points,) standard errors of the extensions without the stage's motion."""
        if self.stage_nm2 is None:
            return self.extension_stderr_nm
        return np.asarray(np.sqrt(self.extension_stderr_nm**2 - np.diag(self.stage_nm2)))

    @property
    def stage_shapes_nm(self) -> FloatArray:
        """(points, n) independent shapes of the stage's motion, each of the size it has: any such
        motion is their sum with factors of variance 1."""
        if self.stage_nm2 is None:
            return np.zeros((len(self), 0))
        variance, shapes = np.linalg.eigh(self.stage_nm2)
        kept = variance > _LEAST_SHARE * variance.max()
        return np.asarray(shapes[:, kept] * np.sqrt(variance[kept]))

    def usable(self) -> NDArray[np.bool_]:
        """Which points have a positive force and extension and positive errors of both."""
        columns = (
            self.force_pN, self.force_stderr_pN, self.extension_nm, self.own_stderr_nm
        )  # fmt: skip
        return np.asarray(np.all([np.isfinite(c) & (c > 0) for c in columns], axis=0))


@dataclass(frozen=True)
class Assay:
    """How extensions and forces came about.

    Attributes
    ----------
    relation : see `mtpipe.fit.tether`.
    bead_turns : the bead turns freely about the field's axis and its attachment swings, which
        lowers its centre by kT/(2F) (effect `rotation_coupling`).
    zero_stderr_nm : standard error of where z = 0 lies, common to all points; infinite where it is
        unknown. Unless 0 an offset is fitted, with this as its prior, and forces follow it.
    """

    temperature_K: float
    relation: Relation = "potential"
    bead_turns: bool = False
    zero_stderr_nm: float = 0.0
