"""From channels to a mission: which channel is which sensor, in one frame and on one clock."""
