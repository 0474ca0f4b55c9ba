"""The simulated world: vehicles on their paths, sensors, and the log of what they did."""
