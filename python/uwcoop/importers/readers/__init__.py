"""Readers of recordings: a file format each, and nothing of navigation."""
