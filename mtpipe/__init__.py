"""mtpipe: force calibration for magnetic tweezers."""

__version__ = "0.1.0"
