"""Extension against turns of the magnets: is the tether nicked, supercoilable, or several?

`turned` takes the curve from a recording, `kinds` holds what each kind of tether would show,
`verdict` weighs them. Nothing here reads or writes files.
"""
