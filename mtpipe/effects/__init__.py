"""The catalogue of effects: physics and instrument faults that a setup may leave out.

One file per effect. Each is a change of the experiment's description with its parameters, so that
expected spectra, simulators, fit and cross-check all have it at once.
"""
