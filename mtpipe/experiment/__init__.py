"""The experiment, described once: what the expected spectra, the simulators and the design read."""
