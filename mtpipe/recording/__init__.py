"""A recording: positions, magnets and plateaus, however they came in."""
