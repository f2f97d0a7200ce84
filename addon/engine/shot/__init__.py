"""Shots: the state of each one, its options, its bake folder and what is left to do."""
