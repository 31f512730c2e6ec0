"""Small made-up recordings and setups for the tests of reading."""

from pathlib import Path

import numpy as np
import pytest

from mtpipe.setup.setup import Setup, parse_setup
from mtpipe.setup.usual_errors import exact

RATE = 100.0
N = 400
START_NS = 1_700_000_000_123_456_789


def setup_of(source=None, *, rate=RATE, reference=("ref1",), minimum_s=1.0, **plateaus) -> Setup:
    content = {
        "schema": 1,
        "camera": {"frame_rate_hz": rate, "exposure_s": "unknown"},
        "beads": {"radius_nm": 500.0, "reference": list(reference)},
        "tether": {"contour_length_nm": 1000.0, "persistence_length_nm": 50.0},
        "buffer": {"temperature_K": 298.0, "viscosity_mPa_s": 0.9},
        "field": {"direction": "x"},
        "plateaus": {"minimum_s": minimum_s, **plateaus},
    }
    if source is not None:
        content["source"] = source
    return parse_setup(exact(content))


def motion(n=400, beads=("b1", "ref1"), seed=0) -> dict[str, np.ndarray]:
    """Tethered beads that fluctuate by 30 nm, references by 2 nm, far from the origin."""
    rng = np.random.default_rng(seed)
    return {
        bead: np.round(
            rng.normal(0, 2 if bead.startswith("ref") else 30, (n, 3)) + 1000 * (k + 1), 3
        )
        for k, bead in enumerate(beads)
    }


def canonical_lines(positions, time=None, magnet=None) -> list[str]:
    n = len(next(iter(positions.values())))
    time = [f"{i / RATE:.4f}" for i in range(n)] if time is None else time
    header = ["time_s"] + (["magnet_mm"] if magnet is not None else [])
    header += [f"{bead}_{axis}_nm" for bead in positions for axis in "xyz"]
    lines = [",".join(header)]
    for i in range(n):
        cells = [time[i]] + ([str(magnet[i])] if magnet is not None else [])
        cells += ["" if np.isnan(v) else repr(float(v)) for p in positions.values() for v in p[i]]
        lines.append(",".join(cells))
    return lines


def write(path: Path, lines: list[str], encoding="utf-8") -> Path:
    path.write_bytes(("\n".join(lines) + "\n").encode(encoding))
    return path


def codes(recording) -> set[str]:
    return {notice.code for notice in recording.notices}


def table(columns, mark=" ") -> list[str]:
    """Lines of a table without header; floats in full, NaN as LabVIEW writes it."""

    def cell(value):
        return "-1.#IND000" if np.isnan(value) else repr(float(value))

    return [mark.join(cell(v) for v in row) for row in zip(*columns, strict=True)]


def axes_of(positions) -> list[np.ndarray]:
    return [xyz[:, k] for xyz in positions.values() for k in range(3)]


def write_magscope(path: Path, batches, names=("_ns", "_nm")) -> Path:
    """A tracking file as MagScope appends it: batches are (sequence, time_ns, {bead: (n, 3)}).

    A bead that a batch does not name was not followed then.
    """
    import h5py

    time, offsets, sequence, bead_ids, positions = [], [0], [], [], []
    for number, time_ns, beads in batches:
        for row, stamp in enumerate(time_ns):
            time.append(stamp)
            sequence.append(number)
            for bead, xyz in beads.items():
                bead_ids.append(bead)
                positions.append(xyz[row])
            offsets.append(len(bead_ids))
    with h5py.File(path, "w") as file:
        group = file.create_group("tracking")
        group.attrs["schema_version"] = 1
        group[f"frame_timestamps{names[0]}"] = np.array(time, dtype="u8")
        group["frame_offsets"] = np.array(offsets, dtype="u8")
        group["frame_batch_sequence"] = np.array(sequence, dtype="u8")
        group["batch_sequence"] = np.array([b[0] for b in batches], dtype="u8")
        group["bead_ids"] = np.array(bead_ids, dtype="u2")
        group[f"positions{names[1]}"] = np.array(positions, dtype="f8").reshape(-1, 3)
    return path


def preset(name_or_table, **options):
    source = {"preset": name_or_table} if isinstance(name_or_table, str) else name_or_table
    return setup_of(source, **{"reference": (), **options})


def height(time_s):
    """A magnet that moves from 3 to 2 mm at half time, within 0.1 s."""
    return np.interp(time_s, [1.9, 2.0], [3.0, 2.0])


def sentences(recording):
    return " ".join(n.message for n in recording.notices)


def survives_a_round_trip(recording):
    again = parse_setup(recording.setup.model_dump(mode="json", by_alias=True))
    assert again == recording.setup


def magscope_batches(positions):
    """Batches of 50 frames; bead 7 is followed from frame 100 on, frames 250 to 259 are lost."""
    stamps = START_NS + np.rint(np.arange(N) * 1e9 / RATE).astype(np.int64)
    batches = []
    for number, start in enumerate(range(0, N, 50)):
        rows = [r for r in range(start, start + 50) if not 250 <= r < 260]
        beads = {b: xyz[rows] for b, xyz in positions.items() if b != 7 or start >= 100}
        batches.append((10 + number, stamps[rows], beads))
    return batches


def magscope_positions():
    return dict(zip((3, 7), motion(N).values(), strict=True))


FIVE = ("Time", "Magnet", "X", "Y", "Z")


def five_columns(n=N, seed=0) -> dict[str, np.ndarray]:
    """The plain recording of one bead that the tests write in every container and every way."""
    xyz = motion(n, beads=("b1",), seed=seed)["b1"]
    time = np.round(np.arange(n) / RATE, 4)
    return dict(zip(FIVE, [time, np.full(n, 3.0), *xyz.T], strict=True))


def five_setup(names=FIVE, *, rate=RATE, time=True, minimum_s=1.0, **source) -> Setup:
    """The setup of the plain recording, its columns under the names that the container gives."""
    clock, magnet, x, y, z = names
    table = {
        "beads": {"name": "b1", "x": x, "y": y, "z": z},
        "units": {"position": "nm"},
        "magnet": {"column": magnet, "unit": "mm"},
        "z_zero": {"value_nm": 0.0},
    }
    if time:
        table["time"] = {"column": clock, "unit": "s"}
    return setup_of(table | source, rate=rate, reference=(), minimum_s=minimum_s)


def assert_plain(recording, columns, *, rows=None, lost=()):
    """The recording is the plain one: every position to 1e-6 nm, every time to 1 ns."""
    xyz = np.column_stack([columns[axis] for axis in "XYZ"])[:rows]
    xyz[list(lost)] = np.nan
    np.testing.assert_allclose(recording.positions_nm["b1"], xyz, atol=1e-6, rtol=0)
    np.testing.assert_allclose(recording.time_s, columns["Time"][:rows], atol=1e-9, rtol=0)
    np.testing.assert_array_equal(recording.magnet_mm, columns["Magnet"][:rows])
    assert recording.setup.camera.frame_rate_hz.value == pytest.approx(RATE, rel=1e-6)
