"""Recordings of real vehicles as mission logs."""
