"""Times tweezepy's simulator; runs in tweezepy's own environment and knows nothing of mtpipe.

python tweezepy_trace.py FRICTION STIFFNESS RATE FRAMES RUNS
"""

import json
import sys
import time

from tweezepy.simulations import downsampled_trace


def main() -> None:
    """Print frames per CPU second, the best of so many runs."""
    friction, stiffness = float(sys.argv[1]), float(sys.argv[2])
    rate, frames, runs = (int(text) for text in sys.argv[3:])
    downsampled_trace(friction, stiffness, rate, 8, 1)  # compiles
    seconds = []
    for seed in range(1, 1 + runs):
        began = time.process_time()
        downsampled_trace(friction, stiffness, rate, frames, seed)
        seconds.append(time.process_time() - began)
    print(json.dumps({"frames_per_s": frames / min(seconds)}))


if __name__ == "__main__":
    main()
