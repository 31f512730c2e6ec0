"""The verdict on a bead, before and after its diagnosis."""
