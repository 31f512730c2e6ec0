"""The configured experiment fitted to a bead's whole recording: few parameters, all traces."""
