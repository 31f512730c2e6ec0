"""mtpipe, tweezepy and pylake on the same simulated traces: the table of docs/comparison.md.

    python workflows/benchmark/other_programs.py --write docs/comparison.md

Force errors are those of the stiffness, as the force of a trace is stiffness times a length. Times
are CPU seconds of a fit over those of mtpipe's, medians of one run on one machine. The other
programs run in environments of their own, made on first use with the versions in
`workflows/validation/tweezepy_peer` and `pylake_peer`.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "common"))
sys.path.append(str(Path(__file__).parents[1] / "validation"))
import pages
import peer_environment
import peers as tweezepy_peer
import traces
from traces import Case

import mtpipe

PYLAKE = Path(__file__).parent / "pylake_peer"
CASES = [Case("free", corner, exposure) for exposure in (1.0, 0.5) for corner in (0.1, 0.4, 1.0)]
Answer = tuple[str, np.ndarray, np.ndarray]  # method, stiffness in pN/nm and CPU seconds (repeats,)


def main() -> None:
    """Fit all traces with all programs, and print the table."""
    parser = argparse.ArgumentParser(description="Other programs on the same simulated traces.")
    parser.add_argument("--repeats", type=int, default=40, help="traces per case")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--write", type=Path, help="page to put the table into")
    parser.add_argument("--environments", type=Path, default=Path(tempfile.gettempdir()))
    choice = parser.parse_args()
    tweezepy = tweezepy_peer.environment(choice.environments / "mtpipe-study-tweezepy")
    pylake = peer_environment.environment(
        choice.environments / "mtpipe-study-pylake", PYLAKE / "requirements.txt"
    )
    errors: dict[str, list[str]] = {}
    seconds: dict[str, list[np.ndarray]] = {}
    for case in CASES:
        job = tweezepy_peer.Job(tweezepy, case, choice.seed, choice.repeats, "free")
        for method, stiffness, cpu_s in [*_mtpipe(job), *_tweezepy(job), *_pylake(pylake, job)]:
            errors.setdefault(method, []).append(_error(stiffness, case))
            seconds.setdefault(method, []).append(cpu_s)
    own = np.median(np.concatenate(seconds["mtpipe"]))
    lines = [
        [method, *row, f"{np.median(np.concatenate(seconds[method])) / own:.2g}"]
        for method, row in errors.items()
    ]
    heads = [f"{case.corner:g}, {case.exposure:g}" for case in CASES]
    table = pages.table(" | ".join(["program", *heads, "time"]), lines)
    command = f"other_programs.py --repeats {choice.repeats} --seed {choice.seed}"
    run = (
        f"Printed {datetime.now(UTC):%Y-%m-%d} by mtpipe {mtpipe.__version__} with\n\n"
        f"    python workflows/benchmark/{command} --write docs/comparison.md\n\n"
        f"{choice.repeats} traces a column."
    )
    print(f"{run}\n\n{table}")
    if choice.write:
        text = choice.write.read_text(encoding="utf-8")
        new = pages.into_page(text, {"peers": f"{run}\n\n{table}"})
        choice.write.write_text(new, encoding="utf-8")


def _mtpipe(job: tweezepy_peer.Job) -> Iterator[Answer]:
    known = (traces.FRICTION, 0.03 * traces.FRICTION)
    for name, friction in (("mtpipe", None), ("mtpipe, friction to 3 %", known)):
        stiffness, cpu_s = [], []
        for repeat in range(-1, job.repeats):  # the first compiles
            x, _, _ = traces.draw(job.case, job.seed, max(repeat, 0))
            began = time.process_time()
            fit = mtpipe.fit_trace(
                x,
                frame_rate_hz=traces.RATE_HZ,
                exposure_s=job.case.exposure / traces.RATE_HZ,
                temperature_K=traces.TEMPERATURE_K,
                friction=friction,
            )
            cpu_s.append(time.process_time() - began)
            value = fit.stiffness.value
            stiffness.append(np.nan if value is None else value)
        yield name, np.array(stiffness[1:]), np.array(cpu_s[1:])


def _tweezepy(job: tweezepy_peer.Job) -> Iterator[Answer]:
    names, estimates, cpu_s = tweezepy_peer.fit(job)
    for k, name in enumerate(names):
        if "default" not in name:
            yield name, estimates[:, k, 0, 0], cpu_s[:, k]


def _pylake(python: Path, job: tweezepy_peer.Job) -> Iterator[Answer]:
    drawn = [traces.draw(job.case, job.seed, repeat)[0] for repeat in range(job.repeats)]
    with tempfile.TemporaryDirectory(prefix="mtpipe-peers-") as folder:
        asked, answered = Path(folder) / "traces.npz", Path(folder) / "answers.npz"
        np.savez(
            asked,
            x_nm=drawn,
            friction_pN_s_per_nm=traces.FRICTION,
            temperature_K=traces.TEMPERATURE_K,
            frame_rate_hz=traces.RATE_HZ,
            exposure_s=job.case.exposure / traces.RATE_HZ,
            radius_nm=tweezepy_peer.RADIUS_NM,
        )
        subprocess.run([str(python), str(PYLAKE / "fit.py"), str(asked), str(answered)], check=True)
        with np.load(answered) as answers:
            for k, name in enumerate(map(str, answers["methods"])):
                yield name, answers["stiffness"][:, k], answers["cpu_s"][:, k]


def _error(stiffness: np.ndarray, case: Case) -> str:
    """Root-mean-square error in percent, and the share of traces with a result, if not all."""
    good = stiffness[np.isfinite(stiffness) & (stiffness > 0)]
    if not len(good):
        return "none"
    ratio = good / case.stiffness_pN_per_nm - 1
    share = f" ({100 * len(good) / len(stiffness):.0f} %)" if len(good) < len(stiffness) else ""
    return f"{100 * np.sqrt(np.mean(ratio**2)):.1f}{share}"


if __name__ == "__main__":
    main()
