"""Force and extension of a tether together."""
