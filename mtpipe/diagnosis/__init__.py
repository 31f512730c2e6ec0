"""Diagnosis: which missing physics explains what the cross-check found."""
