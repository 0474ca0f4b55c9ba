"""Missions, runs and studies."""
