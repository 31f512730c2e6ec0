"""Fits of spectra: models, maximum likelihood (lmfit), posteriors (emcee)."""
