"""Work done bead by bead: each with what it needs of the recording, and its own generator.

A bead that cannot be worked on is refused in words and takes nothing from the others.
"""

from __future__ import annotations

import hashlib
import itertools
import os
import traceback
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from mtpipe.crosschecking.check import BeadCheck, check_bead
from mtpipe.crosschecking.lines import with_lines_apart
from mtpipe.crosschecking.prepared_bead import prepare
from mtpipe.crosschecking.setup_effects import with_listed
from mtpipe.ground.errors import MtpipeError, WorkerEndedError
from mtpipe.ground.processes import with_parts
from mtpipe.ground.steps import Steps
from mtpipe.recording.recording import Recording

T = TypeVar("T")
# What goes wrong with data; anything else is a fault of the program and is told as that.
DATA_ERRORS = (MtpipeError, ValueError)


@dataclass(frozen=True)
class Outcomes(Generic[T]):
    """What became of beads, by name.

    Attributes
    ----------
    results : of those that were worked on.
    refused : what is wrong with the data of others. failed : a fault of the program or the machine.
    """

    results: dict[str, T]
    refused: dict[str, str]
    failed: dict[str, str]


def per_bead(
    recording: Recording,
    work: Callable[[Recording, str, np.random.Generator], T],
    pool: Executor,
    *,
    seed: int,
    parts: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Steps[Outcomes[T]]:
    """All tethered beads worked on, in steps; one that cannot be takes nothing from the others.

    Parameters
    ----------
    work : a function of a module (it is sent to other processes): recording with this bead alone,
        bead, generator.
    parts : processes over which the simulations of one bead are spread.
    progress : called with (beads done, of how many).
    """
    beads = recording.tethered
    say = progress or (lambda done, total: None)
    say(0, len(beads))
    done = itertools.count(1)
    futures = {}
    for bead in beads:
        alone, random = _alone(recording, bead), bead_generator(seed, bead)
        futures[bead] = pool.submit(with_parts, parts, _attempted, work, alone, bead, random)
        futures[bead].add_done_callback(lambda _: say(next(done), len(beads)))
    yield list(futures.values())
    outcomes = Outcomes[T]({}, {}, {})
    for bead, future in futures.items():
        try:
            result, reason = future.result()
        except WorkerEndedError as error:
            outcomes.failed[bead] = str(error)
            continue
        except (MtpipeError, MemoryError, BrokenExecutor):
            raise  # of the machine, and no matter of this bead
        except Exception as error:
            if os.environ.get("MTPIPE_DEBUG"):
                traceback.print_exception(error)
            fault = f"a defect of mtpipe, {type(error).__name__}: {error}"
            outcomes.failed[bead] = f"{fault}. Please report it."
            continue
        if result is None:
            outcomes.refused[bead] = reason
        else:
            outcomes.results[bead] = result
    return outcomes


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
