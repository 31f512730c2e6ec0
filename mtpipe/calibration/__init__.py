"""From a recording to forces: each bead's plateaus fitted, judged and put side by side."""
