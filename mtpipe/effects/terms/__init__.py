"""Terms of known form: what a recording has that no effect's name describes."""
