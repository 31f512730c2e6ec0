"""Rendered image stacks: a simulated recording as the camera's movie, and the truth it shows.

The motion is simulated in equal parts of a frame, exactly, and a bead is drawn at its mean position
in each part during which the shutter is open: that is the motion blur. Beads add to the background;
where they come close their images add as well. The lamp flickers frame by frame. A pixel counts
photoelectrons (Poisson), has its own response, adds read noise and is digitized. What the tracker
makes of pixels (pixel locking) is not put in: it comes about.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtpipe.experiment.description import Clock, Experiment
from mtpipe.ground.errors import SetupError
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera
from mtpipe.recording.plateaus import find_plateaus
from mtpipe.recording.recording import Recording
from mtpipe.setup.setup import Setup
from mtpipe.simulation.bead_image import BeadImage, BeadOptics
from mtpipe.simulation.setup_experiment import stated_experiment
from mtpipe.simulation.simulate import SPACING_NM, rows_in_file, simulate_experiment

Frames = NDArray[np.uint8] | NDArray[np.uint16]
# Frames drawn at once; a stack is never in memory as a whole.
BLOCK = 64
# Equal parts of a frame, tried in turn until the exposure is a whole number of them.
PARTS = (4, 5, 6, 7, 8, 10, 12, 16, 20)


@dataclass(frozen=True)
class Sensor:
    """A camera's noise; the values given are those of a common CMOS camera, 8 bit.

    Attributes
    ----------
    background_e : photoelectrons in a pixel of the background. read_noise_e : per pixel.
    electrons_per_level : of a grey level. offset : grey level of darkness. bits : 8 or 16.
    flicker : relative standard deviation of the lamp from frame to frame.
    response_spread : relative standard deviation of the pixels' responses, which stay.
    """

    background_e: float = 5000.0
    read_noise_e: float = 8.0
    electrons_per_level: float = 40.0
    offset: float = 4.0
    bits: int = 8
    flicker: float = 0.005
    response_spread: float = 0.005

    @property
    def highest(self) -> int:
        """The grey level of a saturated pixel."""
        return int(2**self.bits - 1)

    def response(self, shape: tuple[int, int], random: np.random.Generator) -> FloatArray:
        """Responses of the pixels, about 1."""
        return np.asarray(1 + self.response_spread * random.normal(size=shape))

    def expose(
        self, brightness: FloatArray, response: FloatArray, random: np.random.Generator
    ) -> Frames:
        """Grey levels of frames (n, height, width) given as brightness over the background's."""
        lamp = 1 + self.flicker * random.normal(size=(len(brightness), 1, 1))
        mean_e = np.maximum(self.background_e * brightness * lamp * response, 0)
        electrons = random.poisson(mean_e) + self.read_noise_e * random.normal(size=mean_e.shape)
        levels = np.rint(electrons / self.electrons_per_level + self.offset)
        levels = np.clip(levels, 0, self.highest)
        return levels.astype(np.uint8) if self.bits == 8 else levels.astype(np.uint16)


def draw(
    bead: BeadImage,
    sensor: Sensor,
    positions: FloatArray,
    shape: tuple[int, int],
    random: np.random.Generator,
) -> Frames:
    """Frames of one bead, each pixel with the same response.

    Parameters
    ----------
    positions : (n, 3) x and y in px, 0 the centre of the first pixel, and z in nm.
    shape : height and width of a frame in px.
    """
    brightness = np.ones((len(positions), *shape))
    x, y, z = (np.ascontiguousarray(column[:, None]) for column in positions.T)
    bead.add_to(brightness, x, y, z)
    return sensor.expose(brightness, np.ones(shape), random)


def render_stack(
    path: Path,
    setup: Setup,
    forces_pN: Sequence[float],
    frames: int,
    seed: int,
    *,
    beads: int = 1,
    optics: BeadOptics | None = None,
    sensor: Sensor | None = None,
) -> Recording:
    """Simulate an experiment and write what its camera would have filmed, as TIFF.

    The frame interval stands in the file as ImageJ writes it. If the magnets move, their position
    in each frame is written beside the stack as `<name>-magnets.csv` (`frame,magnet_mm`).

    Parameters
    ----------
    path : of the stack. forces_pN, frames, beads : as `mtpipe.simulate`; frames per plateau.
    optics : default: the setup's bead radius and pixel size.

    Returns
    -------
    The truth: positions averaged over each exposure, x and y from the centre of the first pixel
    on, z the extension; without tracking noise.

    Raises
    ------
    SetupError : the setup does not state what a simulation needs, pixel size included.
    FitError : a force does not hold the bead off the surface.
    """
    optics, sensor = optics or optics_of(setup), sensor or Sensor()
    experiment, notices = stated_experiment(
        setup, forces_pN, frames, noise_nm=(0.0, 0.0, 0.0), beads=beads
    )
    parts, open_parts = parts_of(experiment.camera)
    motion_seed, noise_seed, clock_seed = np.random.SeedSequence(seed).spawn(3)
    fine = simulate_experiment(
        _in_parts(experiment, parts), setup, np.random.default_rng(motion_seed), notices=notices
    )
    clock = np.random.default_rng(clock_seed)
    whole = len(fine.time_s) // parts
    filmed = rows_in_file(whole, experiment.clock.dropped_share, clock)
    count = len(filmed)
    pixel, margin = optics.pixel_size_nm, SPACING_NM / 2
    names = list(fine.positions_nm)
    # (beads, frames, open parts, 3)
    seen = np.array(
        [
            fine.positions_nm[n][: whole * parts].reshape(whole, parts, 3)[filmed, :open_parts]
            for n in names
        ]
    )
    first = seen.mean(axis=(1, 2))[:, :2]
    origin = np.floor((first.min(axis=0) - margin) / pixel) * pixel
    seen[..., :2] -= origin
    width, height = np.ceil((first.max(axis=0) + margin - origin) / pixel).astype(int)
    image = BeadImage.of(optics, seen[..., 2].min(), seen[..., 2].max())
    random = np.random.default_rng(noise_seed)
    time_s = np.asarray(experiment.camera.frame_s * np.arange(count), dtype=np.float64)
    magnet = None if fine.magnet_mm is None else fine.magnet_mm[: whole * parts : parts][filmed]
    levels = _film(image, sensor, seen, pixel, (int(height), int(width)), random)
    write_tiff(
        path,
        levels,
        (count, int(height), int(width)),
        sensor,
        experiment.camera.frame_s,
    )
    if magnet is not None and len(forces_pN) > 1:
        _write_magnets(path.with_name(f"{path.stem}-magnets.csv"), magnet)
    truth = {name: xyz.mean(axis=1) for name, xyz in zip(names, seen, strict=True)}
    return Recording(
        name=path.name,
        setup=setup,
        time_s=time_s,
        frame=np.arange(count, dtype=np.int64),
        positions_nm=truth,
        magnet_mm=magnet,
        plateaus=find_plateaus(time_s, magnet, setup.plateaus),
        notices=fine.notices,
    )


def optics_of(setup: Setup) -> BeadOptics:
    """Optics of a setup's bead and pixels, the rest as given there."""
    pixel, radius = setup.camera.pixel_size_nm, setup.beads.radius_nm
    if pixel is None or pixel.value is None:
        raise SetupError("an image needs [camera] pixel_size_nm")
    if radius.value is None:
        raise SetupError("an image needs [beads] radius_nm")
    return BeadOptics(radius.value, pixel.value)


def parts_of(camera: Camera) -> tuple[int, int]:
    """Equal parts of a frame, and in how many of them the shutter is open.

    Raises
    ------
    SetupError : the exposure is no simple part of a frame.
    """
    share = camera.exposure_s / camera.frame_s
    for parts in PARTS:
        opened = round(share * parts)
        if opened and abs(opened - share * parts) < 0.01 * opened:
            return parts, opened
    raise SetupError(
        f"an exposure of {share:.3g} of a frame cannot be rendered",
        mend="State a simple fraction of a frame, like 1, 3/4, 1/2 or 1/10.",
    )


def write_tiff(
    path: Path,
    levels: Iterator[Frames],
    shape: tuple[int, int, int],
    sensor: Sensor,
    frame_s: float,
) -> None:
    """Write frames as they come as a multi-page TIFF with ImageJ's frame interval."""
    import tifffile

    metadata: dict[str, Any] = {"axes": "TYX", "finterval": frame_s}
    kind = np.uint8 if sensor.bits == 8 else np.uint16
    with tifffile.TiffWriter(path, imagej=True) as tiff:
        tiff.write(levels, shape=shape, dtype=kind, metadata=metadata, photometric="minisblack")


def _in_parts(experiment: Experiment, parts: int) -> Experiment:
    """The same experiment filmed faster, without a dark time, every part of every frame."""
    part_s = experiment.camera.frame_s / parts
    rests = tuple(replace(rest, frames=rest.frames * parts) for rest in experiment.rests)
    return replace(experiment, camera=Camera(part_s, part_s), rests=rests, clock=Clock())


def _film(
    image: BeadImage,
    sensor: Sensor,
    seen: FloatArray,
    pixel_size_nm: float,
    shape: tuple[int, int],
    random: np.random.Generator,
) -> Iterator[Frames]:
    response = sensor.response(shape, random)
    for start in range(0, seen.shape[1], BLOCK):
        piece = seen[:, start : start + BLOCK]
        brightness = np.ones((piece.shape[1], *shape))
        for xyz in piece:
            x, y, z = (np.ascontiguousarray(xyz[..., i]) for i in range(3))
            image.add_to(brightness, x / pixel_size_nm, y / pixel_size_nm, z)
        yield from sensor.expose(brightness, response, random)


def _write_magnets(path: Path, magnet_mm: FloatArray) -> None:
    rows = "".join(f"{i},{value:.6f}\n" for i, value in enumerate(magnet_mm))
    path.write_text(f"frame,magnet_mm\n{rows}", encoding="utf-8")
