"""Whether every plateau is one state, before any force is believed.

`with_states` holds the magnets' log against what the beads of a recording do together, cuts
plateaus where the force changes, and says what it found.
"""

from mtpipe.states.one_state import with_states

__all__ = ["with_states"]
