"""Effects that are seen in the traces and taken off them, where no spectrum would tell."""
