"""Simulators of the experiment: exact for linear systems, step by step for everything else."""
