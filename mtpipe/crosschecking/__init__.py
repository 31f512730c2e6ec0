"""The cross-check: a recording beside simulations of the same configured experiment."""
