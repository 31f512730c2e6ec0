"""Power spectra of traces, by Welch's method and by windows."""
