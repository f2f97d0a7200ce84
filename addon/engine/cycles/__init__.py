"""Cycles as the reference: verification of a picture."""
