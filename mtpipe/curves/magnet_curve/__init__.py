"""The magnet's curve: forces of many beads and recordings against the magnets' position.

`measured` holds the forces, `forms` the shapes that a curve may have, `spread` what beads differ
by, `fit` one form fitted, `outliers` the beads that are left out, `curve` the result and its
intervals. Nothing here reads or writes files.
"""
