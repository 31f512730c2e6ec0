"""From image stacks to tracked positions."""
