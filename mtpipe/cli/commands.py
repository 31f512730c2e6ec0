"""The command line: what `mtpipe --help` lists.

Exit codes: 0 done, 1 the data could not be processed, 2 the call was wrong. Errors are one or a few
plain lines on standard error; a traceback appears only with MTPIPE_DEBUG set in the environment.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from mtpipe.cli import arguments as given
from mtpipe.cli.batch import batch
from mtpipe.cli.terminal import progress_bar, quoted, summary
from mtpipe.ground.errors import writing
from mtpipe.ground.streams import say
from mtpipe.ground.version import VERSION

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Force calibration for magnetic tweezers: from tracked beads to forces you can defend.",
)


@app.callback(invoke_without_command=True)
def about(
    version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False,
) -> None:
    """Force calibration for magnetic tweezers: from tracked beads to forces you can defend."""
    if version:
        typer.echo(f"mtpipe {VERSION}")
        raise typer.Exit


@app.command()
def run(
    recording: given.Recording,
    out: Annotated[Path, typer.Option("--out", help="Folder to write.", file_okay=False)],
    setup: given.SetupFile = None,
    seed: given.Seed = 0,
    workers: given.Workers = None,
    method: given.Methods = None,
    crosscheck: Annotated[
        bool,
        typer.Option(
            help="Compare every bead with simulations of the experiment that the setup describes, "
            "and diagnose what differs."
        ),
    ] = True,
    overwrite: Annotated[
        bool,
        typer.Option(
            "--overwrite", help="Let a run without cross-check replace an earlier one that has it."
        ),
    ] = False,
) -> None:
    """Calibrate a recording: forces, curves and a report.

    Beads are also compared with simulations, and what differs is diagnosed.
    """
    from mtpipe.pipeline import run as pipeline

    with progress_bar() as progress, writing(out):
        done = pipeline.run(
            recording,
            out,
            setup=setup,
            seed=seed,
            workers=workers or os.cpu_count() or 1,
            methods=method or (),
            cross_check=crosscheck,
            overwrite=overwrite,
            progress=progress,
        )
    summary(out)
    raise typer.Exit(int(bool(done.failed)))


app.command()(batch)


@app.command()
def init(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE…",
            help="A laboratory's recording: a file, several files, their folder, or a film. The "
            "magnets' log is found beside it.",
            callback=lambda paths: [given.existing(path) for path in paths],
        ),
    ],
    setup: Annotated[
        Path | None,
        typer.Option(
            "--setup", help="Setup to write; default: setup.toml beside the files.", dir_okay=False
        ),
    ] = None,
    answers: Annotated[
        Path | None,
        typer.Option(
            help="TOML file with keys of a setup that you know (radius_nm = 1400.0); nothing is "
            "asked then.",
            exists=True,
            dir_okay=False,
        ),
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace a setup that is there.")
    ] = False,
    run_it: Annotated[
        bool, typer.Option("--run", help="Then make a first run, without cross-check.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", help="Folder of that run; default: results beside the setup.", file_okay=False
        ),
    ] = None,
    workers: given.Workers = None,
) -> None:
    """Propose a setup for your files.

    Looks at them, asks for what they do not contain, and writes setup.toml.
    """
    from mtpipe.cli.init import propose_and_write

    done = propose_and_write(files, setup, answers, overwrite=overwrite)
    folder = out or done.setup.parent / "results"
    command = f"mtpipe run {done.in_words} --out {quoted(folder)}"
    if done.left:
        raise typer.Exit(1)
    if not (run_it or done.wants_run()):
        say(f"Next: {command}")
        return
    run(done.target, folder, done.setup, workers=workers, crosscheck=False)
    say(f"Then cross-check, to know whether the forces can be believed: {command}")


@app.command()
def track(
    stack: given.Stack,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            help="Recording to write: .csv, .csv.gz or .parquet.",
            dir_okay=False,
        ),
    ],
    setup: given.SetupFile = None,
    workers: given.Workers = None,
) -> None:
    """Track the beads of a film.

    TIFF images in, a recording for `mtpipe run` out.
    """
    from mtpipe.tracking.track import track as track_stack

    given.with_ending(out, given.RECORDING_ENDINGS, "--out")
    with progress_bar() as progress:
        done = track_stack(
            stack, out, setup=setup, workers=workers or os.cpu_count() or 1, progress=progress
        )
    for notice in done.notes.notices:
        say(f"{notice.bead}: {notice.message}" if notice.bead else notice.message)
    say(f"Recording: {out} ({len(done.regions)} beads, {done.frames} frames)")


@app.command()
def lut(
    stack: given.Stack,
    z: Annotated[
        Path,
        typer.Option(
            "--z",
            metavar="POSITIONS",
            help="Table of focus positions: a column z_nm (or z_um) with a row for each frame, "
            "or columns frame (the first is 0) and z_nm.",
            exists=True,
            dir_okay=False,
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Table to write: .npz.", dir_okay=False)],
    refractive_index_factor: Annotated[
        float | None,
        typer.Option(
            metavar="FACTOR",
            help="Height per focus position: 0.8 to 0.88 for an oil objective and a bead in water, "
            "1 for a water objective or heights that are corrected already; negative where the "
            "focus counts the other way. Default: 1, with a warning.",
        ),
    ] = None,
    bead: Annotated[
        str | None, typer.Option(help="Name of the bead; needed where several are found.")
    ] = None,
    region: Annotated[
        str | None,
        typer.Option(metavar="X,Y,SIZE", help="Region of the bead: centre and side, in pixels."),
    ] = None,
    setup: Annotated[
        Path | None,
        typer.Option(
            "--setup",
            help="Setup, for the regions of beads and the size of a pixel.",
            exists=True,
            dir_okay=False,
        ),
    ] = None,
) -> None:
    """Make a look-up table for z from a focus scan of one bead."""
    from mtpipe.setup.setup import read_setup
    from mtpipe.tracking.scan import table_from_scan

    given.with_ending(out, (".npz",), "--out")
    place = None if region is None else given.region_of(region, "--region")
    with progress_bar() as progress:
        table = table_from_scan(
            stack,
            z,
            refractive_index_factor=(
                1.0 if refractive_index_factor is None else refractive_index_factor
            ),
            bead=bead,
            region=place,
            setup=None if setup is None else read_setup(setup),
            progress=progress,
        )
    with writing(out):
        table.save(out)
    for notice in table.notices:
        say(notice.message)
    if refractive_index_factor is None:
        say(
            "No --refractive-index-factor was given: focus positions are taken for heights (factor "
            "1). Behind an oil objective heights in water are 0.8 to 0.88 of that."
        )
    low, high = table.z_nm[0], table.z_nm[-1]
    say(
        f"Look-up table of {table.bead}: {out} ({len(table.z_nm)} heights, {low:.0f} to "
        f"{high:.0f} nm; one image gives z to {float(table.precision_nm.min()):.1f} to "
        f"{float(table.precision_nm.max()):.1f} nm)"
    )


@app.command()
def simulate(
    setup: Annotated[
        Path,
        typer.Argument(
            metavar="SETUP", help="The experiment: a setup.toml.", exists=True, dir_okay=False
        ),
    ],
    force: Annotated[
        str,
        typer.Option(
            metavar="F,F,…", help="Force of each plateau in pN, in time order, as in 1,5,10."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder to write.", file_okay=False)],
    frames: Annotated[int, typer.Option(help="Camera frames per plateau.", min=2)] = 16_384,
    seed: Annotated[int, typer.Option(help="The same seed gives the same files.", min=0)] = 0,
    beads: Annotated[int, typer.Option(help="Tethered beads.", min=1)] = 1,
    noise: Annotated[
        str | None,
        typer.Option(
            metavar="N[,N,N]",
            help="Tracking noise in nm, one number or one each for x, y, z; default: the setup's.",
        ),
    ] = None,
    lost_share: Annotated[
        float, typer.Option(help="Share of frames in which the tracker loses a bead.", min=0)
    ] = 0.0,
    engine: Annotated[
        str,
        typer.Option(
            help="linear: exact and fast; brownian: step by step, nonlinear motion included.",
            callback=given.known_engine,
        ),
    ] = "linear",
) -> None:
    """Simulate a recording of your experiment.

    The experiment is that of a setup.toml; truth.json holds the true values.
    """
    from mtpipe.simulation.written import simulate_to_folder

    if not lost_share < 1:
        raise typer.BadParameter("a share below 1 is needed", param_hint="--lost-share")
    forces = given.numbers(force, "--force")
    if not all(0 < value <= given.STRONGEST_PN for value in forces):
        raise typer.BadParameter(
            f"forces above 0 pN are needed, and none above {given.STRONGEST_PN:g} pN",
            param_hint="--force",
        )
    with progress_bar() as progress:
        recording = simulate_to_folder(
            setup,
            out,
            forces,
            frames,
            seed,
            beads=beads,
            noise_nm=None if noise is None else given.along_axes(noise, "--noise"),
            lost_share=lost_share,
            engine="brownian" if engine == "brownian" else "linear",
            progress=lambda done, total: progress("simulating beads", done, total),
        )
    for notice in recording.notices:
        say(notice.message)
    say(f"Recording: {out / 'recording.csv'}")


@app.command()
def design(
    setup: Annotated[
        Path,
        typer.Argument(
            metavar="SETUP", help="The experiment: a setup.toml.", exists=True, dir_okay=False
        ),
    ],
    error: Annotated[
        float, typer.Option(help="Relative error of the force that is allowed: 0.1 for 10 %.")
    ] = 0.1,
    duration: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Length of a plateau.")
    ] = None,
    frames: Annotated[
        int | None, typer.Option(help="Length of a plateau in frames, default: 16384.", min=1)
    ] = None,
    reach: Annotated[
        float | None,
        typer.Option(metavar="PN", help="Find the cheapest change that reaches this force."),
    ] = None,
    csv: Annotated[
        Path | None, typer.Option(help="Write all ranges to this CSV file.", dir_okay=False)
    ] = None,
    figure: Annotated[
        Path | None,
        typer.Option(help="Draw the ranges: a page (.html) or a picture (.png).", dir_okay=False),
    ] = None,
) -> None:
    """Say which forces a setup can measure.

    Also what limits them, and which change of the experiment would help.
    """
    from mtpipe.design import guide, show
    from mtpipe.setup.setup import read_setup

    if duration is not None and frames is not None:
        raise typer.BadParameter("give --duration or --frames, not both")
    if not 0 < error < 1:
        raise typer.BadParameter(
            f"a share between 0 and 1 is needed, 0.1 for 10 %; got {error:g}", param_hint="--error"
        )
    given.above_zero(duration, "a time in s", "--duration")
    given.above_zero(reach, "a force in pN", "--reach")
    if figure is not None:
        given.with_ending(figure, given.FIGURE_ENDINGS, "--figure")
    answer = guide.measurable_forces(
        read_setup(setup), frames=frames, duration_s=duration, error=error, reach_pN=reach
    )
    show.print_design(answer)
    if csv is not None:
        with writing(csv, "--csv"):
            show.write_csv(answer, csv)
        say(f"Table: {csv}")
    if figure is not None:
        from mtpipe.design.figure import write_figure

        with writing(figure, "--figure"):
            write_figure(answer, figure)
        say(f"Figure: {figure}")


@app.command()
def demo(
    out: Annotated[Path, typer.Option("--out", help="Folder to write.", file_okay=False)] = Path(
        "mtpipe-demo"
    ),
    workers: given.Workers = None,
    film: Annotated[
        bool, typer.Option("--film", help="Begin with a film, which is rendered and tracked.")
    ] = False,
) -> None:
    """Analyse bundled recordings whose true forces are known."""
    from mtpipe.pipeline.demo import run_demo
    from mtpipe.pipeline.demo_film import run_film_demo

    shown = run_film_demo if film else run_demo
    with progress_bar() as progress, writing(out):
        text = shown(out, workers=workers or os.cpu_count() or 1, progress=progress)
    say(text)
