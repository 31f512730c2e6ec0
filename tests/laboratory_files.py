"""A small recording as laboratories of different habits would have written it."""

import numpy as np

RATE = 100.0
KT = 4.09
LENGTH_NM, LATERAL = 1500.0, "xy"
# Magnets far away first: the beads lie on the surface. Forces of the dwells that follow, pN.
FORCES = (0.4, 1.0, 2.5, 6.0)
MAGNET_MM = (15.0, 6.0, 5.0, 4.0, 3.0)
DWELL_S, MOVE_S = 12.0, 1.0
FOCUS_NM = 3200.0
PLACES_NM = {"ref": (80_600.0, 34_900.0), "b1": (72_800.0, 17_800.0), "b2": (48_000.0, 23_600.0)}
# The log's clock began that much later, and its first entry is before the first frame.
LOG_STARTS_S, LOG_BEFORE_S = 33.4, -3.0


class Laboratory:
    """Two tethered beads and one on the surface; magnets that step from far to near.

    Attributes
    ----------
    positions_nm : (n, 3) of each bead, z above the focus. down_rows : rows in which beads lie on
        the surface. height_nm : of the tethered beads in the dwells that follow.
    """

    def __init__(self):
        random = np.random.default_rng(7)
        dwell, move = round(DWELL_S * RATE), round(MOVE_S * RATE)
        magnet, force = [], []
        for k, place in enumerate(MAGNET_MM):
            if k:
                magnet.append(np.linspace(MAGNET_MM[k - 1], place, move))
                force.append(np.full(move, FORCES[max(k - 2, 0)] if k > 1 else 0.05))
            magnet.append(np.full(dwell, place))
            force.append(np.full(dwell, FORCES[k - 1] if k else 0.0))
        self.magnet_mm, force = np.concatenate(magnet), np.concatenate(force)
        n = len(force)
        self.time_s = np.arange(n) / RATE
        # a chain's height at high force: L (1 - (kT / 4 F P)^(1/2)), 50 nm of persistence length
        with np.errstate(divide="ignore"):
            height = LENGTH_NM * np.clip(1 - np.sqrt(KT / (4 * force * 50.0)), 0.0, 1.0)
        lateral = np.sqrt(KT * np.maximum(height, 300.0) / np.maximum(force, 0.03))
        self.down_rows = dwell
        self.height_nm = [float(height[(k + 1) * (dwell + move)]) for k in range(len(FORCES))]
        self.positions_nm = {}
        for bead, place in PLACES_NM.items():
            still = bead == "ref"
            xyz = random.normal(0, 1.5, (n, 3))
            if not still:
                xyz[:, 0] += lateral * coloured(n, random)
                xyz[:, 1] += 1.3 * lateral * coloured(n, random)
                xyz[:, 2] += height + np.abs(np.where(force > 0.1, 8.0, 60.0) * coloured(n, random))
            xyz += (*place, FOCUS_NM)
            lost = random.random(n) < 0.002
            xyz[lost] = np.nan
            self.positions_nm[bead] = xyz

    def holds(self, recording, names):
        """The recording has these beads, at these places, z up to where its zero is."""
        assert set(recording.positions_nm) == set(names)
        for name, bead in names.items():
            away = recording.positions_nm[name] - self.positions_nm[bead]
            away[:, 2] -= np.nanmedian(away[:, 2])
            assert np.nanmax(np.abs(away)) < 1.0, name
        np.testing.assert_allclose(
            recording.time_s - recording.time_s[0], self.time_s, atol=0.2 / RATE
        )

    def rests(self, recording):
        """The magnets' dwells are its plateaus, but for one that was taken to tell z = 0."""
        down = recording.setup.source.z_zero.touch_rows is not None
        found = [round(plateau.magnet_mm, 1) for plateau in recording.plateaus]
        assert found == list(MAGNET_MM[1:] if down else MAGNET_MM)

    def rows_of(self, dwell):
        """The first row of a dwell."""
        number = range(len(MAGNET_MM))[dwell]
        return number * (self.down_rows + round(MOVE_S * RATE))

    def log(self):
        """The magnets at 20 Hz with some noise of their readout, from before to after."""
        random = np.random.default_rng(3)
        time_s = np.arange(LOG_BEFORE_S, self.time_s[-1] + 3.0, 0.05)
        magnet = np.interp(time_s, self.time_s, self.magnet_mm)
        return time_s, magnet + random.normal(0, 0.001, len(time_s))

    def german(self, folder, *, log_in_times_of_day=False):
        """Semicolons, decimal commas, Windows' letters, and a log with a clock of its own."""
        heads = {"ref": "Ref", "b1": "Kugel1", "b2": "Kugel2"}
        lines = ["Messprogramm 4.2", "Bildrate: 100 Hz", "Belichtungszeit (ms): 8,0", ""]
        names = [f"{heads[bead]} {axis.upper()} (µm)" for bead in heads for axis in "xyz"]
        lines.append(";".join(["Bild", "Zeit (ms)", *names]))
        table = np.hstack([self.positions_nm[bead] for bead in heads]) / 1e3
        for k, row in enumerate(table):
            cells = ["" if np.isnan(v) else comma(v, 5) for v in row]
            lines.append(";".join([str(k), comma(1e3 * self.time_s[k], 1), *cells]))
        (folder / "Messung 12.txt").write_bytes("\r\n".join([*lines, ""]).encode("cp1252"))
        time_s, magnet = self.log()
        head, clock = "Zeit (s)", [comma(t - LOG_STARTS_S, 3) for t in time_s]
        if log_in_times_of_day:
            head, clock = (
                "Uhrzeit",
                [
                    f"14:0{int(t - LOG_BEFORE_S) // 60}:{(t - LOG_BEFORE_S) % 60:06.3f}"
                    for t in time_s
                ],
            )
        lines = [f"{head};Magnetposition (mm)"]
        lines += [f"{at};{comma(m, 4)}" for at, m in zip(clock, magnet, strict=True)]
        (folder / "Motor 12.txt").write_bytes("\r\n".join([*lines, ""]).encode("cp1252"))

    def french(self, folder):
        """Remarks in French, aligned columns of decimal commas, a log that is called `.log`."""
        heads = {"ref": "bille1", "b1": "bille2", "b2": "bille3"}
        names = ["image", *(f"{axis}_{head}" for head in heads.values() for axis in "XYZ")]
        lines = [
            "PINCE MAGNETIQUE v4.11",
            "Caméra : fréquence d'images 100,0 Hz ; temps de pose 8,0 ms",
            "".join(f"{name:>12}" for name in names),
            " " * 12 + f"{'(µm)':>12}" * 9,
        ]
        table = np.hstack([self.positions_nm[bead] for bead in heads]) / 1e3
        for k, row in enumerate(table):
            cells = [f"{'-----' if np.isnan(v) else comma(v, 4):>12}" for v in row]
            lines.append("".join([f"{4501 + k:>12}", *cells]))
        (folder / "manip_07.dat").write_bytes("\r\n".join([*lines, ""]).encode("latin-1"))
        lines = ["# heure ; aimants [mm]"]
        for at, magnet in zip(*self.log(), strict=True):
            minutes, seconds = divmod(at - LOG_BEFORE_S, 60)
            lines.append(f"14:0{int(minutes)}:{comma(seconds, 3):0>6} ; {comma(magnet, 3)}")
        (folder / "manip_07_moteurs.log").write_text("\n".join([*lines, ""]))

    def spanish(self, folder):
        """Tabs below remarks, Windows' letters, and a log in times of day."""
        heads = {"ref": "Perla 1", "b1": "Perla 2", "b2": "Perla 3"}
        names = [f"{head} {axis} (µm)" for head in heads.values() for axis in "XYZ"]
        lines = [
            "% Frecuencia de imagen: 100 fps",
            "% Tiempo de exposición: 8 ms",
            "\t".join(["Imagen", "Tiempo (ms)", *names]),
        ]
        table = np.hstack([self.positions_nm[bead] for bead in heads]) / 1e3
        for k, row in enumerate(table):
            cells = ["--" if np.isnan(v) else f"{v:.5f}" for v in row]
            lines.append("\t".join([str(k + 5201), f"{1e3 * self.time_s[k] + 12e3:.1f}", *cells]))
        (folder / "medida 7.dat").write_bytes("\r\n".join([*lines, ""]).encode("latin-1"))
        lines = ["Hora\tPosición imanes (mm)\tGiro (vueltas)"]
        for at, magnet in zip(*self.log(), strict=True):
            minutes, seconds = divmod(at - LOG_BEFORE_S, 60)
            lines.append(f"16:2{int(minutes)}:{seconds:06.3f}\t{magnet:.4f}\t0.0000")
        (folder / "medida 7 imanes.dat").write_bytes("\n".join([*lines, ""]).encode("latin-1"))

    def italian(self, folder, clock="Tempo [s]"):
        """Semicolons and decimal commas below remarks, and a log in times of day."""
        heads = {"ref": "Sfera 2", "b1": "Sfera 1", "b2": "Sfera 3"}
        names = [f"{head} {axis} (µm)" for head in heads.values() for axis in "XYZ"]
        lines = [
            "Pinzette magnetiche, acquisizione del 12/03/2025",
            "Frequenza dei fotogrammi: 100,0 Hz",
            "Tempo di esposizione: 8,0 ms",
            "",
            ";".join(["Fotogramma", clock, *names]),
        ]
        table = np.hstack([self.positions_nm[bead] for bead in heads]) / 1e3
        for k, row in enumerate(table):
            cells = ["NaN" if np.isnan(v) else comma(v, 4) for v in row]
            lines.append(";".join([str(k), comma(self.time_s[k], 4), *cells]))
        (folder / "misura_03.txt").write_bytes("\r\n".join([*lines, ""]).encode("latin-1"))
        lines = ["Ora;Posizione magneti [mm]"]
        for at, magnet in zip(*self.log(), strict=True):
            minutes, seconds = divmod(at - LOG_BEFORE_S, 60)
            lines.append(f"10:4{int(minutes)}:{comma(seconds, 2):0>5};{comma(magnet, 4)}")
        (folder / "misura_03_motore.txt").write_bytes("\r\n".join([*lines, ""]).encode("latin-1"))

    def dutch(self, path):
        """A struct of MATLAB with rows of beads, and what the camera was set to."""
        from scipy.io import savemat

        x, y, z = np.stack([*self.positions_nm.values()]).transpose(2, 0, 1)
        read = {
            "tijd": self.time_s[:, None],
            "kraal": {"X": x / 93.5, "Y": y / 93.5, "Z": z / 1e3},
            "magneetpos": self.magnet_mm[:, None],
            "pixel_nm": 93.5,
            "belichting_ms": 8.0,
        }
        savemat(path, {"meting": read})

    def columns(self, path, rows):
        """One table with names, in nm, the magnets among them."""
        names = [f"{bead}.{axis}" for bead in self.positions_nm for axis in "xyz"]
        table = [self.time_s, self.magnet_mm, *np.hstack([*self.positions_nm.values()]).T]
        head = ",".join(["time", "motor", *names])
        np.savetxt(path, np.column_stack(table)[rows], "%.4f", ",", header=head, comments="")

    def per_bead(self, folder):
        """A file for each bead in µm, and the log."""
        for name, bead in (("ref1", "ref"), ("bead1", "b1"), ("bead2", "b2")):
            table = np.column_stack([self.time_s, self.positions_nm[bead] / 1e3])
            np.savetxt(folder / f"{name}.txt", table, "%.6f", header="t x y z", comments="")
        log = np.column_stack(self.log())
        np.savetxt(folder / "motor.csv", log, "%.4f", ",", header="time_s,magnet_mm", comments="")

    def hdf5(self, path, *, axes_first):
        """An array of frames × beads × axes, or × axes × beads, and the motor's group."""
        import h5py

        array = np.stack([*self.positions_nm.values()], axis=2 if axes_first else 1)
        time_s, magnet = self.log()
        with h5py.File(path, "w") as file:
            file["tracking/positions"] = array / 1e3
            file["tracking/time"] = self.time_s
            file["motor/time"], file["motor/position"] = time_s, magnet

    def hdf5_by_bead(self, path):
        """A group for each bead with an array of frames × axes, and what the camera was set to."""
        import h5py

        time_s, magnet = self.log()
        with h5py.File(path, "w") as file:
            file["camera/t"] = self.time_s
            file["camera"].attrs["exposure_ms"] = 8.0
            for k, xyz in enumerate(self.positions_nm.values()):
                file[f"roi/{k:02}/pos"] = xyz / 1e3
                file[f"roi/{k:02}/quality"] = np.linspace(0.8, 0.9, len(xyz))
            file["rig/time"], file["rig/magnet_height"] = time_s, magnet

    def hdf5_height_apart(self, path):
        """A group for each bead: x and y in one array in pixels, the height in another in µm."""
        import h5py

        time_s, magnet = self.log()
        with h5py.File(path, "w") as file:
            file["meta"] = np.arange(3)
            file["meta"].attrs["nm_per_px"] = 100.0
            file["tracks/t"] = 1e3 * self.time_s
            file["tracks/t"].attrs["unit"] = "ms"
            for k, xyz in enumerate(self.positions_nm.values()):
                group = file.create_group(f"tracks/particle_{k:02}")
                group["lateral"], group["height"] = xyz[:, :2] / 100.0, xyz[:, 2] / 1e3
                group["lateral"].attrs["unit"], group["height"].attrs["unit"] = "px", "um"
                group["snr"] = np.linspace(19, 21, len(xyz))
            file["stage/magnets/timestamp"], file["stage/magnets/height"] = 1e3 * time_s, magnet
            file["stage/magnets/timestamp"].attrs["unit"] = "ms"

    def hdf5_in_dutch(self, path):
        """Beads × frames for each axis, units as `eenheid`; the log a table of records."""
        import h5py

        with h5py.File(path, "w") as file:
            positions = np.stack([*self.positions_nm.values()])
            for axis, (unit, nm) in enumerate((("pixels", 71.5), ("pixels", 71.5), ("µm", 1e3))):
                file[f"opname/kralen/{'xyz'[axis]}"] = positions[:, :, axis] / nm
                file[f"opname/kralen/{'xyz'[axis]}"].attrs["eenheid"] = unit
            file["opname/tijd"] = 1e3 * self.time_s
            file["opname/tijd"].attrs["eenheid"] = "ms"
            file["opname"].attrs["pixelgrootte_nm"] = 71.5
            time_s, magnet = self.log()
            kinds = [("tijd", "f8"), ("positie", "f8"), ("rotatie", "f8")]
            log = np.zeros(len(time_s), dtype=kinds)
            log["tijd"], log["positie"] = 1e3 * time_s, 1e3 * magnet
            file["opname/magneten"] = log
            file["opname/magneten"].attrs["eenheid"] = ["ms", "µm", "omwentelingen"]

    def tdms(self, path):
        """Groups of the tracker and of the motor, units in the names."""
        from nptdms import ChannelObject, TdmsWriter

        channels = [ChannelObject("Tracking", "Time (ms)", 1e3 * self.time_s)]
        for k, xyz in enumerate(self.positions_nm.values()):
            channels += [
                ChannelObject("Tracking", f"{axis}{k} (nm)", xyz[:, a])
                for a, axis in enumerate("XYZ")
            ]
        time_s, magnet = self.log()
        channels += [
            ChannelObject("Motor", "Time (ms)", 1e3 * time_s),
            ChannelObject("Motor", "Magnet (mm)", magnet),
        ]
        with TdmsWriter(path) as file:
            file.write_segment(channels)

    def plain(self, path):
        """Columns without names; x and y in pixels of 100 nm, z in µm, -1 for lost."""
        table = [np.arange(len(self.time_s)), 1e3 * self.time_s, self.magnet_mm]
        table.append(np.zeros(len(self.time_s)))
        table += [xyz[:, a] / (100.0 if a < 2 else 1e3) for xyz in self.positions_nm.values()
                  for a in range(3)]  # fmt: skip
        np.savetxt(path, np.nan_to_num(np.column_stack(table), nan=-1), "%.6f")

    def series(self, folder):
        """Five files, each with a clock that begins at 0."""
        names = [f"{bead}.{axis}" for bead in self.positions_nm for axis in "xyz"]
        table = np.column_stack(
            [self.time_s, self.magnet_mm, *np.hstack([*self.positions_nm.values()]).T]
        )
        for k, piece in enumerate(np.array_split(table, 5)):
            piece[:, 0] -= piece[0, 0]
            head = ",".join(["time", "motor", *names])
            np.savetxt(folder / f"part{k}.csv", piece, "%.4f", ",", header=head, comments="")


def coloured(n, random):
    """Motion of variance 1 that lasts some frames."""
    from scipy.signal import lfilter

    keep = 0.5
    return lfilter([np.sqrt(1 - keep**2)], [1, -keep], random.normal(size=n))


def comma(value, digits):
    """A number as it is written in German."""
    return f"{value:.{digits}f}".replace(".", ",")
