"""Missions of hovering vehicles that take turns as the landmark."""
