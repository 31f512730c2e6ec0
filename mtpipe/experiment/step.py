"""A step between the bead's motion and its record: what effects of the readout bring.

Each has a place in the way of a recording (docs/architecture.md) and is read twice: as covariances
(`mtpipe.experiment.readout`), and played in time (`mtpipe.simulation.readout`). An experiment has
any number of them; within one place they act in the order in which they were added.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar, Literal, Protocol, TypeGuard

import numpy as np

from mtpipe.experiment.changed import changed
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera

# In the order of a recording. What moves with the tether is blurred by the exposure; positions are
# as recorded behind the optics.
Place = Literal["tether", "optics", "tracker"]


@dataclass(frozen=True, eq=False)
class Seen:
    """Motion of a bead at one force on its way to the record, as covariances.

    Attributes
    ----------
    tau_s : (m,) relaxation times of modes; covariance_nm2 : (m, 3, 3), before the exposure's blur.
    white_nm2 : (3, 3) covariance of what is independent from frame to frame, as recorded.
    height_nm : mean of z.
    """

    tau_s: FloatArray
    covariance_nm2: FloatArray
    white_nm2: FloatArray
    height_nm: float

    def with_modes(self, tau_s: FloatArray, covariance_nm2: FloatArray) -> Seen:
        """With more modes: times (k,), covariances (k, 3, 3)."""
        return changed(
            self,
            tau_s=np.concatenate([self.tau_s, tau_s]),
            covariance_nm2=np.concatenate([self.covariance_nm2, covariance_nm2]),
        )

    def through(self, matrix: FloatArray) -> Seen:
        """Positions turned and scaled by a matrix (3, 3); the mean height as z is scaled."""
        return Seen(
            self.tau_s,
            matrix @ self.covariance_nm2 @ matrix.T,
            matrix @ self.white_nm2 @ matrix.T,
            float(matrix[2, 2]) * self.height_nm,
        )


def nothing_seen() -> Seen:
    """A bead that does not move."""
    return Seen(np.empty(0), np.empty((0, 3, 3)), np.zeros((3, 3)), 0.0)


class StepByPlateau(Protocol):
    """A step that is another in each plateau."""

    def in_plateau(self, plateau: int) -> Step:
        """The step in one plateau."""


def by_plateau(step: Step | StepByPlateau) -> TypeGuard[StepByPlateau]:
    """Whether a step is another in each plateau."""
    return hasattr(step, "in_plateau")


class Step(Protocol):
    """One step, a frozen dataclass of numbers: experiments are compared and kept by them.

    `place` : where in the way of a recording it acts.
    """

    place: ClassVar[Place]

    def expected(self, seen: Seen, force_pN: float, thermal_energy_pN_nm: float) -> Seen:
        """What is seen behind this step of a bead at a steady force."""

    def played(
        self,
        position_nm: FloatArray,
        force_pN: FloatArray,
        camera: Camera,
        thermal_energy_pN_nm: float,
        random: np.random.Generator,
    ) -> FloatArray:
        """(frames, 3) positions behind this step, averaged over exposures, from those before it.

        Parameters
        ----------
        force_pN : (frames,) that acts.
        """


class NothingByItself:
    """A step that acts in plateaus only, in each as its own `in_plateau` or `changed_in` says: by
    itself it does nothing.
    """

    def expected(self, seen: Seen, force_pN: float, thermal_energy_pN_nm: float) -> Seen:
        """As it was."""
        return seen

    def played(
        self,
        position_nm: FloatArray,
        force_pN: FloatArray,
        camera: Camera,
        thermal_energy_pN_nm: float,
        random: np.random.Generator,
    ) -> FloatArray:
        """As it was."""
        return position_nm


class StepOfAxis(Step, Protocol):
    """A step of one axis (0 to 2), of a pair, of which an experiment may have one for each, or of
    all axes.
    """

    form: ClassVar[str]

    @property
    def axis(self) -> int | tuple[int, int] | None:
        """The axis, or the pair: the one that changes first; None: all."""


def axes_with_another(steps: Iterable[Step]) -> set[int]:
    """Axes along which steps record a share of another axis."""
    pairs = [getattr(step, "axis", None) for step in steps]
    return {pair[0] for pair in pairs if isinstance(pair, tuple)}
