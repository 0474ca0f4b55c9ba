"""Figures of merit: error, consistency, bounds."""
