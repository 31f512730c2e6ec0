"""Results in a notebook: the report's figures of single results."""
