"""Physics on numbers and arrays: camera, modes, tether, friction. Knows no files, no fits."""
