"""Work done bead by bead: each with what it needs of the recording, and its own generator.

A bead that cannot be worked on is refused in words and takes nothing from the others.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from mtpipe.crosschecking.check import BeadCheck, check_bead
from mtpipe.crosschecking.lines import with_lines_apart
from mtpipe.crosschecking.prepared_bead import prepare
from mtpipe.crosschecking.setup_effects import with_listed
from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.processes import executor
from mtpipe.recording.recording import Recording

T = TypeVar("T")
# What goes wrong with data; anything else is a fault of the program and is not hidden.
DATA_ERRORS = (MtpipeError, ValueError)


def per_bead(
    recording: Recording,
    work: Callable[[Recording, str, np.random.Generator], T],
    *,
    seed: int,
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[dict[str, T], dict[str, str]]:
    """Results of all tethered beads, and why there is none of the others.

    Parameters
    ----------
    work : a function of a module (it is sent to other processes): recording with this bead alone,
        bead, generator.
    progress : called with (beads done, of how many).
    """
    beads = recording.tethered
    say = progress or (lambda done, total: None)
    say(0, len(beads))
    results: dict[str, T] = {}
    refused: dict[str, str] = {}
    with executor(min(workers, len(beads))) as pool:
        done = itertools.count(1)
        futures = {}
        for bead in beads:
            random = bead_generator(seed, bead)
            futures[bead] = pool.submit(_attempted, work, _alone(recording, bead), bead, random)
            futures[bead].add_done_callback(lambda _: say(next(done), len(beads)))
        for bead, future in futures.items():
            result, reason = future.result()
            if result is None:
                refused[bead] = reason
            else:
                results[bead] = result
    return results, refused


def _attempted(
    work: Callable[[Recording, str, np.random.Generator], T],
    recording: Recording,
    bead: str,
    random: np.random.Generator,
) -> tuple[T | None, str]:
    try:
        return work(recording, bead, random), ""
    except DATA_ERRORS as error:
        return None, str(error)


def check_of(
    recording: Recording, bead: str, random: np.random.Generator, *, with_curves: bool = False
) -> BeadCheck:
    """A bead beside simulations of the configured experiment, listed effects included.

    Raises
    ------
    MtpipeError : as `prepare`.
    """
    case = with_listed(with_lines_apart(prepare(recording, bead)), recording.setup)
    return check_bead(case, random, with_curves=with_curves)


def bead_generator(seed: int, bead: str) -> np.random.Generator:
    """A generator of the bead's own, the same whatever other beads there are."""
    digest = hashlib.sha256(f"crosscheck {bead}".encode()).digest()
    return np.random.default_rng([seed, int.from_bytes(digest[:8], "little")])


def _alone(recording: Recording, bead: str) -> Recording:
    """The recording with this tethered bead only, which is all that its check reads."""
    kept = (bead, *recording.setup.beads.reference)
    return replace(
        recording,
        positions_nm={name: xyz for name, xyz in recording.positions_nm.items() if name in kept},
    )
