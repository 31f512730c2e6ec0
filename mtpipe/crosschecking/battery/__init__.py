"""Statistics of a recording that need no idea of what could be wrong with it."""
