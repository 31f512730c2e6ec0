"""The force to quote: one per bead and plateau, chosen by evidence."""
