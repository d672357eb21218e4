"""The scene as a whole: what stands and moves in it, its floor, and where bodies touch it."""
